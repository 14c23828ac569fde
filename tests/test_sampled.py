"""Digital controllers: when they are asked, what is held, on every method, against closed forms, SciPy and Pinocchio."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from tools import EPS, case, condition, error

import robodyn as rd
from robodyn.joints import Fixed, Prismatic
from robodyn.model import GROUND, Inertia, Joint, Link
from robodyn.simulation import METHODS

ROBOTS = Path(__file__).parents[1] / "robots"
BOTH = pytest.mark.parametrize("backend", ["native", "numpy"])
X = np.array([1.0, 0.0, 0.0])
MASS = 2.0


def slide():
    """One body on a horizontal rail: m ẍ = u."""
    body = Inertia.about_centre(MASS, np.zeros(3), np.eye(3))
    joints = (Joint(GROUND, Fixed(), -1), Joint("slide", Prismatic.from_axis(X), 0))
    return rd.Robot("slide", (Link("base"), Link("body", body)), joints)


def pendulum():
    return rd.load(ROBOTS / "pendulum.urdf")


class Recorder:
    """A law that writes down every call."""

    def __init__(self, law=lambda t, q, v: 0 * v):
        self.law, self.calls = law, []

    def __call__(self, t, q, v):
        self.calls.append((t, q, v))
        return self.law(t, q, v)

    @property
    def times(self):
        return np.array([t for t, _, _ in self.calls])


class PID:
    """A discrete PID controller: its integral and its last error are its memory."""

    def __init__(self, dt, target, kp=30.0, ki=20.0, kd=4.0, limit=np.inf):
        self.dt, self.target, self.gains, self.limit = dt, target, (kp, ki, kd), limit
        self.sum, self.last = 0.0, None

    def __call__(self, t, q, v):
        e = self.target - q
        kp, ki, kd = self.gains
        self.sum = self.sum + self.dt * e
        slope = 0 * e if self.last is None else (e - self.last) / self.dt
        self.last = e
        u = kp * e + ki * self.sum + kd * slope
        if abs(u).max() > self.limit:  # what no tracer can follow
            u = u * (self.limit / abs(u).max())
        return u


# --- closed forms ------------------------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("method", METHODS)
def test_a_double_integrator_under_a_zero_order_hold(method, backend):
    """x⁺ = x + v h + u h² / 2m, v⁺ = v + u h / m, exactly: every method integrates a constant force up to rounding or its tolerance.

    An order-one method errs by u h² / 2m per period of one step, which is its own closed form: x⁺ = x + h v⁺.
    """
    h, pid = 0.02, PID(0.02, 0.5)
    run = rd.simulate(
        rd.Scene(slide(), loads=[rd.Sampled(PID(h, 0.5), h)]),
        t_end=1.0,
        v0=[0.3],
        times=np.arange(51) * h,
        method=method,
        dt=h,
        backend=backend,
    )
    x, v, expected = 0.0, 0.3, []
    for k in range(51):
        expected.append((x, v))
        u = pid(k * h, np.array([x]), np.array([v]))[0]
        a = u / MASS
        x, v = (x + h * (v + h * a) if "euler" in method else x + v * h + a * h * h / 2), v + a * h
    # A closed loop that converges does not magnify what each of 50 periods adds: some roundings, or some steps of rtol (1 + |x|).
    tolerance = {"radau": 1e-7, "bdf": 1e-5, "lsoda": 1e-5}.get(method, 50 * 64 * EPS)
    assert np.allclose(np.hstack([run.q, run.v]), expected, rtol=0, atol=tolerance)


@BOTH
def test_what_was_held_is_what_is_reported(backend):
    """a and u between samples are those of the hold; at a sample, of its answer; at the end, of the last hold."""
    law = Recorder(lambda t, q, v: np.array([1.0 + round(t / 0.1)]))
    run = rd.simulate(rd.Scene(slide(), loads=[rd.Sampled(law, 0.1)]), t_end=1.0, times=np.arange(41) / 40, backend=backend)
    k = np.minimum(np.floor(run.t * 10 + 1e-9), 9)
    assert np.array_equal(run.u[:, 0], 1.0 + k)
    assert np.allclose(run.a[:, 0], (1.0 + k) / MASS, rtol=4 * EPS)
    assert len(law.calls) == 10
    total, constraint = (run.reactions(part=part)["slide"] for part in ("total", "constraint"))
    assert np.allclose((total - constraint)[:, 3], 1.0 + k, rtol=0, atol=64 * EPS * abs(total).max())
    # Its work is ∫ u v dt, here ½ m v² with v from the sum of the holds; the balance has nothing else in it.
    assert np.allclose(run.work, 0.5 * MASS * run.v[:, 0] ** 2, rtol=0, atol=1e-9)
    assert run.energy().drift < 1e-9
    assert run.work[-1] > 1


# --- against others ----------------------------------------------------------------------------------------------------


def piecewise(f, x0, times, hold):
    """The same by SciPy at its tightest, one span after another; `hold(t, x)` gives what is held from t on."""
    from scipy.integrate import solve_ivp

    states = [np.asarray(x0, dtype=float)]
    for a, b in pairwise(times):
        u = hold(a, states[-1])
        states.append(solve_ivp(lambda t, x, u=u: f(t, x, u), (a, b), states[-1], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1])
    return np.array(states)


def test_an_arm_against_pinocchio_and_scipy():
    """UR5e under a saturated discrete PID: Pinocchio's accelerations, SciPy's integration, nothing of ours but the file."""
    import pinocchio as pin

    path, h = ROBOTS / "ur5e.urdf", 0.01
    robot, model = rd.load(path), pin.buildModelFromUrdf(str(path))
    data, n = model.createData(), robot.nv
    target = np.linspace(-0.3, 0.4, n)
    gains = {"kp": 20.0, "ki": 5.0, "kd": 0.5, "limit": 15.0}

    def law(pid):
        scale = np.array([1.0, 1.0, 0.5, 0.01, 0.01, 0.001])
        return lambda t, q, v: scale * pid(t, q, v)

    run = rd.simulate(
        rd.Scene(robot, loads=[rd.Sampled(law(PID(h, target, **gains)), h)], declared=False), t_end=0.3, times=np.arange(31) * h, rtol=1e-12
    )
    reference = law(PID(h, target, **gains))
    states = piecewise(
        lambda t, x, u: np.concatenate([x[n:], pin.aba(model, data, x[:n], x[n:], u)]),
        np.zeros(2 * n),
        np.arange(31) * h,
        lambda t, x: reference(t, x[:n], x[n:]),
    )
    # Both within 30 periods of 1e-12 (1 + |x|) √12 each, magnified by the gains' slope 1 / h in the derivative, up to 1e2 in velocity.
    largest = max(1.0, abs(states).max())
    assert abs(np.hstack([run.q, run.v]) - states).max() < 30 * 1e-12 * 12**0.5 * 1e2 * (1 + largest)
    assert abs(run.q[-1]).max() > 0.05


@pytest.mark.parametrize("method", METHODS)
def test_methods_agree_beside_other_loads(method):
    """Quaternions, damping, a traced law and two controllers of different rates: every method tends to one motion."""
    c = case(1, n=3, joint_types=("revolute", "spherical", "prismatic"))
    moving = [joint.name for joint in c.robot.joints if joint.type.nv]

    def scene():
        loads = [
            rd.JointDamping(dict.fromkeys(moving, 0.2)),
            rd.ControlLaw(lambda t, q, v: np.sin(5 * t) - 0.1 * v),
            rd.Sampled(lambda t, q, v: -v if v[0] > 0 else -2 * v, 0.03),
            rd.Sampled(lambda t, q, v: np.full(len(v), math.floor(50 * t + 1e-9) - 4.0), 0.02),
        ]
        return rd.Scene(c.robot, loads=loads)

    options = {"t_end": 0.2, "q0": c.q, "v0": c.v, "fps": 37}
    reference = rd.simulate(scene(), rtol=1e-12, **options)
    run = rd.simulate(scene(), method=method, rtol=1e-8, dt=1e-3 if method == "rk4" else 1e-4, **options)
    largest = max(1.0, abs(reference.q).max(), abs(reference.v).max())
    bound = {"semi_implicit_euler": 1e-2, "rk4": 1e-7}.get(method, run.stats["steps"] * 1e-8 * 10)
    assert abs(run.q - reference.q).max() < bound * (1 + largest) * 4
    assert reference.energy().drift < 1e-9
    other = rd.simulate(scene(), rtol=1e-12, backend="numpy", **options)
    assert abs(other.q - reference.q).max() < 1e-10 * (1 + largest)
    assert abs(other.u - reference.u).max() < 1e-8 * (1 + largest)


# --- when a law is asked -----------------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("method", METHODS)
def test_a_law_is_asked_once_per_period_in_order(method, backend):
    """Whatever the method tries in between; not at the end, where a simulation that goes on would ask again. On states of the motion."""
    law = Recorder(lambda t, q, v: -5 * q)
    run = rd.simulate(
        rd.Scene(pendulum(), loads=[rd.Sampled(law, 0.05)]),
        t0=-3.0,
        t_end=-2.5,
        q0=[1.0],
        method=method,
        dt=0.02,
        fps=None,
        rtol=1e-7,
        backend=backend,
    )
    assert np.array_equal(law.times, -3.0 + 0.05 * np.arange(10))
    # Steps end at each of them, on exactly the state that the law was given.
    rows = np.searchsorted(run.t, law.times)
    assert np.array_equal(run.t[rows], law.times)
    assert np.array_equal(run.q[rows], [q for _, q, _ in law.calls])
    assert np.array_equal(run.v[rows], [v for _, _, v in law.calls])
    assert len(run.t) == run.stats["steps"] + 1
    assert (np.diff(run.t) > 0).all()
    if not METHODS[method].adaptive:
        assert run.stats["steps"] == 30  # three of at most 0.02 s in each period


@BOTH
def test_instants_that_differ_by_rounding_are_one(backend):
    """0.1 and 0.3: 3 · 0.1 is not 0.3 in float64. Called in the order of the loads, and no sliver of a step in between."""
    order = []
    fast, slow = ((lambda t, q, v, name=name: order.append((name, t)) or 0 * v) for name in ("fast", "slow"))
    scene = rd.Scene(slide(), loads=[rd.Sampled(slow, 0.3), rd.Sampled(fast, 0.1)])
    run = rd.simulate(scene, t_end=30.0, v0=[1.0], method="rk4", dt=0.1, fps=None, backend=backend)
    assert [name for name, _ in order] == ["slow", "fast", "fast", "fast"] * 100
    assert np.allclose([t for _, t in order if _ == "fast"], np.arange(300) * 0.1, rtol=4 * EPS)
    assert all(a == b for (m, a), (n, b) in pairwise(order) if (m, n) == ("slow", "fast"))
    assert run.stats["steps"] == 300
    assert np.allclose(np.diff(run.t), 0.1, rtol=1e-12)


@BOTH
@pytest.mark.parametrize("t0", [0.0, 1000.0, -7.3])
def test_a_period_that_is_the_step_takes_one_step(t0, backend):
    """t0 + k dt rounds, and the quotient with it: still one step per period."""
    law = Recorder()
    run = rd.simulate(
        rd.Scene(slide(), loads=[rd.Sampled(law, 1e-3)]), t0=t0, t_end=t0 + 0.5, v0=[1.0], method="rk4", dt=1e-3, backend=backend
    )
    assert len(law.calls) == run.stats["steps"] == 500
    assert np.allclose(run.q[:, 0], run.t - t0, rtol=0, atol=500 * EPS * max(1, abs(t0)))


def test_two_rates_without_a_common_period():
    laws = Recorder(), Recorder()
    rd.simulate(rd.Scene(slide(), loads=[rd.Sampled(laws[0], 0.07), rd.Sampled(laws[1], 0.031)]), t_end=0.5)
    assert np.array_equal(laws[0].times, np.arange(8) * 0.07)
    assert np.array_equal(laws[1].times, np.arange(17) * 0.031)


def test_a_period_longer_than_the_simulation():
    law = Recorder(lambda t, q, v: [4.0])
    run = rd.simulate(rd.Scene(slide(), loads=[rd.Sampled(law, 100.0)]), t_end=0.5)
    assert law.times.tolist() == [0.0]
    assert np.isclose(run.q[-1, 0], 4.0 / MASS * 0.125, rtol=100 * EPS)


@BOTH
def test_a_law_may_keep_and_change_what_it_is_given(backend):
    """And go on writing to the array that it returned."""
    tau = np.zeros(1)

    def greedy(t, q, v):
        q += 100.0
        v[:] = np.nan
        tau[0] += 1.0
        return tau

    run = rd.simulate(rd.Scene(slide(), loads=[rd.Sampled(greedy, 0.1)]), t_end=0.3, backend=backend, times=[0.0, 0.15, 0.25])
    assert run.u[:, 0].tolist() == [1.0, 2.0, 3.0, 3.0]


@BOTH
def test_what_is_held_is_a_copy(backend):
    """The one law's array, written to by the other in between."""
    shared = np.array([1.0])

    def fast(t, q, v):
        shared[:] += 10.0
        return np.zeros(1)

    scene = rd.Scene(slide(), loads=[rd.Sampled(lambda t, q, v: shared, 0.4), rd.Sampled(fast, 0.1)])
    run = rd.simulate(scene, t_end=0.8, times=[0.0, 0.15, 0.35, 0.45, 0.75], backend=backend)
    assert run.u[:, 0].tolist() == [1.0, 1.0, 1.0, 41.0, 41.0, 41.0]


