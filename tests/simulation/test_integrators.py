"""Integrators by their observed order, the output times, what is conserved, and motions known in closed form.

Tolerances come from the integrator's own: a step of dop853 has an estimated error of at most rtol (1 + |x_k|) √n in each of the n
numbers x_k, and errors add up over the steps. `reach` turns that into a bound for any function of the state.
"""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ellipj, ellipk
from tools import EPS, case, condition, error

import robodyn as rd
from robodyn.formalism import energy
from robodyn.joints import Fixed, Free, Prismatic, Revolute, Spherical
from robodyn.model import GROUND, Inertia, Joint, Link
from robodyn.simulation import METHODS

ROBOTS = Path(__file__).parents[2] / "robots"
BACKENDS = ("native", "numpy")
BOTH = pytest.mark.parametrize("backend", BACKENDS)
dop853, rk45, rk4, euler = (METHODS[name].steps for name in ("dop853", "rk45", "rk4", "semi_implicit_euler"))
G = 9.81
NONE = (0.0, 0.0, 0.0)
X, Y, Z = np.eye(3)


# --- the methods alone, on a problem with a closed solution ------------------------------------------------------------


def wave(t, x):
    """ẋ = x cos t with x = exp(sin t), beside a rotation at 2 rad/s: smooth, depends on time, neither grows nor decays."""
    return np.array([x[0] * np.cos(t), -2 * x[2], 2 * x[1]])


def exact_wave(t):
    t = np.asarray(t)
    return np.stack([np.exp(np.sin(t)), np.cos(2 * t), np.sin(2 * t)], axis=-1)


def run(method, t_end=3.0, **options):
    return list(method(wave, 0.0, exact_wave(0.0), t_end, lambda x: x, **options))


def orders(errors):
    """log₂ of the ratio of each error to the next, of half the step."""
    return np.log2(errors[:-1] / errors[1:])


@pytest.mark.parametrize(("method", "order"), [(rk4, 4), (euler, 1)])
def test_orders_of_equal_steps(method, order):
    """Halving the step divides the error at the end by 2 to the order."""
    errors = np.array([abs(run(method, dt=3.0 / n)[-1].x - exact_wave(3.0)).max() for n in (80, 160, 320, 640)])
    assert np.allclose(orders(errors), order, rtol=0, atol=0.15)
    assert errors[-1] > 100 * EPS  # above rounding: the ratios mean something


def test_order_of_rk4_between_steps():
    """The cubic Hermite output is of order 4 as well."""
    errors = []
    for n in (40, 80, 160, 320):
        at = [(step, step.t_old + np.array([0.25, 0.5, 0.8]) * (step.t - step.t_old)) for step in run(rk4, dt=3.0 / n)]
        errors.append(max(abs(step.between(times) - exact_wave(times)).max() for step, times in at))
    assert np.allclose(orders(np.array(errors)), 4, rtol=0, atol=0.15)


def test_output_between_steps_meets_the_steps():
    for method in (rk4, dop853, rk45):
        before = exact_wave(0.0)
        for step in method(wave, 0.0, before, 3.0, lambda x: x, dt=0.1, rtol=1e-6, atol=1e-6):
            ends = step.between(np.array([step.t_old, step.t]))
            assert np.allclose(ends, [before, step.x], rtol=0, atol=50 * EPS * 3)  # values up to e, some ten products
            before = step.x


def test_error_of_dop853_follows_its_tolerance():
    """Within steps · rtol (1 + |x|) √n, times e² for the growth between exp(sin t) at its lowest and its highest; each 1e-3 pays."""
    errors = []
    for rtol in (1e-4, 1e-7, 1e-10, 1e-13):
        ends, between = [], []
        for step in dop853(wave, 0.0, exact_wave(0.0), 3.0, lambda x: x, rtol=rtol, atol=rtol):
            times = np.linspace(step.t_old, step.t, 4)
            ends.append(abs(step.x - exact_wave(step.t)).max())
            between.append(abs(step.between(times) - exact_wave(times)).max())
        errors.append(max(between))
        assert max(ends) < len(ends) * (rtol * (1 + np.e) * np.sqrt(3) * np.e**2 + 20 * EPS)
        assert max(between) < 10 * len(ends) * (rtol * (1 + np.e) * np.sqrt(3) * np.e**2 + 20 * EPS)  # the interpolant has order 7
    assert np.all(np.array(errors[1:]) < np.array(errors[:-1]) / 100)


