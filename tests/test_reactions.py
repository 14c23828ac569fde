"""Reactions: every link in equilibrium by accelerations that only `link_poses` gave, frames and parts, and cases worked by hand."""

import io
from dataclasses import replace
from pathlib import Path

import mpmath
import numpy as np
import pytest
from tools import EPS, SEEDS, Reference, case, condition, derivative, error, many_digits

import robodyn as rd
from robodyn.joints import Fixed, Prismatic, Revolute, Spherical
from robodyn.model import GROUND, Inertia, Joint, Link, Mimic

ROBOTS = Path(__file__).parents[1] / "robots"
C = 50  # roundings along a path of up to 8 bodies, each a product of 3 × 3 matrices
G = 9.81
X, Y, Z = np.eye(3)


@pytest.fixture
def fifty_digits():
    with mpmath.workdps(50):
        yield


def axial(A):
    """The vector of an antisymmetric part: Σ m r × a from Σ m a rᵀ."""
    return np.array([A[2, 1] - A[1, 2], A[0, 2] - A[2, 0], A[1, 0] - A[0, 1]])


def matter(inertia):
    """Σ m (ρ, 1)(ρ, 1)ᵀ (4, 4) in 50 digits: the mass distribution as homogeneous coordinates see it."""
    P = np.zeros((4, 4), dtype=object)
    tensor = many_digits(inertia.tensor)
    P[:3, :3] = np.trace(tensor) / 2 * np.eye(3) - tensor
    P[:3, 3] = P[3, :3] = many_digits(inertia.moment)
    P[3, 3] = mpmath.mpf(inertia.mass)
    return P


def second_derivative(robot, q, v, vdot):
    """T̈ (nlinks, 4, 4) of all link poses on the path q + h q̇ + h² q̈ / 2, by a difference in 50 digits (truncation 1e-24)."""
    equations = rd.Scene(robot).equations("mpmath")

    def rate(x):
        with mpmath.workdps(50):
            return equations.rate(x[: robot.nq], x[robot.nq :])

    x = np.concatenate([q, v])
    qdot = rate(x)
    qddot = derivative(rate, x, np.concatenate([qdot, vdot]))
    h = mpmath.mpf(10) ** -12
    before, now, after = (robot.link_poses(q + s * h * qdot + (s * h) ** 2 / 2 * qddot, backend="mpmath") for s in (-1, 0, 1))
    return now, (after - 2 * now + before) / h**2


def about_origin(wrench, point):
    """A wrench in the world's frame about the world's origin."""
    return np.concatenate([wrench[:3] + cross(point, wrench[3:]), wrench[3:]])


def cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


# --- every link in equilibrium -----------------------------------------------------------------------------------------


def everything(robot, rng):
    """One load of every kind that fits a robot: in joints, and on a link that moves, on one on a fixed joint, on the root."""
    moving = [joint.name for joint in robot.joints if joint.type.nv]
    springs = {joint.name: 3.0 for joint in robot.joints if joint.type.nv and not joint.type.rated}
    fixed = [robot.links[i].name for i, joint in enumerate(robot.joints) if i and not joint.type.nv]
    on = {robot.link_names[-1], robot.link_names[0], *fixed[:1]}
    wrenches = [
        rd.LinkWrench(link, force=rng.normal(size=3), moment=rng.normal(size=3), point=rng.normal(size=3), frame=frame)
        for link, frame in zip(sorted(on), ("link", "world", "link"), strict=False)
    ]
    return [
        rd.JointForce(dict.fromkeys(moving, 0.7)),
        rd.JointDamping(dict.fromkeys(moving, 0.4)),
        rd.JointFriction(dict.fromkeys(moving, 0.2), width=0.5),
        rd.JointSpring(springs, rest=dict.fromkeys(springs, 0.1)),
        *wrenches,
    ]


