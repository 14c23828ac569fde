"""Robots as data: names, sizes, inertias, the lumped tree, mimic joints, and that nothing of it can be changed."""

import dataclasses
from pathlib import Path

import mpmath
import numpy as np
import pytest
from tools import EPS, SEEDS, Reference, case, condition, error, many_digits

import robodyn as rd
from robodyn.arithmetic.vectors import congruent, rotation
from robodyn.dynamics.equations import SWEEPS
from robodyn.formalism.energy import kinetic
from robodyn.formalism.newton_euler import bias_resultants
from robodyn.formalism.nonrecursive import bias_forces, mass_matrix, nonrecursive
from robodyn.formalism.reactions import joint_wrenches
from robodyn.joints import Fixed, Free, Prismatic, Revolute, Spherical
from robodyn.model import GROUND, Inertia, Joint, Limits, Link, Mimic, lump, minimal

ROBOTS = Path(__file__).parents[1] / "robots"
C = 50  # roundings along a path of up to 8 bodies, each a product of 3 × 3 matrices
X, Y, Z = np.eye(3)


# --- inertia: the same as a cloud of mass points -----------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Cloud:
    """Mass points: what an inertia is the sum of."""

    masses: np.ndarray  # (n,)
    points: np.ndarray  # (n, 3)

    @classmethod
    def random(cls, seed):
        rng = np.random.default_rng(seed)
        return cls(rng.uniform(0.1, 1.0, 12), rng.uniform(-0.4, 0.6, (12, 3)))

    def moved(self, R, r):
        return Cloud(self.masses, self.points @ R.T + r)

    @property
    def inertia(self):
        """m, m ρ and Θ about the origin by their definitions."""
        m, p = self.masses, self.points
        tensor = sum(mi * (pi @ pi * np.eye(3) - np.outer(pi, pi)) for mi, pi in zip(m, p, strict=True))
        return m.sum(), m @ p, tensor


def numbers(inertia):
    return inertia.mass, inertia.moment, inertia.tensor


def assert_same(found, expected, c=50):
    """Sums of 12 points and a few products of numbers of size 1: c roundings."""
    for x, y in zip(found, expected, strict=True):
        assert np.allclose(x, y, rtol=0, atol=c * EPS * max(1.0, np.abs(y).max()))


def about_centre(cloud):
    m, moment, tensor = cloud.inertia
    c = moment / m
    return Inertia.about_centre(m, c, tensor - m * (c @ c * np.eye(3) - np.outer(c, c)))


def pose(seed):
    rng = np.random.default_rng([5, seed])
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.linalg.det(q), rng.normal(size=3)


@pytest.mark.parametrize("seed", range(5))
def test_inertia_about_the_centre_and_back(seed):
    """Steiner's theorem there and back."""
    cloud = Cloud.random(seed)
    inertia = about_centre(cloud)
    assert_same(numbers(inertia), cloud.inertia)
    assert_same([inertia.centre], [cloud.inertia[1] / cloud.inertia[0]])
    central = cloud.moved(np.eye(3), -inertia.centre)
    assert_same([inertia.about_own_centre], [central.inertia[2]])
    assert np.array_equal(inertia.tensor, inertia.tensor.T)


@pytest.mark.parametrize("seed", range(5))
def test_inertia_seen_from_another_frame(seed):
    """The points moved, then summed; and back again by the inverse pose."""
    cloud, (R, r) = Cloud.random(seed), pose(seed)
    seen = about_centre(cloud).seen_from(R, r)
    assert_same(numbers(seen), cloud.moved(R, r).inertia)
    assert_same(numbers(seen.seen_from(R.T, -R.T @ r)), cloud.inertia, c=200)  # |r| is about 2: the tensor grows tenfold, then shrinks
    assert np.array_equal(seen.tensor, seen.tensor.T)


def test_inertias_add():
    one, other = Cloud.random(1), Cloud.random(2)
    both = Cloud(np.concatenate([one.masses, other.masses]), np.concatenate([one.points, other.points]))
    assert_same(numbers(about_centre(one) + about_centre(other)), both.inertia)


def test_inertia_without_mass():
    zero = Inertia.zero()
    assert zero.is_zero
    assert np.array_equal(zero.centre, np.zeros(3))
    assert np.array_equal(zero.about_own_centre, np.zeros((3, 3)))
    assert not Inertia.about_centre(1.0, np.zeros(3), np.zeros((3, 3))).is_zero  # a point mass
    assert not Inertia.about_centre(0.0, np.zeros(3), np.diag([0.0, 0.0, 1.0])).is_zero  # a rotor whose mass is counted elsewhere
    assert (zero + Inertia.about_centre(2.0, X, np.eye(3))).mass == 2.0