@pytest.mark.parametrize("method", [name for name in METHODS if METHODS[name].adaptive])
def test_errors_follow_the_tolerance(method):
    """Error ∝ rtol, to a power near 1: all these methods control their error per step."""
    rtol = 10.0 ** np.arange(-4, -11 if method in ("dop853", "rk45", "radau") else -8, -1)
    errors = [abs(run(METHODS[method].steps, rtol=r, atol=r)[-1].x - exact_wave(3.0)).max() for r in rtol]
    slope = np.polyfit(np.log(rtol), np.log(errors), 1)[0]
    assert (0.8 if method != "bdf" else 0.6) < slope < 1.3  # SciPy's BDF varies its order: the error is less regular


@pytest.mark.parametrize("method", [METHODS[name].steps for name in METHODS], ids=list(METHODS))
def test_steps_follow_each_other(method):
    steps = run(method, dt=0.013, rtol=1e-8, atol=1e-8)
    assert steps[0].t_old == 0.0
    assert steps[-1].t == 3.0
    assert all(a.t == b.t_old for a, b in pairwise(steps))


@pytest.mark.parametrize(
    ("t_end", "dt", "count"), [(1.0, 0.1, 10), (1.0, 0.3, 4), (0.3, 0.1, 3), (0.7, 0.1, 7), (1.0, 1 / 3, 3), (1.0, 5.0, 1), (1.1, 0.1, 11)]
)
def test_rk4_takes_the_largest_equal_steps(t_end, dt, count):
    """h ≤ dt that divides the span; decimal fractions that do not quite add up make no extra step."""
    steps = run(rk4, t_end=t_end, dt=dt)
    assert len(steps) == count
    assert steps[-1].t == t_end
    lengths = [step.t - step.t_old for step in steps]
    assert np.allclose(lengths, t_end / count, rtol=0, atol=2 * EPS * t_end)


def test_the_projection_is_part_of_every_step():
    """Each method goes on from the projected state, and yields it."""

    def project(x):
        return np.array([x[0], *(x[1:] / np.hypot(*x[1:]))])

    for method in (rk4, euler, dop853, rk45):
        end, steps = exact_wave(0.0), list(method(wave, 0.0, exact_wave(0.0), 3.0, project, dt=0.2, rtol=1e-4, atol=1e-4))
        assert all(abs(np.hypot(*step.x[1:]) - 1) < 2 * EPS for step in steps)
        # The next step starts there: one step of the method from the projected state, over the same time, arrives at the same state.
        for step in steps[:3]:
            h = step.t - step.t_old
            if method in (rk4, euler):
                (alone,) = method(wave, step.t_old, end, step.t, project, dt=h)
                assert np.allclose(alone.x, step.x, rtol=4 * EPS, atol=0)  # h is rounded
            end = step.x


# --- simulate: orders, times, methods ----------------------------------------------------------------------------------


def pendulum():
    return rd.load(ROBOTS / "pendulum.urdf")


def swing(t, theta=-np.pi / 2):
    """The pendulum released at rest: sin(θ/2) = k sn(K(k) − ω t, k), k = sin(θ₀/2), by elliptic functions."""
    k = np.sin(theta / 2)
    sn, *_ = ellipj(ellipk(k**2) - np.sqrt(G) * t, k**2)
    return 2 * np.arcsin(k * sn)


@BOTH
@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("semi_implicit_euler", 1)])
def test_orders_on_a_pendulum(method, order, backend):
    """Between the steps as well: 111 frames per second fall on none of them."""
    errors = []
    for dt in (0.04, 0.02, 0.01) if order == 4 else (0.004, 0.002, 0.001):
        trajectory = rd.simulate(pendulum(), t_end=0.8, q0=[-np.pi / 2], method=method, dt=dt, fps=111, backend=backend)
        errors.append(abs(trajectory.q[:, 0] - swing(trajectory.t)).max())
    assert np.allclose(orders(np.array(errors)), order, rtol=0, atol=0.15)


