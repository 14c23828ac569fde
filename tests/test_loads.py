"""Each load against a closed form, as virtual work, in both arithmetics; what a URDF declares; and what is refused by name."""

import io
import itertools
from dataclasses import dataclass, replace
from pathlib import Path

import mpmath
import numpy as np
import pytest
from tools import EPS, ROUTES, SEEDS, Reference, case, condition, derivative, error, many_digits

import robodyn as rd
from robodyn.joints import Fixed, Free, Planar, Prismatic, Revolute, Spherical
from robodyn.loads import LOADS, Load, State
from robodyn.model import GROUND, Inertia, Joint, Link, Mimic

ROBOTS = Path(__file__).parents[1] / "robots"
C = 50  # roundings along a path of up to 8 bodies, each a product of 3 × 3 matrices
G = 9.81
NONE = (0.0, 0.0, 0.0)
X, Y, Z = np.eye(3)


@pytest.fixture
def fifty_digits():
    with mpmath.workdps(50):
        yield


def body_on(joint_type, mass=2.0, tensor=(0.2, 0.3, 0.4)):
    """One body about its centre of mass on one joint, named `joint`."""
    body = Inertia.about_centre(mass, np.zeros(3), np.diag(tensor))
    return rd.Robot("one", (Link("base"), Link("body", body)), (Joint(GROUND, Fixed(), -1), Joint("joint", joint_type, 0)))


def acceleration(robot, load, q, v, **options):
    return rd.Scene(robot, gravity=NONE, loads=[load]).forward_dynamics(q, v, **options)


# --- closed forms, joints of one and of several freedoms ---------------------------------------------------------------


def test_force_on_a_slide():
    robot = body_on(Prismatic.from_axis(Z))
    assert np.allclose(acceleration(robot, rd.JointForce({"joint": 5.0}), [0.0], [0.0]), [5.0 / 2.0], rtol=4 * EPS)


def test_torque_on_a_ball_joint():
    """Θ ω̇ = τ from rest, per freedom; one number stands for all of them."""
    robot, q = body_on(Spherical()), [1.0, 0, 0, 0]
    each = acceleration(robot, rd.JointForce({"joint": (1.0, 2.0, -3.0)}), q, np.zeros(3))
    assert np.allclose(each, np.array([1.0, 2.0, -3.0]) / [0.2, 0.3, 0.4], rtol=8 * EPS)
    same = acceleration(robot, rd.JointForce({"joint": 1.0}), q, np.zeros(3))
    assert np.allclose(same, 1 / np.array([0.2, 0.3, 0.4]), rtol=8 * EPS)


def test_force_on_a_planar_joint():
    """(Fx, Fy, τ): the first two along the parent's axes, however far the body has turned."""
    robot = body_on(Planar.from_axis(Z))
    found = acceleration(robot, rd.JointForce({"joint": (1.0, 2.0, 3.0)}), [0.1, 0.2, 1.1], np.zeros(3))
    assert np.allclose(found, [0.5, 1.0, 3 / 0.4], rtol=16 * EPS)


def test_force_on_a_free_base():
    """(M, F) resolved in the body."""
    robot = rd.Robot(
        "free", (Link("body", Inertia.about_centre(2.0, np.zeros(3), np.diag([0.2, 0.3, 0.4]))),), (Joint(GROUND, Free(), -1),)
    )
    q, _ = robot.random_state(np.random.default_rng(0))
    wrench = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    found = acceleration(robot, rd.JointForce({GROUND: wrench}), q, np.zeros(6))
    assert np.allclose(found, wrench / [0.2, 0.3, 0.4, 2, 2, 2], rtol=16 * EPS)


@dataclass(frozen=True)
class Law:
    """A joint load and the force it should give."""

    load: type
    values: dict
    force: object  # of β, η

    def __repr__(self):
        return self.load.__name__


COEFFICIENT, REST, WIDTH = 1.5, 0.25, 0.4
LAWS = [
    Law(rd.JointForce, {}, lambda q, v: COEFFICIENT + 0 * v),
    Law(rd.JointDamping, {}, lambda q, v: -COEFFICIENT * v),
    Law(rd.JointFriction, {"width": WIDTH}, lambda q, v: -COEFFICIENT * np.tanh(v / WIDTH)),
    Law(rd.JointSpring, {"rest": REST}, lambda q, v: -COEFFICIENT * (q - REST)),
]
EVERY_LAW = pytest.mark.parametrize("law", LAWS, ids=repr)


def load_of(law, robot):
    """The load in every joint that can have it, and the joints' own forces u (nu,) as a function of q and v."""
    joints = [j for j in robot.joints if j.type.nv and not (law.load is rd.JointSpring and j.type.rated)]
    values = {joint.name: COEFFICIENT for joint in joints}
    options = {k: dict.fromkeys(values, x) if k == "rest" else x for k, x in law.values.items()}
    names = set(values)

    def tau(q, v):
        out = np.zeros(robot.nv)
        for i, joint in enumerate(robot.joints):
            if joint.name in names:
                ratio, offset = (joint.mimic.ratio, joint.mimic.offset) if joint.mimic else (1.0, 0.0)
                beta, eta = ratio * q[robot.q_slices[i]] + offset, ratio * v[robot.v_slices[i]]
                out[robot.v_slices[i]] += ratio * law.force(beta, eta)
        return out

    return law.load(values, **options), tau


@EVERY_LAW
@pytest.mark.parametrize("seed", range(10))
def test_loads_in_joints_are_joint_forces(law, seed):
    """A scene under a joint load moves, on every route, like the bare robot under the forces of its formula; `inverse` takes them off."""
    c = case(seed)
    load, formula = load_of(law, c.robot)
    scene, robot = Reference(rd.Scene(c.robot, loads=[load])), c.reference
    tau = c.tau + formula(c.q, c.v)
    tolerance = C * condition(c.robot, c.q) * EPS
    for route in ROUTES:
        expected = robot.forward_dynamics(c.q, c.v, tau, formalism=route)
        assert error(scene.forward_dynamics(c.q, c.v, c.tau, formalism=route), expected) < tolerance, route
    bias = robot.bias_forces(c.q, c.v) - formula(c.q, c.v)
    assert np.allclose(scene.bias_forces(c.q, c.v), bias, rtol=0, atol=C * EPS * max(1, abs(robot.bias_forces(c.q, c.v)).max()))
    a = scene.forward_dynamics(c.q, c.v, c.tau)
    M = robot.mass_matrix(c.q)
    # η̇ is known to κ eps; M̂ carries that back into the forces.
    assert np.allclose(scene.inverse_dynamics(c.q, c.v, a), c.tau, rtol=0, atol=tolerance * np.linalg.norm(M, 2) * max(1, abs(a).max()))


