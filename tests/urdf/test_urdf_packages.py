"""Where a mesh is sought, and where it is not."""

import os
from pathlib import Path

import pytest

from robodyn.model import Mesh
from robodyn.urdf import read
from robodyn.urdf.packages import find


@pytest.fixture
def home(tmp_path):
    """src/robot/urdf holds the robot file; src/robot and src/tool are packages; old/hand-main is one under another name."""
    for name in (
        "src/robot/meshes/a.stl",
        "src/robot/urdf/b.stl",
        "src/tool/c.stl",
        "old/hand-main/d.stl",
        "ament/share/ros/e.stl",
        "f g.stl",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def sought(home, filename, *package_dirs):
    file = find(filename, home / "src/robot/urdf", [home / d for d in package_dirs])
    return file and Path(file).relative_to(home).as_posix()


@pytest.mark.parametrize(
    ("filename", "package_dirs", "file"),
    [
        ("package://robot/meshes/a.stl", (), "src/robot/meshes/a.stl"),  # above the robot file
        ("model://robot/meshes/a.stl", (), "src/robot/meshes/a.stl"),
        ("package://tool/c.stl", (), "src/tool/c.stl"),  # beside its package
        ("package://src/tool/c.stl", (), "src/tool/c.stl"),
        ("package://hand-main/d.stl", (), None),
        ("package://hand-main/d.stl", ("old",), "old/hand-main/d.stl"),  # holds the package
        ("package://hand/d.stl", ("src", "old/hand-main"), "old/hand-main/d.stl"),  # is the package
        ("package://robot/meshes/absent.stl", ("src",), None),
        ("b.stl", (), "src/robot/urdf/b.stl"),
        ("../meshes/a.stl", (), "src/robot/meshes/a.stl"),
        (r"..\meshes\a.stl", (), "src/robot/meshes/a.stl"),
        ("meshes/a.stl", (), None),
        ("meshes/a.stl", ("src/robot",), "src/robot/meshes/a.stl"),
        ("file://../meshes/a.stl", (), "src/robot/meshes/a.stl"),
        ("../meshes", (), None),  # a folder
        ("", (), None),
        ("package://", (), None),
        ("package://robot", (), None),
        ("http://localhost/a.stl", (), None),
        ("package://robot/" + "a" * 5000, (), None),
        # `..` leads out of no package
        ("package://../../src/tool/c.stl", (), None),
        ("package://robot/../tool/c.stl", (), None),
        ("package://robot/../../../meshes/a.stl", (), "src/robot/meshes/a.stl"),
    ],
)
def test_where_a_mesh_is_sought(home, filename, package_dirs, file):
    assert sought(home, filename, *package_dirs) == file


def test_absolute_names(home):
    assert sought(home, str(home / "f g.stl")) == "f g.stl"
    assert sought(home, f"file://{home}/f%20g.stl") == "f g.stl"
    assert sought(home, f"file://localhost{home}/f%20g.stl") == "f g.stl"


def test_other_hosts_are_not_asked(home, monkeypatch):
    asked = []
    monkeypatch.setattr(os.path, "isfile", lambda path: asked.append(path))
    for name in ("//host/share/a.stl", r"\\host\share\a.stl", "file:////host/share/a.stl", "http://host/a.stl"):
        assert sought(home, name) is None
    assert not asked


def test_ros_says_where_packages_are(home, monkeypatch):
    assert sought(home, "package://ros/e.stl") is None
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join([str(home / "nowhere"), str(home / "ament")]))
    assert sought(home, "package://ros/e.stl") == "ament/share/ros/e.stl"
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(home / "old"))
    assert sought(home, "package://hand-main/d.stl") == "old/hand-main/d.stl"


@pytest.mark.parametrize("package_dirs", ["old", Path("old"), ["old"], (Path("old"),)])
def test_a_robot_file_finds_its_meshes(home, monkeypatch, package_dirs):
    file = home / "src/robot/urdf/robot.urdf"
    meshes = ("package://robot/meshes/a.stl", "package://hand-main/d.stl", "package://absent/d.stl")
    visuals = "".join(f'<visual><geometry><mesh filename="{name}"/></geometry></visual>' for name in meshes)
    file.write_text(f'<robot name="r"><link name="a">{visuals}</link></robot>')
    monkeypatch.chdir(home)
    mechanism = read(file.relative_to(home), package_dirs=package_dirs)
    shapes = [visual.geometry for visual in mechanism.links[0].visuals if isinstance(visual.geometry, Mesh)]
    assert [shape.path for shape in shapes] == [
        str(home / "src/robot/meshes/a.stl"),
        str(home / "old/hand-main/d.stl"),
        None,
    ]
    assert [shape.filename for shape in shapes] == list(meshes)
    reason = "file not found: name its package's folder in package_dirs ('package://absent/d.stl' of link 'a')"
    assert ("link/visual/geometry/mesh@filename", "ignored", reason) in mechanism.ledger