# --- the minimal tree ---


@pytest.mark.parametrize("seed", SEEDS)
def test_the_minimal_tree_moves_alike(seed):
    """M̂, the bias with wrenches on bodies, and η̇ of base parameters on slid origins, against the robot's own in 50 digits."""
    c = case(seed)
    loads = [rd.LinkWrench(name, force=(1.0, 2.0, 3.0), moment=(0.3, 0.1, -0.2)) for name in c.robot.link_names]
    scene = rd.Scene(c.robot, loads=loads)
    plain, exact = scene.equations(), scene.equations("mpmath")
    fewest = minimal(plain.tree)
    own, acts = [dict(e.wrenches(e.state(0.0, x, y))) for e, x, y in ((plain, c.q, c.v), (exact, many_digits(c.q), many_digits(c.v)))]
    state = plain.state(0.0, c.q, c.v).on(fewest.tree)
    with mpmath.workdps(50):
        q, v = many_digits(c.q), many_digits(c.v)
        at = exact.state(0.0, q, v)
        resting = bias_resultants(exact.tree, at.motion, acts, exact.gravity)
        M, bias = exact.mass_matrix(at), bias_forces(exact.tree, at.motion, resting)
        carried = joint_wrenches(exact.tree, at.motion, many_digits(0 * c.v), acts, exact.gravity)
    assert error(mass_matrix(fewest.tree, state.motion, np.dtype(float)), M) < C * EPS
    found = bias_forces(fewest.tree, state.motion, bias_resultants(fewest.tree, state.motion, fewest.wrenches(own), plain.gravity))
    # What cancels in k̂ is as large as the largest wrench that a joint carries.
    assert abs(found - bias).max() < C * EPS * max(abs(f).max() for f in carried)
    vdot = nonrecursive(state, c.tau, fewest.wrenches(own), plain.gravity).vdot
    reference = scene.forward_dynamics(c.q, c.v, c.tau, backend="mpmath")
    assert error(vdot, reference) < C * condition(c.robot, c.q) * EPS


