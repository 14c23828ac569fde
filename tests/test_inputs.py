"""The door: what is accepted means what it says, what is not is named with its index and its coordinate, and nothing is modified."""

import io
import re
from dataclasses import replace
from pathlib import Path

import mpmath
import numpy as np
import pytest
from tools import EPS, ROUTES, Reference, case, condition, error, many_digits

import robodyn as rd
from robodyn.joints import JOINT_TYPES, Fixed, Free, Planar, Prismatic, Revolute, Spherical
from robodyn.model import GROUND, Inertia, Joint, Link

C = 50  # roundings along a path of up to 8 bodies, each a product of 3 × 3 matrices
X, Y, Z = np.eye(3)


@pytest.fixture(scope="module")
def arm():
    """Three revolute joints, named as the coordinates are: joint_1, joint_2, joint_3."""
    return case(0, n=3, joint_types=("revolute",), floating_base=False)


@pytest.fixture(scope="module")
def walker():
    """A free base that carries a ball joint: coordinates ground.x … ground.qz, joint_1.qw … joint_1.qz."""
    return case(0, n=1, joint_types=("spherical",), floating_base=True)


BOTH = pytest.mark.parametrize("backend", ["native", "numpy"])  # each has a door of its own


def on(backend, robot):
    """The robot, answering by kernels or by the readable reference."""
    return robot if backend == "native" else Reference(robot)


def answers(robot, q, v, tau):
    """Every question that takes a state, in one list."""
    return [
        robot.forward_dynamics(q, v, tau),
        robot.inverse_dynamics(q, v, tau),
        robot.bias_forces(q, v),
        robot.mass_matrix(q),
        robot.reactions(q, v, tau).array,
        robot.kinetic_energy(q, v),
        robot.potential_energy(q),
        robot.momentum(q, v),
        robot.link_poses(q),
    ]


# --- what is accepted --------------------------------------------------------------------------------------------------


def strided(x):
    """The same numbers as every second column of a Fortran-ordered array."""
    wide = np.asfortranarray(np.repeat(x, 2, axis=-1))
    return wide[..., ::2]


def backwards(x):
    """The same numbers with negative strides."""
    return np.ascontiguousarray(x[..., ::-1])[..., ::-1]


def read_only(x):
    x = x.copy()
    x.flags.writeable = False
    return x


SAME = {
    "list": lambda x: x.tolist(),
    "tuple": lambda x: tuple(x.tolist()),
    "strided": strided,
    "backwards": backwards,
    "read-only": read_only,
    "big-endian": lambda x: x.astype(">f8"),
    "longdouble": lambda x: x.astype(np.longdouble),
}


@BOTH
@pytest.mark.parametrize("form", SAME)
@pytest.mark.parametrize("batch", [(), (2, 3)])
def test_the_same_numbers_in_another_form(form, batch, backend, walker):
    """Kernels to the last bit; NumPy's own products may add up in another order where the memory is laid out otherwise."""
    robot, states = on(backend, walker.robot), [np.tile(x, (*batch, 1)) for x in (walker.q, walker.v, walker.tau)]
    tolerance = 0.0 if backend == "native" else C * condition(walker.robot, walker.q) * EPS
    for found, expected in zip(answers(robot, *map(SAME[form], states)), answers(robot, *states), strict=True):
        assert error(found, expected) <= tolerance


@BOTH
@pytest.mark.parametrize("dtype", [np.float32, np.float16, np.int64, np.int8, np.uint8])
def test_other_real_types_are_their_float64(arm, dtype, backend):
    states = [np.array(x).astype(dtype) for x in ([1, 2, 3], [3, 2, 1], [5, 6, 7])]
    found, expected = (answers(on(backend, arm.robot), *(x.astype(t) for x in states)) for t in (dtype, float))
    for x, y in zip(found, expected, strict=True):
        assert np.array_equal(x, y)
        assert x.dtype == float


@BOTH
def test_a_quaternion_in_single_precision_is_a_unit_quaternion(walker, backend):
    """Its length is off by 1e-7, which no one could have helped."""
    q = walker.q.astype(np.float32)
    found = on(backend, walker.robot).forward_dynamics(q, walker.v, walker.tau)
    # The pose is right to single precision: κ times that in the acceleration.
    tolerance = C * condition(walker.robot, walker.q) * np.finfo(np.float32).eps
    assert error(found, walker.reference.forward_dynamics(walker.q, walker.v, walker.tau)) < tolerance


