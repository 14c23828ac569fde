"""Nothing is dropped in silence."""

import warnings
from xml.etree import ElementTree

import pytest

from robodyn import RobodynWarning

EVERYTHING = """<robot name="r" version="1.0" xmlns:drake="http://drake.mit.edu" shape="round">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="a" type="base">
    stray words
    <inertial><origin xyz="0 0 0" rpy="0 0 0"/><mass value="1" unit="kg"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
    <visual name="v"><geometry><box size="1 1 1"/></geometry><material name="red"/></visual>
    <collision><geometry><box size="not read"/></geometry></collision>
    <collision/><contact/><sensor/><self_collision_checking/>
  </link>
  <link name="b"/>
  <joint name="j" type="revolute">
    <parent link="a"/><child link="b"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1" jerk="3"/>
    <dynamics damping="1" friction="0" spring_stiffness="3"/>
    <calibration rising="0"/><safety_controller k_velocity="1"/>
  </joint>
  <transmission name="t"><type>x</type></transmission><gazebo reference="a"/><ros2_control name="c"/><sensor name="s"/>
  <mujoco/><drake:linear_bushing_rpy/>
</robot>"""


def test_every_tag_and_attribute_has_its_verdict(load):
    """Each one has a row, stands in its tag's row, or stands inside a tag that is ignored as a whole."""
    mechanism = load(EVERYTHING.replace("drake:", ""))  # ElementTree would expand the prefix
    honoured = {path: reason for path, verdict, reason in mechanism.ledger if verdict == "honoured"}
    ignored = {path for path, verdict, _ in mechanism.ledger if verdict == "ignored"}

    def accounted(element, path):
        if path in ignored:
            return
        for name in element.attrib:
            assert f"{path}@{name}" in ignored or name in honoured[path].split("[")[1].split("]")[0].split(", "), (path, name)
        assert path in honoured
        assert not (element.text or "").strip() or f"{path}/text()" in ignored
        for child in element:
            accounted(child, f"{path}/{child.tag}".removeprefix("robot/"))

    accounted(ElementTree.fromstring(EVERYTHING.replace("drake:", "").replace('xmlns:drake="http://drake.mit.edu"', "")), "robot")


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("link/collision", "ignored: contact is not modelled (2×: line 7, line 8)"),
        ("link/self_collision_checking", "ignored: is no part of URDF (line 8)"),
        ("link/text()", "ignored: URDF has no text between tags (line 3)"),
        ("link@type", "ignored: is no part of URDF (line 3)"),
        ("joint/limit@jerk", "ignored: is no part of URDF (line 12)"),
        ("joint/calibration", "ignored: reference positions of a sensor change no motion (line 14)"),
        ("joint/safety_controller", "ignored: soft limits belong to a controller (line 14)"),
        ("transmission", "ignored: joint forces act at the joint itself, without gears and motors (line 16)"),
        ("gazebo", "ignored: is meant for Gazebo alone (line 16)"),
        ("drake:linear_bushing_rpy", "ignored: is no part of URDF (line 17)"),
        ("robot@version", "ignored: every version is read alike (line 1)"),
        ("robot@xmlns:drake", "ignored: namespaces mean nothing in URDF (line 1)"),
        ("link", "honoured: a link [name] (2×: line 3, line 10)"),
        ("joint/dynamics", "honoured: forces in the joint [damping, friction] (line 13)"),
    ],
)
def test_rows_say_what_became_of_a_tag(load, row, path, reason):
    assert row(load(EVERYTHING), path) == reason


def test_a_clean_file_warns_of_nothing(load):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(EVERYTHING)


@pytest.mark.parametrize(
    ("wrong", "path", "hint"),
    [
        ('<dynamic damping="1"/>', "joint/dynamic", "did you mean 'dynamics'?"),
        ('<Axis xyz="0 0 1"/>', "joint/Axis", "did you mean 'axis'?"),
        ('<dynamics dampin="1"/>', "joint/dynamics@dampin", "did you mean 'damping'?"),
    ],
)
def test_a_slip_of_the_pen_is_a_warning(load, arm, row, wrong, path, hint):
    with pytest.warns(RobodynWarning, match=f"{path} is no part of URDF: {hint[:-1]}"):
        mechanism = load(arm(joint=wrong))
    assert hint in row(mechanism, path)


def test_many_rows_become_one(load, arm, row):
    mechanism = load(arm(link="<collision/>\n" * 1000))
    assert row(mechanism, "link/collision") == "ignored: contact is not modelled (1000×: line 3, line 4, line 5, …)"


def test_a_warning_points_at_the_caller_of_load(tmp_path):
    """`robodyn.load` calls `read`: the warning shows the line above both."""
    from robodyn.urdf import read

    path = tmp_path / "robot.urdf"
    path.write_text('<robot name="r" Version="1"><link name="a"/></robot>')

    def load():
        return read(path)

    with pytest.warns(RobodynWarning) as caught:
        load()
    assert caught[0].filename == __file__
    assert caught[0].lineno > load.__code__.co_firstlineno + 1


def test_many_alarms_are_one_warning(load, arm):
    with pytest.warns(RobodynWarning) as caught:
        load(arm(link="<Visual/>" * 10))
    assert [str(warning.message).split("robot.urdf: ")[1] for warning in caught] == [
        "link/Visual is no part of URDF: did you mean 'visual'? (10×: line 3, line 3, line 3, …)"
    ]
