"""Trajectories: what they hold, how they are saved and read back, and what is left of a run that was stopped or failed."""

import csv
import errno
import io
import json
import os
import pickle
import signal
import subprocess
import sys
import textwrap
import threading
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from tools import EPS, case, condition

import robodyn as rd
from robodyn.joints import Fixed, Prismatic, Revolute
from robodyn.model import GROUND, Inertia, Joint, Link, Mesh
from robodyn.simulation import native
from robodyn.simulation.storage import to_json

ROBOTS = Path(__file__).parents[2] / "robots"
X, Y, Z = np.eye(3)
ARRAYS = ("t", "q", "v", "a", "u", "work")


def slide(mass=2.0):
    body = Inertia.about_centre(mass, np.zeros(3), np.diag([0.2, 0.3, 0.4]))
    joints = (Joint(GROUND, Fixed(), -1), Joint("slide", Prismatic.from_axis(X), 0))
    return rd.Robot("slide", (Link("base"), Link("body", body)), joints)


def mixed_scene():
    """Every joint type on a free base, springs, damping, friction, forces, and wrenches in both frames."""
    rng, robot = np.random.default_rng(12), slide()
    while len({joint.type.kind for joint in robot.joints}) < 7:  # until every type was drawn
        robot = rd.random_robot(rng, 9, floating_base=True)
    moving = [joint.name for joint in robot.joints if joint.type.nv]
    first = next(joint.name for joint in robot.joints[1:] if joint.type.nv and not joint.type.rated)
    loads = [
        rd.JointDamping(dict.fromkeys(moving, 0.1)),
        rd.JointFriction({moving[1]: 0.2}, width=0.05),
        rd.JointForce({GROUND: (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)}),
        rd.JointSpring({first: 3.0}, rest={first: 0.1}),
        rd.LinkWrench("link_3", force=(1.0, 2.0, 3.0), point=np.array([0.1, 0.2, 0.3])),
        rd.LinkWrench("link_0", moment=(1.0, 2.0, 3.0), frame="link"),
    ]
    return rd.Scene(robot, gravity=(0.1, 0.2, -3.7), loads=loads)


@pytest.fixture(scope="module")
def run():
    scene = mixed_scene()
    q, v = scene.robot.random_state(np.random.default_rng(3))
    return rd.simulate(scene, t_end=0.02, q0=q, v0=v, fps=250, rtol=1e-6, backend="numpy")


@pytest.fixture(scope="module")
def short():
    """Three states of the double pendulum."""
    return rd.simulate(rd.load(ROBOTS / "double_pendulum.urdf"), t_end=0.02, q0=[1.0, 0.5], fps=100)


# --- members -----------------------------------------------------------------------------------------------------------


def test_members(run):
    robot, T = run.scene.robot, 6
    shapes = {"t": (T,), "q": (T, robot.nq), "v": (T, robot.nv), "a": (T, robot.nv), "u": (T, robot.nu), "work": (T,)}
    assert {name: getattr(run, name).shape for name in ARRAYS} == shapes
    assert run.completed
    assert run.link_poses().shape == (T, len(robot.links), 4, 4)
    assert np.array_equal(run.link_poses(), robot.link_poses(run.q))
    assert {"method", "formalism", "backend", "rtol", "atol", "steps", "rejected", "evaluations", "wall_time", "completed"} == set(
        run.stats
    )
    assert run.stats["steps"] > 0
    assert run.stats["evaluations"] >= 12 * run.stats["steps"]
    assert run.stats["wall_time"] > 0
    assert repr(run) == "<Trajectory of 'random_9': 6 states, 0 to 0.02 s>"


def test_a_trajectory_cannot_be_changed(run):
    with pytest.raises(AttributeError):
        run.t = run.t[:2]


def test_energies(run):
    energy = run.energy()
    robot = run.scene.robot
    assert energy._fields == ("kinetic", "potential", "work", "balance")
    assert all(x.shape == (6,) for x in energy)
    assert np.allclose(energy.kinetic, robot.kinetic_energy(run.q, run.v), rtol=20 * EPS)
    expected = np.array([run.scene.potential_energy(q, backend="numpy") for q in run.q])
    assert np.allclose(energy.potential, expected, rtol=0, atol=50 * EPS * max(1, abs(expected).max()))
    assert np.array_equal(energy.balance, energy.kinetic + energy.potential - energy.work)
    assert energy.drift == abs(energy.balance - energy.balance[0]).max()


def test_reactions_over_time_are_those_of_each_state():
    """Frames, parts and chosen joints pass through; loads count with what they were at each time."""
    c = case(3, n=2)
    moving = [joint.name for joint in c.robot.joints if joint.type.nv]
    loads = [
        rd.JointDamping(dict.fromkeys(moving, 0.3)),
        rd.LinkWrench("link_0", (1.0, 2.0, 3.0), frame="link"),
        rd.LinkWrench("link_2", (0.0, 3.0, 1.0)),
    ]
    scene = rd.Scene(c.robot, loads=loads)
    trajectory = rd.simulate(scene, t_end=0.05, q0=c.q, v0=c.v, fps=100, backend="numpy")
    for options in ({}, {"frame": "world", "part": "total"}, {"frame": "parent", "joints": ["joint_2", GROUND]}):
        r = trajectory.reactions(**options)
        for k in (0, 3, 5):
            one = scene.reactions(trajectory.q[k], trajectory.v[k], backend="numpy", **options)
            assert r.joint_names == one.joint_names
            # The same equations for one state and for six: sums in another order, carried into η̇ by κ.
            tolerance = 50 * condition(c.robot, trajectory.q[k]) * EPS
            assert np.allclose(r.array[k], one.array, rtol=0, atol=tolerance * abs(one.array).max())