def assert_equilibrium(scene, q, v, tau, tolerance=1e-19):
    """Σ m (r × r̈, r̈) = wrench of the own joint − wrenches of the children's joints + weight + applied, for each link alone."""
    robot = scene.robot
    q, v, tau = (many_digits(x) for x in (q, v, tau))
    vdot = scene.forward_dynamics(q, v, tau, backend="mpmath")
    r = scene.reactions(q, v, tau, backend="mpmath", frame="world", part="total")
    T, Tddot = second_derivative(robot, q, v, vdot)
    carried = [about_origin(r[joint.name], T[i][:3, 3]) for i, joint in enumerate(robot.joints)]
    scale = max(1, max(abs(f).max() for f in carried))
    for i, link in enumerate(robot.links):
        P = matter(link.inertia)
        needed = np.concatenate([axial(Tddot[i][:3] @ P @ T[i][:3].T), (Tddot[i] @ P)[:3, 3]])
        g = many_digits(scene.gravity)
        weight = np.concatenate([cross((T[i] @ P)[:3, 3], g), link.inertia.mass * g])
        found = carried[i] + weight - sum((carried[k] for k, joint in enumerate(robot.joints) if joint.parent == i), np.zeros(6))
        for load in scene.loads:
            if isinstance(load, rd.LinkWrench) and load.link == link.name:
                R = T[i][:3, :3] if load.frame == "link" else np.eye(3)
                F, M = R @ many_digits(load.force), R @ many_digits(load.moment)
                found = found + about_origin(np.concatenate([M, F]), (T[i] @ [*many_digits(load.point), 1])[:3])
        assert abs(found - needed).max() < tolerance * scale, link.name


@pytest.mark.parametrize("seed", range(20))
def test_every_link_is_in_equilibrium(seed, fifty_digits):
    """The sum of wrenches on each link is its rate of momentum, from accelerations by differences of `link_poses` alone."""
    c = case(seed, n=5, fixed=0.4)
    gravity = (0.4, -0.8, -9.81)
    assert_equilibrium(rd.Scene(c.robot, gravity, everything(c.robot, np.random.default_rng(seed))), c.q, c.v, c.tau)


def test_every_link_of_a_robot_with_mimic_joints_is_in_equilibrium(fifty_digits):
    robot = rd.load(ROBOTS / "panda.urdf")
    q, v = robot.random_state(np.random.default_rng(1))
    tau = np.linspace(-2.0, 2.0, robot.nv)
    assert_equilibrium(rd.Scene(robot, loads=[rd.LinkWrench(robot.link_names[-1], force=(5.0, -3.0, 8.0))]), q, v, tau)


def test_a_wrench_on_the_base_alone_reaches_the_ground(fifty_digits):
    """The base is fixed and nothing else is loaded: the ground carries it all the same."""
    c = case(1, n=3, floating_base=False)
    load = rd.LinkWrench(c.robot.link_names[0], force=(3.0, -5.0, 7.0), moment=(0.1, 0.2, 0.3), point=(0.1, 0.0, 0.4))
    assert_equilibrium(rd.Scene(c.robot, loads=[load]), c.q, c.v, c.tau)


# --- parts and frames --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_frames_turn_into_each_other(seed):
    """The same wrench about the same point: world = R_child child = R_parent parent, with the rotations of `link_poses`."""
    c = case(seed)
    T = c.reference.link_poses(c.q)
    for part in ("constraint", "total"):
        child, parent, world = (c.reference.reactions(c.q, c.v, c.tau, frame=f, part=part) for f in ("child", "parent", "world"))
        scale = abs(world.array).max()
        assert (child.frame, parent.frame, world.frame, world.part) == ("child", "parent", "world", part)
        for i, joint in enumerate(c.robot.joints):
            R_parent = T[joint.parent][:3, :3] if joint.parent >= 0 else np.eye(3)
            for f, R in ((child, T[i][:3, :3]), (parent, R_parent)):
                turned = np.concatenate([R @ f[joint.name][:3], R @ f[joint.name][3:]])
                # Two rotations along the tree, of a wrench already known: no κ.
                assert abs(turned - world[joint.name]).max() < C * EPS * scale, joint.name


