"""Robots of many bodies: kernels that loop over the tree, against 50 digits, NumPy, Pinocchio, a closed form, and themselves."""

import multiprocessing
import pickle
import sys
from dataclasses import replace

import numpy as np
import pytest
from tools import EPS, case, condition, error

import robodyn as rd
from robodyn.arithmetic.vectors import frozen, rotation
from robodyn.dynamics.questions import Balance, Energies, Evolution, ForwardDynamics, JointReactions
from robodyn.engine.emit import blocks, integrate
from robodyn.engine.run import kernel as kernels
from robodyn.engine.trace.layout import Looped
from robodyn.engine.trace.sweeps import Recorder
from robodyn.evaluation import composed, routes
from robodyn.evaluation.looped import KINDS, LoopedTree
from robodyn.joints import JOINT_TYPES, Fixed
from robodyn.loads import Load
from robodyn.model import GROUND, Inertia, Joint, Link, Mimic
from robodyn.report.timing import fresh
from robodyn.simulation import METHODS

# Of c·κ·eps: trees of these sizes are up to some dozens of bodies deep, each a product of rotations and a shift.
C = 50
EXACT = {"backend": "mpmath", "formalism": "recursive"}  # O(n) in 50 digits too


@pytest.fixture
def all_looped(monkeypatch):
    """Kernels of every robot loop, however few bodies it has."""
    monkeypatch.setattr("robodyn.evaluation.routes.UNROLLED", 0)


@pytest.fixture(scope="module")
def big():
    """A tree of every joint type with fixed links in it and a free base, too large to be written out."""
    c = case(3, n=90, branching=0.4, floating_base=True)
    assert len(c.robot.alone.equations().tree.bodies) > 60
    assert {joint.type.kind for joint in c.robot.joints} >= {"revolute", "prismatic", "planar", "spherical", "floating", "fixed"}
    return c


def batch_of(c, n):
    rng = np.random.default_rng(c.seed)
    return np.stack([c.robot.random_state(rng)[0] for _ in range(n)]), rng.normal(size=(n, c.robot.nv)), rng.normal(size=(n, c.robot.nv))


def program_of(robot, formalism="auto"):
    return robot.alone.evaluator.kernel(ForwardDynamics(formalism)).program


# --- against 50 digits and the reference ---


FRAMES_AND_PARTS = [(frame, part) for frame in ("child", "parent", "world") for part in ("constraint", "total")]


@pytest.mark.parametrize("seed", range(8))
def test_every_question_on_random_trees(seed, all_looped):
    c = case(seed)
    tolerance = C * condition(c.robot, c.q) * EPS
    exact = {"backend": "mpmath"}
    found = c.robot.forward_dynamics(c.q, c.v, c.tau, formalism="recursive")
    assert isinstance(program_of(c.robot, "recursive"), Looped)
    assert error(found, c.robot.forward_dynamics(c.q, c.v, c.tau, **exact)) < tolerance
    frame, part = FRAMES_AND_PARTS[seed % 6]
    shown = {"frame": frame, "part": part}
    expected = c.robot.reactions(c.q, c.v, c.tau, **shown, **exact)
    assert error(c.robot.reactions(c.q, c.v, c.tau, **shown).array, expected.array) < tolerance
    tau = c.robot.inverse_dynamics(c.q, c.v, c.a)
    assert error(tau, c.robot.inverse_dynamics(c.q, c.v, c.a, **exact)) < C * EPS
    M = c.robot.mass_matrix(c.q)
    assert error(M, c.robot.mass_matrix(c.q, **exact)) < C * EPS
    assert np.array_equal(M, M.T)
    if seed % 2:
        assert error(c.robot.link_poses(c.q), c.robot.link_poses(c.q, **exact)) < C * EPS
        assert error(c.robot.momentum(c.q, c.v), c.robot.momentum(c.q, c.v, **exact)) < C * EPS
    else:
        energies = [c.robot.kinetic_energy(c.q, c.v), c.robot.potential_energy(c.q)]
        expected = [c.robot.kinetic_energy(c.q, c.v, **exact), c.robot.potential_energy(c.q, **exact)]
        assert error(energies, expected) < C * EPS


def test_a_big_robot_moves(big):
    """Motion, its inverse, its mass matrix, bias forces; κ of 70 bodies is some thousands."""
    q, v, tau, a = big.q, big.v, big.tau, big.a
    assert isinstance(program_of(big.robot), Looped)
    tolerance = C * condition(big.robot, q) * EPS
    assert error(big.robot.forward_dynamics(q, v, tau), big.robot.forward_dynamics(q, v, tau, **EXACT)) < tolerance
    found = big.robot.forward_dynamics(q, v, tau, gravity=(1.0, -2.0, 3.0))
    assert error(found, big.reference.forward_dynamics(q, v, tau, gravity=(1.0, -2.0, 3.0))) < tolerance
    assert error(big.robot.inverse_dynamics(q, v, a), big.reference.inverse_dynamics(q, v, a)) < C * EPS
    assert error(big.robot.bias_forces(q, v), big.reference.bias_forces(q, v)) < C * EPS
    batch = batch_of(big, 3)[0].reshape(3, 1, -1)
    assert error(big.robot.mass_matrix(batch), big.reference.mass_matrix(batch)) < C * EPS
    assert big.robot.mass_matrix(batch).shape == (3, 1, big.robot.nv, big.robot.nv)
    scene = rd.Scene(big.robot, loads=[rd.JointDamping({"joint_1": 2.0}), rd.LinkWrench("link_5", force=(1, 2, 3))])
    assert np.array_equal(scene.mass_matrix(q), big.robot.mass_matrix(q))


