"""Every joint type against its own definition: pose, motion, bias, rate and side condition fit together, by differences in 50 digits."""

from dataclasses import FrozenInstanceError

import mpmath
import numpy as np
import pytest
from tools import EPS, derivative, error, many_digits

from robodyn.joints import JOINT_TYPES, Continuous, Fixed, Free, Planar, Prismatic, Revolute, Spherical
from robodyn.joints.base import AxisJoint

AXES = {
    "x": (1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "skew": (0.36, -0.48, 0.8),
    "long": (-3.0, 1.0, 7.0),  # not normalised
    "short": (1e-3, 2e-3, -5e-4),
}
WITH_AXIS = [name for name, joint in JOINT_TYPES.items() if issubclass(joint, AxisJoint)]
CASES = [(kind, axis) for kind in JOINT_TYPES for axis in (AXES if kind in WITH_AXIS else ["z"])]
EVERY = pytest.mark.parametrize(("kind", "axis"), CASES, ids=[f"{k}-{a}" if k in WITH_AXIS else k for k, a in CASES])

DIFFERENCE = 1e-28  # a central difference in 50 digits: truncation 1e-36, rounding 1e-50 / 1e-18


def joint_of(kind, axis):
    return JOINT_TYPES[kind].from_axis(np.array(AXES[axis]))


def state_of(joint, seed=0):
    """A random β and η."""
    rng = np.random.default_rng([7, seed])
    return joint.random(rng), rng.normal(size=joint.nv)


def exact_state(kind, axis):
    """The joint, an admissible β, and η, all in 50 digits."""
    joint = joint_of(kind, axis).exact()
    q, v = state_of(joint)
    return joint, joint.project(many_digits(q)), many_digits(v)


def axial(A):
    """a with ã = A."""
    return np.array([A[2, 1] - A[1, 2], A[0, 2] - A[2, 0], A[1, 0] - A[0, 1]]) / 2


@pytest.fixture(autouse=True)
def fifty_digits():
    with mpmath.workdps(50):
        yield


def test_the_words_of_the_file():
    assert {word: joint.__name__ for word, joint in JOINT_TYPES.items()} == {
        "fixed": "Fixed",
        "revolute": "Revolute",
        "continuous": "Continuous",
        "prismatic": "Prismatic",
        "planar": "Planar",
        "spherical": "Spherical",
        "floating": "Free",
    }


@EVERY
def test_sizes_fit_together(kind, axis):
    joint = joint_of(kind, axis)
    q, v = state_of(joint)
    R, r = joint.pose(q)
    assert (R.shape, r.shape) == ((3, 3), (3,))
    assert joint.motion(q).shape == joint.actuation(q).shape == (6, joint.nv)
    assert joint.neutral().shape == q.shape == joint.rate(q, v).shape == joint.project(q).shape == (joint.nq,)
    assert (joint.nq, joint.nv) == {"fixed": (0, 0), "planar": (3, 3), "spherical": (4, 3), "floating": (7, 6)}.get(kind, (1, 1))


@EVERY
def test_neutral_is_the_identity(kind, axis):
    joint = joint_of(kind, axis)
    R, r = joint.pose(joint.neutral())
    assert np.allclose(R, np.eye(3), rtol=0, atol=EPS)
    assert np.array_equal(r, np.zeros(3))


@EVERY
def test_pose_is_a_rotation_and_a_displacement(kind, axis):
    joint, q, _ = exact_state(kind, axis)
    R, _ = joint.pose(q)
    assert error(R.T @ R, np.eye(3)) < 1e-48
    assert abs(np.cross(R[:, 0], R[:, 1]) - R[:, 2]).max() < 1e-48


@EVERY
def test_motion_is_the_rate_of_the_pose(kind, axis):
    """S η = (ω, v) with ω̃ = RᵀṘ, v = Rᵀṙ, along β̇ = H(β) η."""
    joint, q, v = exact_state(kind, axis)
    R, _ = joint.pose(q)
    qdot = joint.rate(q, v)
    Rdot = derivative(lambda x: joint.pose(x)[0] + 0 * mpmath.mpf(1), q, qdot)
    rdot = derivative(lambda x: joint.pose(x)[1] + 0 * mpmath.mpf(1), q, qdot)
    twist = joint.motion(q) @ v if joint.nv else np.zeros(6)
    assert abs(twist - np.concatenate([axial(R.T @ Rdot), R.T @ rdot])).max() < DIFFERENCE


@EVERY
def test_bias_is_the_second_derivative_of_the_pose(kind, axis):
    """(ε, a) at η̇ = 0: the rate of (R ω, ṙ), which is (R S η) at constant η, resolved in the child."""
    joint, q, v = exact_state(kind, axis)
    R, _ = joint.pose(q)

    def velocity(x):
        R, twist = joint.pose(x)[0], joint.motion(x) @ v
        return np.concatenate([R @ twist[:3], R @ twist[3:]])

    bias = joint.bias(q, v)
    if not joint.nv:
        assert bias is None
        return
    slope = derivative(velocity, q, joint.rate(q, v))
    expected = np.concatenate([R.T @ slope[:3], R.T @ slope[3:]])
    assert abs((np.zeros(6) if bias is None else bias) - expected).max() < DIFFERENCE
    if kind == "floating":
        assert abs(expected).max() > 0.1  # it is not zero because the state is nothing


@EVERY
def test_rate_is_linear_and_keeps_the_side_condition(kind, axis):
    """β̇ = H(β) η with φ̇ = 0 on φ = 0; H = 1 where the joint says so."""
    joint, q, v = exact_state(kind, axis)
    other = many_digits(state_of(joint, 1)[1])
    assert abs(joint.rate(q, v + 2 * other) - joint.rate(q, v) - 2 * joint.rate(q, other)).max(initial=0) < 1e-47
    if not joint.rated:
        assert np.array_equal(joint.rate(q, v), v)
    if joint.side_condition(q) is not None:
        assert abs(derivative(joint.side_condition, q, joint.rate(q, v))) < DIFFERENCE


@EVERY
def test_side_condition_and_projection(kind, axis):
    """φ = |p|² − 1; `project` finds the admissible β of the same pose, and leaves an admissible one alone."""
    joint = joint_of(kind, axis)
    q, _ = state_of(joint)
    if joint.side_condition(q) is None:
        assert joint.project(q) is q
        assert not joint.rated
        return
    quaternion = slice(joint.nq - 4, joint.nq)
    longer = q.copy()
    longer[quaternion] *= 1.5
    # Four squares and their sum: 4 roundings of numbers up to 1.5².
    assert abs(joint.side_condition(q)) < 4 * EPS
    assert abs(joint.side_condition(longer) - 1.25) < 4 * 2.25 * EPS
    back = joint.project(longer)
    assert np.allclose(back, q, rtol=4 * EPS, atol=0)
    assert np.allclose(joint.project(q), q, rtol=4 * EPS, atol=0)
    for x, y in zip(joint.pose(longer), joint.pose(q), strict=True):
        assert np.allclose(x, y, rtol=0, atol=16 * EPS)  # R holds sums of four products of entries below 1
    assert np.array_equal(longer[quaternion], 1.5 * q[quaternion])  # the input is not touched


@EVERY
def test_actuation_is_dual_to_motion(kind, axis):
    """Sᵀ W = 1: joint forces u do the power ηᵀu."""
    joint, q, _ = exact_state(kind, axis)
    power = joint.motion(q).T @ joint.actuation(q)
    assert abs(power - np.eye(joint.nv)).max(initial=0) < 1e-48


@EVERY
def test_leading_dimensions(kind, axis):
    joint = joint_of(kind, axis)
    q = np.stack([[state_of(joint, 3 * i + j)[0] for j in range(3)] for i in range(2)])
    v = np.stack([[state_of(joint, 3 * i + j)[1] for j in range(3)] for i in range(2)])
    R, r = joint.pose(q)
    S, rate = np.broadcast_to(joint.motion(q), (2, 3, 6, joint.nv)), joint.rate(q, v)
    for i in np.ndindex(2, 3):
        # The same sums in another order of evaluation, of numbers of size 1: a few roundings each.
        assert np.allclose(np.broadcast_to(R, (2, 3, 3, 3))[i], joint.pose(q[i])[0], rtol=0, atol=8 * EPS)
        assert np.allclose(np.broadcast_to(r, (2, 3, 3))[i], joint.pose(q[i])[1], rtol=0, atol=8 * EPS)
        assert np.allclose(S[i], joint.motion(q[i]), rtol=0, atol=8 * EPS)
        assert np.allclose(rate[i], joint.rate(q[i], v[i]), rtol=0, atol=32 * EPS)
        if (bias := joint.bias(q, v)) is not None:
            assert np.allclose(bias[i], joint.bias(q[i], v[i]), rtol=0, atol=32 * EPS)
        if (phi := joint.side_condition(q)) is not None:
            assert abs(phi[i] - joint.side_condition(q[i])) < 8 * EPS


@pytest.mark.parametrize("kind", WITH_AXIS)
def test_length_of_the_axis_means_nothing_and_its_sign_everything(kind):
    """|axis| = 1 whatever the file says; −axis turns and pushes the other way round."""
    axis = np.array([1.0, -2.0, 0.5])
    joint, longer, opposite = (JOINT_TYPES[kind].from_axis(c * axis) for c in (1.0, 1e6, -1.0))
    assert abs(joint.axis @ joint.axis - 1) < 4 * EPS
    assert np.allclose(longer.axis, joint.axis, rtol=0, atol=2 * EPS)
    assert np.array_equal(opposite.axis, -joint.axis)
    if kind == "planar":
        return
    q = np.array([0.7])
    for x, y in zip(joint.pose(q), opposite.pose(-q), strict=True):
        assert np.allclose(x, y, rtol=0, atol=2 * EPS)


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
def test_a_positive_angle_turns_by_the_right_hand(kind):
    joint = JOINT_TYPES[kind].from_axis(np.array([0.0, 0.0, 1.0]))
    R, _ = joint.pose(np.array([np.pi / 2]))
    assert np.allclose(R @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], rtol=0, atol=EPS)