@pytest.mark.parametrize("seed", SEEDS)
def test_total_is_constraint_plus_what_the_joint_forces_transmit(seed):
    """part="total" − part="constraint" = W u, with u of actuator, spring, damping and friction; zero for fixed joints."""
    c = case(seed, n=5)
    loads = everything(c.robot, np.random.default_rng(seed))
    scene = Reference(rd.Scene(c.robot, loads=loads))
    constraint, total = (scene.reactions(c.q, c.v, c.tau, part=part) for part in ("constraint", "total"))
    scale = abs(total.array).max()
    for i, joint in enumerate(c.robot.joints):
        q, v = c.q[c.robot.q_slices[i]], c.v[c.robot.v_slices[i]]
        u = c.tau[c.robot.v_slices[i]] + 0.7 - 0.4 * v - 0.2 * np.tanh(v / 0.5)
        if not joint.type.rated:
            u = u - 3.0 * (q - 0.1)
        expected = joint.type.actuation(q) @ u if joint.type.nv else np.zeros(6)
        assert abs(total[joint.name] - constraint[joint.name] - expected).max() < C * EPS * scale, joint.name
        # The constraint wrench does no work on the free motion; κ carries the rounding of η̇ into it.
        if joint.type.nv:
            tolerance = C * condition(c.robot, c.q) * EPS * scale
            assert abs(joint.type.motion(q).T @ constraint[joint.name]).max() < tolerance, joint.name


def test_the_default_is_the_constraint_part_in_the_childs_frame():
    c = case(2)
    default, named = c.reference.reactions(c.q, c.v, c.tau), c.reference.reactions(c.q, c.v, c.tau, frame="child", part="constraint")
    assert np.array_equal(default.array, named.array)
    assert (default.frame, default.part) == ("child", "constraint")


# --- the record that comes back ----------------------------------------------------------------------------------------


def test_joints_can_be_chosen_and_ordered():
    c = case(5, n=6)
    every = c.robot.reactions(c.q, c.v, c.tau)
    assert every.joint_names == c.robot.all_joint_names
    names = [c.robot.all_joint_names[k] for k in (4, 0, 2)]
    chosen = c.robot.reactions(c.q, c.v, c.tau, joints=iter(names))
    assert chosen.joint_names == tuple(names)
    assert np.array_equal(chosen.array, every.array[[4, 0, 2]])


def test_reactions_read_like_a_mapping():
    c = case(5, n=3)
    r = c.robot.reactions(c.q, c.v)
    assert list(r) == list(c.robot.all_joint_names)
    assert len(r) == 4
    assert "joint_2" in r
    assert dict(r)["joint_2"] is not None
    assert np.array_equal(r["joint_2"], r.array[2])
    assert repr(r) == "<Reactions of 4 joints, constraint part in the child frame, array (4, 6)>"


def test_a_mapping_answers_questions_about_names_it_does_not_have():
    c = case(5, n=3)
    r = c.robot.reactions(c.q, c.v)
    assert "elbow" not in r
    assert r.get("elbow") is None
    with pytest.raises(rd.ModelError, match=r"'elbow'.*joint_1"):
        r["elbow"]


def test_no_joints_chosen():
    c = case(5, n=3)
    r = c.robot.reactions(np.tile(c.q, (2, 3, 1)), c.v, joints=[])
    assert r.array.shape == (2, 3, 0, 6)


@pytest.mark.parametrize("batch", [(), (0,), (1,), (2, 3)])
def test_a_robot_that_cannot_move_still_carries_itself(batch):
    inertia = Inertia.about_centre(2.0, np.array([0.5, 0.0, 0.0]), np.eye(3))
    robot = rd.Robot("statue", (Link("plinth", inertia), Link("arm", inertia)), (Joint(GROUND, Fixed(), -1), Joint("weld", Fixed(), 0)))
    r = robot.reactions(np.zeros((*batch, 0)), np.zeros((*batch, 0)))
    assert r.array.shape == (*batch, 2, 6)
    assert np.allclose(r["weld"], [0, -2 * G * 0.5, 0, 0, 0, 2 * G], rtol=4 * EPS)
    assert np.allclose(r["ground"], [0, -2 * 2 * G * 0.5, 0, 0, 0, 4 * G], rtol=4 * EPS)