def test_mpmath_numbers_stay_what_they_are(arm):
    with mpmath.workdps(50):
        q = many_digits(arm.q) + mpmath.mpf(10) ** -30
        moved = arm.robot.potential_energy(q, backend="mpmath") - arm.robot.potential_energy(many_digits(arm.q), backend="mpmath")
        slope = sum(arm.robot.bias_forces(arm.q, np.zeros(3), backend="mpmath"))
        assert abs(moved * mpmath.mpf(10) ** 30 - slope) < 1e-15
    assert isinstance(arm.robot.forward_dynamics(arm.q, arm.v, backend="mpmath")[0], mpmath.mpf)


@BOTH
@pytest.mark.parametrize("batch", [(), (0,), (1,), (2, 3)])
def test_leading_dimensions(batch, backend):
    c = case(6, n=3, fixed=0.3)
    robot, n = on(backend, c.robot), len(c.robot.joints)
    q, v, tau = (np.tile(x, (*batch, 1)) for x in (c.q, c.v, c.tau))
    shapes = [(robot.nv,)] * 3 + [(robot.nv, robot.nv), (n, 6), (), (), (6,), (n, 4, 4)]
    for found, shape in zip(answers(robot, q, v, tau), shapes, strict=True):
        assert np.shape(found) == (*batch, *shape)
    for route in ROUTES:
        assert robot.forward_dynamics(q, v, tau, formalism=route).shape == (*batch, robot.nv)


@BOTH
@pytest.mark.parametrize(
    ("of_q", "of_v", "of_tau"), [((4,), (), ()), ((), (4,), ()), ((), (), (4,)), ((3, 1), (1, 4), ()), ((2, 1, 1), (3, 1), (4,))]
)
def test_leading_dimensions_broadcast(of_q, of_v, of_tau, backend):
    """q against v against tau, as NumPy's arrays do; every state of the result is what it is alone."""
    c, rng = case(2, n=3), np.random.default_rng(0)
    q = np.array([c.robot.random_state(rng)[0] for _ in range(int(np.prod(of_q)))]).reshape(*of_q, c.robot.nq)
    v, tau = rng.normal(size=(*of_v, c.robot.nv)), rng.normal(size=(*of_tau, c.robot.nv))
    batch = np.broadcast_shapes(of_q, of_v, of_tau)
    every = [np.broadcast_to(x, (*batch, x.shape[-1])) for x in (q, v, tau)]
    last = tuple(n - 1 for n in batch)
    alone, robot = [x[last] for x in every], on(backend, c.robot)
    tolerance = C * condition(c.robot, alone[0]) * EPS
    for route in ROUTES:
        found = robot.forward_dynamics(q, v, tau, formalism=route)
        assert found.shape == (*batch, c.robot.nv)
        assert error(found[last], robot.forward_dynamics(*alone, formalism=route)) < tolerance, route
    r = robot.reactions(q, v, tau)
    assert r.array.shape == (*batch, 4, 6)
    assert error(r.array[last], robot.reactions(*alone).array) < tolerance


@BOTH
def test_a_robot_that_cannot_move(backend):
    inertia = Inertia.about_centre(2.0, X, np.eye(3))
    robot = rd.Robot("statue", (Link("a", inertia), Link("b", inertia)), (Joint(GROUND, Fixed(), -1), Joint("weld", Fixed(), 0)))
    robot = on(backend, robot)
    for batch in ((), (0,), (2, 3)):
        nothing = np.zeros((*batch, 0))
        shapes = [(0,)] * 3 + [(0, 0), (2, 6), (), (), (6,), (2, 4, 4)]
        for found, shape in zip(answers(robot, nothing, nothing, nothing), shapes, strict=True):
            assert np.shape(found) == (*batch, *shape)
        for route in ROUTES:
            assert robot.forward_dynamics(nothing, nothing, formalism=route).shape == (*batch, 0)
    assert robot.forward_dynamics([], []).shape == (0,)