@pytest.mark.parametrize("t_end", [0.5, np.nextafter(0.5, 1), np.nextafter(0.5, 0)])
def test_an_end_that_is_an_instant_up_to_rounding_is_not_sampled(t_end):
    law = Recorder()
    rd.simulate(rd.Scene(slide(), loads=[rd.Sampled(law, 0.1)]), t_end=t_end)
    assert len(law.calls) == 5


@pytest.mark.parametrize("method", ["dop853", "rk45", "radau"])
@BOTH
def test_the_step_size_survives_a_sample(method, backend):
    """A period far below what error control asks for costs one step, none rejected; one far above, what the motion costs anyway."""
    scene = rd.Scene(pendulum(), loads=[rd.Sampled(lambda t, q, v: -2 * q, 0.01)])
    run = rd.simulate(scene, t_end=1.0, q0=[1.0], method=method, rtol=1e-4, backend=backend)
    assert run.stats["steps"] <= 100 + 5  # the first guess of a step may be short
    assert run.stats["rejected"] == 0
    options = {"t_end": 2.0, "q0": [1.0], "method": method, "rtol": 1e-10, "backend": backend}
    free = rd.simulate(pendulum(), **options)
    run = rd.simulate(rd.Scene(pendulum(), loads=[rd.Sampled(lambda t, q, v: 0 * q, 0.5)]), **options)
    assert run.stats["steps"] <= free.stats["steps"] + 2 * 4  # each end cuts one step in two
    assert abs(run.q - free.q).max() < 1e-10 * free.stats["steps"] * 10