@BOTH
@pytest.mark.parametrize("method", ["dop853", "rk45", "radau", "lsoda"])
def test_tolerances_on_a_pendulum(method, backend):
    """The error falls with rtol, and stays below steps · rtol (1 + |x|) √n, times the pendulum's growth of errors."""
    growth = 1 + np.sqrt(G) * 2  # linear: phase drifts with the speed's error over 2 s
    errors = []
    for rtol in (1e-5, 1e-7, 1e-9):
        trajectory = rd.simulate(pendulum(), t_end=2.0, q0=[-np.pi / 2], method=method, rtol=rtol, backend=backend)
        errors.append(abs(trajectory.q[:, 0] - swing(trajectory.t)).max())
        largest = max(abs(trajectory.q).max(), abs(trajectory.v).max())
        # rk45's own output between steps is of order 4, one less than its steps: it may be the larger error.
        between = 10 if method == "rk45" else 1
        assert errors[-1] < between * trajectory.stats["steps"] * rtol * (1 + largest) * np.sqrt(3) * growth
    assert errors[0] > 5 * errors[1] > 25 * errors[2]


@BOTH
def test_the_tightest_tolerance(backend):
    trajectory = rd.simulate(pendulum(), t_end=0.5, q0=[-np.pi / 2], rtol=1e-13, backend=backend)
    # rtol is 450 eps: per step that, and some ten roundings of numbers up to 5.
    assert abs(trajectory.q[:, 0] - swing(trajectory.t)).max() < trajectory.stats["steps"] * 5e-12
    assert trajectory.stats["rtol"] == trajectory.stats["atol"] == 1e-13
    with pytest.raises(rd.InputError, match=r"rtol=9\.9e-14.*at least 1e-13"):
        rd.simulate(pendulum(), t_end=0.5, rtol=9.9e-14, backend=backend)


def test_atol_of_its_own():
    loose = rd.simulate(pendulum(), t_end=0.5, q0=[-1.0], rtol=1e-9, atol=1e-3, fps=None)
    tight = rd.simulate(pendulum(), t_end=0.5, q0=[-1.0], rtol=1e-9, atol=1e-12, fps=None)
    assert loose.stats["steps"] < tight.stats["steps"]
    assert loose.stats["atol"] == 1e-3


AWKWARD = [(t_end, *pair) for t_end in (0.1, 0.3, 0.7, 1.1, 1 / 3, 2**-0.5) for pair in ((60, 0.1), (7, 0.03), (10, 1 / 7), (1 / 3, 0.05))]


@BOTH
@pytest.mark.parametrize("method", METHODS)
def test_the_last_time_is_the_end(method, backend):
    """t = 0, 1/fps, 2/fps, … and t_end exactly, which no other comes nearer to than a rounding would explain."""
    robot = pendulum()
    for t_end, fps, dt in AWKWARD:
        trajectory = rd.simulate(robot, t_end=t_end, q0=[0.4], method=method, fps=fps, dt=dt, rtol=1e-4, backend=backend)
        t = trajectory.t
        assert t[0] == 0.0
        assert t[-1] == t_end
        assert trajectory.completed
        assert (np.diff(t) > 1e-9).all()
        assert np.allclose(t[:-1] * fps, np.arange(len(t) - 1), rtol=4 * EPS, atol=0)
        assert len(t) - 1 == np.ceil(t_end * fps * (1 - 1e-12))
        assert all(len(x) == len(t) for x in (trajectory.q, trajectory.v, trajectory.a, trajectory.u, trajectory.work))


@BOTH
@pytest.mark.parametrize("method", ["dop853", "rk45", "rk4", "radau"])
def test_times_of_the_callers_choice(method, backend):
    """Exactly these and t_end; t0 only if it is among them; the states are those of the motion there."""
    options = {"q0": [-1.2], "method": method, "dt": 0.01, "rtol": 1e-9, "backend": backend}
    t = np.array([0.1, 0.123456, 0.5, 0.7])
    some = rd.simulate(pendulum(), t_end=0.8, times=t, **options)
    assert np.array_equal(some.t, [*t, 0.8])
    assert np.array_equal(rd.simulate(pendulum(), t_end=0.8, times=[0.0, 0.8], **options).t, [0.0, 0.8])
    # The output of order 4 or more between steps: far below this where the step is 0.01 s or rtol 1e-9.
    assert np.allclose(some.q[:, 0], swing(some.t, -1.2), rtol=0, atol=1e-6)