def test_tau_is_zero_where_it_is_not_given(arm):
    robot, q, v = arm.robot, arm.q, arm.v
    assert np.array_equal(robot.forward_dynamics(q, v), robot.forward_dynamics(q, v, np.zeros(3)))
    assert np.array_equal(robot.reactions(q, v).array, robot.reactions(q, v, np.zeros(3)).array)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize(
    ("route", "backend"), [*((route, "numpy") for route in ROUTES), ("recursive", "native"), ("nonrecursive", "native")]
)
def test_states_of_any_size(route, size, backend):
    """Velocities, forces and displacements of 1e-9 and of 1e9: as right as any, measured against 50 digits."""
    c = case(3, n=4, joint_types=("revolute", "prismatic"), floating_base=False)
    q, v, tau = size * c.q, size * c.v, size * c.tau
    expected = c.robot.forward_dynamics(q, v, tau, backend="mpmath")
    found = c.robot.forward_dynamics(q, v, tau, formalism=route, backend=backend)
    # A slide that is 1e9 m out meets a mass matrix of entries from 1 to 1e18; κ says what is left of it. With
    # terms up to that size in the sum, an acceleration is known relative to M̂⁻¹ times the largest force.
    M, bias = c.reference.mass_matrix(q), c.reference.bias_forces(q, v)
    forces = np.linalg.norm(bias) + np.linalg.norm(tau)
    bound = C * EPS * (np.linalg.norm(np.linalg.inv(M), 2) * forces + np.linalg.cond(M) * np.linalg.norm(expected.astype(float)))
    assert np.linalg.norm((found - expected).astype(float)) < bound
    assert np.isfinite(found).all()


@BOTH
def test_inputs_are_never_modified(walker, backend):
    states = [np.tile(x, (4, 1)) for x in (walker.q, walker.v, walker.tau)]
    before = [x.copy() for x in states]
    answers(on(backend, walker.robot), *states)
    for route in ROUTES:
        on(backend, walker.robot).forward_dynamics(*states, formalism=route)
    rd.simulate(walker.robot, t_end=0.01, q0=states[0][0], v0=states[1][0], fps=None, backend=backend)
    for x, y in zip(states, before, strict=True):
        assert np.array_equal(x, y)
    assert all(x.flags.writeable for x in states)


@BOTH
def test_answers_are_the_callers_own(walker, backend):
    """Every one is writable, and writing into it changes no later one."""
    robot = on(backend, walker.robot)
    first = answers(robot, walker.q, walker.v, walker.tau)
    kept = [np.array(x) for x in first]
    for x in first:
        if np.ndim(x):
            x[:] = 7.0
    for x, y in zip(answers(robot, walker.q, walker.v, walker.tau), kept, strict=True):
        assert np.array_equal(x, y)


# --- what is refused ---------------------------------------------------------------------------------------------------

GARBAGE = {
    "bool": [True, False, True],
    "complex": [1j, 0, 0],
    "text": ["a", "b", "c"],
    "numbers as text": ["1", "2", "3"],
    "None": [None, None, None],
    "a None": [1.0, None, 2.0],
    "objects": [object(), 1.0, 2.0],
    "dictionary": {"joint_1": 1.0},
    "dates": np.array(["2026-01-01"] * 3, dtype="datetime64[D]"),
    "ragged": [[1.0, 2.0, 3.0], [1.0]],
    "word": "home",
}


@pytest.mark.parametrize("backend", ["native", "numpy", "mpmath"])
@pytest.mark.parametrize("garbage", GARBAGE)
def test_what_is_no_array_of_real_numbers(arm, garbage, backend):
    good = np.zeros(3)
    for name, arguments in (("q", (GARBAGE[garbage], good)), ("v", (good, GARBAGE[garbage])), ("tau", (good, good, GARBAGE[garbage]))):
        with pytest.raises(rd.InputError, match=rf"^{name}\b"):
            arm.robot.forward_dynamics(*arguments, backend=backend)


def test_complex_mpmath_numbers_are_refused(arm):
    with pytest.raises(rd.InputError, match=r"^q\b"):
        arm.robot.forward_dynamics(np.array([mpmath.mpc(1, 1)] * 3), np.zeros(3), backend="mpmath")