LAWS = {
    "of NumPy functions": ("native", lambda t, q, v: [np.cos(9 * t)]),
    "with a branch": ("numpy", lambda t, q, v: [np.cos(9 * t) if t > -1 else 0.0]),
}


@pytest.mark.parametrize("law", LAWS)
def test_reactions_know_a_control_laws_forces(law):
    """Whether the law could be compiled or not."""
    backend, function = LAWS[law]
    trajectory = rd.simulate(rd.Scene(slide(), loads=[rd.ControlLaw(function)]), t_end=0.1, backend=backend)
    total, constraint = (trajectory.reactions(part=part)["slide"] for part in ("total", "constraint"))
    assert np.allclose((total - constraint)[:, 3], np.cos(9 * trajectory.t), rtol=0, atol=10 * EPS * abs(total).max())
    assert trajectory.energy().drift < 1e-6


def test_a_wrench_on_the_base_reaches_the_ground_over_time():
    robot = slide()
    plain = rd.simulate(robot, t_end=0.05).reactions()[GROUND]
    pushed = rd.simulate(rd.Scene(robot, loads=[rd.LinkWrench("base", force=(0.0, 0.0, -7.0))]), t_end=0.05).reactions()[GROUND]
    assert np.allclose(pushed - plain, [0, 0, 0, 0, 0, 7], rtol=0, atol=1e-13)


# --- save and load -----------------------------------------------------------------------------------------------------


def assert_same(one, other, *, answers=True):
    """Bit for bit; the scene to its last number, and so its answers: reactions, energies, poses."""
    for name in ARRAYS:
        x, y = getattr(one, name), getattr(other, name)
        assert np.array_equal(x, y), name
        assert (x.dtype, x.shape) == (y.dtype, y.shape), name
    assert one.stats == other.stats
    assert to_json(one.scene.robot) == to_json(other.scene.robot)
    assert np.array_equal(one.scene.gravity, other.scene.gravity)
    assert one.scene.declared == other.scene.declared
    if not answers:  # each is a kernel to compile
        return
    assert np.array_equal(one.reactions(part="total").array, other.reactions(part="total").array)
    for x, y in zip(one.energy(), other.energy(), strict=True):
        assert np.array_equal(x, y)
    assert np.array_equal(one.link_poses(), other.link_poses())


def through_a_file(trajectory, tmp_path):
    path = tmp_path / "run.npz"
    trajectory.save(path)
    return rd.Trajectory.load(path)


def test_save_and_load(run, tmp_path):
    back = through_a_file(run, tmp_path)
    assert_same(run, back)
    assert to_json(back.scene) == to_json(run.scene)
    assert [type(load) for load in back.scene.loads] == [type(load) for load in run.scene.loads]
    assert isinstance(back.scene.robot, rd.Robot)
    # The rebuilt scene goes on where the old one stopped.
    one, other = (x.scene.forward_dynamics(run.q[-1], run.v[-1], backend="numpy") for x in (run, back))
    assert np.array_equal(one, other)


@pytest.mark.parametrize(
    ("file", "options"),
    [
        ("ur5e", {}),  # meshes, declared damping, massless frames
        ("panda", {"locked": {"panda_joint4": -1.2}}),  # a mimic joint, a locked joint
        ("quadruped", {"floating_base": True}),
        ("lecture_tree", {}),  # a spherical joint
        ("pendulum", {}),
    ],
)
def test_save_and_load_robots_of_files(file, options, tmp_path):
    robot = rd.load(ROBOTS / f"{file}.urdf", **options)
    trajectory = rd.simulate(robot, t_end=0.02, v0=np.full(robot.nv, 0.3), rtol=1e-6, backend="numpy")
    back = through_a_file(trajectory, tmp_path)
    assert_same(trajectory, back, answers=file in ("pendulum", "ur5e"))
    assert back.scene.robot.joint_names == robot.joint_names
    assert back.scene.robot.ledger == robot.ledger
    assert back.scene.robot.source == robot.source


def test_what_a_robot_looks_like_is_saved_with_it(tmp_path):
    robot = rd.load(ROBOTS / "ur5e.urdf")
    back = through_a_file(rd.simulate(robot, t_end=0.02, backend="numpy"), tmp_path).scene.robot
    shapes = [v.geometry for link in robot.links for v in link.visuals]
    again = [v.geometry for link in back.links for v in link.visuals]
    assert any(isinstance(shape, Mesh) for shape in shapes)
    assert [(type(x), vars(x)) for x in shapes] == [(type(x), vars(x)) for x in again]
    assert not back.links[0].inertia.tensor.flags.writeable


def test_a_scene_without_the_declared_loads_stays_one(tmp_path):
    scene = rd.Scene(rd.load(ROBOTS / "ur5e.urdf"), declared=False)
    assert through_a_file(rd.simulate(scene, t_end=0.02, backend="numpy"), tmp_path).scene.all_loads == ()


def test_a_mechanism_that_is_no_robot_can_be_saved(tmp_path):
    """`simulate` takes the mechanism that `robodyn.urdf.read` returns; what it takes, `save` keeps."""
    from robodyn.urdf import read

    trajectory = rd.simulate(read(ROBOTS / "pendulum.urdf"), t_end=0.02, q0=[0.3])
    assert np.array_equal(through_a_file(trajectory, tmp_path).q, trajectory.q)


def test_one_state_and_no_joints(tmp_path):
    one = rd.simulate(slide(), t_end=0.1, times=[0.1])
    assert one.t.tolist() == [0.1]
    assert_same(one, through_a_file(one, tmp_path))
    statue = rd.Robot("statue", (Link("a"),), (Joint(GROUND, Fixed(), -1),))
    still = rd.simulate(statue, t_end=1.0, fps=1)
    assert still.q.shape == (2, 0)
    assert_same(still, through_a_file(still, tmp_path))