@BOTH
@pytest.mark.parametrize("method", METHODS)
def test_every_step(method, backend):
    """fps=None: t0, and the end of each step."""
    trajectory = rd.simulate(pendulum(), t_end=0.5, q0=[-1.0], method=method, dt=0.03, fps=None, rtol=1e-6, backend=backend)
    assert len(trajectory.t) == trajectory.stats["steps"] + 1
    assert (trajectory.t[0], trajectory.t[-1]) == (0.0, 0.5)
    assert (np.diff(trajectory.t) > 0).all()
    assert np.allclose(trajectory.q[:, 0], swing(trajectory.t, -1.0), rtol=0, atol=0.05 if "euler" in method else 1e-3)
    if not METHODS[method].adaptive:
        assert trajectory.stats["steps"] == 17
        assert trajectory.stats["evaluations"] == 1 + (4 if method == "rk4" else 1) * 17


@BOTH
@pytest.mark.parametrize("method", ["dop853", "rk4", "semi_implicit_euler"])
def test_a_start_that_is_not_zero(method, backend):
    """Autonomous motion does not care when it starts; a control law does."""
    options = {"q0": [-1.2], "method": method, "dt": 0.01, "fps": 20, "backend": backend}
    early, late = rd.simulate(pendulum(), t_end=0.5, **options), rd.simulate(pendulum(), t0=100.0, t_end=100.5, **options)
    assert (late.t[0], late.t[-1]) == (100.0, 100.5)
    assert np.allclose(early.t + 100, late.t, rtol=2 * EPS)
    # Frames near 100 s are rounded to 1e-14 s.
    assert np.allclose(early.q, late.q, rtol=0, atol=1e-8)
    asked = []
    law = rd.ControlLaw(lambda t, q, v: asked.append(t) or 0 * v)
    rd.simulate(rd.Scene(pendulum(), loads=[law]), t0=-3.0, t_end=-2.9, method=method, dt=0.05, fps=None, backend="numpy")
    assert min(asked) == -3.0
    assert max(asked) == -2.9


def test_both_methods_follow_the_same_motion():
    """rk4's error is known from two step sizes (Richardson), that of dop853 from its tolerance."""
    for seed, backend in ((0, "numpy"), (3, "native"), (6, "native")):  # a chain, a free base, a chain with several joint types
        c = case(seed, n=3)
        options = {"q0": c.q, "v0": c.v, "t_end": 0.1, "fps": 30, "backend": backend}
        fine, coarse = (rd.simulate(c.robot, method="rk4", dt=dt, **options) for dt in (1e-3, 2e-3))
        reference = rd.simulate(c.robot, rtol=1e-11, **options)
        largest = max(abs(reference.q).max(), abs(reference.v).max())
        own = reference.stats["steps"] * 1e-11 * (1 + largest) * np.sqrt(len(c.q) + len(c.v) + 1)
        for name in ("q", "v"):
            one, two, best = (getattr(x, name) for x in (fine, coarse, reference))
            assert abs(one - best).max() < 2 * abs(one - two).max() / 15 + own, (seed, name)


@pytest.mark.parametrize("method", METHODS)
def test_both_backends_follow_the_same_motion(method):
    """Equal steps differ by rounding alone, carried through 20 steps; adaptive ones within what their tolerance leaves."""
    c = case(3, n=3)
    options = {"q0": c.q, "v0": c.v, "t_end": 0.1, "fps": 33, "method": method, "dt": 0.005, "rtol": 1e-8}
    one, other = (rd.simulate(c.robot, backend=backend, **options) for backend in BACKENDS)
    assert np.array_equal(one.t, other.t)
    largest = max(1.0, abs(one.q).max(), abs(one.v).max())
    rounding = 20 * 50 * condition(c.robot, c.q) * EPS * largest
    steps = one.stats["steps"] + other.stats["steps"]
    allowed = steps * 1e-8 * (1 + largest) * np.sqrt(len(c.q) + len(c.v) + 1) if METHODS[method].adaptive else rounding
    for name in ("q", "v", "work"):
        assert abs(getattr(one, name) - getattr(other, name)).max() < 10 * allowed, name
    assert abs(one.q - one.q[0]).max() > 1e-3


def test_formalisms_follow_the_same_motion():
    c = case(2, n=3)
    options = {"q0": c.q, "v0": c.v, "t_end": 0.02, "fps": 100, "rtol": 1e-10}
    found = [rd.simulate(c.robot, formalism=f, **options) for f in ("auto", "recursive", "nonrecursive", "saddle_joint", "saddle_body")]
    for other in found[1:]:
        assert np.allclose(other.q, found[0].q, rtol=0, atol=1e-9)
        assert np.allclose(other.a, found[0].a, rtol=0, atol=1e-7)
    assert found[1].stats["formalism"] == "recursive"