@BOTH
@pytest.mark.parametrize("shape", [(), (2,), (4,), (3, 1), (3, 2), (0,), (2, 3, 4)])
def test_the_last_dimension_must_fit(arm, shape, backend):
    robot, good = on(backend, arm.robot), np.zeros(3)
    message = rf"has the shape {re.escape(str(shape))}: its last dimension must be 3, n"
    with pytest.raises(rd.InputError, match=f"^q {message}q"):
        robot.forward_dynamics(np.zeros(shape), good)
    with pytest.raises(rd.InputError, match=f"^v {message}v"):
        robot.reactions(good, np.zeros(shape))
    with pytest.raises(rd.InputError, match=f"^tau {message}v"):
        robot.forward_dynamics(good, good, np.zeros(shape))
    with pytest.raises(rd.InputError, match=f"^a {message}v"):
        robot.inverse_dynamics(good, good, np.zeros(shape))
    for question in (robot.mass_matrix, robot.potential_energy, robot.link_poses):
        with pytest.raises(rd.InputError, match=f"^q {message}q"):
            question(np.zeros(shape))


@BOTH
def test_leading_dimensions_that_do_not_fit(arm, backend):
    with pytest.raises(rd.InputError, match=r"do not fit together: q \(2, 3\), v \(4, 3\), tau \(3,\)"):
        on(backend, arm.robot).forward_dynamics(np.zeros((2, 3)), np.zeros((4, 3)))


@BOTH
def test_masked_entries_are_refused(arm, backend):
    robot, whole = on(backend, arm.robot), np.ma.masked_array(np.full(3, 0.1))
    assert np.array_equal(robot.forward_dynamics(whole, np.zeros(3)), robot.forward_dynamics(whole.data, np.zeros(3)))
    whole[1] = np.ma.masked
    with pytest.raises(rd.InputError, match="q has masked entries"):
        robot.forward_dynamics(whole, np.zeros(3))


@BOTH
@pytest.mark.parametrize(("value", "shown"), [(np.nan, "nan"), (np.inf, "inf"), (-np.inf, "-inf")])
def test_what_is_not_finite_is_named(arm, walker, value, shown, backend):
    """By index and by the coordinate's name."""
    turning, walking = on(backend, arm.robot), on(backend, walker.robot)
    q = np.zeros((2, 4, 3))
    q[1, 2, 0] = value
    with pytest.raises(rd.InputError, match=rf"^q\[1, 2, 0\] \(joint_1\) is {shown}"):
        turning.mass_matrix(q)
    v = walker.v.copy()
    v[7] = value
    with pytest.raises(rd.InputError, match=rf"^v\[7\] \(joint_1\.wy\) is {shown}"):
        walking.forward_dynamics(walker.q, v)
    q = walker.q.copy()
    q[3] = value
    with pytest.raises(rd.InputError, match=rf"^q\[3\] \(ground\.qw\) is {shown}"):
        walking.link_poses(q)
    with pytest.raises(rd.InputError, match=rf"^tau\[2\] \(joint_3\) is {shown}"):
        turning.forward_dynamics(arm.q, arm.v, [0, 0, value], backend="mpmath")


@pytest.mark.parametrize("backend", ["native", "numpy", "mpmath"])
def test_a_quaternion_that_is_not_unit_is_named(walker, backend):
    q = np.tile(walker.q, (2, 3, 1))
    q[1, 2, 7:] *= 1.5
    with pytest.raises(rd.InputError, match=r"^q\[1, 2\]: the quaternion \(w, x, y, z\) of joint 'joint_1' has the length 1\.5: normalise"):
        walker.robot.forward_dynamics(q, walker.v, backend=backend)
    with pytest.raises(rd.InputError, match=r"^q: the quaternion \(w, x, y, z\) of joint 'ground' has the length 0"):
        walker.robot.potential_energy(np.zeros(11), backend=backend)


@BOTH
@pytest.mark.parametrize(("length", "accepted"), [(1 + 4e-7, True), (1 - 4e-7, True), (1 + 1e-6, False), (1 - 1e-6, False)])
def test_how_far_a_quaternion_may_be_from_unit_length(walker, length, accepted, backend):
    """|p|² within 1e-6 of 1: single precision passes, a slip does not."""
    q, robot = walker.q.copy(), on(backend, walker.robot)
    q[7:] *= length
    if accepted:
        robot.mass_matrix(q)
    else:
        with pytest.raises(rd.InputError, match="normalise"):
            robot.mass_matrix(q)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"formalism": "recursiv"}, r"formalism='recursiv'.*'recursive'"),
        ({"formalism": ""}, r"formalism=''.*'auto'"),
        ({"formalism": None}, r"formalism=None"),
        ({"backend": "nativ"}, r"backend='nativ'.*'native', 'numpy', 'mpmath'"),
        ({"frame": "World"}, r"frame='World'.*'child', 'parent', 'world'"),
        ({"part": "all"}, r"part='all'.*'constraint', 'total'"),
        ({"joints": "joint_1"}, r"joints='joint_1' must be a list"),
    ],
)
def test_options_that_are_not_known(arm, option, message):
    with pytest.raises(rd.InputError, match=message):
        arm.robot.reactions(arm.q, arm.v, **option)


