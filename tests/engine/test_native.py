"""Kernels against the formalism they were traced from, and against 50 digits."""

import pickle
import re
import threading

import numpy as np
import pytest
from tools import EPS, case, condition, error

import robodyn as rd
from robodyn.dynamics.questions import Energies, ForwardDynamics, JointReactions, MassMatrix
from robodyn.engine.emit import blocks, straight as emit
from robodyn.engine.run import compile as compiler, kernel as kernels
from robodyn.engine.run.kernel import Kernel, load
from robodyn.engine.trace.graph import Graph
from robodyn.engine.trace.program import program
from robodyn.evaluation.evaluator import Evaluator

SOME = pytest.mark.parametrize("seed", range(12))
C = 50


def batch_of(c, n):
    rng = np.random.default_rng(c.seed)
    q = np.stack([c.robot.random_state(rng)[0] for _ in range(n)])
    return q, rng.normal(size=(n, c.robot.nv)), rng.normal(size=(n, c.robot.nv))


@SOME
def test_kernels_are_the_formalism(seed):
    c = case(seed)
    tolerance = C * condition(c.robot, c.q) * EPS
    for route in ("recursive", "nonrecursive"):
        exact = c.robot.forward_dynamics(c.q, c.v, c.tau, backend="mpmath", formalism=route)
        assert error(c.robot.forward_dynamics(c.q, c.v, c.tau, formalism=route), exact) < tolerance
    for frame, part in (("child", "constraint"), ("parent", "total"), ("world", "constraint")):
        native = c.robot.reactions(c.q, c.v, c.tau, frame=frame, part=part)
        assert error(native.array, c.reference.reactions(c.q, c.v, c.tau, frame=frame, part=part).array) < tolerance
    assert error(c.robot.inverse_dynamics(c.q, c.v, c.a), c.reference.inverse_dynamics(c.q, c.v, c.a)) < C * EPS
    assert error(c.robot.mass_matrix(c.q), c.reference.mass_matrix(c.q)) < C * EPS
    assert error(c.robot.link_poses(c.q), c.reference.link_poses(c.q)) < C * EPS
    assert error(c.robot.momentum(c.q, c.v), c.reference.momentum(c.q, c.v)) < C * EPS
    assert np.isclose(c.robot.kinetic_energy(c.q, c.v), c.reference.kinetic_energy(c.q, c.v), rtol=C * EPS)


@SOME
def test_the_same_bits_whatever_the_batch_the_lanes_and_the_threads(seed, monkeypatch):
    c = case(seed, n=4)
    q, v, tau = batch_of(c, 4099)
    whole = c.robot.forward_dynamics(q, v, tau, threads=1)
    assert np.array_equal(whole, c.robot.forward_dynamics(q, v, tau, threads=2))
    assert np.array_equal(whole, c.robot.forward_dynamics(q, v, tau, threads=3))
    assert np.array_equal(whole[:5], c.robot.forward_dynamics(q[:5], v[:5], tau[:5]))
    assert np.array_equal(whole[7], c.robot.forward_dynamics(q[7], v[7], tau[7]))
    program = c.robot.alone.evaluator.kernel(ForwardDynamics("auto")).program
    for lanes in (2, 4):
        kernel = Kernel(program)
        monkeypatch.setattr("robodyn.engine.run.kernel.lanes", lambda lanes=lanes: lanes)
        values, bad = kernel((50,), {"q": q[:50], "v": v[:50], "tau": tau[:50], "t": np.zeros(1)})
        assert bad == -1
        assert np.array_equal(values["vdot"], whole[:50])