@EVERY_LAW
@pytest.mark.parametrize("follower", [False, True])
def test_loads_in_mimic_joints(law, follower):
    """A mimic joint's load sees its own β = ratio β_leader + offset, and reaches the leader's coordinate times the ratio."""
    links = tuple(Link(name, Inertia.about_centre(m, X, np.eye(3))) for name, m in (("base", 1.0), ("a", 2.0), ("b", 3.0)))
    turn = Joint("leader", Revolute.from_axis(Z), 0)
    robot = rd.Robot("pair", links, (Joint(GROUND, Fixed(), -1), turn, replace(turn, name="follower", mimic=Mimic(1, -1.7, 0.4))))
    name = "follower" if follower else "leader"
    q, v = np.array([0.3]), np.array([-0.8])
    rest = {"rest": {name: REST}} if law.load is rd.JointSpring else law.values
    scene = rd.Scene(robot, loads=[law.load({name: COEFFICIENT}, **rest)])
    ratio, offset = (-1.7, 0.4) if follower else (1.0, 0.0)
    u = law.force(ratio * q + offset, ratio * v)
    assert np.allclose(robot.bias_forces(q, v) - scene.bias_forces(q, v), ratio * u, rtol=32 * EPS)
    # In the joint's reaction it is the joint's own force, unscaled.
    total, constraint = (scene.reactions(q, v, part=part)[name] for part in ("total", "constraint"))
    assert np.allclose((total - constraint)[2], u, rtol=0, atol=C * EPS * abs(total).max())


def test_the_ends_of_friction():
    """Far beyond the width it is c against the motion, far within it a damper c/width, at rest nothing."""
    robot, friction = body_on(Prismatic.from_axis(Z), mass=1.0), rd.JointFriction({"joint": 3.0}, width=1e-3)
    assert np.array_equal(acceleration(robot, friction, [0.0], [2.0]), [-3.0])
    assert np.array_equal(acceleration(robot, friction, [0.0], [-2.0]), [3.0])
    assert np.array_equal(acceleration(robot, friction, [0.0], [0.0]), [0.0])
    assert np.allclose(acceleration(robot, friction, [0.0], [1e-9]), [-3.0 * 1e-6], rtol=1e-11)  # tanh x = x (1 − x²/3)


def test_springs_store_what_they_take():
    """½ k x² per freedom, on top of gravity's potential; −∂V/∂β is the force, by differences in 50 digits."""
    robot = body_on(Planar.from_axis(Z))
    spring = rd.JointSpring({"joint": (2.0, 3.0, 4.0)}, rest={"joint": (0.1, 0.2, 0.3)})
    scene = rd.Scene(robot, gravity=NONE, loads=[spring])
    q = np.array([0.4, -0.5, 1.0])
    stretch = q - [0.1, 0.2, 0.3]
    assert np.isclose(scene.potential_energy(q), 0.5 * ([2, 3, 4] * stretch**2).sum(), rtol=8 * EPS)
    for k in range(3):
        slope = derivative(lambda x: scene.potential_energy(x, backend="mpmath"), many_digits(q), many_digits(np.eye(3)[k]))
        assert abs(slope - [2, 3, 4][k] * stretch[k]) < 8 * EPS * 4
    assert scene.potential_energy([[0.1, 0.2, 0.3]] * 5).shape == (5,)


def test_only_springs_are_conservative():
    assert {name for name, load in LOADS.items() if load.conservative} == {"JointSpring"}
    assert set(LOADS) == {"ControlLaw", "JointDamping", "JointForce", "JointFriction", "JointSpring", "LinkWrench", "Sampled"}


def test_loads_add_up():
    c = case(4)
    loads = [load_of(law, c.robot)[0] for law in LAWS]
    together = Reference(rd.Scene(c.robot, loads=loads)).bias_forces(c.q, c.v)
    bare = c.reference.bias_forces(c.q, c.v)
    alone = sum(Reference(rd.Scene(c.robot, loads=[load])).bias_forces(c.q, c.v) - bare for load in loads)
    assert np.allclose(together - bare, alone, rtol=0, atol=C * EPS * max(1, abs(bare).max()))


# --- wrenches on links -------------------------------------------------------------------------------------------------


def virtual_work(robot, load, q):
    """Q (nv,): the power of a wrench for each unit velocity, by differences of `link_poses` in 50 digits."""
    i = robot.link_index(load.link)
    F, M, point = many_digits(load.force), many_digits(load.moment), np.array([*many_digits(load.point), 1])
    equations = rd.Scene(robot).equations("mpmath")
    T = robot.link_poses(q, backend="mpmath")[i]
    R = T[:3, :3]
    if load.frame == "link":
        F, M = R @ F, R @ M
    forces = []
    for k in range(robot.nv):
        with mpmath.workdps(50):
            direction = equations.rate(q, many_digits(np.eye(robot.nv)[k]))
        Tdot = derivative(lambda x: robot.link_poses(x, backend="mpmath")[i], q, direction)
        W = Tdot[:3, :3] @ R.T
        omega = np.array([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]]) / 2
        forces.append(F @ (Tdot @ point)[:3] + M @ omega)
    return np.array(forces)


@pytest.mark.parametrize("frame", ["link", "world"])
@pytest.mark.parametrize("seed", range(10))
def test_a_wrench_does_the_work_of_its_force_and_moment(seed, frame, fifty_digits):
    """Jᵀ f̌ = ∂(power)/∂η on a link that moves, on one on a fixed joint, and on the root: force times the velocity of its point."""
    c = case(seed, n=4, fixed=0.4)
    rng = np.random.default_rng(seed)
    q = rd.Scene(c.robot).equations("mpmath").project(many_digits(c.q))
    fixed = [i for i, joint in enumerate(c.robot.joints) if not joint.type.nv]
    for i in {0, len(c.robot.links) - 1, *fixed[-1:]}:
        force, moment, point = rng.normal(size=(3, 3))
        load = rd.LinkWrench(c.robot.link_names[i], force, moment, point, frame)
        scene = rd.Scene(c.robot, gravity=NONE, loads=[load])
        found = -scene.bias_forces(q, np.zeros(c.robot.nv), backend="mpmath")
        expected = virtual_work(c.robot, load, q)
        # r × F and the turned wrench are rounded to float64 at most once; the differences are good to 1e-28.
        assert abs(found - expected).max() < 4 * EPS * max(1, abs(expected).max())
        tau = Reference(scene).inverse_dynamics(c.q, c.v, c.a)
        assert np.allclose(
            c.reference.inverse_dynamics(c.q, c.v, c.a, gravity=NONE) - tau, expected.astype(float), rtol=0, atol=C * EPS * 50
        )


@pytest.mark.parametrize("seed", SEEDS)
def test_a_wrench_means_the_same_in_either_frame(seed):
    """A force in the link's frame is the turned one in the world's; moment and point likewise; on all routes."""
    c = case(seed, fixed=0.3)
    rng = np.random.default_rng(seed)
    i = int(rng.integers(len(c.robot.links)))
    R, name = c.reference.link_poses(c.q)[i][:3, :3], c.robot.link_names[i]
    force, moment, point = rng.normal(size=(3, 3))
    in_link = Reference(rd.Scene(c.robot, loads=[rd.LinkWrench(name, force, moment, point, "link")]))
    in_world = Reference(rd.Scene(c.robot, loads=[rd.LinkWrench(name, R @ force, R @ moment, point, "world")]))
    tolerance = C * condition(c.robot, c.q) * EPS
    expected = in_link.forward_dynamics(c.q, c.v, c.tau)
    for route in ROUTES:
        assert error(in_link.forward_dynamics(c.q, c.v, c.tau, formalism=route), expected) < tolerance, route
        assert error(in_world.forward_dynamics(c.q, c.v, c.tau, formalism=route), expected) < tolerance, route


def test_a_wrench_at_a_point_is_one_at_the_origin_with_its_moment():
    c = case(9)
    name, force, point = c.robot.link_names[-1], np.array([1.0, -2.0, 3.0]), np.array([0.3, 0.1, -0.2])
    at_point = rd.LinkWrench(name, force, point=point, frame="link")
    at_origin = rd.LinkWrench(name, force, moment=np.cross(point, force), frame="link")
    one, other = (rd.Scene(c.robot, loads=[load]).bias_forces(c.q, c.v) for load in (at_point, at_origin))
    assert error(one, other) < C * EPS


