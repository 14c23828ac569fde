"""What is refused because no number would mean anything, and what must not be lost on the way."""

from dataclasses import replace

import numpy as np
import pytest
from tools import EPS, ROUTES

import robodyn as rd
from robodyn.arithmetic.vectors import frozen
from robodyn.joints import Fixed, Planar, Prismatic, Revolute
from robodyn.loads import Load
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


@pytest.mark.parametrize("backend", ["native", "numpy", "mpmath"])
@pytest.mark.parametrize("formalism", [*ROUTES, "auto"])
def test_a_point_mass_on_an_axis_names_its_joint_in_any_arithmetic(formalism, backend):
    """Two hinges a metre apart and a point mass a metre beyond: folded, it lies on the first axis."""
    point = Inertia.about_centre(1.0, np.array([-1.0, 0.0, 0.0]), np.zeros((3, 3)))
    hinge = Revolute.from_axis(np.array([0.0, 0.0, 1.0]))
    joints = (Joint(GROUND, Fixed(), -1), Joint("one", hinge, 0), Joint("two", hinge, 1, translation=np.array([1.0, 0.0, 0.0])))
    robot = rd.Robot("folded", (Link("base"), Link("arm"), Link("tip", point)), joints)
    with pytest.raises(rd.ModelError, match="joint 'one' of 'folded' has no inertia"):
        robot.forward_dynamics([0.3, 0.0], [0.1, 0.2], formalism=formalism, backend=backend)


@pytest.mark.parametrize("formalism", ["recursive", "nonrecursive"])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("n", [8, 24, 44])
def test_two_joints_on_one_axis_are_refused_among_any_number_of_freedoms(n, dtype, formalism):
    """Askew in a chain, a massless link between them: nothing says which of the two turns, whatever the rounding of the others."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        chain = rd.random_robot(rng, n, branching=0.0, joint_types=("revolute",), fixed=0.0)
        first, axis = int(rng.integers(1, n)), rng.normal(size=3)
        joints, links = list(chain.joints), list(chain.links)
        joints[first] = replace(joints[first], type=Revolute.from_axis(axis))
        along = frozen(0.3 * axis / np.linalg.norm(axis))
        joints[first + 1] = replace(joints[first + 1], type=Revolute.from_axis(axis), translation=along, rotation=frozen(np.eye(3)))
        links[first] = Link(links[first].name)
        robot = replace(chain, joints=tuple(joints), links=tuple(links))
        q = np.stack([robot.random_state(rng)[0] for _ in range(64)])
        for one in (q[0], q[1], q):
            with pytest.raises(rd.ModelError, match=rf"joint '{joints[first].name}' of .* has no inertia"):
                robot.forward_dynamics(one, 0.0 * one, dtype=dtype, formalism=formalism)


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


def test_the_users_list_may_change_the_load_does_not():
    robot = rd.random_robot(np.random.default_rng(6), 1, joint_types=("revolute",))
    force, damping = [1.0, 2.0, 3.0], {"joint_1": [2.0]}
    scene = rd.Scene(robot, loads=[rd.LinkWrench("link_1", force=force), rd.JointDamping(damping)])
    before = scene.forward_dynamics([0.1], [1.0])
    force[1], damping["joint_1"][0] = 1e3, 50.0
    for backend in ("native", "numpy"):
        assert np.allclose(scene.forward_dynamics([0.1], [1.0], backend=backend), before, rtol=1e-12)


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


# --- loads that are not finite -----------------------------------------------------------------------------------------


class Given(Load):
    """A load of the user's own: forces in joints and wrenches on links as functions of the state."""

    def __init__(self, forces=None, wrenches=None):
        object.__setattr__(self, "forces", forces)
        object.__setattr__(self, "wrenches", wrenches)

    def joint_forces(self, state):
        return self.forces(state) if self.forces else {}

    def link_wrenches(self, state):
        return self.wrenches(state) if self.wrenches else {}


def column(t):
    """The time (…, 1), beside coordinates."""
    return np.asarray(t)[..., None]