def test_a_big_robot_is_somewhere_and_has_energy(big):
    q, v = big.q, big.v
    assert error(big.robot.link_poses(q), big.reference.link_poses(q)) < C * EPS
    assert error(big.robot.momentum(q, v), big.reference.momentum(q, v)) < C * EPS
    assert error(big.robot.kinetic_energy(q, v), big.reference.kinetic_energy(q, v)) < C * EPS
    masses = sum(link.inertia.mass for link in big.robot.links)
    scale = masses * 9.81 * abs(big.robot.link_poses(q)[:, :3, 3]).max()  # potential energies of bodies above and below cancel
    assert abs(big.robot.potential_energy(q) - big.reference.potential_energy(q)) < C * EPS * scale


@pytest.mark.parametrize(("frame", "part"), FRAMES_AND_PARTS)
def test_a_big_robots_reactions(big, frame, part):
    tolerance, shown = C * condition(big.robot, big.q) * EPS, {"frame": frame, "part": part}
    found = big.robot.reactions(big.q, big.v, big.tau, **shown)
    expected = big.reference.reactions(big.q, big.v, big.tau, **shown)
    assert found.joint_names == big.robot.all_joint_names
    assert error(found.array, expected.array) < tolerance


def test_reactions_of_some_joints_in_any_order(big):
    names = ["joint_70", "ground", next(j.name for j in big.robot.joints if j.type.kind == "fixed"), "joint_2"]
    found = big.robot.reactions(big.q, big.v, big.tau, joints=names)
    expected = big.reference.reactions(big.q, big.v, big.tau)
    tolerance = C * condition(big.robot, big.q) * EPS * abs(expected.array).max()  # the ground of a free base carries nothing
    for name in names:
        assert abs(found[name] - expected[name]).max() < tolerance, name


def test_reactions_at_known_accelerations(big):
    """Asked for as a trajectory does, with joint forces given; and the same motion caused by the forces that inverse dynamics finds."""
    scene, tau = big.robot.alone, big.robot.inverse_dynamics(big.q, big.v, big.a)
    known = scene.reactions_of(big.q, big.v, big.a, tau, part="total")
    caused = big.reference.reactions(big.q, big.v, tau, part="total")
    assert error(known.array, caused.array) < C * condition(big.robot, big.q) * EPS


# --- constants with zeros and ones in many places ---


def patterned(n):
    """Joints in simple and general places on simple and general axes, bodies with and without extent; leaves have all of it."""
    rng = np.random.default_rng(n)
    unit = np.eye(3)
    solid = Inertia.about_centre(1.3, np.array([0.1, -0.2, 0.15]), np.diag([0.03, 0.05, 0.04]) + 0.002)
    axial = Inertia.about_centre(2.0, np.zeros(3), np.diag([0.02, 0.03, 0.04]))
    point = Inertia.about_centre(0.7, np.array([0.0, 0.0, 0.2]), np.zeros((3, 3)))
    links, joints, path = [Link("link_0", solid)], [Joint(GROUND, Fixed(), -1)], [0]
    kinds = ("revolute", "prismatic", "continuous", "planar", "fixed", "spherical")
    for i in range(1, n + 1):
        # Back along the path that led here: depth first.
        path = path[: int(rng.integers(1, len(path) + 1))] if rng.random() < 0.2 else path
        axis = [unit[0], unit[1], unit[2], -unit[2], np.array([0.6, 0.0, 0.8]), np.array([2.0, -1.0, 2.0]) / 3][rng.integers(6)]
        place = [np.zeros(3), unit[2] * 0.3, -unit[0], np.array([0.2, -0.1, 0.25])][rng.integers(4)]
        quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        turn = [np.eye(3), quarter, quarter.T, rotation(np.array([0.0, 0.6, 0.8]), np.cos(0.7), np.sin(0.7))][rng.integers(4)]
        kind = kinds[rng.choice(6, p=[0.4, 0.2, 0.1, 0.1, 0.1, 0.1])]
        joints.append(Joint(f"joint_{i}", JOINT_TYPES[kind].from_axis(axis), path[-1], frozen(turn), frozen(place)))
        links.append(Link(f"link_{i}", [solid, axial, point][rng.integers(3)]))
        path = [*path, i]
    carrying = {joint.parent for joint in joints}
    links = [link if i in carrying else Link(link.name, solid) for i, link in enumerate(links)]
    return rd.Robot(name=f"patterned_{n}", links=tuple(links), joints=tuple(joints))


def test_simple_constants_of_many_patterns():
    robot = patterned(110)
    tree = robot.alone.equations().tree
    assert len(tree.bodies) > 60
    rng = np.random.default_rng(1)
    q, v = robot.random_state(rng)
    tau, a = rng.normal(size=(2, robot.nv))
    found = robot.forward_dynamics(q, v, tau)
    assert isinstance(program_of(robot), Looped)
    tolerance = C * condition(robot, q) * EPS
    assert error(found, robot.forward_dynamics(q, v, tau, **EXACT)) < tolerance
    assert error(robot.inverse_dynamics(q, v, a), robot.inverse_dynamics(q, v, a, backend="numpy")) < C * EPS
    shown = {"frame": "world", "part": "total"}
    expected = robot.reactions(q, v, tau, backend="numpy", **shown)
    assert error(robot.reactions(q, v, tau, **shown).array, expected.array) < tolerance
    assert error(robot.link_poses(q), robot.link_poses(q, backend="numpy")) < C * EPS