@pytest.mark.parametrize("batch", [(0,), (1,), (2, 3)])
def test_batches_of_reactions(batch):
    c = case(7, n=5, fixed=0.3)
    r = c.robot.reactions(np.tile(c.q, (*batch, 1)), np.tile(c.v, (*batch, 1)), c.tau, frame="parent")
    assert r.array.shape == (*batch, 6, 6)
    assert r["joint_1"].shape == (*batch, 6)


# --- worked by hand ----------------------------------------------------------------------------------------------------


def solid(mass, centre=(0.0, 0.0, 0.0)):
    return Inertia.about_centre(mass, np.array(centre), np.diag([0.2, 0.3, 0.4]))


def chain(*parts):
    """A robot from (joint type, translation, inertia) each, in a row on a base of 5 kg."""
    links, joints = [Link("base", solid(5.0))], [Joint(GROUND, Fixed(), -1)]
    for i, (kind, translation, inertia) in enumerate(parts):
        links.append(Link(f"link_{i + 1}", inertia))
        joints.append(Joint(f"joint_{i + 1}", kind, i, translation=np.array(translation)))
    return rd.Robot("chain", tuple(links), tuple(joints))


def test_a_hanging_mass():
    """3 kg at rest below a ball joint: the joint pulls up with the weight, and carries no moment."""
    robot = chain((Spherical(), (0.0, 0.0, 1.0), solid(3.0, (0.0, 0.0, -0.6))))
    r = robot.reactions(robot.neutral(), np.zeros(3))
    assert np.allclose(r["joint_1"], [0, 0, 0, 0, 0, 3 * G], rtol=4 * EPS, atol=1e-14)
    assert np.allclose(r["ground"], [0, 0, 0, 0, 0, 8 * G], rtol=4 * EPS, atol=1e-14)


def test_a_cantilever():
    """Two beams of 2 kg and 1 m welded in a row along x: moments −y of m g l/2 at the second weld, of 2 m g l at the first."""
    robot = chain((Fixed(), (0, 0, 0), solid(2.0, (0.5, 0, 0))), (Fixed(), (1, 0, 0), solid(2.0, (0.5, 0, 0))))
    r = robot.reactions([], [])
    assert np.allclose(r["joint_2"], [0, -2 * G / 2, 0, 0, 0, 2 * G], rtol=4 * EPS)
    assert np.allclose(r["joint_1"], [0, -4 * G, 0, 0, 0, 4 * G], rtol=4 * EPS)


def test_a_held_arm():
    """A horizontal arm about y, held by its motor: all of the moment is the motor's, none is left to the bearing."""
    robot = chain((Revolute.from_axis(Y), (0, 0, 0), solid(2.0, (0.5, 0, 0))))
    tau = robot.inverse_dynamics([0.0], [0.0], [0.0])
    assert np.allclose(tau, [-2 * G * 0.5], rtol=4 * EPS)
    constraint, total = (robot.reactions([0.0], [0.0], tau, part=part)["joint_1"] for part in ("constraint", "total"))
    assert np.allclose(constraint, [0, 0, 0, 0, 0, 2 * G], rtol=4 * EPS, atol=1e-14)
    assert np.allclose(total, [0, -2 * G * 0.5, 0, 0, 0, 2 * G], rtol=4 * EPS, atol=1e-14)