@BOTH
@pytest.mark.parametrize("t", ["now", None, np.nan, np.inf, [0.0, 1.0], 1j])
def test_the_time_is_one_finite_number(arm, t, backend):
    scene = rd.Scene(arm.robot)
    for question in (scene.forward_dynamics, scene.reactions, scene.bias_forces):
        with pytest.raises(rd.InputError, match=r"^t\b"):
            question(arm.q, arm.v, t=t, backend=backend)


def test_threads_are_a_number(arm):
    with pytest.raises(rd.InputError, match="threads"):
        arm.robot.forward_dynamics(np.tile(arm.q, (10_000, 1)), arm.v, threads="many")


def test_joints_that_are_not_there(arm):
    with pytest.raises(rd.ModelError, match=r"no joint named 'joint_9': did you mean 'joint_\d'"):
        arm.robot.reactions(arm.q, arm.v, joints=["joint_1", "joint_9"])


def test_every_error_is_of_one_family():
    for error_class in (rd.UrdfError, rd.ModelError, rd.InputError, rd.SimulationError, rd.FileError, rd.MissingPackageError):
        assert issubclass(error_class, rd.RobodynError)
    assert issubclass(rd.InputError, ValueError)
    assert issubclass(rd.RobodynWarning, UserWarning)


# --- gravity -----------------------------------------------------------------------------------------------------------


def test_gravity_is_earths_where_it_is_not_given(arm):
    robot, q, v = arm.reference, arm.q, arm.v
    earth = (0.0, 0.0, -9.81)
    assert np.array_equal(robot.bias_forces(q, v), robot.bias_forces(q, v, gravity=earth))
    assert np.array_equal(rd.Scene(arm.robot).bias_forces(q, v, backend="numpy"), robot.bias_forces(q, v, gravity=np.array(earth)))
    assert np.array_equal(rd.Scene(arm.robot).gravity, earth)


@pytest.mark.parametrize("seed", range(8))
def test_gravity_is_linear(seed):
    """The bias at rest is linear in gravity, which may point anywhere."""
    c = case(seed, n=4)
    rest = np.zeros(c.robot.nv)
    one, other = (0.3, -2.0, 1.0), (5.0, 1.0, -9.0)
    both = 2 * np.array(one) + other
    found = c.reference.bias_forces(c.q, rest, gravity=both)
    expected = 2 * c.reference.bias_forces(c.q, rest, gravity=one) + c.reference.bias_forces(c.q, rest, gravity=list(other))
    assert np.allclose(found, expected, rtol=0, atol=C * EPS * max(1, abs(expected).max()))
    assert abs(c.reference.bias_forces(c.q, rest, gravity=(0, 0, 0))).max() == 0


def test_the_scene_keeps_its_own_gravity(arm):
    g = np.array([0.0, 0.0, -1.6])
    scene = rd.Scene(arm.robot, gravity=g)
    g[:] = 100.0
    assert scene.gravity[2] == -1.6
    with pytest.raises(ValueError, match="read-only"):
        scene.gravity[2] = 0.0


@pytest.mark.parametrize(
    "gravity", [9.81, (0.0, -9.81), np.zeros((1, 3)), "moon", None, (0.0, 0.0, np.nan), (0, 0, 1j), (True, False, True)]
)
def test_gravity_must_be_three_numbers(arm, gravity):
    with pytest.raises(rd.InputError, match="gravity"):
        rd.Scene(arm.robot, gravity=gravity)
    with pytest.raises(rd.InputError, match="gravity"):
        arm.robot.forward_dynamics(arm.q, arm.v, gravity=gravity)