def test_code_does_not_grow_with_the_number_of_patterns():
    """Each body has zeros and ones in places of its own: what compiles is bounded all the same, and every body is of one kind."""
    code = {}
    for n in (110, 400):
        robot = patterned(n)
        tree = robot.alone.equations().tree
        kinds = LoopedTree.of(tree, Recorder())._kinds
        assert len(kinds) == KINDS
        assert sorted(i for kind in kinds for i in kind.members) == list(range(len(tree.bodies)))
        code[n] = sum(len(program.instructions) for program in program_of(robot).programs)
    assert code[400] < 1.3 * code[110]  # the more bodies share a step, the fewer of its constants fold away


# --- loads ---


@pytest.fixture(scope="module")
def loaded(big):
    """Every load on the big robot; the control law too."""
    moving = [joint for joint in big.robot.joints if joint.type.nv]
    hinged = [joint.name for joint in moving if joint.type.nv == 1]
    loads = [
        rd.JointDamping({joint.name: 0.1 + 0.01 * i for i, joint in enumerate(moving)}),
        rd.JointFriction(dict.fromkeys(hinged[:40], 0.3), width=0.5),
        rd.JointSpring({name: 2.0 + i for i, name in enumerate(hinged)}, rest={hinged[1]: 0.3}),
        rd.JointForce({hinged[0]: 3.0}),
        rd.LinkWrench("link_40", force=(1.0, 2.0, 3.0), moment=(-1.0, 0.5, 0.2), point=(0.1, 0.2, 0.3)),
        rd.LinkWrench("link_40", force=(1.0, 2.0, 3.0), frame="link"),
        rd.LinkWrench("link_71", moment=(1.0, 2.0, 3.0), point=(0.1, 0.2, 0.3), frame="link"),
    ]
    return rd.Scene(big.robot, loads=loads)


def test_loads_on_a_big_robot(big, loaded):
    q, v, tau, a = big.q, big.v, big.tau, big.a
    tolerance = C * condition(big.robot, q) * EPS
    exact = loaded.forward_dynamics(q, v, tau, **EXACT)
    assert error(loaded.forward_dynamics(q, v, tau), exact) < tolerance
    assert error(loaded.inverse_dynamics(q, v, a), loaded.inverse_dynamics(q, v, a, backend="numpy")) < C * EPS
    for shown in ({"part": "total"}, {"part": "constraint", "frame": "world"}):
        expected = loaded.reactions(q, v, tau, backend="numpy", **shown)
        assert error(loaded.reactions(q, v, tau, **shown).array, expected.array) < tolerance
    native, reference = (loaded.potential_energy(q, backend=b) for b in ("native", "numpy"))
    assert abs(native - reference) < C * EPS * abs(q).max() ** 2 * 60 * big.robot.nv  # springs of up to 60 N m/rad add to it


def test_the_power_of_loads_on_a_big_robot(big, loaded):
    """Springs have none: their work is in the potential energy."""
    state = {"q": big.q, "v": big.v, "tau": big.tau}
    found, exact = (loaded.evaluator.ask(Evolution("recursive"), backend, **state)["power"] for backend in ("native", "mpmath"))
    bare = rd.Scene(big.robot, loads=[load for load in loaded.loads if not load.conservative])
    assert abs(bare.evaluator.ask(Evolution("recursive"), **state)["power"] - found) < C * EPS * abs(exact)
    rates = loaded.evaluator.ask(Evolution("recursive"), "numpy", **state | {"tau": 0 * big.tau})["power"]
    terms = abs(big.tau * big.v).sum() + abs(exact) + abs(rates)
    assert abs(found - exact) < C * EPS * terms
    assert abs(found - rates - big.tau @ big.v) < C * EPS * terms


def test_a_control_law_on_a_big_robot(big):
    scene = rd.Scene(
        big.robot, loads=[rd.ControlLaw(lambda t, q, v: -0.3 * v + np.tanh(v) * np.cos(t) - 0.1 * q[3] + 0.2 * np.sin(q[0] * v))]
    )
    found = scene.forward_dynamics(big.q, big.v, big.tau, t=1.5)
    expected = scene.forward_dynamics(big.q, big.v, big.tau, t=1.5, backend="numpy", formalism="recursive")
    assert error(found, expected) < 2 * C * condition(big.robot, big.q) * EPS  # two that round, against each other
    assert error(scene.forward_dynamics(big.q, big.v, big.tau, t=0.1), expected) > 1e-6  # time matters


# --- the step loop ---


@pytest.mark.parametrize("method", ["rk4", "semi_implicit_euler", "dop853", "rk45"])
def test_steps_are_those_of_straight_line_code(method, monkeypatch):
    """A small tree with quaternions, damping and a wrench: only roundings differ, and 0.05 s of motion does not magnify them much.

    Straight-line code is compared with NumPy in simulation/test_native_loop.py.
    """
    c = case(1, n=4, joint_types=("revolute", "spherical", "prismatic", "planar"), floating_base=True)
    damping = {joint.name: 0.2 for joint in c.robot.joints if joint.type.nv}
    options = {"t_end": 0.05, "q0": c.q, "v0": c.v, "method": method, "dt": 2e-3, "rtol": 1e-9, "fps": 70, "formalism": "recursive"}
    runs = []
    for unrolled in (0, 60):
        monkeypatch.setattr("robodyn.evaluation.routes.UNROLLED", unrolled)
        scene = rd.Scene(c.robot, loads=[rd.JointDamping(damping), rd.LinkWrench("link_2", force=(1.0, 2.0, 3.0))])
        assert isinstance(scene.evaluator.integrators.evolution("recursive"), Looped) == (unrolled == 0)
        runs.append(rd.simulate(scene, **options))
    for name in ("t", "q", "v", "a", "work"):
        x, y = (getattr(run, name) for run in runs)
        assert np.allclose(x, y, rtol=1e-11, atol=1e-11 * abs(y).max()), name
    assert runs[0].stats["evaluations"] == runs[1].stats["evaluations"]