def test_accelerations_belong_to_their_states():
    c = case(3, n=3)
    for backend in BACKENDS:
        trajectory = rd.simulate(c.robot, t_end=0.05, q0=c.q, v0=c.v, fps=100, formalism="recursive", backend=backend)
        a = c.robot.forward_dynamics(trajectory.q, trajectory.v, formalism="recursive", backend=backend)
        assert error(trajectory.a, a) < 50 * condition(c.robot, c.q) * EPS


def test_the_initial_state_is_kept_to_the_bit():
    c = case(1, n=3, joint_types=("revolute", "prismatic"), floating_base=False)
    trajectory = rd.simulate(c.robot, t_end=0.01, q0=c.q, v0=c.v)
    assert np.array_equal(trajectory.q[0], c.q)
    assert np.array_equal(trajectory.v[0], c.v)
    at_rest = rd.simulate(c.robot, t_end=0.01)
    assert np.array_equal(at_rest.q[0], c.robot.neutral())
    assert not at_rest.v[0].any()


def test_simulations_repeat_themselves():
    c = case(3, n=3)
    one, two = (rd.simulate(c.robot, t_end=0.05, q0=c.q, v0=c.v) for _ in range(2))
    assert np.array_equal(one.q, two.q)


# --- what is conserved -------------------------------------------------------------------------------------------------


def energy_at(scene, q, v):
    """Kinetic and potential energy by the formula: at states that have been moved, quaternions and all."""
    state = scene.equations().state(0.0, q, v)
    return energy.kinetic(state) + scene.equations().potential(state)


def momentum_at(scene, q, v):
    """Angular and linear momentum, likewise."""
    return energy.momentum(scene.equations().state(0.0, q, v))


def reach(trajectory, function, rtol):
    """How far `function(q, v)` (T, …) may stray: steps · rtol √n Σ_k |∂f/∂x_k| (1 + |x_k|), slopes by central differences."""
    x = np.concatenate([trajectory.q, trajectory.v], axis=-1)
    nq, h, total = trajectory.q.shape[-1], 1e-6, 0.0
    for k in range(x.shape[-1]):
        step = np.zeros(x.shape[-1])
        step[k] = h
        up, down = (function((x + s * step)[:, :nq], (x + s * step)[:, nq:]) for s in (1, -1))
        total = total + (abs(up - down) / (2 * h)).reshape(len(x), -1).max(-1) * (1 + abs(x[:, k]))
    return trajectory.stats["steps"] * rtol * np.sqrt(x.shape[-1] + 1) * total.max()


def conservative(seed):
    """A mixed tree with a free base every fourth time; from seed 20 on a free or spherical joint in mid-branch as well."""
    kinds = {} if seed < 20 else {"joint_types": ("spherical", "floating", "revolute")}
    return case(seed, n=4, **kinds)


@pytest.mark.parametrize("seed", [*range(8), *range(20, 24)])
def test_energy_is_conserved_where_nothing_acts(seed):
    """Gravity alone: kinetic + potential energy stays what it was, spherical and free joints included."""
    c, rtol = conservative(seed), 1e-9
    trajectory = rd.simulate(c.robot, t_end=0.25, q0=c.q, v0=c.v, rtol=rtol, backend=BACKENDS[seed % 2])
    scene = rd.Scene(c.robot)
    equations = scene.equations()
    bound = reach(trajectory, lambda q, v: energy_at(scene, q, v), rtol)
    found = trajectory.energy()
    assert found.drift < bound
    assert not found.work.any()
    assert np.ptp(found.kinetic) > 100 * found.drift  # something happened
    assert np.allclose(found.kinetic, scene.kinetic_energy(trajectory.q, trajectory.v, backend="numpy"), rtol=50 * EPS)
    quaternions = equations.side_conditions(trajectory.q)
    for joint, phi in quaternions:
        assert abs(phi).max() < 8 * EPS, joint


def flying(seed):
    """A tree with a free base, without gravity, with forces and damping in its inner joints."""
    c = conservative(seed)
    assert c.robot.joints[0].type.nv == 6
    inner = {joint.name: 0.5 for joint in c.robot.joints[1:] if joint.type.nv}
    return c, rd.Scene(c.robot, gravity=NONE, loads=[rd.JointForce(inner), rd.JointDamping(inner)])


