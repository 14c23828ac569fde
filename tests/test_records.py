"""Records: what goes to JSON comes back to the last bit, and no text makes anything but robots and scenes."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from tools import SEEDS, case

import robodyn as rd
from robodyn.joints import JOINT_TYPES
from robodyn.loads import LOADS
from robodyn.model import Box, Cylinder, Inertia, Limits, Mesh, Mimic, Sphere, Visual
from robodyn.simulation.storage import from_json, to_json

ROBOTS = Path(__file__).parents[1] / "robots"


def assert_same(one, other, path="record"):
    """Field by field: the same classes, the same numbers bit for bit, tuples where lists were."""
    if dataclasses.is_dataclass(one):
        assert type(one) is type(other), path
        for f in dataclasses.fields(one):
            assert_same(getattr(one, f.name), getattr(other, f.name), f"{path}.{f.name}")
    elif isinstance(one, np.ndarray):
        assert one.shape == other.shape, path
        assert one.astype(float).tobytes() == other.tobytes(), path
        assert not other.flags.writeable, path
    elif isinstance(one, dict):
        assert list(one) == list(other), path
        for name in one:
            assert_same(one[name], other[name], f"{path}[{name!r}]")
    elif isinstance(one, (tuple, list)):
        assert isinstance(other, tuple), path
        assert len(one) == len(other), path
        for i, (x, y) in enumerate(zip(one, other, strict=True)):
            assert_same(x, y, f"{path}[{i}]")
    else:
        assert one == other or (one != one and other != other), path
        assert type(other) in (str, int, float, bool, type(None)), path


def round_trip(value):
    text = to_json(value)
    back = from_json(text)
    assert to_json(back) == text
    return back


@pytest.mark.parametrize("seed", SEEDS)
def test_random_robots(seed):
    robot = case(seed).robot
    assert_same(robot, round_trip(robot))


@pytest.mark.parametrize("file", sorted(path.stem for path in ROBOTS.glob("*.urdf")))
def test_robots_of_files(file):
    """Visuals with their meshes and colours, limits, damping, mimic joints, the ledger and the source."""
    robot = rd.load(ROBOTS / f"{file}.urdf", floating_base=file in ("quadruped", "humanoid"))
    back = round_trip(robot)
    assert_same(robot, back)
    q, _ = robot.random_state(np.random.default_rng(0))
    one, other = (x.mass_matrix(q, backend="numpy") for x in (robot, back))
    assert np.array_equal(one, other)


def scene():
    robot = rd.load(ROBOTS / "ur5e.urdf")
    one, two, *_ = robot.joint_names
    loads = [
        rd.JointDamping({one: 0.1, two: np.float64(0.2)}),
        rd.JointFriction({one: 1 / 3}, width=np.float32(0.25)),
        rd.JointForce({two: 5}),
        rd.JointSpring({one: 3.0}, rest={one: 0.1}),
        rd.LinkWrench(robot.link_names[-1], force=np.array([1.0, 2.0, 3.0]), moment=[0.1, 0.2, 0.3], frame="link"),
    ]
    return rd.Scene(robot, gravity=(0.1, 0.2, -1.62), loads=loads, declared=False)


def test_a_scene():
    one = scene()
    other = round_trip(one)
    assert_same(one, other)
    q, v = one.robot.random_state(np.random.default_rng(0))
    assert np.array_equal(one.forward_dynamics(q, v), other.forward_dynamics(q, v))
    assert isinstance(other.robot, rd.Robot)


def test_every_class_that_a_scene_can_hold():
    """Joint types, loads and shapes: whoever adds one needs nothing more for it to be saved."""
    for kind in JOINT_TYPES.values():
        joint = kind.from_axis(np.array([1.0, 2.0, 3.0]))
        assert_same(joint, round_trip(joint))
    values = {"JointSpring": {"stiffness": {"a": 1.0}}, "LinkWrench": {"link": "a"}, "JointForce": {"values": {"a": 1.0}}}
    for name in set(LOADS) - {"ControlLaw", "Sampled"}:
        load = LOADS[name](**values.get(name, {"coefficients": {"a": (1.0, 2.0, 3.0)}}))
        assert_same(load, round_trip(load))
    for shape in (Box((1.0, 2.0, 3.0)), Cylinder(0.1, 0.2), Sphere(0.3), Mesh("package://a/b.stl", None, (1.0, -1.0, 2.0))):
        visual = Visual(shape, np.eye(3), np.zeros(3), (0.1, 0.2, 0.3, 1.0), "red", "wood.png")
        assert_same(visual, round_trip(visual))
    for record in (Limits(-1.0, 2.0), Mimic(3, -0.5, 0.1), Inertia.about_centre(1.0, np.ones(3), np.eye(3))):
        assert_same(record, round_trip(record))


@pytest.mark.parametrize("x", [0.1, -0.0, 5e-324, 1.7976931348623157e308, np.inf, -np.inf, 1 / 3, 2**60, True, "", "\ud7ff\u0000\n", None])
def test_single_values(x):
    back = round_trip(x)
    assert back == x
    assert type(back) is type(x)
    assert str(back) == str(x)  # the sign of zero


def test_nan():
    assert np.isnan(round_trip(np.nan))


def test_arrays():
    for x in (np.zeros((0, 3)), np.zeros(()), np.array([[np.nan, -0.0], [np.inf, 1e-310]])):
        assert_same(x, round_trip(x))
    assert from_json(to_json(np.arange(3))).tolist() == [0.0, 1.0, 2.0]
    assert round_trip(np.float32(0.1)) == float(np.float32(0.1))


def test_what_no_text_can_hold():
    laws = rd.ControlLaw(lambda t, q, v: v), rd.Sampled(lambda t, q, v: v, 0.1)
    for value in (lambda x: x, object(), {1, 2}, 1j, *laws, b"bytes", dataclasses.make_dataclass("Own", [])()):
        with pytest.raises(TypeError, match="cannot be written"):
            to_json(value)


def test_a_class_of_the_same_name_is_not_the_same_class():
    """A user's own `Sphere` would come back as robodyn's: it is refused instead."""
    own = dataclasses.make_dataclass("Sphere", [("radius", float)])
    with pytest.raises(TypeError, match="Sphere"):
        to_json(own(1.0))


def test_a_text_can_only_make_what_is_in_the_table():
    for name in ("object", "Popen", "Exception", "Robot.__init__", "__import__", "", "ControlLaws", "Scene "):
        with pytest.raises(rd.FileError, match="damaged"):
            from_json(json.dumps({"class": name, "fields": {}}))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "nonsense",
        "{}",
        '{"class":"Box"}',
        '{"class":"Box","fields":{}}',
        '{"class":"Box","fields":[1]}',
        '{"class":"Box","fields":{"size":1,"more":2}}',
        '{"class":["Box"],"fields":{}}',
        '{"class":{"a":1},"fields":{}}',
        '{"array":[1,2,3],"shape":[2,2]}',
        '{"array":[[1],[1,2]],"shape":[3]}',
        '{"array":["a"],"shape":[1]}',
        '{"array":[1]}',
        '{"shape":[1]}',
        '{"dict":[[1]]}',
        '{"dict":5}',
        '{"dict":[[{"array":[1],"shape":[1]},2]]}',
        '{"class":"Scene","fields":{"robot":5}}',
        '{"class":"Robot","fields":{"name":"r","links":[],"joints":[]}}',
        '{"class":"Robot","fields":{"name":"r","links":5,"joints":[]}}',
        '{"class":"Mimic","fields":{"leader":0,"__class__":1}}',
        "[" * 200_000,
        '{"dict":' * 50_000,
    ],
)
def test_damaged_text(text):
    with pytest.raises(rd.FileError, match="damaged"):
        from_json(text)


def test_text_cut_short():
    text = to_json(scene())
    for length in np.linspace(0, len(text) - 1, 100).astype(int):
        with pytest.raises(rd.FileError, match="damaged"):
            from_json(text[:length])