def test_wrenches_on_one_body_add_up():
    """Two links of one lumped body, and one link twice."""
    robot = rd.load(ROBOTS / "ur5e.urdf")
    q, v = robot.random_state(np.random.default_rng(2))
    tip, before = robot.link_names[-1], robot.link_names[-2]
    loads = [
        rd.LinkWrench(tip, force=(1, 2, 3)),
        rd.LinkWrench(tip, force=(4, 0, 0), point=(0.1, 0, 0)),
        rd.LinkWrench(before, moment=(0, 1, 0)),
    ]
    bare = Reference(robot).bias_forces(q, v)
    together = Reference(rd.Scene(robot, loads=loads, declared=False)).bias_forces(q, v) - bare
    alone = sum(Reference(rd.Scene(robot, loads=[load], declared=False)).bias_forces(q, v) - bare for load in loads)
    assert np.allclose(together, alone, rtol=0, atol=C * EPS * max(1, abs(bare).max()))


def test_a_wrench_on_the_ground_moves_nothing():
    robot = rd.load(ROBOTS / "ur5e.urdf")
    q, v = robot.random_state(np.random.default_rng(2))
    scene = rd.Scene(robot, loads=[rd.LinkWrench(robot.link_names[0], force=(100, 200, 300))], declared=False)
    assert np.array_equal(scene.forward_dynamics(q, v), robot.forward_dynamics(q, v))


def test_the_ground_feels_a_wrench_on_the_base():
    robot = body_on(Revolute.from_axis(Z))
    pushed = rd.Scene(robot, loads=[rd.LinkWrench("base", force=(0.0, 0.0, -50.0), point=(0.2, 0.0, 0.0))])
    ground = pushed.reactions([0.0], [0.0])["ground"] - robot.reactions([0.0], [0.0])["ground"]
    assert np.allclose(ground, [0, -50 * 0.2, 0, 0, 0, 50], rtol=8 * EPS, atol=1e-13)


def test_a_fixed_joint_carries_the_wrench_on_its_link():
    """A tool on a flange on an arm at rest: the flange's reaction is the tool's weight and what pushes on it, minus what the arm yields."""
    zero = np.zeros((3, 3))
    links = (Link("base"), Link("arm", Inertia.about_centre(1.0, np.zeros(3), np.eye(3))), Link("tool", Inertia.about_centre(2.0, X, zero)))
    joints = (Joint(GROUND, Fixed(), -1), Joint("elbow", Prismatic.from_axis(X), 0), Joint("flange", Fixed(), 1, translation=0.5 * X))
    robot = rd.Robot("arm", links, joints)
    scene = rd.Scene(robot, loads=[rd.LinkWrench("tool", force=(6.0, 0.0, 4.0), point=(0.0, 0.3, 0.0))])
    # The slide gives way along x with 6 N / 3 kg = 2 m/s²: of the 6 N the flange passes on m_arm · 2.
    assert np.allclose(scene.forward_dynamics([0.0], [0.0]), [2.0], rtol=4 * EPS)
    flange = scene.reactions([0.0], [0.0])["flange"]
    F = np.array([2.0 * 2.0 - 6.0, 0.0, 2 * G - 4.0])
    M = np.cross(X, [4.0, 0.0, 2 * G]) - np.cross([0.0, 0.3, 0.0], [6.0, 0.0, 4.0])
    assert np.allclose(flange, [*M, *F], rtol=8 * EPS, atol=1e-13)
    # Halfway down the chain nothing of it is lost.
    elbow = scene.reactions([0.0], [0.0], part="total")["elbow"]
    assert np.allclose(elbow[3:], [0, 0, 3 * G - 4.0], rtol=8 * EPS, atol=1e-13)


# --- power -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(10))
def test_power_of_the_loads(seed):
    """Force times velocity for the joint loads; for wrenches the virtual work of η. Springs are in the potential instead."""
    c = case(seed, n=4, fixed=0.3)
    load = rd.LinkWrench(c.robot.link_names[-1], (1.0, 2.0, -3.0), (0.5, 0.1, 0.2), (0.1, 0.2, 0.3), ("link", "world")[seed % 2])
    loads = [load_of(law, c.robot)[0] for law in LAWS] + [load]
    equations = rd.Scene(c.robot, loads=loads).equations()
    acts = equations.applied(equations.state(0.0, c.q, c.v), c.tau)
    joint_power = sum(load_of(law, c.robot)[1](c.q, c.v) for law in LAWS[:3]) @ c.v
    wrench_power = virtual_work(c.robot, load, many_digits(c.q)).astype(float) @ c.v
    expected = joint_power + wrench_power + c.tau @ c.v
    assert np.isclose(acts.power, expected, rtol=0, atol=C * EPS * max(1.0, abs(joint_power), abs(wrench_power), abs(c.tau @ c.v)))


# --- control laws ------------------------------------------------------------------------------------------------------


def test_a_control_law_is_asked_state_by_state():
    """t a float, q (nq,), v (nv,), whatever the leading dimensions; its answer acts like tau."""
    c = case(3, n=3)
    asked = []

    def law(t, q, v):
        asked.append((type(t), q.shape, v.shape))
        return np.sin(t) - 2.0 * v

    scene = rd.Scene(c.robot, loads=[rd.ControlLaw(law)])
    found = scene.forward_dynamics(np.tile(c.q, (2, 3, 1)), c.v, c.tau, t=0.7, backend="numpy")
    assert found.shape == (2, 3, c.robot.nv)
    assert asked == [(float, (c.robot.nq,), (c.robot.nv,))] * 6
    expected = c.reference.forward_dynamics(c.q, c.v, c.tau + np.sin(0.7) - 2 * c.v)
    assert error(found[1, 2], expected) < C * condition(c.robot, c.q) * EPS


@pytest.mark.parametrize("backend", ["native", "numpy"])
def test_a_control_law_cannot_change_the_state(backend):
    """What it writes into is a copy, by either backend."""
    c = case(3, n=3)

    def greedy(t, q, v):
        q -= 1.0
        return v

    found = rd.Scene(c.robot, loads=[rd.ControlLaw(greedy)]).forward_dynamics(c.q, c.v, backend=backend)
    assert error(found, c.reference.forward_dynamics(c.q, c.v, c.v)) < C * condition(c.robot, c.q) * EPS


@pytest.mark.parametrize("seed", [3, 6])
def test_a_control_law_of_numpy_functions_by_default(seed):
    """Arithmetic and NumPy functions of t, q and v: the same forces whichever backend asks."""
    c = case(seed, n=3)
    scene = rd.Scene(c.robot, loads=[rd.ControlLaw(lambda t, q, v: np.sin(3 * t) * np.tanh(q.sum()) - 2.0 * v + np.sqrt(1 + v @ v))])
    expected = c.reference.forward_dynamics(c.q, c.v, c.tau + np.sin(3 * 0.7) * np.tanh(c.q.sum()) - 2.0 * c.v + np.sqrt(1 + c.v @ c.v))
    tolerance = C * condition(c.robot, c.q) * EPS
    for backend in ("native", "numpy"):
        assert error(scene.forward_dynamics(c.q, c.v, c.tau, t=0.7, backend=backend), expected) < tolerance