# --- at one state ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [3, 6])
@BOTH
def test_a_question_at_a_state_asks_the_law(seed, backend):
    c = case(seed, n=3)
    law = Recorder(lambda t, q, v: np.sin(t) - 2.0 * v if v[0] > 0 else np.cos(t) + v)
    scene = rd.Scene(c.robot, loads=[rd.Sampled(law, 0.1), rd.Sampled(lambda t, q, v: np.ones(len(v)), 1.0)])
    sampled, tolerance = law.law(0.7, c.q, c.v) + 1, 100 * condition(c.robot, c.q) * EPS
    options = {"t": 0.7, "backend": backend}
    q = np.tile(c.q, (2, 3, 1))
    found = scene.forward_dynamics(q, c.v, c.tau, **options)
    assert len(law.calls) == 6
    assert found.shape == (2, 3, c.robot.nv)
    assert error(found[1, 2], c.reference.forward_dynamics(c.q, c.v, c.tau + sampled)) < tolerance
    assert error(scene.forward_dynamics(c.q, c.v, **options), c.reference.forward_dynamics(c.q, c.v, sampled)) < tolerance
    assert error(scene.inverse_dynamics(c.q, c.v, found[0, 0], **options), c.tau) < tolerance * max(1, abs(c.tau + sampled).max())
    bias = c.reference.bias_forces(c.q, c.v) - sampled
    assert error(scene.bias_forces(c.q, c.v, **options), bias) < tolerance
    for part in ("constraint", "total"):
        expected = c.robot.reactions(c.q, c.v, c.tau + sampled, part=part, backend="numpy").array
        assert error(scene.reactions(c.q, c.v, c.tau, part=part, **options).array, expected) < tolerance
    with pytest.raises(rd.ModelError, match=r"Sampled.*mpmath"):
        scene.forward_dynamics(c.q, c.v, backend="mpmath")