def test_broadcasting_and_layouts_change_nothing():
    c = case(2, n=4)
    q, v, tau = batch_of(c, 24)
    expected = c.robot.forward_dynamics(q, v, tau)
    shape = (2, 3, 4, -1)
    assert np.array_equal(c.robot.forward_dynamics(q.reshape(shape), v.reshape(shape), tau.reshape(shape)), expected.reshape(shape))
    assert np.array_equal(c.robot.forward_dynamics(np.asfortranarray(q), v[::-1][::-1], tau.repeat(2, axis=0)[::2]), expected)
    one = c.robot.forward_dynamics(q[3], v, tau)
    assert np.array_equal(one, c.robot.forward_dynamics(np.broadcast_to(q[3], q.shape), v, tau))
    single = q.astype(np.float32)
    if not any(joint.type.rated for joint in c.robot.joints):
        assert np.array_equal(c.robot.forward_dynamics(single, v, tau), c.robot.forward_dynamics(single.astype(float), v, tau))
    assert c.robot.forward_dynamics(q[:0], v[:0], tau[:0]).shape == (0, c.robot.nv)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_named_even_where_it_does_not_matter(value):
    """The first angle about the vertical has no influence on anything; a NaN there is still no answer."""
    robot = rd.load(robots() / "ur5e.urdf")
    q, v, tau = np.zeros((40, 6)), np.zeros((40, 6)), np.zeros((40, 6))
    q[37, 0] = value
    with pytest.raises(rd.InputError, match=r"q\[37, 0\] \(shoulder_pan_joint\)"):
        robot.forward_dynamics(q, v, tau)
    with pytest.raises(rd.InputError, match=r"tau\[5\] \(wrist_3_joint\)"):
        robot.forward_dynamics(q[0], v[0], [0, 0, 0, 0, 0, value])


def test_errors_of_the_kernel_are_those_of_the_reference():
    robot = rd.load(robots() / "lecture_tree.urdf")
    q, v = robot.neutral(), np.zeros(robot.nv)
    first = robot.q_slices[next(i for i in robot.owners if robot.joints[i].type.rated)].start
    q[first] = 1.1
    with pytest.raises(rd.InputError, match=r"length 1\.1"):
        robot.forward_dynamics(q, v)
    with pytest.raises(rd.ModelError, match="not finite"):
        robot.forward_dynamics(robot.neutral(), v + 1e200)