def test_a_big_robot_is_simulated(big, loaded):
    """Beyond the stack's room; many trajectories have the bits of each alone."""
    options = {"t_end": 4e-3, "v0": big.v, "method": "rk4", "dt": 1e-3, "fps": 500}
    runs = [rd.simulate(loaded, q0=big.q, backend=b, **options) for b in ("native", "numpy")]
    for name in ("q", "v", "a", "work"):
        x, y = (getattr(run, name) for run in runs)
        # Roundings of the accelerations, κ times eps of the largest, over 4 ms.
        assert np.allclose(x, y, rtol=1e-9, atol=C * condition(big.robot, big.q) * EPS * max(1.0, abs(runs[1].a).max())), name
    unit = runs[0].q[:, 3:7]
    assert np.allclose((unit**2).sum(-1), 1.0, atol=4 * EPS)
    q0 = np.stack([big.q, *batch_of(big, 9)[0]])
    many = rd.simulate_many(loaded, q0=q0, **options)
    assert np.array_equal(many.q[0], runs[0].q)
    assert np.array_equal(many.v[0], runs[0].v)
    assert np.array_equal(many[0].a, runs[0].a)
    assert np.array_equal(many.q, rd.simulate_many(loaded, q0=q0, threads=1, **options).q)


# --- one and the same number ---


def test_the_same_bits_whatever_the_batch_the_lanes_and_the_threads(big, monkeypatch):
    q, v, tau = batch_of(big, 43)
    whole = big.robot.forward_dynamics(q, v, tau, threads=1)
    for i in (0, 8, 42):
        assert np.array_equal(whole[i], big.robot.forward_dynamics(q[i], v[i], tau[i]))
    assert np.array_equal(whole[:5], big.robot.forward_dynamics(q[:5], v[:5], tau[:5]))
    assert np.array_equal(whole[9:20], big.robot.forward_dynamics(q[9:20], v[9:20], tau[9:20]))
    monkeypatch.setattr(kernels, "WORK", 1)
    for threads in (2, 3):
        assert np.array_equal(whole, big.robot.forward_dynamics(q, v, tau, threads=threads))
    program = program_of(big.robot)
    for lanes in (2, 4):
        monkeypatch.setattr(kernels, "lanes", lambda lanes=lanes: lanes)
        values, bad = kernels.Kernel(program)((43,), {"q": q, "v": v, "tau": tau, "t": np.zeros(1)})
        assert bad == -1
        assert np.array_equal(values["vdot"], whole)


def test_pickled_forked_and_shared(big):
    q, v, tau = batch_of(big, 11)
    expected = big.robot.forward_dynamics(q, v, tau)
    robot = pickle.loads(pickle.dumps(big.robot))
    assert np.array_equal(robot.forward_dynamics(q, v, tau), expected)
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=lambda: queue.put(np.array_equal(big.robot.forward_dynamics(q, v, tau, threads=2), expected)))
    child.start()
    assert queue.get(timeout=60)
    child.join()


# --- what is refused ---


def test_errors_name_the_joint_and_the_state(big):
    q, v, tau = batch_of(big, 10)
    spoilt = q.copy()
    spoilt[7, 30] = np.nan
    with pytest.raises(rd.InputError, match=r"q\[7, 30\] \(.+\) is nan"):
        big.robot.forward_dynamics(spoilt, v, tau)
    with pytest.raises(rd.InputError, match=r"q\[7, 30\]"):
        big.robot.mass_matrix(spoilt)
    first = next(i for i, joint in enumerate(big.robot.joints) if joint.type.kind == "spherical")
    spoilt = q.copy()
    spoilt[4, big.robot.q_slices[first]] *= 1.1
    for ask in (
        lambda: big.robot.forward_dynamics(spoilt, v, tau),
        lambda: big.robot.mass_matrix(spoilt),
        lambda: big.robot.link_poses(spoilt),
    ):
        with pytest.raises(rd.InputError, match=rf"q\[4\]: the quaternion \(w, x, y, z\) of joint '{big.robot.joints[first].name}'"):
            ask()
    with pytest.raises(rd.ModelError, match="not finite"):
        big.robot.forward_dynamics(q, v + 1e200, tau)
    with pytest.raises(rd.InputError, match="shape"):
        big.robot.forward_dynamics(q[:, 1:], v, tau)


def test_a_massless_tip_is_named():
    robot = rd.random_robot(np.random.default_rng(4), 80, branching=0.0, joint_types=("revolute",))
    nothing = Inertia.about_centre(0.0, np.zeros(3), np.zeros((3, 3)))
    robot = rd.Robot(name="light", links=(*robot.links[:-1], Link("tip", nothing)), joints=robot.joints)
    for ask in (robot.forward_dynamics, robot.reactions):
        with pytest.raises(rd.ModelError, match="'joint_80' have no mass"):
            ask(np.zeros(80), np.zeros(80))
    assert robot.inverse_dynamics(np.zeros(80), np.zeros(80), np.ones(80))[-1] == 0
    with pytest.raises(rd.ModelError, match="joint_80"):
        rd.simulate(robot, t_end=0.01)