def test_mimic_joints_are_driven_at_their_leader():
    robot = rd.load(ROBOTS / "panda.urdf")
    assert robot.nu > robot.nv
    q, v = robot.random_state(np.random.default_rng(0))
    tau = np.arange(1.0, robot.nv + 1)
    scene = rd.Scene(robot, loads=[rd.Sampled(lambda t, q, v: tau, 0.1)], declared=False)
    expected = robot.forward_dynamics(q, v, tau, backend="numpy")
    assert error(scene.forward_dynamics(q, v, backend="numpy"), expected) < 100 * condition(robot, q) * EPS


# --- what goes wrong ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [0.0, -1.0, np.nan, np.inf, "often", None])
def test_a_period_must_be_one(dt):
    with pytest.raises(rd.InputError, match=r"Sampled.*dt=.*positive, finite"):
        rd.Scene(slide(), loads=[rd.Sampled(lambda t, q, v: v, dt)])


def test_a_law_must_be_a_function():
    with pytest.raises(rd.InputError, match=r"Sampled\(5.0\).*function of \(t, q, v\)"):
        rd.Scene(slide(), loads=[rd.Sampled(5.0, 0.1)])


def test_a_period_below_the_resolution_of_time():
    with pytest.raises(rd.InputError, match=r"dt=1e-09.*apart"):
        rd.simulate(rd.Scene(slide(), loads=[rd.Sampled(lambda t, q, v: v, 1e-9)]), t0=1e7, t_end=1e7 + 1)