@pytest.mark.parametrize("seed", [3, 7, 23])
def test_momentum_is_conserved_in_free_flight(seed):
    """A free base without gravity: angular and linear momentum stay, though inner joints move and forces act in them."""
    (c, scene), rtol = flying(seed), 1e-9
    trajectory = rd.simulate(scene, t_end=0.25, q0=c.q, v0=c.v, rtol=rtol)
    equations = scene.equations()
    momentum = momentum_at(scene, trajectory.q, trajectory.v)
    assert abs(momentum - momentum[0]).max() < reach(trajectory, lambda q, v: momentum_at(scene, q, v), rtol)
    assert abs(momentum).max() > 0.1
    for joint, phi in equations.side_conditions(trajectory.q):
        assert abs(phi).max() < 8 * EPS, joint


@pytest.mark.parametrize("seed", [3, 7])
def test_rk4_keeps_momentum_to_its_order(seed):
    """Half the step: a sixteenth of the drift, at least an eighth; quaternions are unit after every step."""
    c, scene = flying(seed)
    equations, drift = scene.equations(), []
    for dt in (0.02, 0.01):
        trajectory = rd.simulate(scene, t_end=0.2, q0=c.q, v0=c.v, method="rk4", dt=dt, fps=None, backend=BACKENDS[seed % 4 == 3])
        momentum = momentum_at(scene, trajectory.q, trajectory.v)
        drift.append(abs(momentum - momentum[0]).max())
        for joint, phi in equations.side_conditions(trajectory.q):
            assert abs(phi).max() < 8 * EPS, joint
    assert drift[1] < drift[0] / 8
    assert drift[0] < 1e-3 * abs(momentum).max()


@pytest.mark.parametrize("seed", range(6))
def test_the_balance_of_energy_counts_the_work_of_every_load(seed):
    """kinetic + potential − work is constant under damping, friction, springs, wrenches, forces and a control law together."""
    c, rtol = case(seed, n=4), 1e-9
    moving = [joint.name for joint in c.robot.joints if joint.type.nv]
    springs = {joint.name: 4.0 for joint in c.robot.joints if joint.type.nv and not joint.type.rated}
    loads = [
        rd.JointDamping(dict.fromkeys(moving, 0.3)),
        rd.JointFriction(dict.fromkeys(moving, 0.2), width=0.3),
        rd.JointForce(dict.fromkeys(moving, 0.4)),
        rd.JointSpring(springs),
        rd.LinkWrench(c.robot.link_names[-1], (1.0, 2.0, 3.0), (0.1, 0.2, 0.3), (0.1, 0.0, 0.2), ("link", "world")[seed % 2]),
        rd.ControlLaw(lambda t, q, v: np.sin(5 * t) - 0.5 * v),
    ]
    scene = rd.Scene(c.robot, loads=loads)
    trajectory = rd.simulate(scene, t_end=0.2, q0=c.q, v0=c.v, rtol=rtol, backend=BACKENDS[seed % 2])
    bound = reach(trajectory, lambda q, v: energy_at(scene, q, v), rtol)
    largest = (
        trajectory.stats["steps"] * rtol * (1 + abs(trajectory.work).max()) * np.sqrt(c.robot.nq + c.robot.nv + 1)
    )  # of the work itself
    found = trajectory.energy()
    assert found.drift < bound + largest
    assert abs(found.work).max() > 1e6 * found.drift
    assert found.work[0] == 0


def test_damping_takes_out_and_never_puts_in():
    robot = rd.load(ROBOTS / "double_pendulum.urdf")
    scene = rd.Scene(robot, loads=[rd.JointDamping(dict.fromkeys(robot.joint_names, 0.01))])
    work = rd.simulate(scene, t_end=0.5, q0=[1.0, 0.5]).work
    assert (np.diff(work) < 0).all()


# --- closed forms ------------------------------------------------------------------------------------------------------


def body_on(joint_type, mass=2.0, moments=(0.2, 0.3, 0.4), centre=NONE):
    body = Inertia.about_centre(mass, np.array(centre), np.diag(moments))
    if isinstance(joint_type, Free):
        return rd.Robot("one", (Link("body", body),), (Joint(GROUND, joint_type, -1),))
    return rd.Robot("one", (Link("base"), Link("body", body)), (Joint(GROUND, Fixed(), -1), Joint("joint", joint_type, 0)))