def test_threads_of_the_user_may_share_a_robot():
    c = case(4, n=5)
    q, v, tau = batch_of(c, 200)
    expected, found = c.reference.forward_dynamics(q, v, tau), []

    def work():
        found.append(c.robot.forward_dynamics(q, v, tau))

    workers = [threading.Thread(target=work) for _ in range(8)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(found) == 8
    assert all(np.array_equal(x, found[0]) for x in found)
    assert error(found[0], expected) < 1e-9


def test_robots_and_scenes_can_be_pickled_after_use():
    c = case(5, n=4)
    expected = c.robot.forward_dynamics(c.q, c.v, c.tau)
    robot = pickle.loads(pickle.dumps(c.robot))
    assert np.array_equal(robot.forward_dynamics(c.q, c.v, c.tau), expected)
    scene = rd.Scene(c.robot, gravity=(0, 0, -1.6))
    expected = scene.forward_dynamics(c.q, c.v, c.tau)
    assert np.array_equal(pickle.loads(pickle.dumps(scene)).forward_dynamics(c.q, c.v, c.tau), expected)


def test_after_fork():
    import multiprocessing

    c = case(6, n=4)
    q, v, tau = batch_of(c, 5000)
    expected = c.robot.forward_dynamics(q, v, tau, threads=2)
    context = multiprocessing.get_context("fork")
    queue = context.Queue()

    def child():
        queue.put(np.array_equal(c.robot.forward_dynamics(q, v, tau, threads=2), expected))

    process = context.Process(target=child)
    process.start()
    assert queue.get(timeout=60)
    process.join()


def test_long_programs_are_cut_and_compute_the_same(monkeypatch):
    c = case(7, n=8)
    q, v, tau = batch_of(c, 9)
    evaluator = Evaluator(c.robot, np.array([0, 0, -9.81]), ())
    program = evaluator.kernel(ForwardDynamics("nonrecursive")).program
    arrays = {"q": q, "v": v, "tau": tau, "t": np.zeros(1)}
    expected, _ = Kernel(program)((9,), arrays)
    monkeypatch.setattr(emit, "WHOLE", 200)
    monkeypatch.setattr(emit, "PIECE", 200)
    found, bad = Kernel(program)((9,), arrays)
    assert bad == -1
    assert len(program.instructions) > 1000
    assert np.array_equal(found["vdot"], expected["vdot"])


@pytest.mark.parametrize("setting", [("WRITTEN_OUT", 0), ("LONG", 1), ("LONG", 10**9)])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_inputs_and_outputs_are_moved_alike_in_every_way(monkeypatch, setting, dtype):
    c = case(11, n=3)  # a free base: rows of many lengths
    q, v, tau = (x.astype(dtype) for x in batch_of(c, 37))
    joints = tuple(range(len(c.robot.joints)))
    for question in (JointReactions("auto", "child", "total", joints), MassMatrix(), Energies()):
        program = Evaluator(c.robot, np.array([0, 0, -9.81]), ()).kernel(question).program
        arrays = {"q": q, "v": v, "tau": tau, "t": np.zeros(1)}
        with monkeypatch.context() as patched:
            expected, good = Kernel(program, dtype)((37,), arrays)
            patched.setattr(blocks, *setting)
            found, bad = Kernel(program, dtype)((37,), arrays)
        assert good == bad == -1
        for name in expected:
            assert np.array_equal(found[name], expected[name])


def test_vectors_do_not_cross_cache_lines():
    # Frames of functions that spill vectors are aligned: LLVM shows it by what it moves vectors with.
    c = case(7, n=8)
    program = Evaluator(c.robot, np.zeros(3), ()).kernel(ForwardDynamics("nonrecursive")).program
    if (lanes := compiler.lanes()) == 2:
        pytest.skip("frames are aligned to 16 bytes anyway")
    text = compiler.assembly(blocks.module(program, lanes)).split("\nrun:")[1]
    spills = [line.split()[0] for line in text.splitlines() if re.search(r"rsp\)", line) and re.match(r"\s+vmov[au]p", line)]
    assert len(spills) > 100
    assert not [name for name in spills if name.startswith("vmovu")]


def test_modules_are_what_llvm_accepts_for_every_width():
    c = case(8, n=3)
    program = Evaluator(c.robot, np.zeros(3), ()).kernel(ForwardDynamics("auto")).program
    for lanes in (1, 2, 4, 8):
        load(blocks.module(program, lanes))
    assert compiler.lanes() in (2, 4, 8)


def robots():
    from pathlib import Path

    return Path(__file__).parents[2] / "robots"


@pytest.mark.parametrize("n", [1, 20])
def test_what_the_dynamics_do_not_need_has_to_be_finite(n):
    """A slider falls alike wherever it is; that it is nowhere is an error all the same."""
    robot = rd.random_robot(np.random.default_rng(0), 1, joint_types=("prismatic",))
    q, v = np.zeros((n, robot.nq)), np.zeros((n, robot.nv))
    assert np.isfinite(robot.forward_dynamics(q, v)).all()
    q[-1, 0] = np.nan
    with pytest.raises(rd.InputError, match="q"):
        robot.forward_dynamics(q, v)


def test_the_first_of_several_bad_rows_is_found(monkeypatch):
    monkeypatch.setattr(kernels, "WORK", 1)
    graph = Graph()
    x = graph.inputs("x", (1,))
    kernel, rows = kernels.Kernel(program(graph, {"x": 1}, {"y": x * 2.0})), np.zeros((640, 1))
    rows[[100, 600]] = np.nan
    assert kernel((640,), {"x": rows}, threads=2)[1] // 16 == 100 // 16