GAINS = np.array([1.0, 2.0, 0.5, 1.5, 3.0, 0.7])

NUMPY_LAWS = {
    "where": lambda t, q, v: np.where(v > 0, -1.0, 2.0) * np.abs(v),
    "limits": lambda t, q, v: np.minimum(np.maximum(-50 * q, -10), 10) + np.clip(-5 * v, -GAINS, GAINS) + (3 * q).clip(-1, 1),
    "functions": lambda t, q, v: -np.sign(v) * np.exp(-(v**2)) + np.log(1 + q**2) + np.tan(q) - np.arctan2(q, v),
    "conditions": lambda t, q, v: np.where((v > 0) & (q < 1) | ~(q >= 0.5), 1.0, v) + np.where(np.logical_and(v > -1, v < 1), q, 0.0),
    "equal conditions": lambda t, q, v: (
        np.where((q > 0) == (v > 0), q, v) + np.where((q > 0) != (v > 0.1), 1.0, 2.0) + np.where(((q > 0) & (v > 0)) == False, 3.0, v)  # noqa: E712
    ),
    "either": lambda t, q, v: (
        ((q > 0) ^ (v > 0)) * 2.0 + np.where(np.logical_xor(q[0] > 0, v > 0), q, 1.0) + np.where((q > 0) == 1.0, q, v)
    ),
    "conditions divided": lambda t, q, v: (q > 0) / 2.0 + 2.0 ** (v > 0) + 1.0 / (1.0 + (q > 0)),
    "whole numbers": lambda t, q, v: np.floor(q) - np.ceil(v) + np.rint(3 * q) * np.trunc(v) + np.fix(q) + np.round(v, 1) + q // 0.3,
    "angles": lambda t, q, v: -((q - GAINS + np.pi) % (2 * np.pi) - np.pi) + np.mod(v, -0.7) + np.fmod(q, 0.4) + np.degrees(np.deg2rad(v)),
    "roots": lambda t, q, v: np.hypot(q, v) + np.cbrt(v) + np.hypot(1.0, q) + np.mod(5.0, v) + 7.0 // q,
    "of one number": lambda t, q, v: np.where(q[0] > 0, GAINS, -GAINS) * np.where(t > 0.5, 1.0, 0.0) + np.clip(q[1], -0.1, 0.1) * v,
    "conditions as numbers": lambda t, q, v: (v > 0) * 5.0 - (v <= 0) * 3.0 + (q == 0) * 1.0,
    "over all": lambda t, q, v: -v * np.max(np.abs(q)) + q.min() + np.any(q > 1) * 1.0 + np.all(q > -9) * 1.0,
    "norms": lambda t, q, v: -v * np.linalg.norm(q) - v * np.sqrt(v @ v),
    "stacked": lambda t, q, v: np.where(np.stack([q[0], v[1], q[2], t, q[4], q[5]]) > 0.1, 1.0, 2.0),
    "mixed": lambda t, q, v: np.minimum(np.concatenate([q[:3], v[3:]]), 0.1) + np.minimum(t * GAINS, q[0] * GAINS),
    "powers": lambda t, q, v: np.abs(q) ** 1.5 + q**3 + 2.0**v + np.power(np.abs(q), v),
    "selected": lambda t, q, v: np.select([v > 1, v > 0], [q, v], -1.0),
    "array of entries": lambda t, q, v: np.array([-q[0], v[1], np.minimum(q[2], 0.0), t, 0.0, np.where(q[0] > 0, 1.0, q[1])]),
    "linear algebra": lambda t, q, v: np.diag(GAINS) @ q + np.outer(q, v) @ GAINS + np.dot(GAINS, v) + np.mean(q) + np.cumsum(q),
}


@pytest.mark.parametrize("kind", NUMPY_LAWS)
def test_control_laws_in_plain_numpy_compile(kind):
    """What NumPy computes on floats, the kernel computes: comparisons, choices, limits, reductions."""
    robot = rd.load(ROBOTS / "ur5e.urdf")
    rng = np.random.default_rng(7)
    scene = rd.Scene(robot, loads=[rd.ControlLaw(NUMPY_LAWS[kind])])
    for _ in range(5):
        q, v = robot.random_state(rng)
        found, expected = (scene.inverse_dynamics(q, v, v, t=0.7, backend=backend) for backend in ("native", "numpy"))
        assert error(found, expected) < C * EPS


@pytest.mark.parametrize("same", [lambda a, b: a == b, lambda a, b: a != b, lambda a, b: a ^ b])
def test_a_branch_on_equal_conditions_is_refused(same):
    robot = rd.load(ROBOTS / "ur5e.urdf")

    def law(t, q, v):
        return q if same(q[0] > 0, v[0] > 0) else -v

    with pytest.raises(rd.InputError, match=r"return q if same"):
        rd.Scene(robot, loads=[rd.ControlLaw(law)]).forward_dynamics(robot.neutral(), np.zeros(6))


def test_a_law_that_branches_is_told_how_to_choose():
    def law(t, q, v):
        return -v if q[0] > 0 else v

    def comparing(t, q, v):
        x = np.array([q[0], q[1], v[0]])
        return np.where(x > 0, 1.0, 2.0)

    c = case(3, n=3)
    for wrong, line in ((law, "return -v if"), (comparing, "return np.where")):
        with pytest.raises(rd.InputError, match=rf"test_loads\.py:\d+, `{line}.*truth value.*np\.where"):
            rd.Scene(c.robot, loads=[rd.ControlLaw(wrong)]).forward_dynamics(c.q, c.v)


class Integral:
    """A law with a memory."""

    def __init__(self):
        self.sum = 0.0

    def __call__(self, t, q, v):
        self.sum = self.sum + 0.001 * (1.0 - q[0])
        return -2.0 * v + self.sum


def remembering(kind, nv):
    """A law whose answer is no function of t, q and v."""
    count, rng = itertools.count(), np.random.default_rng(0)
    laws = {
        "counts": lambda t, q, v: np.full(nv, float(next(count))),
        "draws": lambda t, q, v: rng.normal(size=nv) - v,
        "integrates": Integral(),
    }
    return laws[kind]


@pytest.mark.parametrize("kind", ["counts", "draws", "integrates"])
def test_a_control_law_that_remembers_is_not_frozen_in_silence(kind):
    """Compiled, its first answer would hold for ever: it is refused with the way out, which follows it call by call."""
    c = case(3, n=2)
    with pytest.raises(rd.InputError, match=r"control law.*backend='numpy'"):
        rd.Scene(c.robot, loads=[rd.ControlLaw(remembering(kind, c.robot.nv))]).forward_dynamics(c.q, c.v)
    scene = rd.Scene(c.robot, loads=[rd.ControlLaw(remembering(kind, c.robot.nv))])
    first, second = (scene.forward_dynamics(c.q, c.v, backend="numpy") for _ in range(2))
    assert not np.array_equal(first, second)


def test_a_control_law_drives_mimic_joints_at_their_leader():
    robot = rd.load(ROBOTS / "panda.urdf")
    assert robot.nu > robot.nv
    q, v = robot.random_state(np.random.default_rng(0))
    tau = np.arange(1.0, robot.nv + 1)
    scene = rd.Scene(robot, loads=[rd.ControlLaw(lambda t, q, v: tau)], declared=False)
    assert error(Reference(scene).forward_dynamics(q, v), Reference(robot).forward_dynamics(q, v, tau)) < C * condition(robot, q) * EPS


