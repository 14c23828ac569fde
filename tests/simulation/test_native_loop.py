"""The step loop in native code against the same methods in Python, and trajectories side by side in SIMD lanes."""

import re
import signal
import subprocess
import sys
import threading
import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import scipy.integrate
from tools import case

import robodyn as rd
from robodyn.engine.emit import integrate, vectors
from robodyn.joints import Fixed, Prismatic, Revolute
from robodyn.model import GROUND, Inertia, Joint, Link
from robodyn.simulation import many, native

BACKENDS = ("native", "numpy")


@pytest.fixture(scope="module")
def moving():
    """A tree with quaternions, damping and a load, and a state to start from."""
    c = case(1, n=4, joint_types=("revolute", "spherical", "prismatic", "planar"), floating_base=True)
    damping = {joint.name: 0.2 for joint in c.robot.joints if joint.type.nv}
    return rd.Scene(c.robot, loads=[rd.JointDamping(damping), rd.LinkWrench("link_2", force=(1.0, 2.0, 3.0))]), c.q, c.v


@pytest.mark.parametrize("method", ["rk4", "semi_implicit_euler"])
def test_equal_steps_are_the_same_steps(moving, method):
    """Same method, same step: only roundings differ, and 0.1 s of motion does not magnify them much."""
    scene, q, v = moving
    runs = [rd.simulate(scene, t_end=0.1, q0=q, v0=v, method=method, dt=2e-3, fps=70, backend=b) for b in ("native", "numpy")]
    assert np.array_equal(runs[0].t, runs[1].t)
    for name in ("q", "v", "a", "work"):
        a, b = (getattr(run, name) for run in runs)
        assert np.allclose(a, b, rtol=1e-11, atol=1e-11 * abs(b).max()), name
    assert runs[0].stats["evaluations"] == runs[1].stats["evaluations"]


@pytest.mark.parametrize(("method", "rtol"), [("dop853", 1e-10), ("rk45", 1e-8)])
def test_error_control_keeps_its_promise(moving, method, rtol):
    scene, q, v = moving
    reference = rd.simulate(scene, t_end=0.5, q0=q, v0=v, rtol=1e-13)
    run = rd.simulate(scene, t_end=0.5, q0=q, v0=v, method=method, rtol=rtol)
    assert abs(run.q - reference.q).max() < 1e3 * rtol  # some dozens of steps, each within rtol, and what the motion makes of it
    assert np.allclose(rd.simulate(scene, t_end=0.5, q0=q, v0=v, method=method, rtol=rtol, backend="numpy").q, reference.q, atol=1e3 * rtol)


@pytest.mark.parametrize("method", ["radau", "bdf", "lsoda"])
def test_stiff_methods(moving, method):
    scene, q, v = moving
    reference = rd.simulate(scene, t_end=0.1, q0=q, v0=v, rtol=1e-12)
    run = rd.simulate(scene, t_end=0.1, q0=q, v0=v, method=method, rtol=1e-7)
    assert abs(run.q[-1] - reference.q[-1]).max() < 1e-4  # multistep methods accumulate some hundred steps of 1e-7


def test_semi_implicit_euler_is_of_order_one_and_bounded():
    """Halved steps halve the error; the energy of a pendulum swings but does not drift as explicit Euler's would."""
    pendulum = rd.load(rods())
    reference = rd.simulate(pendulum, t_end=1.0, q0=[1.0], rtol=1e-12).q[-1]
    errors = [
        abs(rd.simulate(pendulum, t_end=1.0, q0=[1.0], method="semi_implicit_euler", dt=dt).q[-1] - reference)[0] for dt in (2e-3, 1e-3)
    ]
    assert errors[0] / errors[1] == pytest.approx(2, abs=0.1)
    swing = rd.simulate(pendulum, t_end=30.0, q0=[1.0], method="semi_implicit_euler", dt=5e-3).energy()
    assert swing.drift < 0.05 * swing.kinetic.max()


def test_every_step_natively(moving):
    scene, q, v = moving
    run = rd.simulate(scene, t_end=0.3, q0=q, v0=v, fps=None)
    assert len(run.t) == run.stats["steps"] + 1
    assert (np.diff(run.t) > 0).all()
    assert run.t[-1] == 0.3