def test_finite_forces_of_any_size_are_forces():
    """Their sum is beyond float64, they are not; and an infinity is found beside one of the other sign."""
    robot = rd.random_robot(np.random.default_rng(2), 2, joint_types=("prismatic",))
    most = np.finfo(float).max
    tau = rd.Sampled(lambda t, q, v: [most, most], 0.1).forces(robot, 0.0, np.zeros(2), np.zeros(2))
    assert tau.tolist() == [most, most]
    with pytest.raises(rd.InputError, match=r"returned inf for 'joint_1' at t=0 s"):
        rd.Sampled(lambda t, q, v: [np.inf, -np.inf], 0.1).forces(robot, 0.0, np.zeros(2), np.zeros(2))


class Broken(Exception):
    pass


def broken(t, q, v):
    raise Broken("no sensor")


FAULTS = {
    "shape": (lambda t, q, v: np.zeros(3), r"an array of shape \(3,\) at t=0.5 s: it must be an array \(1,\)", rd.InputError),
    "none": (lambda t, q, v: None, r"returned None at t=0.5 s", rd.InputError),
    "text": (lambda t, q, v: "full speed", r"returned 'full speed' at t=0.5 s", rd.InputError),
    "nan": (lambda t, q, v: [np.nan], r"returned nan for 'slide' at t=0.5 s", rd.InputError),
    "raises": (broken, r"raised Broken at t=0.5 s: no sensor", Broken),
}