@pytest.mark.parametrize(("answer", "shape"), [(1.0, r"\(\)"), ([1.0] * 7, r"\(7,\)"), ([[1.0]], r"\(1, 1\)")])
def test_the_answer_of_a_control_law_must_fit(answer, shape):
    c = case(3, n=3)
    scene = rd.Scene(c.robot, loads=[rd.ControlLaw(lambda t, q, v: answer)])
    with pytest.raises(
        rd.InputError, match=rf"control law returned an array of shape {shape} at t=0.5 s: it must be an array \({c.robot.nv},\)"
    ):
        scene.forward_dynamics(c.q, c.v, t=0.5, backend="numpy")
    with pytest.raises(rd.InputError, match=rf"control law returned an array of shape {shape}.*it must be an array \({c.robot.nv},\)"):
        scene.forward_dynamics(c.q, c.v)


@pytest.mark.parametrize("fault", [lambda: 1 / 0, lambda: np.linalg.inv(np.zeros((2, 2)))])
def test_a_control_law_that_divides_by_zero_is_not_taken_for_a_singular_robot(fault):
    scene = rd.Scene(case(3, n=3).robot, loads=[rd.ControlLaw(lambda t, q, v: fault())])
    with pytest.raises(rd.InputError, match=r"control law raised (ZeroDivisionError|LinAlgError) at t=0.5"):
        scene.forward_dynamics(*case(3, n=3).robot.random_state(np.random.default_rng(0)), t=0.5, backend="numpy")


def test_a_control_law_that_is_no_function_is_refused():
    with pytest.raises(rd.InputError, match="ControlLaw"):
        rd.Scene(case(3, n=3).robot, loads=[rd.ControlLaw(5.0)])


def test_a_control_law_is_of_float64():
    c = case(3, n=3)
    scene = rd.Scene(c.robot, loads=[rd.ControlLaw(lambda t, q, v: v)])
    with pytest.raises(rd.ModelError, match=r"ControlLaw.*mpmath"):
        scene.forward_dynamics(c.q, c.v, backend="mpmath")


# What is no force at all, and what the error says of it.
NO_FORCES = {
    "complex": (lambda t, q, v: -2j * v - q, r"complex number"),
    "one complex": (lambda t, q, v: [1.0, 0.0, 3j], r"complex number 0\+3j for 'joint_3'.*real numbers.*np\.real"),
    "complex without an imaginary part": (lambda t, q, v: np.zeros(3, complex), r"complex number 0\+0j for 'joint_1'.*real numbers"),
    "text": (lambda t, q, v: ["1.0", "2.0", "3.0"], r"returned \['1.0', '2.0', '3.0'\].*real numbers"),
    "objects": (lambda t, q, v: np.array([0.0, None, 0.0]), r"returned None for 'joint_2'.*real numbers"),
    "none": (lambda t, q, v: None, r"returned None.*an array \(3,\)"),
    "ragged": (lambda t, q, v: [[1.0], [1.0, 2.0], []], r"rows have different lengths.*an array \(3,\)"),
    "too short": (lambda t, q, v: [1.0, 2.0], r"shape \(2,\).*an array \(3,\)"),
    "too long": (lambda t, q, v: np.zeros(4), r"shape \(4,\).*an array \(3,\)"),
}


def refused_everywhere(scene, q, v, backend, message):
    """At one state and at several, in reactions and in simulations."""
    for ask in (
        lambda: scene.forward_dynamics(q, v, t=0.5, backend=backend),
        lambda: scene.forward_dynamics([q, q], v, backend=backend),
        lambda: scene.reactions(q, v, backend=backend),
        lambda: rd.simulate(scene, t_end=0.1, v0=v, backend=backend),
        lambda: rd.simulate_many(scene, t_end=0.1, v0=v),
    ):
        with pytest.raises(rd.InputError, match=message):
            ask()


def three():
    return rd.random_robot(np.random.default_rng(5), 3, joint_types=("revolute",))


@pytest.mark.filterwarnings("error::numpy.exceptions.ComplexWarning")
@pytest.mark.parametrize("backend", ["native", "numpy"])
@pytest.mark.parametrize("fault", NO_FORCES)
def test_laws_that_return_no_forces_are_refused(fault, backend):
    """By both kinds of law, at one state and in simulations, and never by leaving the imaginary part out."""
    (law, message), robot = NO_FORCES[fault], three()
    q = v = np.full(3, 0.2)
    scene = rd.Scene(robot, loads=[rd.ControlLaw(law)])
    refused_everywhere(scene, q, v, backend, f"control law.*{message}")
    scene = rd.Scene(robot, loads=[rd.Sampled(law, 0.01)])
    with pytest.raises(rd.InputError, match=f"sampled control law.*{message}"):
        scene.forward_dynamics(q, v, backend=backend)
    with pytest.raises(rd.SimulationError, match=f"sampled control law.*{message}") as caught:
        rd.simulate(scene, t_end=0.1, v0=v, backend=backend)
    assert isinstance(caught.value.__cause__, rd.InputError)


@pytest.mark.filterwarnings("error::numpy.exceptions.ComplexWarning")
@pytest.mark.parametrize("backend", ["native", "numpy"])
def test_a_law_may_answer_whole_numbers_and_truths(backend):
    robot, q = three(), np.array([0.2, -0.3, 0.4])
    for law, tau in ((lambda t, q, v: [1, -2, 3], [1.0, -2.0, 3.0]), (lambda t, q, v: q > 0, [1.0, 0.0, 1.0])):
        expected = robot.forward_dynamics(q, 0 * q, tau)
        for load in (rd.ControlLaw(law), rd.Sampled(law, 0.1)):
            found = rd.Scene(robot, loads=[load]).forward_dynamics(q, 0 * q, backend=backend)
            assert error(found, expected) < C * condition(robot, q) * EPS


# --- loads of the user's own -------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class EndStop(Load):
    """A one-sided spring in a joint, and a drag on a link that grows with the square of its speed, up to a limit."""

    joint: str
    link: str

    def joint_forces(self, state):
        i = state.mechanism.joint_index(self.joint)
        beta = state.position(i)
        return {i: np.where(beta > 0.1, -40.0 * (beta - 0.1) ** 1.5, 0.0 * beta)}

    def link_wrenches(self, state):
        i = state.mechanism.link_index(self.link)
        v, height = state.twist(i)[..., 3:], state.pose(i).r[..., 2:]
        drag = -np.minimum(np.linalg.norm(v, axis=-1, keepdims=True), 2.0) * v * np.where(height < 0.5, 1.0, 0.5)
        return {i: np.concatenate([0.0 * v, drag], axis=-1)}


def test_a_load_in_plain_numpy_runs_in_every_arithmetic():
    robot = rd.load(ROBOTS / "ur5e.urdf")
    scene, rng = rd.Scene(robot, loads=[EndStop("elbow_joint", "tool0")]), np.random.default_rng(3)
    for sign in (1, -1):
        q, v = robot.random_state(rng)
        q[2] = sign * abs(q[2])
        exact = scene.forward_dynamics(q, v, backend="mpmath")
        for backend in ("native", "numpy"):
            found = scene.forward_dynamics(q, v, backend=backend)
            assert type(found) is np.ndarray
            assert error(found, exact) < C * condition(robot, q) * EPS


