"""A robot from a string: what a test writes is read as a file would be."""

import pytest

from robodyn.urdf import read


@pytest.fixture
def load(tmp_path):
    """XML → Mechanism, by way of a file robot.urdf in an empty folder."""

    def load(xml, **options):
        path = tmp_path / "robot.urdf"
        path.write_bytes(xml if isinstance(xml, bytes) else xml.encode())
        return read(path, **options)

    return load


@pytest.fixture
def arm():
    """Two links and a joint, with room in the upper link, in the joint and after them."""

    def arm(link="", joint="", kind="revolute", more=""):
        return f"""<robot name="arm">
          <link name="base"/>
          <link name="upper">{link}</link>
          <joint name="elbow" type="{kind}"><parent link="base"/><child link="upper"/>{joint}</joint>
          {more}
        </robot>"""

    return arm


@pytest.fixture
def row():
    """The verdict and the reason of the ledger's rows for a tag, joined."""

    def row(mechanism, path):
        return " | ".join(f"{verdict}: {reason}" for tag, verdict, reason in mechanism.ledger if tag == path)

    return row