@pytest.mark.parametrize("robot", ["ur5e.urdf", None, 5])
def test_a_scene_needs_a_robot(robot):
    with pytest.raises(rd.InputError, match="robot"):
        rd.Scene(robot)
    with pytest.raises(rd.InputError, match="robot"):
        rd.simulate(robot, t_end=1.0)


# --- motion that is undetermined ---------------------------------------------------------------------------------------


def chain(*parts):
    """A robot from (name, joint type, inertia) in a row, askew to each other, on a fixed base."""
    frames = case(1, n=8).robot.joints[1:]
    links, joints = [Link("base")], [Joint(GROUND, Fixed(), -1)]
    for i, (name, kind, inertia) in enumerate(parts):
        links.append(Link(f"{name}_link", inertia))
        joints.append(Joint(name, kind, i, rotation=frames[i].rotation, translation=frames[i].translation))
    return rd.Robot("chain", tuple(links), tuple(joints))


SOLID = Inertia.about_centre(2.0, np.array([0.1, -0.05, 0.2]), np.diag([0.02, 0.03, 0.04]))
NOTHING = Inertia.zero()
SKEW = np.array([1.0, 2.0, 3.0])


def point_mass(at):
    return Inertia.about_centre(1.0, np.array(at), np.zeros((3, 3)))


def state_of(robot):
    q, v = robot.random_state(np.random.default_rng(5))
    return q, v


ON_ALL = [*((route, backend) for route in ROUTES for backend in ("numpy", "mpmath")), ("auto", "native"), ("recursive", "native")]


@pytest.mark.filterwarnings("error")  # a division by zero on the way is nothing for the user to read
@pytest.mark.parametrize(("route", "backend"), ON_ALL)
@pytest.mark.parametrize("kind", [k for k in JOINT_TYPES if k != "fixed"])
def test_a_massless_end_is_named(kind, route, backend):
    """Nothing beyond the joint has mass: named with its remedy, on every route, in both arithmetics."""
    end = JOINT_TYPES[kind].from_axis(SKEW)
    robot = chain(("shoulder", Revolute.from_axis(Z), SOLID), ("wrist", end, NOTHING), ("tip", Revolute.from_axis(X), NOTHING))
    q, v = state_of(robot)
    with pytest.raises(rd.ModelError, match=r"'chain' is undetermined: the links moved by 'wrist', 'tip' have no mass.*locked=\{'wrist'"):
        robot.forward_dynamics(q, v, formalism=route, backend=backend)
    if backend != "mpmath":
        with pytest.raises(rd.ModelError, match="undetermined"):
            rd.simulate(robot, t_end=0.1, formalism=route, backend=backend)


def test_a_robot_without_any_mass():
    robot = chain(("a", Revolute.from_axis(Z), NOTHING), ("b", Prismatic.from_axis(X), NOTHING))
    for backend in ("native", "numpy", "mpmath"):
        with pytest.raises(rd.ModelError, match="'a', 'b' have no mass"):
            robot.forward_dynamics([0, 0], [0, 0], backend=backend)
    # What needs no inverse is answered all the same.
    assert np.array_equal(robot.mass_matrix([0, 0]), np.zeros((2, 2)))
    assert np.array_equal(robot.inverse_dynamics([0, 0], [1, 1], [1, 1]), [0, 0])
    assert robot.link_poses([0.1, 0.2]).shape == (3, 4, 4)


QUICK = [*((route, "numpy") for route in ROUTES), ("auto", "native")]
AXES = [Z, SKEW, *np.random.default_rng(8).normal(size=(6, 3))]


@pytest.mark.parametrize(("route", "backend"), QUICK)
@pytest.mark.parametrize("axis", AXES, ids=["z", "skew", *"abcdef"])
def test_a_point_mass_on_the_axis_is_named(axis, route, backend):
    """Turning does not move it: no route may answer with a number, exactly singular or only but for rounding."""
    wrist = Revolute.from_axis(axis)
    robot = chain(("shoulder", Revolute.from_axis(Y), SOLID), ("wrist", wrist, point_mass(0.3 * wrist.axis)))
    q, v = state_of(robot)
    name = "'chain'" if route.startswith("saddle") else "'wrist'"  # a saddle point does not know which
    with pytest.raises(rd.ModelError, match=name):
        robot.forward_dynamics(q, v, formalism=route, backend=backend)


