"""What is refused because no number would mean anything, and what must not be lost on the way."""

from dataclasses import replace

import numpy as np
import pytest
from tools import EPS, ROUTES

import robodyn as rd
from robodyn.algebra import frozen
from robodyn.joints import Fixed, Planar, Prismatic, Revolute
from robodyn.model import GROUND, Inertia, Joint, Link, Mimic


@pytest.mark.parametrize("formalism", [*ROUTES, "auto"])
@pytest.mark.parametrize("backend", ["native", "numpy"])
def test_four_axes_through_one_point_are_one_too_many(formalism, backend):
    """Three turn a body in every direction; with a fourth and nothing between them their shares are undetermined, by any route."""
    robot = rd.random_robot(np.random.default_rng(0), 4, branching=0, joint_types=("revolute",))
    links = tuple(link if i in (0, 4) else Link(link.name) for i, link in enumerate(robot.links))
    joints = tuple(replace(joint, translation=frozen(np.zeros(3))) for joint in robot.joints)
    crossed = replace(robot, links=links, joints=joints)
    q, v = crossed.random_state(np.random.default_rng(1))
    with pytest.raises(rd.ModelError, match="no inertia"):
        crossed.forward_dynamics(q, v, formalism=formalism, backend=backend)


def test_a_load_on_the_base_is_carried_by_the_ground():
    robot = rd.random_robot(np.random.default_rng(2), 3, joint_types=("revolute",))
    q, v = robot.random_state(np.random.default_rng(3))
    loaded = rd.Scene(robot, loads=[rd.LinkWrench("link_0", force=(0.0, 0.0, -50.0))])
    for backend in ("native", "numpy"):
        difference = loaded.reactions(q, v, backend=backend).array - robot.reactions(q, v, backend=backend).array
        assert np.allclose(difference[0], [0, 0, 0, 0, 0, 50], rtol=0, atol=1e3 * EPS)
        assert np.allclose(difference[1:], 0, rtol=0, atol=1e3 * EPS)


def test_coordinates_that_branches_share_fill_the_factorisation():
    """A mimic joint far out on one branch couples it with another: M̂ = GᵀMG of the robot without mimicry, to rounding."""
    rng = np.random.default_rng(4)
    free = rd.random_robot(rng, 7, branching=0.7, joint_types=("revolute",))
    leader, follower = 2, 7
    joints = list(free.joints)
    joints[follower] = replace(joints[follower], mimic=Mimic(leader, ratio=-1.5, offset=0.2))
    joints[6] = replace(joints[6], mimic=Mimic(3, ratio=0.7))
    robot = replace(free, joints=tuple(joints))
    G = np.zeros((7, 5))
    G[:5] = np.eye(5)
    G[follower - 1, leader - 1], G[5, 2] = -1.5, 0.7
    q, v, tau = rng.normal(size=5), rng.normal(size=5), rng.normal(size=5)
    q_free = G @ q + np.array([0, 0, 0, 0, 0, 0, 0.2])
    M = G.T @ free.mass_matrix(q_free) @ G
    expected = np.linalg.solve(M, tau - G.T @ free.bias_forces(q_free, G @ v))
    tolerance = 50 * np.linalg.cond(M) * EPS
    for formalism in ("nonrecursive", "saddle_joint", "saddle_body"):
        for backend in ("native", "numpy"):
            found = robot.forward_dynamics(q, v, tau, formalism=formalism, backend=backend)
            assert abs(found - expected).max() < tolerance * abs(expected).max()


def test_a_planar_joint_moves_along_its_two_axes():
    """n = z: x and y; n = x: y and z; the second axis is n × the first."""
    for axis, first, second in (((0, 0, 1), (1, 0, 0), (0, 1, 0)), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), ((0, 0, -1), (1, 0, 0), (0, -1, 0))):
        _, r = Planar.from_axis(axis).pose(np.array([2.0, 3.0, 0.4]))
        assert np.allclose(r, 2 * np.array(first) + 3 * np.array(second), rtol=0, atol=1e-15)