def test_a_mass_on_a_turntable():
    """2 kg at 0.5 m on a table turning at 3 rad/s: the bearing pulls inwards with m ω² r, in the table's frame and in the world's."""
    robot = chain((Revolute.from_axis(Z), (0, 0, 0), solid(2.0, (0.5, 0, 0))))
    angle = 0.8
    child, world = (robot.reactions([angle], [3.0], gravity=(0, 0, 0), frame=f)["joint_1"] for f in ("child", "world"))
    assert np.allclose(child, [0, 0, 0, -9.0, 0, 0], rtol=4 * EPS, atol=1e-14)
    assert np.allclose(world[3:], [-9 * np.cos(angle), -9 * np.sin(angle), 0], rtol=4 * EPS, atol=1e-14)


def test_an_elevator():
    """A slide pushed up with 50 N: its bearings carry the moment of the eccentric load, m (g + a) times the lever."""
    robot = chain((Prismatic.from_axis(Z), (0, 0, 0), solid(2.0, (0.3, 0, 0))))
    a = 50 / 2 - G
    assert np.allclose(robot.forward_dynamics([0.0], [0.0], [50.0]), [a], rtol=4 * EPS)
    r = robot.reactions([0.0], [0.0], [50.0])
    assert np.allclose(r["joint_1"], [0, -50 * 0.3, 0, 0, 0, 0], rtol=8 * EPS, atol=1e-13)
    assert np.allclose(robot.reactions([0.0], [0.0], [50.0], part="total")["joint_1"][3:], [0, 0, 50], rtol=8 * EPS, atol=1e-13)
    assert np.allclose(r["ground"][3:], [0, 0, 5 * G + 50], rtol=8 * EPS, atol=1e-13)


def test_two_coupled_fingers():
    """One motor, two fingers of 1 and 3 kg that rise together: the coupling passes 3/4 of the motor's force to the second.

    Its reaction along the free axes is the coupling's, equal and opposite: Cᵀ f̌ᵖ = 0 holds for the sum over both fingers.
    """
    base, one, two = (Link(name, solid(m)) for name, m in (("base", 5.0), ("one", 1.0), ("two", 3.0)))
    slide = Joint("motor", Prismatic.from_axis(Z), 0)
    robot = rd.Robot("gripper", (base, one, two), (Joint(GROUND, Fixed(), -1), slide, replace(slide, name="follower", mimic=Mimic(1))))
    u = 80.0
    assert np.allclose(robot.forward_dynamics([0.0], [0.0], [u]), [u / 4 - G], rtol=4 * EPS)
    r = robot.reactions([0.0], [0.0], [u])
    assert np.allclose(r["follower"], [0, 0, 0, 0, 0, 0.75 * u], rtol=8 * EPS, atol=1e-13)
    assert np.allclose(r["motor"], [0, 0, 0, 0, 0, -0.75 * u], rtol=8 * EPS, atol=1e-13)

    # The follower moves the other way, at half the speed: (m₁ + m₂/4) a = u − (m₁ − m₂/2) g.
    opposite = replace(robot, joints=(*robot.joints[:2], replace(robot.joints[2], mimic=Mimic(1, -0.5, 0.2))))
    a = (u - (1 - 1.5) * G) / 1.75
    assert np.allclose(opposite.forward_dynamics([0.0], [0.0], [u]), [a], rtol=8 * EPS)
    r = opposite.reactions([0.0], [0.0], [u])
    assert np.allclose(r["follower"][5], 3 * (G - a / 2), rtol=8 * EPS)
    assert np.allclose(r["motor"][5], 0.5 * r["follower"][5], rtol=8 * EPS)


def test_the_force_of_a_damped_follower_is_its_own():
    """Damping in a mimic joint is transmitted there: part="total" shows it, part="constraint" leaves it out."""
    base, one, two = (Link(name, solid(m)) for name, m in (("base", 5.0), ("one", 1.0), ("two", 3.0)))
    slide = Joint("motor", Prismatic.from_axis(Z), 0)
    robot = rd.Robot("gripper", (base, one, two), (Joint(GROUND, Fixed(), -1), slide, replace(slide, name="follower", mimic=Mimic(1, 2.0))))
    scene = rd.Scene(robot, loads=[rd.JointDamping({"follower": 4.0})])
    # The follower moves at 2 η and feels −4 · 2 η; the leader's coordinate feels twice that.
    assert np.allclose(scene.bias_forces([0.0], [1.5]) - robot.bias_forces([0.0], [1.5]), [2 * 4 * 2 * 1.5], rtol=8 * EPS)
    constraint, total = (scene.reactions([0.0], [1.5], part=part)["follower"] for part in ("constraint", "total"))
    assert np.allclose(total - constraint, [0, 0, 0, 0, 0, -4 * 2 * 1.5], rtol=8 * EPS)