@dataclass(frozen=True, eq=False)
class Gust(Load):
    """A force on a link that grows with time."""

    link: str

    def link_wrenches(self, state: State):
        wrench = np.zeros(6)
        wrench[3] = 10.0
        return {state.mechanism.link_index(self.link): wrench * np.asarray(state.t)[..., None]}


def test_a_load_that_varies_in_time():
    """Its acceleration and its reactions are those of the time that is asked for."""
    robot = body_on(Prismatic.from_axis(Z))
    scene = rd.Scene(robot, loads=[Gust("body")])
    for t in (0.0, 0.5, 2.0):
        assert np.allclose(scene.reactions([0.0], [0.0], t=t)["joint"][3], -10.0 * t, rtol=4 * EPS)
    trajectory = rd.simulate(scene, t_end=0.5, fps=4)
    assert np.allclose(trajectory.reactions()["joint"][:, 3], -10.0 * trajectory.t, rtol=4 * EPS, atol=1e-15)


@dataclass(frozen=True, eq=False)
class Wall(Load):
    """A spring that pushes on one side only, as NumPy chooses: it can be traced."""

    def joint_forces(self, state: State):
        x = state.position(1)
        return {1: np.where(x > 0, -100.0 * x, 0.0 * x)}


@dataclass(frozen=True, eq=False)
class BranchingWall(Load):
    """The same with Python's `if`: a branch on a value."""

    def joint_forces(self, state: State):
        x = state.position(1)
        return {1: -100.0 * x if (x > 0).all() else 0.0 * x}


def test_a_load_may_choose_with_numpy_and_not_with_if():
    """What branches cannot be traced: the error names the load and the way out; the readable reference runs it."""
    answers = [[-5.0], [0.0]]
    scene = rd.Scene(body_on(Prismatic.from_axis(Z)), gravity=NONE, loads=[Wall()])
    for backend in ("native", "numpy"):
        assert np.allclose(scene.forward_dynamics([[0.1], [-0.1]], [0.0], backend=backend), answers, rtol=4 * EPS)
    scene = rd.Scene(body_on(Prismatic.from_axis(Z)), gravity=NONE, loads=[BranchingWall()])
    with pytest.raises(rd.InputError, match=r"BranchingWall.*backend='numpy'"):
        scene.forward_dynamics([0.1], [0.0])
    found = [scene.forward_dynamics([x], [0.0], backend="numpy") for x in (0.1, -0.1)]
    assert np.allclose(found, answers, rtol=4 * EPS)


@dataclass(frozen=True, eq=False)
class Odd(Load):
    """Answers whatever it is told to."""

    forces: object = None
    wrenches: object = None

    def joint_forces(self, state):
        return self.forces(state) if self.forces else {}

    def link_wrenches(self, state):
        return self.wrenches(state) if self.wrenches else {}


ODD = {
    "complex force": (Odd(lambda s: {2: 1j * s.velocity(2)}), r"Odd.*complex number"),
    "complex root": (Odd(lambda s: {2: np.sqrt(s.velocity(2) + 0j)}), r"Odd.*complex number"),
    "constant complex force": (Odd(lambda s: {2: 2j}), r"Odd returned the complex number 0\+2j.*'joint_2'.*real numbers.*np\.real"),
    "text": (Odd(lambda s: {2: "1.0"}), r"Odd returned '1.0'.*'joint_2'.*real numbers of the shape \((2, )?1,?\)"),
    "nothing": (Odd(lambda s: {2: None}), r"Odd returned None.*'joint_2'"),
    "two forces": (Odd(lambda s: {2: np.ones(2)}), r"Odd returned an array of shape \(2,\).*'joint_2'.*of the shape \((2, )?1,?\)"),
    "force of a fixed joint": (
        Odd(lambda s: {0: np.ones(1)}),
        r"Odd returned an array of shape \(1,\).*'ground'.*of the shape \((2, )?0,?\)",
    ),
    "no such joint": (Odd(lambda s: {17: s.velocity(1)}), r"Odd gives forces to the joint 17: .*joint_index"),
    "a name": (Odd(lambda s: {"joint_2": s.velocity(2)}), r"Odd gives forces to the joint 'joint_2'.*joint_index"),
    "no dictionary": (Odd(lambda s: [1.0]), r"Odd.joint_forces returned \[1.0\].*dictionary"),
    "complex wrench": (Odd(None, lambda s: {3: np.full(6, 1j)}), r"Odd returned the complex number 0\+1j.*link 'link_3'"),
    "force alone": (
        Odd(None, lambda s: {3: np.ones(3)}),
        r"Odd returned an array of shape \(3,\).*link 'link_3'.*of the shape \((2, )?6,?\)",
    ),
    "no wrench": (Odd(None, lambda s: {3: None}), r"Odd returned None.*link 'link_3'"),
    "no such link": (Odd(None, lambda s: {"link_3": np.ones(6)}), r"Odd gives forces to the link 'link_3'.*link_index"),
}


@pytest.mark.filterwarnings("error::numpy.exceptions.ComplexWarning")
@pytest.mark.parametrize("backend", ["native", "numpy"])
@pytest.mark.parametrize("fault", ODD)
def test_loads_that_return_no_forces_are_refused(fault, backend):
    """By name, with what they act on, wherever the equations ask them."""
    (load, message), robot = ODD[fault], three()
    q = v = np.full(3, 0.2)
    scene = rd.Scene(robot, loads=[load])
    refused_everywhere(scene, q, v, backend, message)


@pytest.mark.parametrize("backend", ["native", "numpy"])
def test_one_number_is_the_force_of_every_freedom(backend):
    robot, load = body_on(Spherical()), Odd(lambda s: {1: 1.5})
    found = acceleration(robot, load, [1.0, 0, 0, 0], np.zeros(3), backend=backend)
    assert np.allclose(found, 1.5 / np.array([0.2, 0.3, 0.4]), rtol=8 * EPS)


@pytest.mark.parametrize("fault", [lambda: 1 / 0, lambda: np.linalg.inv(np.zeros((2, 2)))])
def test_a_load_that_divides_by_zero_is_not_taken_for_a_singular_robot(fault):
    scene = rd.Scene(three(), loads=[Odd(lambda s: {1: fault()})])
    with pytest.raises(rd.InputError, match=r"Odd raised (ZeroDivisionError|LinAlgError) at t=0.5 s"):
        scene.forward_dynamics(np.zeros(3), np.zeros(3), t=0.5, backend="numpy")


# --- what the file declares --------------------------------------------------------------------------------------------

DECLARES = """<robot name="damped"><link name="base"/>
  <link name="a"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="b"><inertial><mass value="3"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="a"/><axis xyz="1 0 0"/><dynamics damping="4" friction="0.5"/>
    <limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
  <joint name="turn" type="continuous"><parent link="base"/><child link="b"/><axis xyz="1 0 0"/><dynamics damping="0.3"/></joint></robot>"""


def test_what_the_file_declares_acts_in_a_scene():
    robot = rd.load(io.StringIO(DECLARES))
    q, v = [0.1, 0.2], [0.6, -0.7]
    assert [type(load).__name__ for load in rd.Scene(robot).all_loads] == ["JointDamping", "JointFriction"]
    expected = [(-4 * 0.6 - 0.5 * np.tanh(0.6 / 1e-2)) / 2, 0.3 * 0.7 / 1]
    assert np.allclose(rd.Scene(robot).forward_dynamics(q, v), expected, rtol=16 * EPS)
    assert np.allclose(rd.Scene(robot, declared=False).forward_dynamics(q, v), 0, atol=1e-15)
    assert np.allclose(robot.forward_dynamics(q, v), 0, atol=1e-15)  # rigid bodies and gravity alone