@pytest.mark.parametrize(("route", "backend"), QUICK)
@pytest.mark.parametrize("axis", AXES, ids=["z", "skew", *"abcdef"])
def test_freedoms_that_undo_each_other_are_refused(axis, route, backend):
    """Two joints about one axis with nothing between them: how they share their motion is undetermined."""
    inner, outer = Revolute.from_axis(axis), Revolute.from_axis(-axis)
    robot = chain(("shoulder", Revolute.from_axis(Y), SOLID), ("inner", inner, NOTHING), ("outer", outer, SOLID))
    straight = replace(robot, joints=(*robot.joints[:3], Joint("outer", outer, 2, translation=0.2 * inner.axis)))
    q, v = state_of(straight)
    with pytest.raises(rd.ModelError, match="'chain'"):
        straight.forward_dynamics(q, v, formalism=route, backend=backend)


@pytest.mark.parametrize(("route", "backend"), QUICK)
@pytest.mark.parametrize("at", [(0.0, 0.0, 0.3), (0.1, 0.2, 0.3)], ids=["z", "skew"])
@pytest.mark.parametrize("kind", ["spherical", "floating"])
def test_a_point_mass_on_a_joint_that_turns_freely_is_named(kind, at, route, backend):
    """It has no inertia about the line to the joint (spherical), or about itself (floating)."""
    robot = chain(("shoulder", Revolute.from_axis(Y), SOLID), ("wrist", JOINT_TYPES[kind].from_axis(Z), point_mass(at)))
    q, v = state_of(robot)
    name = "'chain'" if route.startswith("saddle") else "'wrist'"
    with pytest.raises(rd.ModelError, match=name):
        robot.forward_dynamics(q, v, formalism=route, backend=backend)


@BOTH
def test_the_state_that_is_singular_is_named(backend):
    """A point mass that a slide brings onto the axis: fine in the first state of a batch, undetermined in the second."""
    robot = chain(("turn", Revolute.from_axis(Z), NOTHING), ("slide", Prismatic.from_axis(X), point_mass((0.0, 0.0, 0.0))))
    straight = replace(robot, joints=tuple(replace(j, rotation=np.eye(3), translation=np.zeros(3)) for j in robot.joints))
    straight = on(backend, straight)
    assert np.allclose(straight.forward_dynamics([0, 0.5], [0, 0], [1, 0]), [4, 0], rtol=4 * EPS)
    with pytest.raises(rd.ModelError, match=r"'turn'.*no inertia.*state \[1\]"):
        straight.forward_dynamics([[0, 0.5], [0, 0]], [0, 0])


@pytest.mark.parametrize(("route", "backend"), QUICK)
def test_a_point_mass_off_the_axis_is_fine(route, backend):
    """m l² α = τ."""
    robot = rd.Robot(
        "bob", (Link("base"), Link("bob", point_mass((0.5, 0, 0)))), (Joint(GROUND, Fixed(), -1), Joint("j", Revolute.from_axis(Z), 0))
    )
    assert np.allclose(robot.forward_dynamics([0.3], [0.0], [1.0], formalism=route, backend=backend), [4.0], rtol=8 * EPS)


@pytest.mark.parametrize(("route", "backend"), [*QUICK, ("recursive", "native")])
@pytest.mark.parametrize(
    "middle",
    [Revolute.from_axis(Y), Prismatic.from_axis(Y), Planar.from_axis(SKEW), Spherical(), Free()],
    ids=lambda joint: joint.kind,
)
def test_a_massless_link_in_mid_chain_is_fine(middle, route, backend):
    """What follows it has mass: the four routes agree, and with 50 digits."""
    robot = chain(("shoulder", Revolute.from_axis(Z), SOLID), ("middle", middle, NOTHING), ("end", Revolute.from_axis(X), SOLID))
    if middle.nv > 1:  # the end must add a freedom that the middle does not have; a free joint has them all
        end = Fixed() if middle.nv == 6 else Prismatic.from_axis(SKEW)
        robot = chain(("shoulder", Revolute.from_axis(Z), SOLID), ("middle", middle, NOTHING), ("end", end, SOLID))
    q, v = state_of(robot)
    tau = np.linspace(-1, 1, robot.nv)
    exact = robot.forward_dynamics(q, v, tau, backend="mpmath")
    assert error(robot.forward_dynamics(q, v, tau, formalism=route, backend=backend), exact) < C * condition(robot, q) * EPS