@pytest.mark.parametrize("length", [1.0, 30.0, 1000.0])
@pytest.mark.parametrize("aligned", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_the_minimal_tree_keeps_its_digits_where_joints_are_far_apart(seed, aligned, length):
    """Offsets up to a thousand times the size of the links, axes in general position and along the frames'."""
    robot = case(seed, n=6, joint_types=("revolute", "prismatic"), floating_base=False).robot
    rng, joints = np.random.default_rng(seed), []
    for joint in robot.joints:
        kind, R = joint.type, joint.rotation
        if aligned and kind.nv:
            kind = type(kind).from_axis(np.eye(3)[rng.integers(3)] * rng.choice([-1, 1]))
            R = rotation(np.eye(3)[rng.integers(3)], *rng.permutation([0.0, 1.0]))
        joints.append(dataclasses.replace(joint, type=kind, rotation=R, translation=joint.translation * length))
    robot = dataclasses.replace(robot, joints=tuple(joints))
    q, v = robot.random_state(rng)
    exact = rd.Scene(robot, declared=False).forward_dynamics(q, v, backend="mpmath", formalism="nonrecursive")
    state = rd.Scene(robot, declared=False).equations().state(0.0, q, v)
    found = nonrecursive(state.on(minimal(state.tree).tree), np.zeros(robot.nv), {}, np.array([0.0, 0.0, -9.81])).vdot
    assert error(found, exact) < C * condition(robot, q) * EPS


def test_the_minimal_tree_of_an_arm_has_base_parameters_alone():
    """Gautier and Khalil: of ten numbers per revolute link at most seven count; mass, moment along the axis and one across are zero."""
    robot = rd.load(ROBOTS / "ur5e.urdf")
    for body in minimal(rd.Scene(robot).equations().tree).tree.bodies:
        assert body.inertia.mass == 0.0
        assert body.inertia.moment @ body.joint.axis == 0.0
        assert (np.diag(body.inertia.tensor) == 0.0).any()


def test_a_turn_about_a_coordinate_axis_takes_half_the_products_and_means_the_same():
    """`congruent` on objects, for every way to name the axes anew, against the product of three matrices."""
    rng = np.random.default_rng(5)
    quarter = [rotation(axis, np.array(0.0), np.array(1.0)) for axis in np.eye(3)]
    turns = [a @ b @ c for a in quarter for b in (np.eye(3), *quarter) for c in (np.eye(3), *quarter)]
    for turn in turns:
        for axis in np.eye(3):
            angle = rng.uniform(-3, 3)
            R, A = turn @ rotation(axis, np.cos(angle), np.sin(angle)), rng.normal(size=(3, 3))
            assert error(congruent(R.astype(object), A), R @ A @ R.T) < 8 * EPS  # sums of nine products of up to three roundings


# --- the lumped tree ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_lumped_and_opened_trees_move_alike(seed):
    """η̇, M̂, the bias and every pose: a fixed joint left open changes nothing of the motion."""
    c = case(seed, n=6, fixed=0.5)
    scene = rd.Scene(c.robot, loads=[rd.LinkWrench(c.robot.link_names[-1], force=(1.0, 2.0, 3.0), point=(0.1, 0.0, 0.2))])
    lumped, opened = scene.equations(), scene.equations(opened=True)
    assert len(opened.tree.bodies) == len(c.robot.links)
    fixed = sum(joint.type.nv == 0 for joint in c.robot.joints)
    assert len(lumped.tree.bodies) == len(c.robot.links) - fixed
    tolerance = C * condition(c.robot, c.q) * EPS
    states = [e.state(0.0, c.q, c.v) for e in (lumped, opened)]
    for route in SWEEPS:
        one, other = (e.accelerate(x, e.applied(x, c.tau), route).vdot for e, x in zip((lumped, opened), states, strict=True))
        assert error(one, other) < tolerance, route
    assert error(*(e.mass_matrix(x) for e, x in zip((lumped, opened), states, strict=True))) < C * EPS
    assert error(*map(kinetic, states)) < C * EPS
    assert error(lumped.link_poses(c.q), opened.link_poses(c.q)) < C * EPS


@pytest.mark.parametrize("seed", SEEDS)
def test_lumping_keeps_the_mass_that_moves(seed):
    """Each body holds the mass of its links; what is fixed to the ground is in none."""
    c = case(seed, n=8, fixed=0.5)
    tree = lump(c.robot)
    for i, body in enumerate(tree.bodies):
        links = [link for link, b in zip(c.robot.links, tree.link_body, strict=True) if b == i]
        assert c.robot.links[body.link] is links[0]
        assert np.isclose(body.inertia.mass, sum(link.inertia.mass for link in links), rtol=10 * EPS)
        assert body.parent < i


def test_cut_opens_only_the_joints_it_names():
    robot = rd.load(ROBOTS / "panda.urdf")
    i = next(i for i, joint in enumerate(robot.joints) if i and joint.type.nv == 0)
    assert len(lump(robot, cut=[i]).bodies) == len(lump(robot).bodies) + 1


def test_a_tree_that_stands_on_the_ground_with_two_feet():
    """Several joints to the ground are two robots beside each other: the mass matrix has two blocks."""
    inertia = Inertia.about_centre(1.0, X, np.eye(3))
    joints = (Joint(GROUND, Revolute.from_axis(Z), -1), Joint("other", Revolute.from_axis(Z), -1))
    robot = rd.Robot("feet", (Link("a", inertia), Link("b", inertia)), joints)
    M = robot.mass_matrix([0.3, 0.4])
    assert np.allclose(M, np.diag([2.0, 2.0]), rtol=4 * EPS, atol=0)
    assert np.allclose(robot.forward_dynamics([0, 0], [0, 0], [1.0, 4.0], gravity=(0, 0, 0)), [0.5, 2.0], rtol=4 * EPS)


# --- mimic -------------------------------------------------------------------------------------------------------------


def mimicking(seed):
    """A random tree with two joints that follow a third; the same tree with all joints free; the map G from the one to the other.

    The leader stands before or behind its followers, on their branch or on another.
    """
    rng = np.random.default_rng([11, seed])
    plain = rd.random_robot(rng, 6, joint_types=("revolute", "prismatic"), floating_base=seed % 2 == 1, branching=(0.5, 1.0)[seed % 2])
    first, leader, last = ((3, 1, 5), (1, 5, 3), (2, 6, 4))[seed % 3]
    rules = {first: Mimic(leader, -0.7, 0.3), last: Mimic(leader, 2.0, -0.1)}
    joints = tuple(dataclasses.replace(joint, mimic=rules.get(i)) for i, joint in enumerate(plain.joints))
    coupled = dataclasses.replace(plain, joints=joints)
    G, offset = np.zeros((plain.nv, coupled.nv)), np.zeros(plain.nq)
    for i, joint in enumerate(coupled.joints):
        G[plain.v_slices[i], coupled.v_slices[i]] = (joint.mimic.ratio if joint.mimic else 1.0) * np.eye(joint.type.nv)
        offset[plain.q_slices[i]] = joint.mimic.offset if joint.mimic else 0.0

    def full(q):
        out = offset.copy()
        for i, joint in enumerate(coupled.joints):
            out[plain.q_slices[i]] += (joint.mimic.ratio if joint.mimic else 1.0) * q[coupled.q_slices[i]]
        return out

    return plain, coupled, G, full, rng


@pytest.mark.parametrize("seed", range(20))
def test_mimic_joints_share_their_leaders_column(seed):
    """M̂ = GᵀM̂_free G and k̂ = Gᵀk̂_free: mimic joints are the free robot's, constrained by η_free = G η."""
    plain, coupled, G, full, rng = mimicking(seed)
    plain, coupled = Reference(plain), Reference(coupled)
    assert (coupled.nv, coupled.nu, plain.nv) == (plain.nv - 2, plain.nv, plain.nv)
    followers = {joint.name for joint in coupled.joints if joint.mimic}
    assert len(followers) == 2
    assert not followers & set(coupled.joint_names)
    q, v = coupled.random_state(rng)
    tau = rng.normal(size=coupled.nv)
    M = G.T @ plain.mass_matrix(full(q)) @ G
    k = G.T @ plain.bias_forces(full(q), G @ v)
    assert error(coupled.mass_matrix(q), M) < C * EPS
    assert error(coupled.bias_forces(q, v), k) < C * EPS
    assert error(coupled.link_poses(q), plain.link_poses(full(q))) < C * EPS
    expected = np.linalg.solve(M, tau - k)
    for route in ("nonrecursive", "saddle_joint", "saddle_body"):
        # κ carries the roundings of M̂ and of τ − k̂ into η̇.
        assert error(coupled.forward_dynamics(q, v, tau, formalism=route), expected) < C * np.linalg.cond(M) * EPS, route


def test_slices_of_mimic_joints():
    _, coupled, *_ = mimicking(0)
    assert coupled.q_slices[3] == coupled.q_slices[5] == coupled.q_slices[1]
    assert coupled.v_slices[3] == coupled.v_slices[1]
    own = [coupled.u_slices[i] for i in range(len(coupled.joints))]
    assert [s.start for s in own] == np.cumsum([0, *(joint.type.nv for joint in coupled.joints)])[:-1].tolist()
    assert lump(coupled).has_mimic
    assert not lump(mimicking(0)[0]).has_mimic


def test_the_route_that_cannot_share_coordinates_says_so():
    _, coupled, _, _, rng = mimicking(0)
    q, v = coupled.random_state(rng)
    with pytest.raises(rd.ModelError, match=r"recursive.*mimic.*nonrecursive"):
        coupled.forward_dynamics(q, v, formalism="recursive")


# --- names and sizes ---------------------------------------------------------------------------------------------------


def three_joints():
    links = tuple(Link(name) for name in ("base", "ball", "slider"))
    joints = (Joint(GROUND, Free(), -1), Joint("shoulder", Spherical(), 0), Joint("slide", Prismatic.from_axis(Z), 1))
    return rd.Robot("three", links, joints)


def test_names_and_sizes():
    robot = three_joints()
    assert (robot.nq, robot.nv, robot.nu) == (12, 10, 10)
    assert robot.joint_names == robot.all_joint_names == ("ground", "shoulder", "slide")
    q_names, v_names = robot.coordinate_names()
    assert [name for name, _ in q_names] == [
        *(f"ground.{x}" for x in ("x", "y", "z", "qw", "qx", "qy", "qz")),
        *(f"shoulder.{x}" for x in ("qw", "qx", "qy", "qz")),
        "slide",
    ]
    assert v_names[-1] == ("slide", "m/s")
    assert v_names[0] == ("ground.wx", "rad/s")
    assert robot.neutral().tolist() == [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0]
    assert robot.link_index("ball") == robot.joint_index("shoulder") == 1
    assert repr(robot) == "<Robot 'three': 3 links, nq=12, nv=10>"


def test_fixed_joints_have_a_reaction_but_no_coordinate():
    robot = rd.load(ROBOTS / "ur5e.urdf")
    assert robot.all_joint_names[0] == GROUND
    assert GROUND not in robot.joint_names
    assert len(robot.joint_names) == robot.nq == robot.nv == 6
    assert robot.nq == len(robot.coordinate_names()[0])


@pytest.mark.parametrize(("kind", "wrong", "right"), [("link", "bal", "ball"), ("joint", "sholder", "shoulder")])
def test_an_unknown_name_is_met_with_its_neighbours(kind, wrong, right):
    with pytest.raises(rd.ModelError, match=rf"robot 'three' has no {kind} named '{wrong}': did you mean '{right}'"):
        getattr(three_joints(), f"{kind}_index")(wrong)


def test_an_unknown_name_like_no_other_gets_the_list():
    with pytest.raises(rd.ModelError, match="it has ground, shoulder, slide"):
        three_joints().joint_index("???")


def test_what_is_no_mechanism_is_refused():
    a, b = Link("a"), Link("b")
    ground, joint = Joint(GROUND, Fixed(), -1), Joint("j", Fixed(), 0)
    with pytest.raises(rd.ModelError, match="one joint per link: 2 links, 1 joints"):
        rd.Robot("r", (a, b), (ground,))
    with pytest.raises(rd.ModelError, match="one joint per link"):
        rd.Robot("r", (), ())
    with pytest.raises(rd.ModelError, match=r"joint 'j' \(number 1\) must come after its parent"):
        rd.Robot("r", (a, b), (ground, dataclasses.replace(joint, parent=1)))
    with pytest.raises(rd.ModelError, match=r"more than one link named \['a'\]"):
        rd.Robot("r", (a, a), (ground, joint))
    with pytest.raises(rd.ModelError, match=r"more than one joint named \['ground'\]"):
        rd.Robot("r", (a, b), (ground, dataclasses.replace(joint, name=GROUND)))


def test_random_states_keep_to_the_limits():
    """Uniform between lower and upper where both are given; a continuous joint has none."""
    joints = (
        Joint(GROUND, Fixed(), -1),
        Joint("a", Revolute.from_axis(X), 0, limits=Limits(2.0, 2.5)),
        Joint("b", Prismatic.from_axis(X), 1, limits=Limits(-0.2, -0.1)),
        Joint("c", Revolute.from_axis(X), 2, limits=Limits(lower=50.0)),
    )
    robot = rd.Robot("limits", tuple(Link(str(i)) for i in range(4)), joints)
    rng = np.random.default_rng(0)
    q = np.array([robot.random_state(rng)[0] for _ in range(200)])
    assert q[:, 0].min() >= 2.0
    assert q[:, 0].max() <= 2.5
    assert q[:, 1].min() >= -0.2
    assert q[:, 1].max() <= -0.1
    assert np.ptp(q[:, 0]) > 0.4
    assert abs(q[:, 2]).max() <= np.pi
    v = robot.random_state(rng)[1]
    assert v.shape == (3,)
    assert abs(v).max() <= 1


# --- nothing can be changed --------------------------------------------------------------------------------------------


def records(value, path="robot"):
    """Every dataclass and every array inside a record, with its path."""
    if dataclasses.is_dataclass(value):
        yield path, value
        for f in dataclasses.fields(value):
            yield from records(getattr(value, f.name), f"{path}.{f.name}")
    elif isinstance(value, (tuple, list)):
        assert isinstance(value, tuple), path
        for i, x in enumerate(value):
            yield from records(x, f"{path}[{i}]")
    elif isinstance(value, np.ndarray):
        yield path, value
    else:
        assert value is None or isinstance(value, (str, int, float, bool, slice)), f"{path} is {value!r}"


def assert_immutable(record):
    for path, value in records(record):
        if isinstance(value, np.ndarray):
            assert not value.flags.writeable, path
        else:
            with pytest.raises(dataclasses.FrozenInstanceError):
                value.surprise = 1


@pytest.mark.parametrize("file", ["ur5e", "panda", "quadruped", "lecture_tree"])
def test_a_loaded_robot_is_immutable(file):
    robot = rd.load(ROBOTS / f"{file}.urdf", floating_base=file == "quadruped")
    assert_immutable(robot)
    assert_immutable(lump(robot))
    assert_immutable(lump(robot, cut=range(len(robot.joints))))


def test_a_random_robot_is_immutable():
    robot = rd.random_robot(np.random.default_rng(0), 12)
    assert_immutable(robot)
    assert_immutable(lump(robot))


def test_neutral_is_a_fresh_array():
    robot = three_joints()
    robot.neutral()[:] = 7.0
    assert robot.neutral()[3] == 1.0