def test_a_pivot_that_vanishes_in_one_state_is_named():
    """A point mass on two crossed hinges: where it comes to lie on the first one's axis, that hinge moves nothing."""
    chain = rd.random_robot(np.random.default_rng(5), 70, branching=0.0, joint_types=("revolute",))
    x, z = (JOINT_TYPES["revolute"].from_axis(np.eye(3)[k]) for k in (0, 2))
    point = Inertia.about_centre(1.0, np.array([0.0, 1.0, 0.0]), np.zeros((3, 3)))
    nothing = Inertia.about_centre(0.0, np.zeros(3), np.zeros((3, 3)))
    here = frozen(np.eye(3)), frozen(np.zeros(3))
    links = (*chain.links, Link("cross", nothing), Link("mass", point))
    joints = (*chain.joints, Joint("inner", z, 70, *here), Joint("outer", x, 71, *here))
    robot = rd.Robot(name="crossed", links=links, joints=joints)
    q = np.random.default_rng(6).normal(size=(9, 72))
    assert np.isfinite(robot.forward_dynamics(q, 0 * q)).all()
    assert isinstance(program_of(robot), Looped)
    q[6, 71] = np.pi / 2
    with pytest.raises(rd.ModelError, match=r"joint 'inner' of 'crossed' has no inertia to accelerate in state \[6\]"):
        robot.forward_dynamics(q, 0 * q)


def test_a_needle_about_its_own_axis_is_not_refused():
    """A billionth of what it shows about the other axes is still inertia; its pivot has no rounding, so neither has its acceleration."""
    chain = rd.random_robot(np.random.default_rng(7), 70, branching=0.0, joint_types=("revolute",))
    needle = Inertia.about_centre(1.0, np.zeros(3), np.diag([1.0, 1.0, 1e-9]))
    spin = Joint("spin", JOINT_TYPES["revolute"].from_axis(np.eye(3)[2]), 70, frozen(np.eye(3)), frozen(np.zeros(3)))
    robot = rd.Robot(name="needle", links=(*chain.links, Link("needle", needle)), joints=(*chain.joints, spin))
    q, tau = np.random.default_rng(8).normal(size=(2, 71))
    found, exact = (robot.forward_dynamics(q, 0 * q, tau, **how) for how in ({}, EXACT))
    assert abs(found[-1] / exact[-1] - 1) < C * EPS


# --- from outside ---


def test_pinocchio_on_a_hundred_joints():
    pin = pytest.importorskip("pinocchio", reason="the oracle needs pin: pip install '.[test]'")
    from robodyn.report.peers.pinocchio import chain_model, swap

    robot = rd.random_robot(np.random.default_rng(8), 100, branching=0.3, joint_types=("revolute",))
    model = chain_model(robot)
    data, rng = model.createData(), np.random.default_rng(9)
    q, v = robot.random_state(rng)
    tau, a = rng.normal(size=(2, 100))
    assert isinstance(program_of(robot), Looped)
    tolerance = C * condition(robot, q) * EPS
    assert error(robot.forward_dynamics(q, v, tau), pin.aba(model, data, q, v, tau)) < tolerance
    M = pin.crba(model, data, q)
    assert error(robot.mass_matrix(q), np.triu(M) + np.triu(M, 1).T) < C * EPS
    assert error(robot.inverse_dynamics(q, v, a), pin.rnea(model, data, q, v, a)) < C * EPS
    expected = np.stack([swap(data.f[i].vector) for i in range(1, 101)])
    found = robot.alone.reactions_of(q, v, a, 0 * a, part="total", joints=robot.joint_names)
    assert error(found.array, expected) < C * EPS


def test_pinocchio_on_a_hundred_joints_of_which_some_follow_others():
    """Pinocchio moves every joint freely: v̇_free = G η̇ with one column of G per coordinate makes its M and its forces ours."""
    pin = pytest.importorskip("pinocchio", reason="the oracle needs pin: pip install '.[test]'")
    from robodyn.report.peers.pinocchio import chain_model

    free = rd.random_robot(np.random.default_rng(8), 100, branching=0.3, joint_types=("revolute",))
    robot = coupled(free, 39)
    model, (q, v, tau, a) = chain_model(free), state_of(robot, 39)
    data, moving = model.createData(), robot.joints[1:]
    G, offsets = np.zeros((100, robot.nv)), np.array([joint.mimic.offset if joint.mimic else 0.0 for joint in moving])
    for row, joint in enumerate(moving):
        G[row, robot.v_slices[row + 1]] = joint.mimic.ratio if joint.mimic else 1.0
    M = pin.crba(model, data, G @ q + offsets)
    M = G.T @ (np.triu(M) + np.triu(M, 1).T) @ G
    assert error(robot.mass_matrix(q), M) < C * EPS
    assert error(robot.inverse_dynamics(q, v, a), G.T @ pin.rnea(model, data, G @ q + offsets, G @ v, G @ a)) < C * EPS
    expected = np.linalg.solve(M, tau - G.T @ pin.rnea(model, data, G @ q + offsets, G @ v, 0.0 * (G @ v)))
    assert error(robot.forward_dynamics(q, v, tau), expected) < 2 * C * np.linalg.cond(M) * EPS  # two that round, against each other


N = 10_000