def test_a_continuous_joint_is_not_wrapped():
    assert Revolute.bounded
    assert not Continuous.bounded
    joint = Continuous.from_axis(np.array([0.0, 1.0, 0.0]))
    q = np.array([100.0])
    assert joint.project(q) is q
    # The angle is rounded to 100 eps before its sine is taken.
    assert np.allclose(joint.pose(q)[0], joint.pose(q - 30 * np.pi)[0], rtol=0, atol=2 * 100 * EPS)


@pytest.mark.parametrize("axis", AXES)
def test_the_axes_of_a_plane(axis):
    """u, n × u and n are orthonormal and right-handed; a point moves in the plane, whose normal stays."""
    joint = joint_of("planar", axis)
    u, w = joint.plane().T
    assert np.allclose([u @ u, w @ w, u @ w, u @ joint.axis, w @ joint.axis], [1, 1, 0, 0, 0], rtol=0, atol=4 * EPS)
    assert np.allclose(np.cross(u, w), joint.axis, rtol=0, atol=4 * EPS)
    R, r = joint.pose(np.array([2.0, 3.0, 0.4]))
    assert np.allclose(r, 2 * u + 3 * w, rtol=0, atol=8 * EPS)
    assert np.allclose(R @ joint.axis, joint.axis, rtol=0, atol=4 * EPS)