def test_free_fall():
    """z = ½ g t² downwards, for a slide along −z: to rounding, because the method is exact for polynomials."""
    trajectory = rd.simulate(body_on(Prismatic.from_axis(-Z)), t_end=1.0, fps=13)
    assert np.allclose(trajectory.q[:, 0], G * trajectory.t**2 / 2, rtol=0, atol=200 * EPS * G)
    assert np.allclose(trajectory.v[:, 0], G * trajectory.t, rtol=0, atol=200 * EPS * G)
    assert np.allclose(trajectory.reactions()["joint"], 0, rtol=0, atol=200 * EPS * G * 2)


def test_a_thrown_tumbling_body():
    """The centre of mass, away from O, flies the parabola whatever the body does; gravity askew."""
    robot, rtol, centre, gravity = body_on(Free(), centre=(0.3, -0.1, 0.2)), 1e-10, np.array([0.3, -0.1, 0.2]), np.array([1.0, 2.0, -9.0])
    rng = np.random.default_rng(1)
    q0, v0 = robot.random_state(rng)
    trajectory = rd.simulate(rd.Scene(robot, gravity=gravity), t_end=0.7, q0=q0, v0=3 * v0, rtol=rtol)
    T = trajectory.link_poses()[:, 0]
    flown = T[:, :3, :3] @ centre + T[:, :3, 3]
    start = T[0, :3, :3] @ (3 * v0[3:] + np.cross(3 * v0[:3], centre))
    t = trajectory.t[:, None]
    # Positions carry the speed's error over the flight; numbers are up to 10.
    bound = trajectory.stats["steps"] * rtol * 11 * np.sqrt(14) * (1 + 0.7 + 0.4)
    assert np.allclose(flown, flown[0] + start * t + gravity * t**2 / 2, rtol=0, atol=bound)


def free_precession(A, C, omega, t):
    """Body rates of a symmetric body, moments A, A, C: (ω₁, ω₂) turn in the body at λ = (A − C)/A · ω₃, ω₃ stays."""
    angle = (A - C) / A * omega[2] * t
    return np.stack(
        [omega[0] * np.cos(angle) + omega[1] * np.sin(angle), omega[1] * np.cos(angle) - omega[0] * np.sin(angle), 0 * t + omega[2]], -1
    )


@pytest.mark.parametrize("kind", ["spherical", "floating"])
def test_a_symmetric_body_precesses(kind):
    """Torque-free: ω as above in the body; in space the axis goes round L at |L|/A and keeps its angle to L."""
    A, C, rtol = 0.2, 0.35, 1e-10
    robot = body_on(Spherical() if kind == "spherical" else Free(), moments=(A, A, C))
    p = np.array([0.5, 0.5, -0.5, 0.5])
    omega = np.array([2.0, -1.0, 5.0])
    q0, v0 = (p, omega) if kind == "spherical" else (np.concatenate([[1.0, 2.0, 3.0], p]), np.concatenate([omega, [0.0, 0.0, 0.0]]))
    trajectory = rd.simulate(rd.Scene(robot, gravity=NONE), t_end=1.0, q0=q0, v0=v0, rtol=rtol)
    t, R = trajectory.t, trajectory.link_poses()[:, -1, :3, :3]
    bound = trajectory.stats["steps"] * rtol * 6 * np.sqrt(14) * (1 + 6.0)  # numbers up to 6; angles follow rates over 1 s
    assert np.allclose(trajectory.v[:, :3], free_precession(A, C, omega, t), rtol=0, atol=bound)

    L = R[0] @ ([A, A, C] * omega)
    rate, n = np.linalg.norm(L) / A, L / np.linalg.norm(L)
    axis = R[0][:, 2]
    along, across = n * (n @ axis), axis - n * (n @ axis)
    turned = along + np.cos(rate * t)[:, None] * across + np.sin(rate * t)[:, None] * np.cross(n, across)
    assert np.allclose(R[:, :, 2], turned, rtol=0, atol=bound)


def test_a_damped_slide():
    """m v̇ = −d v: v = v₀ exp(−d t/m), x = v₀ m/d (1 − exp(−d t/m)); the damper took what the mass lost."""
    m, d, v0, rtol = 2.0, 3.0, 1.5, 1e-10
    scene = rd.Scene(body_on(Prismatic.from_axis(X), mass=m), loads=[rd.JointDamping({"joint": d})])
    trajectory = rd.simulate(scene, t_end=1.0, v0=[v0], rtol=rtol)
    decay = np.exp(-d * trajectory.t / m)
    bound = trajectory.stats["steps"] * rtol * (1 + 3) * np.sqrt(3) * (1 + m / d)
    assert np.allclose(trajectory.v[:, 0], v0 * decay, rtol=0, atol=bound)
    assert np.allclose(trajectory.q[:, 0], v0 * m / d * (1 - decay), rtol=0, atol=bound)
    assert np.allclose(trajectory.work, m * v0**2 / 2 * (decay**2 - 1), rtol=0, atol=bound)
    assert np.allclose(trajectory.u[:, 0], -d * trajectory.v[:, 0], rtol=2 * EPS)