@BOTH
@pytest.mark.parametrize("fault", FAULTS)
def test_a_law_that_fails_leaves_the_trajectory_so_far(fault, backend):
    law, message, cause = FAULTS[fault]
    scene = rd.Scene(slide(), loads=[rd.Sampled(lambda t, q, v: [2.0] if t < 0.49 else law(t, q, v), 0.1)])
    with pytest.raises(rd.SimulationError, match=message) as caught:
        rd.simulate(scene, t_end=1.0, fps=100, backend=backend)
    assert isinstance(caught.value.__cause__, cause)
    run = caught.value.trajectory
    assert run.t[-1] == 0.5
    assert not run.completed
    assert np.allclose(run.q[:, 0], run.t**2 / MASS, rtol=0, atol=1e-13)
    assert (run.u == 2.0).all()
    with pytest.raises(cause):
        scene.forward_dynamics([0.0], [0.0], t=0.5, backend=backend)


@BOTH
def test_a_law_that_fails_at_once(backend):
    with pytest.raises(rd.SimulationError, match="Broken at t=0 s") as caught:
        rd.simulate(rd.Scene(slide(), loads=[rd.Sampled(broken, 0.1)]), t_end=1.0, backend=backend)
    assert caught.value.trajectory.t.tolist() == [0.0]


@BOTH
@pytest.mark.parametrize("fps", [None, 100])
def test_ctrl_c_in_a_law_keeps_what_was_computed(fps, backend):
    def law(t, q, v):
        if t > 0.45:
            raise KeyboardInterrupt
        return [2.0]

    with pytest.warns(rd.RobodynWarning, match=r"interrupted at t=0.5 s of 1 s"):
        run = rd.simulate(rd.Scene(slide(), loads=[rd.Sampled(law, 0.1)]), t_end=1.0, fps=fps, backend=backend)
    assert not run.completed
    assert run.t[-1] == 0.5
    assert np.allclose(run.q[:, 0], run.t**2 / MASS, rtol=0, atol=1e-13)
    assert (run.u == 2.0).all()


@BOTH
def test_a_motion_that_fails_between_samples(backend):
    """v̇ = v² / m, run away at t = 1: the error is that of any simulation, under what is held."""
    scene = rd.Scene(slide(), loads=[rd.ControlLaw(lambda t, q, v: MASS * v * v - 3.0), rd.Sampled(lambda t, q, v: [3.0], 0.3)])
    with pytest.raises(rd.SimulationError, match=r"t=(1\.0|0\.99)") as caught:
        rd.simulate(scene, t_end=2.0, v0=[1.0], rtol=1e-6, backend=backend)
    early = caught.value.trajectory.t < 0.9
    assert np.allclose(caught.value.trajectory.v[early, 0], 1 / (1 - caught.value.trajectory.t[early]), rtol=1e-3)


def test_many_trajectories_cannot_share_a_memory():
    with pytest.raises(rd.InputError, match=r"Sampled.*rd\.simulate.*ControlLaw"):
        rd.simulate_many(rd.Scene(slide(), loads=[rd.Sampled(lambda t, q, v: v, 0.1)]), t_end=1.0, q0=np.zeros((3, 1)))


def test_a_file_keeps_the_held_forces(tmp_path):
    scene = rd.Scene(slide(), loads=[rd.JointDamping({"slide": 1.0}), rd.Sampled(lambda t, q, v: [5.0 if t < 0.1 else -3.0], 0.02)])
    run = rd.simulate(scene, t_end=0.2)
    with pytest.warns(rd.RobodynWarning, match=r"Sampled cannot be stored.*forces"):
        run.save(tmp_path / "run.npz")
    back = rd.Trajectory.load(tmp_path / "run.npz")
    assert [type(load).__name__ for load in back.scene.loads] == ["JointDamping"]
    assert np.array_equal(back.u, run.u)
    assert np.array_equal(back.reactions(part="total").array, run.reactions(part="total").array)
    assert np.array_equal(back.energy().balance, run.energy().balance)


def test_progress_is_told_along_the_way():
    shares = []
    rd.simulate(rd.Scene(slide(), loads=[rd.Sampled(lambda t, q, v: v, 0.1)]), t_end=1.0, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(shares) >= 10