def test_names_of_any_kind(tmp_path):
    """Joints named like the record's own keys, with quotes, newlines and other alphabets."""
    names = ("class", "fields", 'a "b", c', "d\ne", "ä→関節", "\\u0000")
    body = Inertia.about_centre(1.0, X, np.eye(3))
    joints = tuple(Joint(n, Revolute.from_axis(Z), i) for i, n in enumerate(names))
    robot = rd.Robot('"}', (Link("base"), *(Link(f"of {n}", body) for n in names)), (Joint(GROUND, Fixed(), -1), *joints))
    trajectory = rd.simulate(rd.Scene(robot, loads=[rd.JointDamping(dict.fromkeys(names, 0.1))]), t_end=0.02)
    back = through_a_file(trajectory, tmp_path)
    assert back.scene.robot.joint_names == names
    assert_same(trajectory, back)


def test_a_control_law_leaves_its_forces_in_the_file(tmp_path):
    scene = rd.Scene(slide(), loads=[rd.JointDamping({"slide": 1.0}), rd.ControlLaw(lambda t, q, v: [5.0])])
    trajectory = rd.simulate(scene, t_end=0.05, backend="numpy")
    with pytest.warns(rd.RobodynWarning, match="ControlLaw cannot be stored.*forces"):
        back = through_a_file(trajectory, tmp_path)
    assert [type(load).__name__ for load in back.scene.loads] == ["JointDamping"]
    assert np.array_equal(back.u, trajectory.u)
    assert np.array_equal(back.reactions(part="total").array, trajectory.reactions(part="total").array)
    assert np.array_equal(back.energy().work, trajectory.energy().work)


def test_a_load_of_the_users_own_is_refused_by_name(tmp_path):
    """It cannot be rebuilt from a file: an error of robodyn's own, and no file."""
    from robodyn.loads import Load

    class Magnet(Load):
        pass

    trajectory = rd.simulate(rd.Scene(slide(), loads=[Magnet()]), t_end=0.02)
    with pytest.raises(rd.FileError, match="Magnet"):
        trajectory.save(tmp_path / "run.npz")
    assert not any(tmp_path.iterdir())