def test_ten_thousand_sliders_in_closed_form():
    """Along one axis body i has the acceleration (τ_i − τ_i+1) / m_i + g, and η̇_i is what it has more than its parent.

    Every pivot is the body's own mass, whatever hangs on it: roundings stay where they arise.
    """
    rng = np.random.default_rng(10)
    masses, here = rng.uniform(0.5, 3.0, N), frozen(np.eye(3))
    slide = JOINT_TYPES["prismatic"].from_axis(np.array([0.0, 0.0, 1.0]))
    bodies = [Link(f"b{i}", Inertia.about_centre(m, rng.uniform(-0.1, 0.1, 3), 0.01 * np.eye(3))) for i, m in enumerate(masses)]
    carried = [Joint(f"j{i}", slide, i, here, frozen(rng.uniform(-0.1, 0.1, 3))) for i in range(N)]
    links, joints = (Link("base", bodies[0].inertia), *bodies), (Joint(GROUND, Fixed(), -1), *carried)
    robot = rd.Robot(name="sliders", links=links, joints=joints)
    q, v, tau = rng.normal(size=(3, N))
    absolute = (tau - np.append(tau[1:], 0.0)) / masses - 9.81
    expected = np.diff(absolute, prepend=0.0)
    assert abs(robot.forward_dynamics(q, v, tau) - expected).max() < 8 * EPS * abs(absolute).max()


def test_ten_thousand_hinges_forward_and_back():
    """The torques come back from the accelerations that they caused, up to a rounding per joint of the wrenches that pass through."""
    robot = rd.random_robot(np.random.default_rng(11), N, branching=0.0, joint_types=("revolute",))
    rng = np.random.default_rng(12)
    q, v = robot.random_state(rng)
    tau = rng.normal(size=N)
    a = robot.forward_dynamics(q, v, tau)
    largest = abs(robot.alone.reactions_of(q, v, a, tau, part="total").array).max()
    assert abs(robot.inverse_dynamics(q, v, a) - tau).max() < N * EPS * largest
    assert N * EPS * largest < 1e-3  # which is a statement: torques are of size 1


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux for the peak memory")
def test_ten_thousand_joints_need_less_than_a_gigabyte():
    code = f"""
import numpy as np, robodyn as rd
from robodyn.report.chains import _most_memory
robot = rd.random_robot(np.random.default_rng(0), {N}, branching=0.0, joint_types=("revolute",))
robot.forward_dynamics(np.zeros({N}), np.zeros({N}))
print(_most_memory())
"""
    assert fresh(code) < 1e9


def test_code_is_the_same_for_a_hundred_and_a_thousand_joints():
    """What LLVM gets differs in sizes and places alone, so that its time does not depend on n.

    Both are multiples of 8: columns that are left over in SIMD code have code of their own.
    """

    def texts(n):
        robot = rd.random_robot(np.random.default_rng(n), n, branching=0.3, joint_types=("revolute", "prismatic"))
        evaluator = rd.Scene(robot, loads=[rd.JointDamping(dict.fromkeys(robot.joint_names, 0.1))]).evaluator
        yield blocks.module(evaluator.kernel(ForwardDynamics("auto")).program, 8)
        yield blocks.module(evaluator.kernel(JointReactions("auto", "world", "total", tuple(range(n)))).program, 1)
        bare = rd.Scene(robot).evaluator
        yield integrate.module(METHODS["rk4"].tableau(), bare.integrators.evolution("auto"), bare.integrators.projection(), 1)
        table = {name: 0.1 + 0.0103 * i for i, name in enumerate(robot.joint_names)}  # none, nor half of one, folds away
        loads = [load(table) for load in (rd.JointDamping, rd.JointFriction, rd.JointSpring, rd.JointForce)]
        law = rd.ControlLaw(lambda t, q, v: np.where(q > 0.1, -v, np.tanh(v)) * np.cos(t) - 0.1 * q[3] * v)
        driven = rd.Scene(robot, loads=[*loads, law]).evaluator
        yield integrate.module(METHODS["rk4"].tableau(), driven.integrators.evolution("auto"), driven.integrators.projection(), 1)
        yield blocks.module(driven.kernel(Energies()).program, 8)

    for small, large in zip(texts(104), texts(1000), strict=True):
        a, b = small.splitlines(), large.splitlines()
        assert len(a) == len(b)
        assert sum(len(line) for line in b) < 1.02 * sum(len(line) for line in a)  # numbers of more digits


def test_what_has_no_loops_is_answered_by_numpy_where_it_would_compile_for_minutes():
    """The nonrecursive route beyond 100 bodies: the same numbers, in seconds."""
    rng = np.random.default_rng(12)
    robot = rd.random_robot(rng, 120, branching=0.2, joint_types=("revolute",))
    q, v = robot.random_state(rng)
    exact = robot.forward_dynamics(q, v, v, backend="mpmath", formalism="recursive")
    bound = C * condition(robot, q) * EPS
    found = robot.forward_dynamics(q, v, v, formalism="nonrecursive")
    assert np.array_equal(found, robot.forward_dynamics(q, v, v, formalism="nonrecursive", backend="numpy"))
    assert error(found, exact) < bound


# --- mimic joints ---


def coupled(robot, seed, share=0.3):
    """The robot with some of its joints of one freedom following others, before or behind them, turning or sliding."""
    rng, joints = np.random.default_rng([33, seed]), list(robot.joints)
    single = [i for i, joint in enumerate(joints) if joint.type.nv == 1]
    followers = rng.choice(single, size=int(share * len(single)), replace=False)
    leaders = sorted(set(single) - set(followers.tolist()))
    for i in followers if leaders else ():
        joints[i] = replace(joints[i], mimic=Mimic(int(rng.choice(leaders)), rng.choice([1.0, -1.0, 0.5, -1.7]), rng.choice([0.0, 0.4])))
    return replace(robot, joints=tuple(joints))


def state_of(robot, seed):
    rng = np.random.default_rng([34, seed])
    return (*robot.random_state(rng), *rng.normal(size=(2, robot.nv)))