@pytest.mark.parametrize("method", ["dop853", "rk4"])
def test_every_step_is_kept_without_python_in_the_loop(moving, method, monkeypatch):
    """Some hundred steps in a few calls of native code; where there is room for three at a time, the same ones."""
    scene, q, v = moving
    runs, calls, advance = [], [], native.Run.slice
    monkeypatch.setattr(native.Run, "slice", lambda run: (calls.append(1), advance(run))[1])
    for record in (native.RECORD, (3, 10**5), (1024, 1)):
        monkeypatch.setattr(native, "RECORD", record)
        calls.clear()
        runs.append(rd.simulate(scene, t_end=2.0, q0=q, v0=v, method=method, dt=1e-2, fps=None))
        steps = runs[-1].stats["steps"]
        assert steps > 100
        assert len(calls) < 10 if len(runs) == 1 else steps / 3 <= len(calls) <= steps + 5
    for run in runs[1:]:
        assert np.array_equal(run.t, runs[0].t)
        assert np.array_equal(run.q, runs[0].q)
        assert np.array_equal(run.work, runs[0].work)


def test_many_trajectories_have_the_bits_of_one(moving):
    scene, _, v = moving
    rng = np.random.default_rng(0)
    q0 = np.stack([scene.robot.random_state(rng)[0] for _ in range(19)])
    many = rd.simulate_many(scene, t_end=0.05, q0=q0, v0=v, dt=1e-3, fps=100)
    assert many.q.shape == (19, len(many.t), scene.robot.nq)
    for i in (0, 7, 18):
        alone = rd.simulate(scene, t_end=0.05, q0=q0[i], v0=v, method="rk4", dt=1e-3, fps=100)
        assert np.array_equal(many.q[i], alone.q)
        assert np.array_equal(many[i].a, alone.a)
    assert np.array_equal(many.q, rd.simulate_many(scene, t_end=0.05, q0=q0, v0=v, dt=1e-3, fps=100, threads=1).q)


@pytest.mark.parametrize("method", ["rk4", "semi_implicit_euler"])
@pytest.mark.parametrize(("t0", "t_end", "dt"), [(0.0, 0.05, 1e-3), (-3.1, -3.0, 0.007), (1e3, 1e3 + 0.3, 0.1)])
def test_without_frames_every_step_is_kept_whoever_simulates(moving, method, t0, t_end, dt):
    """fps=None means the same to one trajectory and to many: t0 and the end of each step, to the bit."""
    scene, q, v = moving
    options = {"t0": t0, "t_end": t_end, "dt": dt, "method": method, "v0": v}
    many = rd.simulate_many(scene, q0=np.stack([q] * 3), fps=None, **options)
    alone = rd.simulate(scene, q0=q, fps=None, **options)
    assert len(many.t) == alone.stats["steps"] + 1
    assert np.array_equal(many.t, alone.t)
    assert np.array_equal(many.q, np.stack([alone.q] * 3))
    assert np.array_equal(many.v[2], alone.v)
    assert np.array_equal(many.work[1], alone.work)
    # The end alone is a time as any other.
    ends = rd.simulate_many(scene, q0=q, times=[t_end], **options)
    assert ends.t.tolist() == [t_end]
    assert np.array_equal(ends.q[0], alone.q[-1:])


def test_ends_of_steps_are_rounded_once():
    from fractions import Fraction

    from robodyn.simulation.times import step_count, step_times

    for t0, t_end, dt in ((0.1, 7.3, 0.01), (-1e9, -1e9 + 1.0, 1e-2), (1e-300, 1.0, 0.1)):
        n = step_count(t0, t_end, dt)
        h = Fraction((t_end - t0) / n)
        assert step_times(t0, t_end, dt).tolist() == [float(Fraction(t0) + k * h) for k in range(n)] + [t_end]


def test_many_trajectories_need_unit_quaternions(moving):
    scene, q, _ = moving
    with pytest.raises(rd.InputError, match=r"q0\[1\]: the quaternion \(w, x, y, z\) of joint 'ground' has the length 1\.1"):
        rd.simulate_many(scene, q0=np.stack([q, 1.1 * q]), t_end=0.01)
    with pytest.raises(rd.InputError, match=r"^q0: the quaternion"):
        rd.simulate(scene, q0=1.1 * q, t_end=0.01)