def test_what_is_saved_is_named_as_asked(short, tmp_path):
    """No suffix is added, a string will do, an old file is replaced, a link stays a link; nothing else is left in the folder."""
    short.save(str(tmp_path / "run"))
    (tmp_path / "link").symlink_to("run")
    (tmp_path / "run").write_bytes(b"old")
    short.save(tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert np.array_equal(rd.Trajectory.load(tmp_path / "run").q, short.q)
    assert sorted(x.name for x in tmp_path.iterdir()) == ["link", "run"]


# --- files that cannot be read -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """The bytes of a small trajectory's file."""
    path = tmp_path_factory.mktemp("saved") / "run.npz"
    rd.simulate(slide(), t_end=0.02, fps=100).save(path)
    return path.read_bytes()


def contents(saved):
    with np.load(io.BytesIO(saved)) as file:
        return dict(file)


def assert_refused(path, match=None):
    with pytest.raises(rd.FileError, match=match) as caught:
        rd.Trajectory.load(path)
    assert str(path) in str(caught.value)


def test_a_file_that_is_not_there(tmp_path):
    assert_refused(tmp_path / "none.npz", "there is no file")
    assert_refused(tmp_path)


@pytest.mark.parametrize("data", [b"", b"hello", b"PK\x03\x04", b"\x93NUMPY", b"<robot/>", bytes(1000)])
def test_a_file_of_something_else(data, tmp_path):
    path = tmp_path / "run.npz"
    path.write_bytes(data)
    assert_refused(path)


def test_a_file_cut_short(saved, tmp_path):
    path = tmp_path / "run.npz"
    for length in np.linspace(1, len(saved) - 1, 60).astype(int):
        path.write_bytes(saved[:length])
        assert_refused(path)


def test_a_file_with_a_flipped_byte(saved, tmp_path):
    """Anywhere: either it is refused as damaged, or the byte meant nothing and all numbers are the same."""
    path, good = tmp_path / "run.npz", contents(saved)
    for position in np.linspace(0, len(saved) - 1, 400).astype(int):
        data = bytearray(saved)
        data[position] ^= 0xFF
        path.write_bytes(data)
        try:
            found = rd.Trajectory.load(path)
        except rd.FileError:
            continue
        assert all(np.array_equal(getattr(found, name), good[name]) for name in ARRAYS), position


def rewritten(saved, path, **changes):
    """The file with some of its arrays replaced; None leaves one out."""
    arrays = {k: v for k, v in {**contents(saved), **changes}.items() if v is not None}
    np.savez(path, **arrays)


WRONG = {
    "other arrays": dict.fromkeys((*ARRAYS, "scene", "stats", "format")),
    "no t": {"t": None},
    "no scene": {"scene": None},
    "q of another robot": {"q": np.zeros((3, 7))},
    "t of another length": {"t": np.zeros(9)},
    "t a table": {"t": np.zeros((3, 1))},
    "t of text": {"t": np.array(["a", "b", "c"])},
    "q complex": {"q": np.ones((3, 1), dtype=complex)},
    "a format of the future": {"format": np.array(99)},
    "a format that is none": {"format": np.array("one")},
    "several formats": {"format": np.array([1, 1])},
    "no JSON": {"scene": np.array("{")},
    "stats that are no JSON": {"stats": np.array("{'")},
    "stats that are a list": {"stats": np.array("[1]")},
    "stats of numbers": {"stats": np.array("5")},
    "a scene that is a number": {"scene": np.array("5")},
    "a scene that is null": {"scene": np.array("null")},
    "a scene that is a box": {"scene": np.array('{"class":"Box","fields":{"size":[1,1,1]}}')},
    "an unknown class": {"scene": np.array('{"class":"Popen","fields":{"args":["id"]}}')},
    "fields that are a list": {"scene": np.array('{"class":"Scene","fields":[]}')},
    "an unknown field": {"scene": np.array('{"class":"Scene","fields":{"robot":null,"surprise":1}}')},
    "a scene without a robot": {"scene": np.array('{"class":"Scene","fields":{"robot":null}}')},
    "a robot without links": {
        "scene": np.array('{"class":"Scene","fields":{"robot":{"class":"Robot","fields":{"name":"r","links":[],"joints":[]}}}}')
    },
    "a ragged array": {"scene": np.array('{"array":[[1],[1,2]],"shape":[2,2]}')},
    "a deep nest": {"scene": np.array("[" * 100_000)},
}


@pytest.mark.parametrize("what", WRONG)
def test_a_file_of_the_wrong_contents(what, saved, tmp_path):
    path = tmp_path / "run.npz"
    rewritten(saved, path, **WRONG[what])
    assert_refused(path)


@pytest.mark.parametrize(
    ("old", "new"),
    [('"parent":0', '"parent":7'), ('"mimic":null', '"mimic":{"class":"Mimic","fields":{"leader":9}}'), ('"mass":2.0', '"mass":"2"')],
)
def test_a_record_that_no_robot_can_be(old, new, saved, tmp_path):
    path = tmp_path / "run.npz"
    scene = str(contents(saved)["scene"])
    assert old in scene
    rewritten(saved, path, scene=np.array(scene.replace(old, new)))
    assert_refused(path)


def test_a_newer_file_says_so(saved, tmp_path):
    rewritten(saved, tmp_path / "run.npz", format=np.array(2))
    assert_refused(tmp_path / "run.npz", "newer robodyn.*update")


class Trap:
    """Touches a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (str(self.path), "w"))


def test_nothing_in_a_file_is_executed(saved, tmp_path):
    """Pickles, bare and inside an array: refused, and not opened on the way."""
    touched, path = tmp_path / "touched", tmp_path / "run.npz"
    path.write_bytes(pickle.dumps(Trap(touched)))
    assert_refused(path)
    for name in (*ARRAYS, "scene", "stats", "format"):
        trap = np.empty(3, dtype=object)
        trap[:] = [Trap(touched)] * 3
        np.savez(path, **{**contents(saved), name: trap})
        assert_refused(path)
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("t.npy", pickle.dumps(Trap(touched)))
    assert_refused(path)
    assert not touched.exists()


# --- files that cannot be written --------------------------------------------------------------------------------------


def writers(trajectory):
    return {"npz": trajectory.save, "html": trajectory.to_html, "csv": trajectory.to_csv}


def test_a_folder_that_is_not_there(short, tmp_path):
    for write in (short.save, short.to_html):
        with pytest.raises(rd.FileError, match=r"none.*run"):
            write(tmp_path / "none" / "run")
    assert not any(tmp_path.iterdir())


def test_a_path_that_is_a_folder(short, tmp_path):
    folder = tmp_path / "run.npz"
    folder.mkdir()
    (folder / "precious").write_text("data")
    for write in (short.save, short.to_html):
        with pytest.raises(rd.FileError, match=r"run\.npz"):
            write(folder)
    assert (folder / "precious").read_text() == "data"
    assert [x.name for x in tmp_path.iterdir()] == ["run.npz"]


def test_names_that_are_no_names(short, tmp_path):
    for write in (short.save, short.to_html):
        with pytest.raises(rd.FileError, match="cannot write"):
            write(f"{tmp_path}/nul\0byte")
        with pytest.raises(rd.FileError, match="cannot write"):
            write(tmp_path / ("x" * 300))
        with pytest.raises(rd.FileError, match="cannot write"):
            write("")
    assert not any(tmp_path.iterdir())


def test_a_long_name_is_a_name(short, tmp_path):
    """Whatever the file system takes as a name; the temporary file beside it needs no longer one."""
    path = tmp_path / ("x" * 250)
    short.save(path)
    assert [x.name for x in tmp_path.iterdir()] == [path.name]


def test_a_folder_that_is_a_file(short, tmp_path):
    (tmp_path / "file").write_text("data")
    with pytest.raises(rd.FileError, match="file"):
        short.to_csv(tmp_path / "file")
    with pytest.raises(rd.FileError, match="file"):
        short.save(tmp_path / "file" / "run.npz")
    assert (tmp_path / "file").read_text() == "data"


@pytest.mark.parametrize("step", ["fsync", "replace", "chmod"])
@pytest.mark.parametrize("kind", ["npz", "html", "csv"])
def test_a_full_disk_leaves_the_old_file(kind, step, short, tmp_path, monkeypatch):
    """Wherever the system says no: FileError with its reason, the old bytes still there, no part of a new file beside them."""
    path = tmp_path / "run"
    writers(short)[kind](path)
    old = path if path.is_file() else path / "states.csv"
    before, names = old.read_bytes(), sorted(tmp_path.rglob("*"))

    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, step, full)
    with pytest.raises(rd.FileError, match="No space left on device"):
        writers(short)[kind](path)
    monkeypatch.undo()
    assert old.read_bytes() == before
    assert sorted(tmp_path.rglob("*")) == names


def test_ctrl_c_while_writing_leaves_the_old_file(short, tmp_path, monkeypatch):
    path = tmp_path / "run.npz"
    path.write_bytes(b"old")

    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        short.save(path)
    assert path.read_bytes() == b"old"
    assert [x.name for x in tmp_path.iterdir()] == ["run.npz"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
def test_what_is_no_regular_file_is_not_replaced(short, tmp_path):
    """A pipe, or /dev/null, is written to or refused; it is never swapped for a file."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDWR | os.O_NONBLOCK)
    received = []
    stop = threading.Event()

    def drain():
        while not stop.is_set():
            try:
                received.append(os.read(reader, 65536))
            except BlockingIOError:
                time.sleep(0.01)

    thread = threading.Thread(target=drain)
    thread.start()
    try:
        short.save(pipe)
    except rd.FileError:
        pass
    finally:
        stop.set()
        thread.join()
        os.close(reader)
    assert pipe.is_fifo()


# --- CSV ---------------------------------------------------------------------------------------------------------------


def table(path):
    with open(path, newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return header, np.array([[float(x) for x in row] for row in rows])


def test_csv_tables_bit_for_bit(run, tmp_path):
    run.to_csv(tmp_path / "new" / "folder")
    folder = tmp_path / "new" / "folder"
    assert sorted(x.name for x in folder.iterdir()) == ["energy.csv", "reactions.csv", "states.csv"]
    header, rows = table(folder / "states.csv")
    assert np.array_equal(rows, np.column_stack([run.t, run.q, run.v, run.a]))
    robot = run.scene.robot
    q_names, v_names = robot.coordinate_names()
    assert header[0] == "t [s]"
    assert header[1 : 1 + robot.nq] == [f"q.{name} [{unit}]" for name, unit in q_names]
    assert header[1 + robot.nq : 1 + robot.nq + robot.nv] == [f"v.{name} [{unit}]" for name, unit in v_names]
    assert header[1 + robot.nq + robot.nv :] == [f"a.{name} [{unit}²]" for name, unit in v_names]
    assert {
        "q.ground.x [m]",
        "q.ground.qw [1]",
        "v.ground.wx [rad/s]",
        "v.ground.vz [m/s]",
        "a.ground.wx [rad/s²]",
        "a.ground.vz [m/s²]",
    } <= set(header)

    header, rows = table(folder / "reactions.csv")
    assert np.array_equal(rows, np.column_stack([run.t, run.reactions().array.reshape(len(run.t), -1)]))
    assert header[1:7] == [f"ground.{x}" for x in ("Mx [N m]", "My [N m]", "Mz [N m]", "Fx [N]", "Fy [N]", "Fz [N]")]
    assert len(header) == 1 + 6 * len(robot.joints)

    header, rows = table(folder / "energy.csv")
    assert header == ["t [s]", "kinetic [J]", "potential [J]", "work [J]", "balance [J]"]
    assert np.array_equal(rows, np.column_stack([run.t, *run.energy()]))


HOSTILE = ["a,b", 'say "no"', "two\nlines", "semi;colon", "=1+1", "ä→関節", "tab\there", " space ", "carriage\rreturn", "both\r\n"]


def test_csv_with_hostile_names(tmp_path):
    body = Inertia.about_centre(1.0, X, np.eye(3))
    joints = (Joint(GROUND, Fixed(), -1), *(Joint(n, Revolute.from_axis(Z), i) for i, n in enumerate(HOSTILE)))
    robot = rd.Robot("hostile", tuple(Link(f"link {i}", body) for i in range(len(joints))), joints)
    trajectory = rd.simulate(robot, t_end=0.02, v0=np.linspace(0.1, 1.0, len(HOSTILE)))
    trajectory.to_csv(tmp_path)
    header, rows = table(tmp_path / "states.csv")
    assert header[1 : 1 + len(HOSTILE)] == [f"q.{name} [rad]" for name in HOSTILE]
    assert np.array_equal(rows[:, 1 : 1 + len(HOSTILE)], trajectory.q)
    header, rows = table(tmp_path / "reactions.csv")
    assert header[7::6] == [f"{name}.Mx [N m]" for name in HOSTILE]
    assert rows.shape == (len(trajectory.t), 1 + 6 * (1 + len(HOSTILE)))


# --- plots -------------------------------------------------------------------------------------------------------------


def test_plot(short):
    pytest.importorskip("matplotlib")
    figure = short.plot()
    assert [axes.get_ylabel() for axes in figure.axes] == ["position", "velocity", "reaction force [N]", "reaction moment [N m]"]
    assert figure.axes[-1].get_xlabel() == "t [s]"
    for axes, labels in zip(figure.axes, (["qA [rad]", "qB [rad]"], ["qA [rad/s]", "qB [rad/s]"], ["qA", "qB"], ["qA", "qB"]), strict=True):
        assert [line.get_label() for line in axes.lines] == labels
        assert [text.get_text() for text in axes.get_legend().get_texts()] == labels
    assert np.array_equal(figure.axes[0].lines[1].get_ydata(), short.q[:, 1])
    assert np.array_equal(figure.axes[1].lines[0].get_ydata(), short.v[:, 0])
    r = short.reactions()["qB"]
    assert np.array_equal(figure.axes[2].lines[1].get_ydata(), np.linalg.norm(r[:, 3:], axis=-1))
    assert np.array_equal(figure.axes[3].lines[1].get_ydata(), np.linalg.norm(r[:, :3], axis=-1))


def test_plot_chosen_joints(short, run, tmp_path):
    pytest.importorskip("matplotlib")
    assert [line.get_label() for line in short.plot(joints=["qB"]).axes[2].lines] == ["qB"]
    assert [line.get_label() for line in short.plot("qB").axes[2].lines] == ["qB"]
    assert len(run.plot(["ground"]).axes[0].lines) == 7
    assert len(run.plot(["ground"]).axes[1].lines) == 6
    with pytest.raises(rd.ModelError, match="no joint named 'qC': it has ground, qA, qB"):
        short.plot(["qC"])
    with pytest.raises(rd.InputError, match="no joint to plot"):
        short.plot([])
    short.plot().savefig(tmp_path / "figure.png", dpi=40)
    assert (tmp_path / "figure.png").stat().st_size > 1000


@pytest.mark.filterwarnings("error")
def test_plot_a_fixed_joint(short):
    """It has no coordinate, but a reaction."""
    pytest.importorskip("matplotlib")
    figure = short.plot(["ground"])
    assert [len(axes.lines) for axes in figure.axes] == [0, 0, 1, 1]


def test_plot_without_matplotlib(short, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(rd.MissingPackageError, match=r"pip install 'robodyn\[plot\]'"):
        short.plot()


def test_page(short, tmp_path):
    short.to_html(tmp_path / "run.html", title="A <title>")
    assert "A &lt;title&gt;" in (tmp_path / "run.html").read_text("utf-8")


# --- stopped and failed ------------------------------------------------------------------------------------------------


def stopping(after):
    """A progress callback that is interrupted after a share of the run."""

    def progress(share):
        if share >= after:
            raise KeyboardInterrupt

    return progress


@pytest.mark.parametrize("method", ["dop853", "rk4", "radau"])
@pytest.mark.parametrize(("fps", "backend"), [(50, "numpy"), (None, "numpy"), (None, "native")])
def test_ctrl_c_keeps_what_has_been_computed(method, fps, backend, tmp_path, monkeypatch):
    """A warning with the time, `completed` False, states that are those of the whole run; reactions and files work as ever."""
    monkeypatch.setattr(native, "RECORD", (3, 10**5))  # short runs would be over before Python comes in between
    robot = rd.load(ROBOTS / "pendulum.urdf")
    options = {"t_end": 2.0, "q0": [1.0], "method": method, "dt": 0.02, "fps": fps, "rtol": 1e-6, "backend": backend}
    whole = rd.simulate(robot, **options)
    with pytest.warns(rd.RobodynWarning, match=r"interrupted at t=.* s of 2 s: the trajectory ends with its last state before"):
        part = rd.simulate(robot, progress=stopping(0.4), **options)
    assert not part.completed
    assert part.stats["completed"] is False
    n = len(part.t)
    assert 2 < n < len(whole.t)
    assert 0.4 <= part.t[-1] < 2.0
    for name in ARRAYS:
        assert np.array_equal(getattr(part, name), getattr(whole, name)[:n]), name
    assert "interrupted" in repr(part)
    assert part.reactions().array.shape == (n, 2, 6)
    back = through_a_file(part, tmp_path)
    assert not back.completed
    assert_same(part, back)


@pytest.mark.filterwarnings("ignore:interrupted")
@pytest.mark.parametrize("sampled", [False, True])
@pytest.mark.parametrize(("method", "fps", "backend"), [("rk4", 60, "native"), ("dop853", None, "native"), ("rk4", None, "numpy")])
def test_ctrl_c_at_any_line_leaves_a_whole_trajectory_or_none(method, fps, backend, sampled, monkeypatch):
    """An interrupt at each line of the integration in turn: arrays fit one another, and `completed` says what is there."""
    monkeypatch.setattr(native, "RECORD", (3, 10**5))
    folder = os.path.join("robodyn", "simulation")
    robot = rd.load(ROBOTS / "pendulum.urdf")
    scene = rd.Scene(robot, loads=[rd.Sampled(lambda t, q, v: -v, 0.02)] * sampled)
    options = {"t_end": 0.05, "q0": [1.0], "method": method, "dt": 0.01, "fps": fps, "backend": backend}
    whole, returned = rd.simulate(scene, **options), 0

    for n in range(10_000):
        left = n

        def interrupt(frame, event, _):
            nonlocal left
            if folder not in frame.f_code.co_filename:
                return None
            if event == "line":
                left -= 1
                if left == -1:
                    raise KeyboardInterrupt
            return interrupt

        sys.settrace(interrupt)
        try:
            part = rd.simulate(scene, **options)
        except KeyboardInterrupt:
            continue  # before it began, or while the results are put together
        finally:
            sys.settrace(None)
        returned += 1
        m = len(part.t)
        assert m >= 1
        assert part.completed == (part.t[-1] == 0.05)
        for name in ARRAYS:
            # At a last instant whose controller was not asked, what it had answered before is still held.
            k = m - (sampled and name in ("a", "u") and not part.completed)
            assert np.array_equal(getattr(part, name)[:k], getattr(whole, name)[:k]), name
        if left >= 0:  # it ended before the line came
            break
    assert returned > 20


def test_ctrl_c_inside_a_control_law():
    def law(t, q, v):
        if t > 0.05:
            raise KeyboardInterrupt
        return 0 * v

    with pytest.warns(rd.RobodynWarning, match="interrupted"):
        trajectory = rd.simulate(
            rd.Scene(slide(), loads=[rd.ControlLaw(law)]), t_end=1.0, v0=[1.0], method="rk4", dt=0.01, fps=None, backend="numpy"
        )
    assert not trajectory.completed
    assert 0.03 < trajectory.t[-1] <= 0.05
    assert np.allclose(trajectory.q[:, 0], trajectory.t, rtol=0, atol=20 * EPS)


def test_ctrl_c_before_the_first_output(tmp_path):
    with pytest.warns(rd.RobodynWarning, match="interrupted"):
        trajectory = rd.simulate(slide(), t_end=1.0, times=[0.9], method="rk4", dt=0.1, progress=stopping(0.1), backend="numpy")
    assert trajectory.t.shape == (0,)
    assert trajectory.q.shape == (0, 1)
    assert "empty" in repr(trajectory)
    assert not trajectory.completed
    assert trajectory.reactions().array.shape == (0, 2, 6)
    assert trajectory.energy().drift == 0
    assert_same(trajectory, through_a_file(trajectory, tmp_path))


def test_a_callback_is_told_the_share_done():
    shares = []
    rd.simulate(slide(), t_end=0.5, v0=[1.0], method="rk4", dt=0.1, progress=shares.append, backend="numpy")
    assert np.allclose(shares, [0.2, 0.4, 0.6, 0.8, 1.0], rtol=4 * EPS)
    # Native code looks up now and then; the end is always told.
    shares.clear()
    rd.simulate(slide(), t_end=0.5, v0=[1.0], method="rk4", dt=1e-4, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_a_bar_on_standard_error(capsys):
    rd.simulate(slide(), t_end=0.1, progress=True)
    assert capsys.readouterr().out == ""


def failing(t_fail):
    """A force that stops being a number."""
    return rd.Scene(slide(), loads=[rd.ControlLaw(lambda t, q, v: [np.nan if t > t_fail else 2.0])])


@pytest.mark.parametrize("method", ["dop853", "rk4"])
def test_an_error_on_the_way_carries_what_had_been_computed(method):
    with pytest.raises(rd.SimulationError, match=r"at t=0\.\d+ s: .*finite") as caught:
        rd.simulate(failing(0.5), t_end=1.0, method=method, dt=0.05, fps=100, backend="numpy")
    trajectory = caught.value.trajectory
    assert isinstance(trajectory, rd.Trajectory)
    assert not trajectory.completed
    assert 0.1 < trajectory.t[-1] <= 0.5
    assert np.allclose(trajectory.q[:, 0], trajectory.t**2 / 2, rtol=0, atol=1e-12)
    assert np.isfinite(trajectory.a).all()
    assert trajectory.reactions().array.shape[0] == len(trajectory.t)


@pytest.mark.parametrize("method", ["dop853", "rk4", "radau"])
@pytest.mark.parametrize(
    ("fault", "cause"), [(lambda: 1 / 0, rd.InputError), (lambda: np.zeros(2), rd.InputError), (lambda: [][0], IndexError)]
)
def test_a_control_law_that_fails_on_the_way_leaves_what_had_been_computed(fault, cause, method):
    """Uncompiled, it may do so at any evaluation: an hour of computing is not lost, and the law's own exception is there."""
    scene = rd.Scene(slide(), loads=[rd.ControlLaw(lambda t, q, v: [2.0] if t < 0.5 else fault())])
    with pytest.raises(rd.SimulationError, match=rf"load failed at t=0\.\d+ s: {cause.__name__}") as caught:
        rd.simulate(scene, t_end=1.0, method=method, dt=0.05, fps=100, backend="numpy")
    assert isinstance(caught.value.__cause__, cause)
    trajectory = caught.value.trajectory
    assert len(trajectory.t) > 1
    assert np.allclose(trajectory.q[:, 0], trajectory.t**2 / 2, rtol=0, atol=1e-8)
    with pytest.raises(cause):
        rd.simulate(scene, t0=0.6, t_end=1.0, backend="numpy")


BOTH = pytest.mark.parametrize("backend", ["native", "numpy"])


@BOTH
def test_times_may_be_a_rounding_off(backend):
    """3 · 0.1 > 0.3, and 1e6 + 0.1 is not as far from 1e6: neither is refused, and t_end comes once."""
    run = rd.simulate(slide(), t_end=0.3, v0=[1.0], times=np.arange(4) * 0.1, backend=backend)
    assert run.t.tolist() == [0.0, 0.1, 0.2, 0.3]
    for t_end in (1e6 + 0.1, 1e6 + 0.7):
        run = rd.simulate(slide(), t0=1e6, t_end=t_end, v0=[1.0], fps=60, backend=backend)
        assert (np.diff(run.t) > 0.015).all()
        assert (run.t[0], run.t[-1]) == (1e6, t_end)
        assert np.allclose(run.q[:, 0], run.t - 1e6, rtol=0, atol=1e-9)


@BOTH
def test_a_motion_that_runs_away(backend):
    """v̇ = v² reaches infinity at t = 1: the step size goes to zero there, and the error says where and what to try."""
    scene = rd.Scene(slide(1.0), loads=[rd.ControlLaw(lambda t, q, v: v * v)])
    with pytest.raises(rd.SimulationError, match=r"t=(1\.0|0\.99).*(rtol|finite)") as caught:
        rd.simulate(scene, t_end=2.0, v0=[1.0], rtol=1e-6, backend=backend)
    trajectory = caught.value.trajectory
    assert 0.9 < trajectory.t[-1] <= 1.0 + 1e-6
    assert np.allclose(trajectory.v[trajectory.t < 0.9, 0], 1 / (1 - trajectory.t[trajectory.t < 0.9]), rtol=1e-3)


@BOTH
def test_a_step_that_is_too_long_is_an_error_not_a_number(backend):
    """rk4 on a stiff spring beyond its limit of stability grows until float64 ends: no inf or nan comes back."""
    scene = rd.Scene(slide(1.0), loads=[rd.JointSpring({"slide": 1e10})])
    with pytest.raises(rd.SimulationError, match=r"finite|too large") as caught:
        rd.simulate(scene, t_end=10.0, q0=[1.0], method="rk4", dt=0.1, backend=backend)
    for name in ARRAYS:
        assert np.isfinite(getattr(caught.value.trajectory, name)).all(), name


def test_motion_that_is_undetermined_from_the_start():
    robot = rd.Robot("light", (Link("base"), Link("a")), (Joint(GROUND, Fixed(), -1), Joint("free", Revolute.from_axis(Z), 0)))
    with pytest.raises(rd.ModelError, match="'free' have no mass"):
        rd.simulate(robot, t_end=1.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"t_end": 0.0}, "t_end=0.0 must be later than t0=0.0"),
        ({"t0": 1e9, "t_end": 1e9 + 1e-6}, "closer than 7.11e-06 s.*start from t0=0"),
        ({"t_end": -1.0}, "t_end=-1.0"),
        ({"t_end": np.nan}, "t_end=nan must be finite"),
        ({"t_end": np.inf}, "t_end=inf must be finite"),
        ({"t_end": "soon"}, "t_end='soon' must be a number"),
        ({"t_end": None}, "t_end=None must be a number"),
        ({"t0": 2.0}, "later than t0=2.0"),
        ({"method": "rk5"}, "method='rk5'.*'dop853'.*'rk4'"),
        ({"formalism": "fast"}, "formalism='fast'.*'recursive'"),
        ({"rtol": 0.0}, "rtol=0"),
        ({"rtol": -1e-9}, "rtol=-1e-09"),
        ({"rtol": 1e-14}, "rtol=1e-14.*at least 1e-13"),
        ({"atol": 0.0}, "atol=0"),
        ({"dt": 0.0, "method": "rk4"}, "dt=0"),
        ({"dt": np.nan, "method": "rk4"}, "dt=nan must be finite"),
        ({"fps": 0.0}, "fps=0.0 must be positive"),
        ({"fps": -60}, "fps=-60 must be positive"),
        ({"fps": "many"}, "fps='many' must be a number"),
        ({"fps": 1e300}, "fps"),
        ({"times": [0.5, 0.2]}, r"times must ascend within \[0, 1\]"),
        ({"times": [0.1, 0.1]}, "times must ascend"),
        ({"times": [0.1, 1.5]}, "times must ascend"),
        ({"times": [-0.1, 0.5]}, "times must ascend"),
        ({"times": []}, "times must ascend"),
        ({"times": 0.5}, "times"),
        ({"times": [0.1, np.nan]}, r"times\[1\] is nan"),
        ({"q0": [0.0, 0.0]}, r"q0 has the shape \(2,\)"),
        ({"q0": [[0.0]]}, r"leading dimensions \(1,\)"),
        ({"v0": [np.nan]}, r"v0\[0\] \(slide\) is nan"),
    ],
)
def test_arguments_that_make_no_sense(options, message):
    with pytest.raises(rd.InputError, match=message):
        rd.simulate(slide(), **{"t_end": 1.0, **options})


# --- a real Ctrl-C -----------------------------------------------------------------------------------------------------

COMMAND = "import sys; from robodyn.cli import main; sys.exit(main())"


def interrupted(arguments, ready, **options):
    """Run a program, send it SIGINT as soon as `ready` says so, and return its code, output and errors."""
    process = subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background job would hand down that it is ignored
        **options,
    )
    try:
        ready(process)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    return process.returncode, out, err