@pytest.mark.parametrize("seed", range(6))
def test_every_question_on_random_trees_with_mimic_joints(seed, all_looped):
    options = {"joint_types": ("revolute", "prismatic", "continuous", "revolute", "spherical", "fixed"), "floating_base": seed % 2 == 1}
    robot = coupled(rd.random_robot(np.random.default_rng([35, seed]), 7, branching=0.4, **options), seed, share=0.5)
    assert robot.nu > robot.nv
    q, v, tau, a = state_of(robot, seed)
    exact, tolerance = {"backend": "mpmath"}, C * condition(robot, q) * EPS
    assert error(robot.forward_dynamics(q, v, tau), robot.forward_dynamics(q, v, tau, **exact)) < tolerance
    shown = dict(zip(("frame", "part"), FRAMES_AND_PARTS[seed], strict=True))
    expected = robot.reactions(q, v, tau, **shown, **exact)
    assert error(robot.reactions(q, v, tau, **shown).array, expected.array) < tolerance
    assert error(robot.inverse_dynamics(q, v, a), robot.inverse_dynamics(q, v, a, **exact)) < C * EPS
    M = robot.mass_matrix(q)
    assert error(M, robot.mass_matrix(q, **exact)) < C * EPS
    assert np.array_equal(M, M.T)
    assert error(robot.link_poses(q), robot.link_poses(q, **exact)) < C * EPS
    assert error(robot.momentum(q, v), robot.momentum(q, v, **exact)) < C * EPS
    assert error([robot.kinetic_energy(q, v)], [robot.kinetic_energy(q, v, **exact)]) < C * EPS


@pytest.fixture(scope="module")
def gang():
    """A robot of more than 100 bodies with mimic joints, quaternions and a free base; and a scene with loads on it."""
    types = ("revolute", "prismatic", "revolute", "continuous", "spherical", "planar", "fixed")
    robot = coupled(rd.random_robot(np.random.default_rng(36), 130, branching=0.4, joint_types=types, floating_base=True), 36)
    assert len(robot.alone.equations().tree.bodies) > routes.WRITTEN_OUT
    moving = [joint for joint in robot.joints if joint.type.nv]
    single = [joint.name for joint in moving if joint.type.nv == 1]
    followers = [joint.name for joint in moving if joint.mimic]
    loads = [
        rd.JointDamping({joint.name: 0.1 + 0.01 * i for i, joint in enumerate(moving)}),
        rd.JointFriction(dict.fromkeys(single, 0.3), width=0.5),
        rd.JointSpring({name: 2.0 + i for i, name in enumerate(single)}, rest={followers[1]: 0.3}),
        rd.JointForce({followers[0]: 3.0}),
        rd.LinkWrench("link_40", force=(1.0, 2.0, 3.0)),
    ]
    return robot, rd.Scene(robot, loads=loads)


def test_a_big_robot_with_mimic_joints(gang):
    robot, scene = gang
    q, v, tau, a = state_of(robot, 1)
    tolerance, exact = C * condition(robot, q) * EPS, {"backend": "mpmath"}
    for ask in (robot, scene):
        assert error(ask.forward_dynamics(q, v, tau), ask.forward_dynamics(q, v, tau, **exact)) < tolerance
        assert error(ask.inverse_dynamics(q, v, a), ask.inverse_dynamics(q, v, a, backend="numpy")) < C * EPS
    for shown in ({"part": "total", "frame": "world"}, {"part": "constraint"}):
        expected = scene.reactions(q, v, tau, backend="numpy", **shown)
        assert error(scene.reactions(q, v, tau, **shown).array, expected.array) < tolerance
    assert error(robot.mass_matrix(q), robot.mass_matrix(q, backend="numpy")) < C * EPS
    found, expected = (scene.evaluator.ask(Evolution("auto"), b, q=q, v=v, tau=tau) for b in ("native", "numpy"))
    for name in ("qdot", "vdot", "power"):
        assert error([found[name]], [expected[name]]) < tolerance, name


class Gust(Load):
    """A force on a link that grows with time."""

    def link_wrenches(self, state):
        return {40: np.asarray(state.t)[..., None] * np.arange(1.0, 7.0)}


def test_loads_that_vary_in_time_on_a_big_robot_with_mimic_joints(gang):
    robot, _ = gang
    scene, (q, v, tau, _) = rd.Scene(robot, loads=[Gust()]), state_of(robot, 2)
    expected = scene.reactions(q, v, tau, t=7.0, backend="numpy").array
    tolerance = C * condition(robot, q) * EPS
    assert error(scene.reactions(q, v, tau, t=7.0).array, expected) < tolerance
    assert error(scene.reactions(q, v, tau).array, expected) > 1e3 * tolerance