def test_declared_loads_stand_beside_the_given_ones():
    robot = rd.load(io.StringIO(DECLARES))
    scene = rd.Scene(robot, loads=[rd.JointForce({"slide": 1.0})])
    assert [type(load).__name__ for load in scene.all_loads] == ["JointForce", "JointDamping", "JointFriction"]
    assert len(scene.loads) == 1
    bare = rd.Scene(rd.load(ROBOTS / "pendulum.urdf"))
    assert bare.all_loads == ()


# --- compiled ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 3])
def test_every_load_compiled(seed):
    """Kernels and the readable reference: the same motion, inverse dynamics, energy and reactions under all loads at once."""
    c = case(seed, n=4, fixed=0.3)
    wrenches = [
        rd.LinkWrench(c.robot.link_names[k], (1.0, 2.0, -3.0), (0.5, 0.1, 0.2), (0.1, 0.2, 0.3), f) for k, f in ((-1, "link"), (0, "world"))
    ]
    scene = rd.Scene(c.robot, loads=[load_of(law, c.robot)[0] for law in LAWS] + wrenches)
    reference, tolerance = Reference(scene), C * condition(c.robot, c.q) * EPS
    states = [np.stack([x, 0.5 * x]) for x in (c.v, c.tau)]
    q = np.stack([c.q, c.q])
    assert error(scene.forward_dynamics(q, *states), reference.forward_dynamics(q, *states)) < tolerance
    assert error(scene.reactions(q, *states).array, reference.reactions(q, *states).array) < tolerance
    assert error(scene.inverse_dynamics(q, *states), reference.inverse_dynamics(q, *states)) < C * EPS
    assert error(scene.potential_energy(q), reference.potential_energy(q)) < C * EPS


# --- fifty digits ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_every_load_in_fifty_digits(seed):
    """Both arithmetics give the same motion, inverse dynamics, energy and reactions, to float64's own rounding."""
    c = case(seed, n=4, fixed=0.3)
    wrench = rd.LinkWrench(c.robot.link_names[-1], (1.0, 2.0, -3.0), (0.5, 0.1, 0.2), (0.1, 0.2, 0.3), ("link", "world")[seed % 2])
    for load in [load_of(law, c.robot)[0] for law in LAWS] + [wrench]:
        scene = rd.Scene(c.robot, loads=[load])
        tolerance = C * condition(c.robot, c.q) * EPS
        one, other = (scene.forward_dynamics(c.q, c.v, c.tau, backend=b) for b in ("numpy", "mpmath"))
        assert error(one, other) < tolerance
        assert isinstance(other[0], mpmath.mpf)
        one, other = (scene.reactions(c.q, c.v, c.tau, backend=b).array for b in ("numpy", "mpmath"))
        assert error(one, other) < tolerance
        one, other = (scene.potential_energy(c.q, backend=b) for b in ("numpy", "mpmath"))
        assert abs(one - other) < C * EPS * 100  # at most 25 kg, 10 m/s² and 0.5 m


@pytest.mark.parametrize("frame", ["link", "world"])
def test_a_wrench_is_exact_in_fifty_digits(frame, fifty_digits):
    """r × F among decimal numbers is no float64: the reference must not be rounded on its way."""
    robot = body_on(Spherical())
    load = rd.LinkWrench("body", force=(0.1, 0.7, 0.3), point=(0.3, 0.1, 0.9), frame=frame)
    found = -rd.Scene(robot, gravity=NONE, loads=[load]).bias_forces(robot.neutral(), np.zeros(3), backend="mpmath")
    r, F = many_digits(load.point), many_digits(load.force)
    exact = np.array([r[1] * F[2] - r[2] * F[1], r[2] * F[0] - r[0] * F[2], r[0] * F[1] - r[1] * F[0]])
    assert abs(found - exact).max() < 1e-45


# --- refused by name ---------------------------------------------------------------------------------------------------


def robot_of_many():
    links = tuple(Link(name, Inertia.about_centre(1.0, X, np.eye(3))) for name in ("base", "upper", "ball", "plate"))
    kinds = (Fixed(), Revolute.from_axis(Z), Spherical(), Fixed())
    return rd.Robot(
        "many", links, tuple(Joint(n, k, i - 1) for i, (n, k) in enumerate(zip((GROUND, "elbow", "hip", "weld"), kinds, strict=True)))
    )


@pytest.mark.parametrize("load", [rd.JointForce, rd.JointDamping, rd.JointFriction, rd.JointSpring])
@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"elbw": 1.0}, r"no joint named 'elbw': did you mean 'elbow'"),
        ({"weld": 1.0}, r"'weld'.*fixed.*no freedom"),
        ({"ground": 1.0}, r"'ground'.*fixed.*no freedom"),
        ({"elbow": (1.0, 2.0)}, r"'elbow'.*one finite number"),
        ({"hip": (1.0, 2.0)}, r"'hip'.*3 of them"),
        ({"elbow": np.nan}, r"'elbow'.*nan"),
        ({"elbow": np.inf}, r"'elbow'.*inf"),
        ({"elbow": "strong"}, r"'elbow'.*'?strong"),
        ({"elbow": None}, r"'elbow'"),
    ],
)
def test_values_that_fit_no_joint(load, values, message):
    with pytest.raises(rd.RobodynError, match=message):
        rd.Scene(robot_of_many(), loads=[load(values)])


@pytest.mark.parametrize(
    ("load", "what"), [(rd.JointForce, "force"), (rd.JointDamping, "damping"), (rd.JointFriction, "friction"), (rd.JointSpring, "spring")]
)
def test_a_number_for_all_joints_is_not_guessed(load, what):
    with pytest.raises(rd.InputError, match=rf"{what}.*0\.5"):
        rd.Scene(robot_of_many(), loads=[load(0.5)])


@pytest.mark.parametrize(("load", "what"), [(rd.JointDamping, "damping"), (rd.JointFriction, "friction")])
def test_what_would_drive_instead_of_brake(load, what):
    with pytest.raises(rd.InputError, match=rf"{what} of joint 'elbow' is .*-1.*not be negative"):
        rd.Scene(robot_of_many(), loads=[load({"elbow": -1.0})])
    with pytest.raises(rd.InputError, match=rf"{what} of joint 'hip'"):
        rd.Scene(robot_of_many(), loads=[load({"hip": (1.0, -1.0, 0.0)})])


@pytest.mark.parametrize("width", [0.0, -1.0, np.nan])
def test_friction_needs_a_width(width):
    with pytest.raises(rd.InputError, match=r"width=.*positive"):
        rd.Scene(robot_of_many(), loads=[rd.JointFriction({"elbow": 1.0}, width=width)])