BOTH = pytest.mark.parametrize("backend", ["native", "numpy"])
FINE = rd.JointDamping({"joint_1": 0.1})
# Not finite, or too large, at q = 0.5 and t = 0.7; and what the error says, beside the time.
ENDLESS = {
    "pole": (Given(lambda s: {2: 1 / (s.position(2) - 0.5)}), r"force in joint 'joint_2' that the load Given gives is inf at t=0.7 s"),
    "root": (rd.ControlLaw(lambda t, q, v: np.sqrt(0.2 - q)), r"force in joint 'joint_1' that the load ControlLaw gives is nan at t=0.7 s"),
    "late": (
        Given(None, lambda s: {3: np.ones(6) * np.log(0.5 - column(s.t))}),
        r"link 'link_3' that the load Given gives is nan at t=0.7 s",
    ),
    "spring": (rd.JointSpring({"joint_3": 1e308}), r"'joint_3' that the load JointSpring gives is -5e\+307 at t=0.7 s.*too large"),
}


def arm():
    return rd.random_robot(np.random.default_rng(5), 3, joint_types=("revolute",))


@BOTH
@pytest.mark.parametrize("case", ENDLESS)
def test_a_load_that_is_not_finite_is_named_with_its_joint_and_time(case, backend):
    (load, message), q = ENDLESS[case], np.full(3, 0.5)
    scene = rd.Scene(arm(), loads=[FINE, load])
    for ask in (scene.forward_dynamics, scene.reactions):
        with pytest.raises(rd.ModelError, match=message):
            ask(q, 0 * q, t=0.7, backend=backend)
    if case != "late":  # in a batch, the state that is bad
        assert np.isfinite(scene.forward_dynamics(0.0 * q, 0 * q, t=0.7, backend=backend)).all()
        with pytest.raises(rd.ModelError, match=message.split(" gives")[0] + r".* at t=0.7 s in state \[1\]"):
            scene.forward_dynamics([0 * q, q], 0 * q, t=0.7, backend=backend)
    if case != "spring":  # whose forces are finite
        with pytest.raises(rd.ModelError, match=message):
            scene.inverse_dynamics(q, 0 * q, 0 * q, t=0.7, backend=backend)
    with pytest.raises(rd.ModelError, match=message):
        rd.simulate(scene, t0=0.7, t_end=1.0, q0=q, backend=backend)
    with pytest.raises(rd.SimulationError, match=message.split(" gives")[0]):
        rd.simulate_many(scene, t0=0.7, t_end=1.0, q0=[q, q])


@BOTH
@pytest.mark.parametrize("method", ["dop853", "rk45", "rk4", "semi_implicit_euler", "radau"])
def test_a_load_that_stops_being_finite_on_the_way_is_named(method, backend):
    """At the time of the trial state that it was asked at: within the step that failed, of 0.01 s or of error control's."""
    law = rd.ControlLaw(lambda t, q, v: np.sqrt(0.2 - t) - v)
    scene = rd.Scene(arm(), loads=[FINE, law], gravity=(0, 0, 0))
    with pytest.raises(rd.SimulationError, match=r"'joint_1' that the load ControlLaw gives is nan at t=0\.2") as caught:
        rd.simulate(scene, t_end=0.5, method=method, dt=0.01, rtol=1e-4, backend=backend)
    assert 0.1 < caught.value.trajectory.t[-1] <= 0.2


def test_in_many_trajectories_too():
    """The one that meets the pole first, in a crowd that does not."""
    pole = Given(lambda s: {2: 0.1 * np.sqrt(0.3 - s.position(2))})
    scene, q0 = rd.Scene(arm(), loads=[FINE, pole], gravity=(0, 0, 0)), np.zeros((11, 3))
    v0 = np.zeros((11, 3))
    v0[7, 1] = 3.0
    with pytest.raises(rd.SimulationError, match=r"trajectory 7: .*'joint_2' that the load Given gives is nan at t=0\.\d+ s"):
        rd.simulate_many(scene, t_end=0.2, q0=q0, v0=v0)


@BOTH
def test_finite_loads_are_not_blamed(backend):
    """A velocity that nothing can hold: its damping is large as well, and no cause."""
    scene = rd.Scene(arm(), loads=[FINE])
    with pytest.raises(rd.ModelError, match=r"not finite") as caught:
        scene.forward_dynamics(np.zeros(3), np.full(3, 1e200), backend=backend)
    assert "JointDamping" not in str(caught.value)