LONG = {"t_end": 1e6, "method": "rk4", "fps": 0.001}  # minutes, even for native code


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT is sent otherwise there")
@BOTH
def test_sigint_in_a_script(backend, tmp_path):
    """A script that saves what `simulate` returns has its file after Ctrl-C."""
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(
            f"""
            import robodyn as rd
            robot = rd.load({str(ROBOTS / "double_pendulum.urdf")!r})
            told = lambda share: print("step", flush=True)
            trajectory = rd.simulate(robot, q0=[1.0, 1.0], progress=told, backend={backend!r}, **{LONG!r})
            trajectory.save({str(tmp_path / "run.npz")!r})
            print("completed", trajectory.completed)
            """
        )
    )

    def ready(process):
        for _ in range(10):
            assert process.stdout.readline() == "step\n"

    code, out, err = interrupted([str(script)], ready)
    assert code == 0, err
    assert out.endswith("completed False\n")
    assert "RobodynWarning: interrupted at t=" in err
    assert "Traceback" not in err
    assert not rd.Trajectory.load(tmp_path / "run.npz").completed


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT is sent otherwise there")
def test_sigint_on_the_command_line(tmp_path):
    """Exit code 130, a warning, no traceback, and every file that was asked for is written."""
    # The child tells the test when it integrates: `simulate` is given a callback that prints.
    program = (
        "import sys, robodyn as rd, robodyn.cli.simulate as command\n"
        "def told(share): print('integrating', flush=True)\n"
        "command.simulate = lambda *a, **o: rd.simulate(*a, **{**o, 'progress': told})\n" + COMMAND
    )
    files = [f"--html={tmp_path / 'run.html'}", f"--npz={tmp_path / 'run.npz'}", f"--csv={tmp_path / 'csv'}"]
    motion = ["--t-end", str(LONG["t_end"]), "--method", LONG["method"], "--fps", str(LONG["fps"]), "--quiet"]

    def ready(process):
        assert process.stdout.readline() == "integrating\n"

    code, out, err = interrupted(["-c", program, "simulate", str(ROBOTS / "double_pendulum.urdf"), *motion, *files], ready)
    assert code == 130, err
    assert "warning: interrupted at t=" in err
    assert "Traceback" not in err
    assert "largest reaction" in out
    trajectory = rd.Trajectory.load(tmp_path / "run.npz")
    assert not trajectory.completed
    assert trajectory.t[-1] < LONG["t_end"]
    assert table(tmp_path / "csv" / "states.csv")[1].shape[0] == len(trajectory.t)
    assert (tmp_path / "run.html").stat().st_size > 1e5


def test_stats_are_plain_json(run):
    assert json.loads(json.dumps(run.stats)) == run.stats


def test_trajectories_of_many_robots_are_saved_bit_for_bit(tmp_path):
    for seed in (0, 3, 6):
        c = case(seed, n=3)
        trajectory = rd.simulate(c.robot, t_end=0.01, q0=c.q, v0=c.v, fps=200, backend="numpy")
        assert_same(trajectory, through_a_file(trajectory, tmp_path), answers=False)