def test_a_rubbing_slide():
    """m v̇ = −c tanh(v/w): sinh(v/w) = sinh(v₀/w) exp(−c t/(m w))."""
    m, c, w, v0, rtol = 2.0, 3.0, 0.5, 1.0, 1e-10
    scene = rd.Scene(body_on(Prismatic.from_axis(X), mass=m), loads=[rd.JointFriction({"joint": c}, width=w)])
    trajectory = rd.simulate(scene, t_end=1.0, v0=[v0], rtol=rtol)
    expected = w * np.arcsinh(np.sinh(v0 / w) * np.exp(-c * trajectory.t / (m * w)))
    assert np.allclose(trajectory.v[:, 0], expected, rtol=0, atol=trajectory.stats["steps"] * rtol * (1 + 3) * np.sqrt(3))


@pytest.mark.parametrize("axis", [X, Z])
def test_a_mass_on_a_spring(axis):
    """x = x₀ cos ω t about the position of rest, ω² = k/m, over three periods: amplitude and phase. Gravity shifts the rest along z."""
    m, k, x0, rest, rtol = 2.0, 50.0, 0.2, 0.1, 1e-10
    scene = rd.Scene(body_on(Prismatic.from_axis(axis), mass=m), loads=[rd.JointSpring({"joint": k}, rest={"joint": rest})])
    middle = rest - m * G * axis[2] / k
    omega = np.sqrt(k / m)
    t_end = 3 * 2 * np.pi / omega
    trajectory = rd.simulate(scene, t_end=t_end, q0=[middle + x0], rtol=rtol)
    bound = trajectory.stats["steps"] * rtol * (1 + 1) * np.sqrt(3) * omega
    assert np.allclose(trajectory.q[:, 0], middle + x0 * np.cos(omega * trajectory.t), rtol=0, atol=bound)
    assert np.allclose(trajectory.v[:, 0], -x0 * omega * np.sin(omega * trajectory.t), rtol=0, atol=bound)


def test_a_wheel_that_turns_by_itself():
    """No torque: the angle of a continuous joint grows without being wrapped."""
    trajectory = rd.simulate(body_on(Revolute.from_axis(Z)), t_end=2.0, v0=[50.0], fps=10)
    assert np.allclose(trajectory.q[:, 0], 50 * trajectory.t, rtol=0, atol=100 * 100 * EPS)


def test_a_driven_slide():
    """A control law of time alone: m v̇ = A cos ω t from rest gives v = A/(mω) sin ω t."""
    A, omega, m, rtol = 4.0, 7.0, 2.0, 1e-10
    scene = rd.Scene(body_on(Prismatic.from_axis(X), mass=m), loads=[rd.ControlLaw(lambda t, q, v: [A * np.cos(omega * t)])])
    trajectory = rd.simulate(scene, t_end=1.0, rtol=rtol)
    bound = trajectory.stats["steps"] * rtol * (1 + 1) * np.sqrt(3)
    assert np.allclose(trajectory.v[:, 0], A / (m * omega) * np.sin(omega * trajectory.t), rtol=0, atol=bound)
    assert np.allclose(trajectory.u[:, 0], A * np.cos(omega * trajectory.t), rtol=0, atol=4 * EPS * A)


def test_motion_far_from_the_origin():
    """A base 10 km away moves like one at the origin: everything is resolved in the bodies' own frames."""
    c = case(1, n=3, floating_base=False)
    far = replace(c.robot, joints=(replace(c.robot.joints[0], translation=np.array([1e4, -1e4, 1e4])), *c.robot.joints[1:]))
    near, away = (rd.simulate(robot, t_end=0.1, q0=c.q, v0=c.v) for robot in (c.robot, far))
    assert np.array_equal(near.q, away.q)
    assert np.array_equal(near.reactions().array[:, 1:], away.reactions().array[:, 1:])