@pytest.mark.parametrize("file", ["ur5e", "panda", "puma560", "lecture_tree", "hand", "scara"])
def test_the_ground_carries_the_weight_of_a_robot_at_rest(file):
    """Held still in any position, force: Σ m g upwards; moment: the weight at the centre of mass."""
    robot = Reference(rd.load(ROBOTS / f"{file}.urdf"))
    q, _ = robot.random_state(np.random.default_rng(4))
    v = np.zeros(robot.nv)
    ground = robot.reactions(q, v, robot.inverse_dynamics(q, v, v), frame="world")["ground"]
    mass = sum(link.inertia.mass for link in robot.links)
    T = robot.link_poses(q)
    moment = sum(x.inertia.mass * T[i][:3, 3] + T[i][:3, :3] @ x.inertia.moment for i, x in enumerate(robot.links))
    # Held by forces that were rounded, it accelerates by κ eps: the inertia forces of that are on the same scale.
    tolerance = C * condition(robot, q) * EPS * mass * G
    assert np.allclose(ground, [*np.cross(moment, [0, 0, G]), 0, 0, mass * G], rtol=0, atol=tolerance)


@pytest.mark.parametrize("seed", range(3, 50, 4))
def test_nothing_holds_a_floating_base(seed):
    """All six freedoms are free: the constraint part at the ground is zero, and the total is the forces given there."""
    c = case(seed, n=4)
    assert c.robot.joints[0].type.nv == 6
    r, total = (c.reference.reactions(c.q, c.v, c.tau, part=part) for part in ("constraint", "total"))
    tolerance = C * condition(c.robot, c.q) * EPS * abs(total.array).max()
    assert abs(r["ground"]).max() < tolerance
    assert abs(total["ground"] - c.tau[:6]).max() < tolerance


@pytest.mark.parametrize("seed", range(5))
def test_routes_give_the_same_reactions(seed):
    c = case(seed)
    found = [
        c.reference.reactions(c.q, c.v, c.tau, formalism=f).array for f in ("recursive", "nonrecursive", "saddle_joint", "saddle_body")
    ]
    tolerance = C * condition(c.robot, c.q) * EPS
    assert max(error(x, found[0]) for x in found) < tolerance


def test_a_force_sensor_between_two_welds():
    """Base – sensor – tool, all fixed, on a moving arm: the sensor's joints differ by the sensor's own weight and inertia alone."""
    urdf = """<robot name="arm"><link name="base"/>
      <link name="arm"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <link name="sensor"/>
      <link name="tool"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="elbow" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
      <joint name="flange" type="fixed"><parent link="arm"/><child link="sensor"/><origin xyz="0 0 0.5" rpy="0.4 0 0"/></joint>
      <joint name="plate" type="fixed"><parent link="sensor"/><child link="tool"/><origin xyz="0 0 0.1" rpy="0 0.3 0"/></joint></robot>"""
    robot = rd.load(io.StringIO(urdf))
    q, v = [0.4], [2.0]
    r = rd.Scene(robot).reactions(q, v, frame="world")
    # The sensor has no mass: what it takes from the arm it hands to the tool, about another point.
    T = robot.link_poses(q)
    lever = T[3][:3, 3] - T[2][:3, 3]
    moment = r["plate"][:3] + np.cross(lever, r["plate"][3:])
    assert np.allclose(r["flange"], [*moment, *r["plate"][3:]], rtol=0, atol=C * EPS * abs(r.array).max())
    assert abs(r["flange"]).max() > 1