def test_a_step_that_is_too_large_is_told_to_be_so():
    stiff = rd.Scene(rd.load(rods()), loads=[rd.JointDamping({"hinge": 1e5})])
    for run in (partial(rd.simulate, method="rk4"), rd.simulate_many):
        with pytest.raises(rd.SimulationError, match=r"dt=0\.001 s is too large, or method='radau'"):
            run(stiff, q0=[1.0], v0=[1.0], t_end=1.0, dt=1e-3)


def test_threads_that_need_the_same_step_loop_compile_it_once(monkeypatch):
    c = case(3, n=3)
    scene, compiled = rd.Scene(c.robot), []
    module = integrate.module
    monkeypatch.setattr(integrate, "module", lambda *arguments: (compiled.append(1), module(*arguments))[1])
    workers = [threading.Thread(target=native.compiled, args=(scene.evaluator, "rk4", "auto", 1)) for _ in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(compiled) == 1


def test_too_many_steps_to_keep_are_refused_before_they_are_made():
    with pytest.raises(rd.InputError, match=r"steps are too many to keep.*times=\[t_end\]"):
        rd.simulate_many(rd.load(rods()), t_end=1e6, fps=None)


def test_the_trajectory_that_cannot_go_on_is_named():
    cartpole = rd.load(rods().with_name("cartpole.urdf"))
    v0 = np.zeros((10, 2))
    v0[6, 1] = 1e200  # its square is beyond float64
    with pytest.raises(rd.SimulationError, match="trajectory 6"):
        rd.simulate_many(cartpole, t_end=0.1, v0=v0)


@pytest.mark.parametrize("width", [1, 2, 4, 8])
def test_the_first_is_named_whatever_the_lanes(monkeypatch, width):
    """Though the next one, which may share a block with it, fails earlier in time."""
    monkeypatch.setattr(many, "lanes", lambda: width)
    v0 = np.zeros((8, 2))
    v0[[2, 3, 7], 1] = 1e153, 1e200, 1e200
    with pytest.raises(rd.SimulationError, match="trajectory 2: "):
        rd.simulate_many(rd.load(rods().with_name("cartpole.urdf")), t_end=0.05, v0=v0)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_of_several_that_cannot_go_on_the_first_is_named(threads):
    """Whatever the number of threads, and though a later one fails earlier in time."""
    v0 = np.zeros((400, 2))
    v0[[150, 390], 1] = 1e153, 1e200  # a step, and none
    with pytest.raises(rd.SimulationError, match="trajectory 150: "):
        rd.simulate_many(rd.load(rods().with_name("cartpole.urdf")), t_end=0.05, v0=v0, threads=threads)


INTERRUPTED = """
import signal, sys, time
import numpy as np
import robodyn as rd
robot = rd.load(sys.argv[1])
rd.simulate_many(robot, q0=np.zeros((64, robot.nq)), t_end=0.01)
signal.signal(signal.SIGALRM, signal.default_int_handler)
signal.setitimer(signal.ITIMER_REAL, 0.5)
started = time.perf_counter()
try:
    rd.simulate_many(robot, q0=np.zeros((2048, robot.nq)), t_end=1e4, times=[1e4], threads=int(sys.argv[2]))
except KeyboardInterrupt:
    print(time.perf_counter() - started)
"""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs POSIX timers")
@pytest.mark.parametrize("threads", [1, 3])
def test_ctrl_c_stops_many_trajectories_between_slices(threads):
    """An hour's work ends soon: a slice takes 0.05 s, and a busy machine some of them."""
    command = [sys.executable, "-c", INTERRUPTED, rods().with_name("ur5e.urdf"), str(threads)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert 0.5 < float(done.stdout) < 10


def test_the_first_is_named_even_if_another_thread_took_it(monkeypatch):
    take, taken = native.Crowd._take, {True: threading.Event(), False: threading.Event()}

    def second(crowd, count, workers):
        mine = threading.current_thread() is threading.main_thread()
        if mine:
            assert taken[False].wait(60)
        blocks = take(crowd, count, workers)
        taken[mine].set()
        assert taken[True].wait(60)
        return blocks

    monkeypatch.setattr(native.Crowd, "_take", second)
    with pytest.raises(rd.SimulationError, match="trajectory 0: "):
        rd.simulate_many(rd.load(rods().with_name("cartpole.urdf")), t_end=0.05, v0=np.full((400, 2), 1e200), threads=2)


@pytest.mark.parametrize(
    ("method", "lanes"), [("rk4", 1), ("rk4", 4), ("semi_implicit_euler", 1), ("semi_implicit_euler", 4), ("dop853", 1)]
)
def test_a_pause_after_every_step_changes_no_bit(moving, method, lanes):
    """What a step needs of the one before is kept in between: progress and Ctrl-C come in pauses."""
    scene, q, v = moving
    x0 = np.repeat(np.concatenate([q, v, [0.0]])[:, None], lanes, axis=1)
    found = []
    for budget in (10**6, 1):
        settings = {"dt": 1e-3, "rtol": 1e-9, "atol": 1e-9}
        run = native.Run(native.compiled(scene.evaluator, method, "auto", lanes), x0, 0.0, np.linspace(0.0, 0.1, 77), settings)
        run.head_for(0.1)
        pauses, run._budget = 0, budget
        while run.slice():
            pauses, run._budget = pauses + 1, budget
        assert (pauses > 5) == (budget == 1)
        found.append((run.results.copy(), run.x.copy(), run.counts))
    assert np.array_equal(found[0][0], found[1][0])
    assert np.array_equal(found[0][1], found[1][1])
    assert len(found[0][0]) == 77
    assert found[0][2] == found[1][2]


def test_a_control_law_is_compiled():
    pendulum = rd.load(rods())
    scene = rd.Scene(pendulum, loads=[rd.ControlLaw(lambda t, q, v: -8.0 * q - np.tanh(3 * v) + np.sin(5 * t))])
    runs = [rd.simulate(scene, t_end=0.5, q0=[0.3], rtol=1e-11, backend=b) for b in ("native", "numpy")]
    assert np.allclose(runs[0].q, runs[1].q, rtol=0, atol=1e-9)
    assert np.allclose(runs[0].u, runs[1].u, rtol=0, atol=1e-8)


def test_a_law_that_branches_is_told_where():
    def law(t, q, v):
        return -q if q[0] > 0 else q

    scene = rd.Scene(rd.load(rods()), loads=[rd.ControlLaw(law)])
    where = r"test_native_loop\.py:\d+, `return -q if q\[0\] > 0 else q`"
    with pytest.raises(rd.InputError, match=where + r".*rd\.Sampled\(law, dt\).*backend='numpy'"):
        rd.simulate(scene, t_end=0.1)
    # Both ways out lead on.
    assert rd.simulate(scene, t_end=0.1, q0=[0.2], backend="numpy").completed
    assert rd.simulate(rd.Scene(scene.robot, loads=[rd.Sampled(law, 0.01)]), t_end=0.1, q0=[0.2]).completed


class Switch:
    """A law that is an object, and lets a method decide."""

    def __call__(self, t, q, v):
        return self.side(q) * v

    def side(self, q):
        return 1.0 if float(q[0]) > 0 else -1.0


@pytest.mark.parametrize("law", [Switch(), partial(Switch.__call__, Switch()), Switch().__call__], ids=["object", "partial", "method"])
def test_the_line_is_the_last_of_the_users_own(law):
    scene = rd.Scene(rd.load(rods()), loads=[rd.ControlLaw(law)])
    with pytest.raises(rd.InputError, match=r"test_native_loop\.py:\d+, `return 1\.0 if float\(q\[0\]\) > 0 else -1\.0`"):
        rd.simulate(scene, t_end=0.1)


def test_the_line_is_not_one_of_a_library():
    from scipy.spatial.transform import Rotation

    def law(t, q, v):
        return Rotation.from_rotvec([q[0], 0, 0]).as_rotvec()[:1]

    scene = rd.Scene(rd.load(rods()), loads=[rd.ControlLaw(law)])
    with pytest.raises(rd.InputError, match=r"test_native_loop\.py:\d+, `return Rotation\.from_rotvec"):
        rd.simulate(scene, t_end=0.1)


@pytest.mark.parametrize("method", ["rk45", "dop853"])
def test_states_between_steps_are_as_good_as_the_steps(moving, method):
    """Dense output in native code is SciPy's: no cubic that is coarser than the error control."""
    scene, q, v = moving
    reference = rd.simulate(scene, t_end=0.5, q0=q, v0=v, rtol=1e-13)
    errors = [abs(rd.simulate(scene, t_end=0.5, q0=q, v0=v, method=method, rtol=1e-9, backend=b).q - reference.q).max() for b in BACKENDS]
    assert errors[0] < 2 * errors[1] + 1e-10  # not the same steps: the first is guessed on its own


def rods():
    from pathlib import Path

    return Path(__file__).parents[2] / "robots" / "pendulum.urdf"


@pytest.mark.parametrize("threads", [0, -1, 1.5, "a", True])
def test_many_trajectories_refuse_what_is_no_number_of_threads(threads):
    robot = rd.random_robot(np.random.default_rng(0), 2, joint_types=("revolute",))
    with pytest.raises(rd.InputError, match="threads="):
        rd.simulate_many(robot, q0=np.zeros((3, 2)), t_end=0.01, threads=threads)


def test_no_trajectories_and_trajectories_that_cannot_start():
    robot = rd.random_robot(np.random.default_rng(0), 2, branching=0.0, joint_types=("revolute",))
    assert rd.simulate_many(robot, q0=np.zeros((0, 2)), t_end=0.01).q.shape[0] == 0
    massless = replace(robot, links=(*robot.links[:-1], Link(robot.links[-1].name)))
    with pytest.raises(rd.ModelError, match=robot.joint_names[-1]):
        rd.simulate_many(massless, q0=np.zeros((3, 2)), t_end=0.01)


@pytest.mark.parametrize(("links", "method"), [(1, "dop853"), (6, "dop853"), (6, "rk45"), (11, "rk4"), (60, "dop853")])
def test_entries_side_by_side_have_the_bits_of_one_at_a_time(links, method, monkeypatch):
    """3, 13, 23 and 121 entries: runs of 8, 4, 2 and 1, written out and in loops, at steps and in between."""
    runs = []
    for widths in (vectors.WIDTHS, (1,)):
        monkeypatch.setattr(vectors, "WIDTHS", widths)
        c = case(2, n=links, joint_types=("revolute",), floating_base=False)
        runs.append(rd.simulate(rd.Scene(c.robot), t_end=0.3, q0=c.q, v0=c.v, method=method, rtol=1e-9, fps=300))
    assert runs[0].stats["steps"] > 2
    for name in ("q", "v", "work"):
        assert np.array_equal(getattr(runs[0], name), getattr(runs[1], name)), name


@pytest.mark.parametrize("method", ["dop853", "rk45"])
@pytest.mark.parametrize("t_end", [2.0, 1e-5])
def test_the_first_step_is_scipys(method, t_end):
    """The same rule on the same numbers: only roundings differ, and the root of order 8 or 5 does not magnify them."""
    scene, q = rd.Scene(rd.load(rods().with_name("double_pendulum.urdf"))), np.array([0.4, -0.7])
    theirs = getattr(scipy.integrate, method.upper())(partial(rate, scene), 0.0, [*q, 0, 0, 0], t_end, rtol=1e-9, atol=1e-9)
    ours = rd.simulate(scene, t_end=t_end, q0=q, method=method, rtol=1e-9, fps=None)
    assert np.isclose(ours.t[1], theirs.h_abs, rtol=1e-9, atol=0)


@pytest.mark.parametrize("method", ["dop853", "rk45"])
def test_a_step_that_an_end_cuts_short_says_nothing_of_the_next(moving, method):
    """Behind a sample that falls just behind a step, the next one is as long as if there were none."""
    scene, q, v = moving
    settings = {"dt": 1e-3, "rtol": 1e-9, "atol": 1e-9}
    x0 = np.concatenate([q, v, [0.0]])[:, None]
    run, steps = native.Run(native.compiled(scene.evaluator, method, "auto", 1), x0, 0.0, np.zeros(0), settings), []
    for end in (0.5, 0.5 + 1e-9):
        run.head_for(end)
        while run.slice() != integrate.DONE:
            pass
        steps.append(run.h)
    assert run.t == 0.5 + 1e-9
    assert steps[1] == steps[0] > 1e-6


def test_where_the_motion_ends_the_step_shrinks_to_the_resolution_of_time():
    """A force that goes to infinity at t = 1: sixteen roundings of t are the last step."""
    scene = rd.Scene(
        rd.load(rods().with_name("cartpole.urdf")), loads=[rd.ControlLaw(lambda t, q, v: np.stack([(1.0 - t) ** -2.0, 0.0 * t]))]
    )
    with pytest.raises(rd.SimulationError, match="step size went to zero at t=1 s") as found:
        rd.simulate(scene, t_end=2.0, fps=None)
    t = found.value.trajectory.t
    assert 16 < (t[-1] - t[-2]) / np.finfo(float).eps < 80
    assert 1.0 - 1e-9 < t[-1] < 1.0


@pytest.mark.parametrize("method", ["dop853", "rk45"])
def test_a_step_that_leaves_where_the_load_is_defined_is_tried_again_shorter(method):
    """A cart that runs freely into a logarithmic barrier: before it steps grow at will, and beyond zero there is NaN; it turns before."""

    def barrier(t, q, v):
        return np.stack([np.where(q[0] > 0.3, 0.0, -50.0 * np.log(q[0] / 0.3)), 0.0 * t])

    scene = rd.Scene(rd.load(rods().with_name("cartpole.urdf")), loads=[rd.ControlLaw(barrier)])
    options = {"t_end": 3.0, "q0": [5.0, np.pi], "v0": [-3.0, 0.0], "method": method}
    run, exact = (rd.simulate(scene, rtol=rtol, **options) for rtol in (1e-3, 1e-11))
    assert run.stats["rejected"] > 0
    assert abs(run.q[-1, 0] - exact.q[-1, 0]) < 0.1  # of the cart's way of 5 m, at some dozens of steps of 1e-3


def test_at_the_same_tolerance_no_more_work_than_scipys_and_errors_of_the_same_size():
    """Both control DOP853's steps by the same rule: what differs is where steps happen to end, which evens out over a dozen falls."""
    scene, rng = rd.Scene(rd.load(rods().with_name("double_pendulum.urdf"))), np.random.default_rng(3)
    work, errors = np.zeros(2), np.zeros(2)
    for q in rng.uniform(-3, 3, (12, 2)):
        exact = rd.simulate(scene, t_end=1.0, q0=q, rtol=1e-13, times=[1.0])
        ours = rd.simulate(scene, t_end=1.0, q0=q, rtol=1e-9, times=[1.0])
        theirs = scipy.integrate.solve_ivp(partial(rate, scene), (0, 1), [*q, 0, 0, 0], method="DOP853", rtol=1e-9, atol=1e-9)
        work += ours.stats["evaluations"], theirs.nfev
        errors += [np.log(abs(end[:2] - exact.q[-1]).max()) for end in (ours.q[-1], theirs.y[:, -1])]
    assert work[0] <= work[1]
    assert abs(errors[0] - errors[1]) < 12 * np.log(1.1)


def rate(scene, t, x):
    """ẋ of x = (q, v, work) where no load does work."""
    n = scene.robot.nv
    return np.concatenate([x[n : 2 * n], scene.forward_dynamics(x[:n], x[n : 2 * n], np.zeros(n)), [0.0]])


@pytest.mark.parametrize("method", ["rk4", "semi_implicit_euler"])
def test_every_stage_has_its_own_time(method):
    """A law of time alone: a stage at the wrong time would differ by a share of dt, roundings do not."""

    def law(t, q, v):
        return np.sin(40.0 * t) * np.ones_like(v)

    scene = rd.Scene(rd.load(rods()), loads=[rd.ControlLaw(law)])
    runs = [rd.simulate(scene, t_end=0.2, q0=[0.3], method=method, dt=5e-3, backend=b) for b in BACKENDS]
    assert np.allclose(runs[0].q, runs[1].q, rtol=1e-12, atol=0)
    assert np.allclose(runs[0].v, runs[1].v, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("method", ["dop853", "rk45", "rk4"])
def test_every_step_ends_with_unit_quaternions(moving, method):
    scene, q, v = moving
    run = rd.simulate(scene, t_end=0.3, q0=q, v0=v, method=method, rtol=1e-5, dt=1e-2, fps=None)
    assert run.stats["steps"] > 3
    for _, phi in scene.equations().side_conditions(run.q):
        assert abs(phi).max() < 8 * np.finfo(float).eps  # of a sum of four squares, each rounded, after a division


@pytest.mark.parametrize("method", ["dop853", "rk4"])
def test_an_inertia_beyond_float64_is_not_taken_for_a_wall(method):
    """Divided by it, any force gives a finite zero: what turns a slider that is infinitely far away has to be refused by name."""
    sphere = Inertia.about_centre(1.0, np.zeros(3), 0.01 * np.eye(3))
    joints = (
        Joint(GROUND, Fixed(), -1),
        Joint("turn", Revolute.from_axis(np.array([0.0, 0.0, 1.0])), 0),
        Joint("slide", Prismatic.from_axis(np.array([1.0, 0.0, 0.0])), 1),
    )
    robot = rd.Robot("boom", (Link("base"), Link("boom", sphere), Link("far", sphere)), joints)
    with pytest.raises(rd.ModelError, match="the inertia that joint 'turn' moves is not finite"):
        rd.simulate(robot, t_end=0.01, q0=[0.0, 1e170], method=method)
    # Under way: the slider gets there within a step that is otherwise exact.
    with pytest.raises(rd.SimulationError, match="'turn' moves is not finite"):
        rd.simulate(robot, t_end=1.0, v0=[0.0, 1e160], method="rk4", dt=0.5)


@pytest.mark.parametrize("method", ["dop853", "rk45"])
def test_a_step_at_time_zero_shrinks_no_further_than_the_span_resolves(method):
    """√q is NaN on one side of the start: steps that move q by less than the least number would creep for ever."""
    robot = rd.load(rods().with_name("ur5e.urdf"))
    scene = rd.Scene(robot, loads=[rd.ControlLaw(lambda t, q, v: np.sqrt(q))])
    with pytest.raises(
        rd.SimulationError, match=r"the step size went to zero at t=0 s: the force in joint '\w+' that the load ControlLaw gives is nan"
    ):
        rd.simulate(scene, t_end=1.0, method=method)


def test_what_stopped_native_code_is_looked_for_in_few_steps(monkeypatch):
    """Velocities of 1e80 give steps of which Python would make millions until t_end."""
    from robodyn.simulation import integration as run

    asked, steps = [], run.Integration.steps

    def counted(self, *arguments, **options):
        for step in steps(self, *arguments, **options):
            asked.append(step)
            yield step

    monkeypatch.setattr(run.Integration, "steps", counted)
    robot = rd.load(rods().with_name("ur5e.urdf"))
    with pytest.raises(rd.SimulationError):
        rd.simulate(robot, t_end=0.1, v0=np.full(6, 1e80))
    assert len(asked) <= run.FEW


@pytest.mark.parametrize(("soon", "warned"), [((0.0, 0.0), True), ((1e9, 0.0), False), ((0.0, 1e9), False)])
def test_who_will_wait_for_hours_hears_of_it_once(moving, monkeypatch, soon, warned):
    from robodyn.simulation import progress as run

    monkeypatch.setattr(run, "SOON", soon)
    scene, q, v = moving
    monkeypatch.setattr(native, "RECORD", (3, 10**5))  # reports between
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        whole = rd.simulate(scene, t_end=0.3, q0=q, v0=v, fps=None)
    assert whole.completed
    assert len(found) == warned
    if warned:
        assert found[0].category is rd.RobodynWarning
        assert found[0].filename == __file__
        assert re.search(
            r"after \d s the simulation is at t=0\.\d+ s of 0\.3 s and would take [\d.e-]+ hours at this rate", str(found[0].message)
        )


def test_methods_by_the_names_that_scipy_gives_them(moving):
    scene, q, v = moving
    for name in ("Radau", "BDF", "LSODA", "DOP853", "RK45"):
        assert rd.simulate(scene, t_end=0.01, q0=q, v0=v, method=name, rtol=1e-4).stats["method"] == name.lower()
    assert rd.simulate_many(scene, t_end=0.01, q0=q, method="RK4").stats["method"] == "rk4"