@pytest.mark.parametrize(("normal", "first", "second"), [("z", "x", "y"), ("x", "y", "z"), ("y", "z", "x")])
def test_a_plane_of_coordinate_axes_takes_them_in_turn(normal, first, second):
    e = dict(zip("xyz", np.eye(3), strict=True))
    assert np.array_equal(Planar.from_axis(e[normal]).plane().T, [e[first], e[second]])


def test_a_planar_velocity_is_along_the_parents_axes():
    """η = (ẋ, ẏ, θ̇): x and y stay along the parent's axes however far the child has turned."""
    joint = Planar.from_axis(np.array([0.0, 0.0, 1.0]))
    S = joint.motion(np.array([0.3, -0.2, np.pi / 2]))
    assert np.allclose(S[:, 0], [0, 0, 0, 0, -1, 0], rtol=0, atol=EPS)
    assert np.allclose(S[:, 1], [0, 0, 0, 1, 0, 0], rtol=0, atol=EPS)
    assert np.array_equal(S[:, 2], [0, 0, 1, 0, 0, 0])


def test_quaternions_are_w_x_y_z():
    """(cos φ/2, sin φ/2 · axis): a quarter turn about z takes x to y, in spherical and free joints alike."""
    p = np.array([np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)])
    for R in (Spherical().pose(p)[0], Free().pose(np.concatenate([[1.0, 2.0, 3.0], p]))[0]):
        assert np.allclose(R @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], rtol=0, atol=4 * EPS)


def test_velocities_of_a_free_joint_are_resolved_in_the_body():
    """η = (ω, v) in the child: after a quarter turn about z, v = x̂ moves O along the parent's y."""
    q = np.array([0.0, 0.0, 0.0, np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)])
    rate = Free().rate(q, np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]))
    assert np.allclose(rate, [0, 1, 0, 0, 0, 0, 0], rtol=0, atol=4 * EPS)


@pytest.mark.parametrize("kind", JOINT_TYPES)
def test_random_coordinates_are_admissible_and_seeded(kind):
    joint = joint_of(kind, "skew")
    first, again = (joint.random(np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(first, again)
    phi = joint.side_condition(first)
    assert phi is None or abs(phi) < 4 * EPS


@pytest.mark.parametrize("kind", WITH_AXIS)
def test_constants_cannot_be_changed(kind):
    axis = np.array([0.0, 0.6, 0.8])
    joint = JOINT_TYPES[kind].from_axis(axis)
    with pytest.raises(FrozenInstanceError):
        joint.axis = axis
    with pytest.raises(ValueError, match="read-only"):
        joint.axis[0] = 1.0
    axis[0] = 5.0
    assert abs(joint.axis @ joint.axis - 1) < 4 * EPS


@pytest.mark.parametrize("kind", WITH_AXIS)
def test_an_exact_axis_has_length_one_to_fifty_digits(kind):
    exact = joint_of(kind, "long").exact()
    assert abs((exact.axis * exact.axis).sum() - 1) < 1e-49
    assert error(exact.axis, joint_of(kind, "long").axis) < 2 * EPS


def test_prismatic_and_fixed_joints_do_not_turn():
    R, r = Prismatic.from_axis(np.array([0.0, -2.0, 0.0])).pose(np.array([0.3]))
    assert np.array_equal(R, np.eye(3))
    assert np.array_equal(r, [0.0, -0.3, 0.0])
    assert Fixed().motion(np.zeros(0)).shape == (6, 0)