def test_springs_need_angles_or_displacements():
    with pytest.raises(rd.InputError, match=r"'hip' is spherical.*angles or displacements"):
        rd.Scene(robot_of_many(), loads=[rd.JointSpring({"hip": 1.0})])
    with pytest.raises(rd.InputError, match=r"rest positions.*'elbow'"):
        rd.Scene(robot_of_many(), loads=[rd.JointSpring({}, rest={"elbow": 1.0})])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"link": "plte"}, "no link named 'plte': did you mean 'plate'"),
        ({"frame": "child"}, "'plate'.*frame='child'.*'link' or 'world'"),
        ({"force": (1.0, 2.0)}, "'plate'.*force.*three finite numbers"),
        ({"force": 5.0}, "'plate'.*force.*three finite numbers"),
        ({"moment": (1.0, 2.0, np.nan)}, "'plate'.*moment.*three finite numbers"),
        ({"point": (np.inf, 0.0, 0.0)}, "'plate'.*point.*three finite numbers"),
        ({"force": "down"}, "'plate'.*force"),
        ({"force": (0.0, None, 0.0)}, "'plate'.*force"),
    ],
)
def test_wrenches_that_fit_nothing(options, message):
    with pytest.raises(rd.RobodynError, match=message):
        rd.Scene(robot_of_many(), loads=[rd.LinkWrench(**{"link": "plate", **options})])


@pytest.mark.parametrize("loads", ["damping", [0.5], [rd.JointDamping], [None], rd.JointDamping({"elbow": 1.0}), None, 3.0])
def test_what_is_no_list_of_loads(loads):
    with pytest.raises(rd.InputError, match="loads"):
        rd.Scene(robot_of_many(), loads=loads)


def test_a_load_is_a_record_of_its_own():
    """Whoever changes the numbers they gave afterwards does not change the scene."""
    robot, damping, force = body_on(Prismatic.from_axis(X)), {"joint": 1.0}, np.array([2.0, 0.0, 0.0])
    scene = rd.Scene(robot, loads=[rd.JointDamping(damping), rd.LinkWrench("body", force=force)])
    before = scene.forward_dynamics([0.0], [1.0])
    damping["joint"] = -5.0
    force[:] = 100.0
    assert np.array_equal(scene.forward_dynamics([0.0], [1.0]), before)


# --- what a user may do with what he is given, and with what he gave ---------------------------------------------------


@pytest.mark.parametrize(
    "law",
    [
        lambda t, q, v: np.clip(-500.0 * q, a_min=-5.0, a_max=5.0),
        lambda t, q, v: np.clip(-500.0 * q, -5.0, a_max=5.0),
        lambda t, q, v: np.clip(-500.0 * q, min=-5.0, max=5.0),
        lambda t, q, v: np.clip(tau := -500.0 * q, -5.0, 5.0, out=tau),
    ],
    ids=["a_min a_max", "mixed", "min max", "out"],
)
def test_clip_limits_a_compiled_law_however_it_is_written(law):
    robot = rd.random_robot(np.random.default_rng(5), 4, joint_types=("revolute",))
    scene = rd.Scene(robot, gravity=NONE, loads=[rd.ControlLaw(law)])
    q, v = np.array([0.5, -0.001, 0.002, -0.7]), np.zeros(4)
    expected = robot.forward_dynamics(q, v, np.clip(-500.0 * q, -5.0, 5.0), gravity=NONE)
    for backend in ("native", "numpy"):
        assert error(scene.forward_dynamics(q, v, backend=backend), expected) < C * condition(robot, q) * EPS


def test_a_law_may_write_into_the_state_that_it_is_given():
    """It is a copy: the robot's own state stays what it is."""

    def law(t, q, v):
        v[2:] = 0.0
        return -5.0 * v

    robot = rd.random_robot(np.random.default_rng(6), 4, joint_types=("revolute",))
    scene, (q, v) = rd.Scene(robot, loads=[rd.ControlLaw(law)]), robot.random_state(np.random.default_rng(7))
    expected = robot.forward_dynamics(q, v, np.concatenate([-5.0 * v[:2], [0.0, 0.0]]))
    for backend in ("native", "numpy"):
        assert error(scene.forward_dynamics(q, v, backend=backend), expected) < C * condition(robot, q) * EPS


def test_a_load_keeps_the_numbers_that_it_was_given():
    """A kernel compiled before the user's array changes and one compiled after answer alike."""
    robot = rd.random_robot(np.random.default_rng(8), 3, joint_types=("revolute",))
    name, coefficient, force = robot.joint_names[0], np.array([5.0]), np.array([1.0, 2.0, 3.0])
    scene = rd.Scene(robot, loads=[rd.JointDamping({name: coefficient}), rd.LinkWrench(robot.link_names[-1], force=force)])
    q, v = robot.random_state(np.random.default_rng(9))
    a = scene.forward_dynamics(q, v)
    coefficient[0], force[:] = 500.0, 100.0
    M = robot.mass_matrix(q)
    assert abs(scene.inverse_dynamics(q, v, a)).max() <= C * EPS * (abs(M) @ abs(a)).max() * np.linalg.cond(M)


class Gain:
    """A law, and a load, whose gain may change."""

    k = 10.0

    def __call__(self, t, q, v):
        return -self.k * q


class Spring(Load):
    """The same as a load of one's own, that looks at its giver."""

    gain = Gain()

    def joint_forces(self, state):
        return {1: -self.gain.k * state.position(1)}


@pytest.mark.parametrize("kind", ["law", "load"])
def test_gains_that_change_after_compiling_are_not_mixed_with_the_old_ones(kind):
    pendulum = rd.load(ROBOTS / "pendulum.urdf")
    gain = Gain() if kind == "law" else Spring.gain
    load = rd.ControlLaw(gain) if kind == "law" else Spring()
    scene = rd.Scene(pendulum, loads=[load, rd.JointDamping({"hinge": 0.1})])
    try:
        first = rd.simulate(scene, t_end=0.1, q0=[0.2])
        assert np.array_equal(rd.simulate(scene, t_end=0.1, q0=[0.2]).q, first.q)
        rd.simulate_many(scene, t_end=0.1, q0=[0.2])
        gain.k = 100.0
        for again in (
            lambda: rd.simulate(scene, t_end=0.1, q0=[0.2]),
            lambda: rd.simulate(scene, t_end=0.1, q0=[0.2], method="rk4"),
            lambda: rd.simulate(scene, t_end=0.1, q0=[0.2], method="radau"),
            lambda: rd.simulate_many(scene, t_end=0.1, q0=[0.2]),
            lambda: scene.reactions([0.2], [0.0]),  # a kernel that is not there yet
        ):
            with pytest.raises(rd.InputError, match=rf"the load {type(load).__name__} gives other forces than when.*new rd\.Scene"):
                again()
        if kind == "law":  # what joints carried at known forces is no matter of a law
            assert np.isfinite(first.reactions().array).all()
        new = rd.simulate(rd.Scene(pendulum, loads=[load, rd.JointDamping({"hinge": 0.1})]), t_end=0.1, q0=[0.2])
        asked = rd.simulate(scene, t_end=0.1, q0=[0.2], backend="numpy")  # asks the law itself
        assert np.allclose(new.q, asked.q, rtol=1e-8)
        assert abs(new.q[-1] - first.q[-1]) > 1e-3
    finally:
        gain.k = 10.0


def test_what_loads_have_no_part_in_does_not_ask_them():
    def law(t, q, v):
        return -q if q[0] > 0 else q

    scene = rd.Scene(rd.load(ROBOTS / "pendulum.urdf"), loads=[rd.ControlLaw(law)])
    assert scene.link_poses([0.1]).shape[-2:] == (4, 4)
    assert scene.mass_matrix([0.1]) > 0
    assert scene.kinetic_energy([0.1], [0.2]) > 0
    assert scene.momentum([0.1], [0.2]).shape == (6,)
    with pytest.raises(rd.InputError, match="cannot be compiled"):
        scene.forward_dynamics([0.1], [0.2])