def test_states_with_mimic_joints_in_any_shape(gang, monkeypatch):
    robot, scene = gang
    states = np.stack([state_of(robot, k)[0] for k in range(6)]).reshape(2, 3, -1)
    v, tau = np.random.default_rng(1).normal(size=(2, 2, 3, robot.nv))
    whole = scene.forward_dynamics(states, v, tau)
    for i in np.ndindex(2, 3):
        assert np.array_equal(whole[i], scene.forward_dynamics(states[i], v[i], tau[i], threads=1))
    monkeypatch.setattr(composed, "NUMBERS", 2 * robot.nv**2)
    assert np.array_equal(scene.forward_dynamics(states, v, tau), whole)
    out = np.empty(whole.shape)
    assert scene.forward_dynamics(states, v, tau, out=out) is out
    assert np.array_equal(out, whole)
    assert scene.forward_dynamics(states[:0], v[:0], tau[:0]).shape == (0, 3, robot.nv)
    assert np.array_equal(scene.forward_dynamics(states, v[0, 0], None)[0, 0], scene.forward_dynamics(states[0, 0], v[0, 0]))
    single = scene.forward_dynamics(states[0, 0], v[0, 0], tau[0, 0], dtype=np.float32)
    assert single.dtype == np.float32
    # Angles, velocities and torques that are rounded change what they cause by so much.
    assert error(single, whole[0, 0]) < C * condition(robot, states[0, 0]) * np.finfo(np.float32).eps
    pushed = rd.Scene(robot, loads=[rd.ControlLaw(lambda t, q, v: -v * np.cos(t))])
    at = pushed.evaluator.ask(ForwardDynamics("auto"), t=np.array([0.0, 1.0]), q=states[0, [0, 0]], v=v[0, [0, 0]], tau=None)["vdot"]
    assert np.array_equal(at[1], pushed.forward_dynamics(states[0, 0], v[0, 0], t=1.0))
    assert error(at[0], at[1]) > 1e-6


@pytest.mark.parametrize("method", ["rk4", "semi_implicit_euler", "dop853"])
def test_a_big_robot_with_mimic_joints_is_simulated(gang, method):
    robot, scene = gang
    q, v, _, _ = state_of(robot, 2)
    options = {"t_end": 2e-3, "q0": q, "v0": 0.1 * v, "method": method, "dt": 1e-3, "rtol": 1e-6, "fps": 1000}
    runs = [rd.simulate(scene, backend=b, **options) for b in ("native", "numpy")]
    for name in ("q", "v", "a", "u", "work"):
        x, y = (getattr(run, name) for run in runs)
        # Roundings of the accelerations, κ times eps of the largest.
        assert np.allclose(x, y, rtol=0, atol=C * condition(robot, q) * EPS * max(1.0, abs(runs[1].a).max())), name
    if method != "dop853":
        many = rd.simulate_many(scene, **{k: x for k, x in options.items() if k not in ("q0", "rtol")}, q0=np.stack([q, q]))
        for name in ("q", "v", "work"):
            assert np.array_equal(getattr(many, name)[1], getattr(runs[0], name))
        assert np.array_equal(many.t, runs[0].t)
    assert error(runs[0].reactions(joints=["joint_7"]).array, runs[1].reactions(joints=["joint_7"]).array) < 1e-9


def test_step_loops_of_mimic_joints_written_out_project_in_loops(all_looped):
    """Up to 100 bodies the step loop is compiled; with quaternions, what keeps them at unit length loops beside it."""
    types = ("revolute", "spherical", "prismatic")
    robot = coupled(rd.random_robot(np.random.default_rng(38), 8, joint_types=types, floating_base=True), 38, share=0.5)
    assert robot.nu > robot.nv
    q, v, _, _ = state_of(robot, 3)
    runs = [rd.simulate(robot, t_end=0.02, q0=q, v0=v, method="rk4", dt=1e-3, fps=100, backend=b) for b in ("native", "numpy")]
    for name in ("q", "v", "a"):
        x, y = (getattr(run, name) for run in runs)
        assert np.allclose(x, y, rtol=1e-11, atol=1e-11 * abs(y).max()), name


def test_what_is_refused_with_mimic_joints(gang):
    robot, _ = gang
    q, v, tau, _ = state_of(robot, 4)
    spoilt = q.copy()
    spoilt[30] = np.nan
    with pytest.raises(rd.InputError, match=r"q\[30\]"):
        robot.forward_dynamics(spoilt, v, tau)
    spoilt = q.copy()
    spoilt[3:7] *= 1.1
    for ask in (robot.forward_dynamics, robot.reactions):
        with pytest.raises(rd.InputError, match=r"quaternion .+ of joint 'ground'"):
            ask(spoilt, v, tau)
    with pytest.raises(rd.ModelError, match="not finite"):
        robot.forward_dynamics(q, v + 1e200, tau)
    with pytest.raises(rd.SimulationError, match=r"trajectory 1: .+ q0\[1\]"):
        rd.simulate_many(robot, t_end=2e-3, q0=q, v0=np.stack([v, 1e155 * v]))
    nothing = Inertia.about_centre(0.0, np.zeros(3), np.zeros((3, 3)))
    chain = rd.random_robot(np.random.default_rng(4), 80, branching=0.0, joint_types=("revolute",))
    joints = [*chain.joints[:5], replace(chain.joints[5], mimic=Mimic(3)), *chain.joints[6:]]
    light = replace(chain, links=(*chain.links[:-1], Link("tip", nothing)), joints=tuple(joints))
    for ask in (light.forward_dynamics, light.reactions):
        with pytest.raises(rd.ModelError, match="'joint_80' have no mass"):
            ask(np.zeros(79), np.zeros(79))


def test_code_of_mimic_joints_does_not_grow():
    def texts(n):
        robot = rd.random_robot(np.random.default_rng(n), n, branching=0.3, joint_types=("revolute",))
        robot = coupled(robot, n, share=0.25)  # of 104 and 1000, so that nv is a multiple of 2 but no more: columns left over are alike
        loads = [rd.JointDamping({joint.name: 0.3 + 0.01 * i for i, joint in enumerate(robot.joints) if joint.type.nv})]
        for shown in ("residual", "u"), ("qdot", "power"):
            yield rd.Scene(robot, loads=loads).evaluator.kernel(Balance(shown)).program

    for small, large in zip(texts(104), texts(1000), strict=True):
        a, b = (sum(len(code.instructions) for code in program.programs) for program in (small, large))
        assert b < 1.2 * a