@BOTH
def test_velocities_beyond_float64_are_an_error_not_a_number(arm, backend):
    with pytest.raises(rd.ModelError, match=r"'joint_\d' is not finite.*too large"):
        on(backend, arm.robot).forward_dynamics(arm.q, [1e200, 1e200, 1e200])


def test_displacements_beyond_float64_are_an_error_that_says_so():
    robot = chain(("slide", Prismatic.from_axis(X), SOLID), ("turn", Revolute.from_axis(Y), SOLID), ("far", Prismatic.from_axis(Z), SOLID))
    for route, backend in QUICK:
        with pytest.raises(rd.ModelError, match=r"not finite|too large|singular"):
            robot.forward_dynamics([0.0, 0.3, 1e200], [0.0, 0.0, 0.0], formalism=route, backend=backend)


@BOTH
def test_a_load_that_yields_no_number_is_an_error(arm, backend):
    scene = rd.Scene(arm.robot, loads=[rd.ControlLaw(lambda t, q, v: np.nan * v)])
    with pytest.raises(rd.RobodynError, match="finite"):
        scene.forward_dynamics(arm.q, arm.v, backend=backend)


def test_a_robot_from_text_is_a_robot():
    """io.StringIO stands in for a file wherever a test or a notebook has none."""
    urdf = '<robot name="one"><link name="only"/></robot>'
    assert rd.load(io.StringIO(urdf)).link_names == ("only",)


# --- out= ------------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ur5e():
    return rd.load(Path(__file__).parents[1] / "robots" / "ur5e.urdf")


OUTS = {
    "forward_dynamics": (("q", "v", "tau"), (6,)),
    "inverse_dynamics": (("q", "v", "tau"), (6,)),
    "bias_forces": (("q", "v"), (6,)),
    "mass_matrix": (("q",), (6, 6)),
    "momentum": (("q", "v"), (6,)),
    "link_poses": (("q",), (11, 4, 4)),
    "reactions": (("q", "v", "tau"), (11, 6)),
}


def states(robot, batch):
    rng = np.random.default_rng(8)
    return {name: rng.normal(size=(*batch, 6)) for name in ("q", "v", "tau")}


@pytest.mark.parametrize("batch", [(), (3,), (4, 5)])
@pytest.mark.parametrize("backend", ["native", "numpy"])
@pytest.mark.parametrize("name", OUTS)
def test_out_holds_what_is_returned_without_it(ur5e, name, backend, batch):
    given, shape = OUTS[name]
    shape = (*batch, len(ur5e.links), *shape[1:]) if name in ("link_poses", "reactions") else (*batch, *shape)
    arrays = [states(ur5e, batch)[x] for x in given]
    out = np.full(shape, np.nan)
    found = getattr(ur5e, name)(*arrays, backend=backend, out=out)
    assert (found.array if name == "reactions" else found) is out
    fresh = getattr(ur5e, name)(*arrays, backend=backend)
    assert np.array_equal(out, fresh.array if name == "reactions" else fresh)


@pytest.mark.parametrize("backend", ["native", "numpy"])
def test_an_out_that_cannot_hold_the_result_is_refused(ur5e, backend):
    x = states(ur5e, (4,))
    readonly, interleaved = np.empty((4, 6)), np.empty((4, 12))
    readonly.flags.writeable = False
    for out, words in (
        ([0.0] * 6, "must be an array of float64"),
        (np.empty((4, 6), dtype=np.float32), "an array of float32"),
        (np.empty((4, 6), dtype=">f8"), "must be an array of float64"),
        (np.empty(6), r"has the shape \(6,\): the result has \(4, 6\)"),
        (readonly, "read-only"),
        (interleaved[:, ::2], "not C-contiguous"),
        (np.empty((4, 6), order="F"), "not C-contiguous"),
        (x["tau"], "overlaps tau"),
    ):
        with pytest.raises(rd.InputError, match=words):
            ur5e.forward_dynamics(*x.values(), backend=backend, out=out)


def test_out_cannot_hold_fifty_digits(ur5e):
    with pytest.raises(rd.InputError, match="cannot hold the digits"):
        ur5e.mass_matrix(np.zeros(6), backend="mpmath", out=np.empty((6, 6)))