def test_quaternions_of_single_precision_pass_and_slips_do_not():
    robot = rd.random_robot(np.random.default_rng(5), 1, joint_types=("spherical",))
    for backend in ("native", "numpy"):
        robot.forward_dynamics(np.array([0.6, 0.8, 0.0, 0.0], dtype=np.float32), np.zeros(3), backend=backend)
        with pytest.raises(rd.InputError, match="length"):
            robot.forward_dynamics([1.0 + 2e-6, 0.0, 0.0, 0.0], np.zeros(3), backend=backend)


def test_a_body_with_negative_mass_is_refused():
    bad = Inertia(-1.0, frozen(np.zeros(3)), frozen(np.eye(3)))
    robot = rd.Robot("r", (Link("base"), Link("bad", bad)), (Joint(GROUND, Fixed(), -1), Joint("j", Revolute.from_axis((0, 0, 1)), 0)))
    for backend in ("native", "numpy", "mpmath"):
        with pytest.raises(rd.ModelError, match="mass -1 kg"):
            robot.forward_dynamics([0.0], [0.0], backend=backend)


def test_the_users_dictionary_may_change_the_load_does_not():
    robot = rd.random_robot(np.random.default_rng(6), 1, joint_types=("revolute",))
    given = {"joint_1": 2.0}
    scene = rd.Scene(robot, loads=[rd.JointDamping(given)])
    before = scene.forward_dynamics([0.1], [1.0], backend="numpy")
    given["joint_1"] = 50.0
    assert np.array_equal(scene.forward_dynamics([0.1], [1.0], backend="numpy"), before)


def test_results_beyond_float64_are_refused():
    robot = rd.random_robot(np.random.default_rng(7), 2, joint_types=("revolute",))
    for backend in ("native", "numpy"):
        with pytest.raises(rd.ModelError, match="not finite"):
            robot.inverse_dynamics([0.1, 0.2], [1e160, 1e160], [0.0, 0.0], backend=backend)
        with pytest.raises(rd.ModelError, match="not finite"):
            robot.kinetic_energy([0.1, 0.2], [1e160, 1e160], backend=backend)


@pytest.mark.parametrize("seed", range(24))
def test_simple_geometry_shares_products(seed):
    """Axes such as (1, 1, 0), equal lengths and round masses make equal products meet: what generic trees never do."""
    rng = np.random.default_rng(seed)
    axes = np.array([(1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0), (1, 0, 1), (1, 1, 1), (-1, 1, 0)], dtype=float)
    links, joints = [Link("base")], [Joint(GROUND, Fixed(), -1)]
    for i in range(1, int(rng.integers(2, 5)) + 1):
        kind = (Revolute, Revolute, Prismatic)[rng.integers(3)]
        offset = rng.integers(-1, 2, 3) * 0.5
        links.append(Link(f"link_{i}", Inertia.about_centre(1.0, rng.integers(-1, 2, 3) * 0.5, np.eye(3) * 0.5)))
        joints.append(Joint(f"joint_{i}", kind.from_axis(axes[rng.integers(len(axes))]), int(rng.integers(i)), translation=frozen(offset)))
    robot = rd.Robot("simple", tuple(links), tuple(joints))
    q, v, tau = (rng.normal(size=robot.nv) for _ in range(3))
    expected = robot.forward_dynamics(q, v, tau, backend="mpmath")
    tolerance = 50 * np.linalg.cond(robot.mass_matrix(q)) * EPS * float(abs(expected).max())
    for formalism in ("recursive", "nonrecursive", "auto"):
        assert abs(robot.forward_dynamics(q, v, tau, formalism=formalism) - expected).max() < tolerance
    assert np.isfinite(robot.reactions(q, v, tau).array).all()


def test_one_joint_without_inertia_is_named_by_the_plainest_call():
    point = Inertia.about_centre(1.0, np.array([0.0, 0.0, 0.3]), np.zeros((3, 3)))
    robot = rd.Robot("r", (Link("base"), Link("bob", point)), (Joint(GROUND, Fixed(), -1), Joint("spin", Revolute.from_axis((0, 0, 1)), 0)))
    with pytest.raises(rd.ModelError, match="'spin'"):
        robot.forward_dynamics([0.1], [1.0])
    for formalism in ROUTES:
        with pytest.raises(rd.ModelError, match="'spin'"):
            robot.forward_dynamics([0.1], [1.0], formalism=formalism)
