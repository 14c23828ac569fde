"""The built-in functions that answer plain calls: the same answers, errors and references as the methods they stand before."""

import copy
import inspect
import os
import pickle
import subprocess
import sys
import threading
import types
from itertools import product

import numpy as np
import pytest
from tools import case

import robodyn as rd
from robodyn.dynamics.questions import ForwardDynamics
from robodyn.engine.emit import call
from robodyn.engine.run import builtin as fastcall, compile as compiler
from robodyn.robot import REMEMBERED

pytestmark = pytest.mark.skipif(not fastcall.supported(), reason="this interpreter lays out objects in another way")


def asked(seed=2):
    """A scene, and what its method says when it is not answered by a built-in function."""
    robot = case(seed).robot
    names = [joint.name for joint in robot.joints if joint.type.nv == 1]
    scene = rd.Scene(robot, loads=[rd.JointDamping(dict.fromkeys(names, 0.3))])
    return scene, rd.Scene(robot, loads=scene.loads)


def states(robot, n, seed=0):
    rng = np.random.default_rng(seed)
    q = np.stack([robot.random_state(rng)[0] for _ in range(n)])
    return q, rng.normal(size=(n, robot.nv)), rng.normal(size=(n, robot.nv))


def method(scene, name, *arguments, **options):
    return getattr(type(scene), name)(scene, *arguments, **options)


@pytest.mark.parametrize("name", ["forward_dynamics", "inverse_dynamics"])
@pytest.mark.parametrize("owner", ["robot", "scene"])
def test_all_kinds_of_calls_give_the_bits_of_the_method(owner, name):
    scene, other = asked()
    asking, reference = (scene, other) if owner == "scene" else (scene.robot, other.robot)
    q, v, x = states(scene.robot, 300)
    ask = lambda: getattr(asking, name)  # noqa: E731
    ask()(q[0], v[0], x[0])
    ask()(q, v, x)  # scalar code and code in lanes are there now
    assert isinstance(ask(), types.BuiltinFunctionType)
    for n, threads, given in product((None, 1, 7, 8, 9, 300), (None, 1), (False, True)):
        state = [a[0] if n is None else a[:n] for a in (q, v, x)]
        options = {"threads": threads} | ({"out": np.full_like(state[1], np.nan)} if given else {})
        found = ask()(*state, **options)
        assert found is options.get("out", found)
        assert np.array_equal(found, method(reference, name, *state, backend="native"))
    if name == "forward_dynamics":
        assert np.array_equal(ask()(q, v), method(reference, name, q, v))
        assert np.array_equal(ask()(q, v, out=None), method(reference, name, q, v))


def test_other_calls_go_to_the_method():
    scene, other = asked()
    q, v, tau = states(scene.robot, 40)
    scene.forward_dynamics(q, v, tau)
    expected = method(other, "forward_dynamics", q, v, tau)
    for arguments, options in [
        ((q.tolist(), v, tau), {}),
        ((q, v), {"tau": tau}),
        ((np.asfortranarray(q), v, tau), {"threads": 2}),
        ((q[None], v[None], tau), {}),
        ((q, v, tau), {"out": np.empty((80, scene.robot.nv))[::2].copy()}),
    ]:
        assert np.array_equal(scene.forward_dynamics(*arguments, **options).reshape(expected.shape), expected)
    assert scene.forward_dynamics(q, v, tau, dtype=np.float32).dtype == np.float32
    assert scene.forward_dynamics(q[:0], v[:0], tau[:0]).shape == (0, scene.robot.nv)
    readonly = np.empty_like(v)
    readonly.flags.writeable = False
    joined = np.zeros(v.size + 3)
    for out in (np.empty_like(v)[:-1], np.empty_like(v)[:, ::-1], readonly, v, joined[1 : 1 + v.size].astype(np.float32), 3):
        with pytest.raises(rd.InputError, match="out"):
            scene.forward_dynamics(q, v, tau, out=out)
    shared = np.concatenate([v.ravel(), np.zeros(v.size)])
    shifted = shared[scene.robot.nv : scene.robot.nv + v.size].reshape(v.shape)
    with pytest.raises(rd.InputError, match="overlaps v"):
        scene.forward_dynamics(q, shared[: v.size].reshape(v.shape), tau, out=shifted)
    behind = shared[v.size :].reshape(v.shape)  # touches v and does not overlap it
    assert np.array_equal(scene.forward_dynamics(q, shared[: v.size].reshape(v.shape), tau, out=behind), expected)
    with pytest.raises(TypeError, match="nonsense"):
        scene.forward_dynamics(q, v, tau, nonsense=1)
    with pytest.raises(rd.InputError, match="threads=True"):
        scene.forward_dynamics(q, v, tau, threads=True)


def test_bad_numbers_are_named_and_no_reference_is_lost():
    scene, _ = asked()
    q, v, tau = states(scene.robot, 40)
    out = scene.forward_dynamics(q, v, tau)
    bad = v.copy()
    bad[17, 0] = np.nan
    counts = [sys.getrefcount(x) for x in (q, v, tau, out, bad)]
    for _ in range(50):
        assert scene.forward_dynamics(q, v, tau, threads=1, out=out) is out
        with pytest.raises(rd.InputError, match=r"v\[17, 0\]"):
            scene.forward_dynamics(q, bad, tau, out=out)
    assert [sys.getrefcount(x) for x in (q, v, tau, out, bad)] == counts


def test_sampled_scenes_are_asked_in_python():
    robot = case(3).robot
    scene = rd.Scene(robot, loads=[rd.Sampled(lambda t, q, v: -v, 0.01)])
    q, v, _ = states(robot, 5)
    for _ in range(2):
        found = scene.forward_dynamics(q, v)
    assert np.array_equal(found, rd.Scene(robot).forward_dynamics(q, v, -v))


def test_long_work_lets_other_threads_run():
    scene, _ = asked()
    q, v, tau = (np.tile(x, (500, 1)) for x in states(scene.robot, 1000))
    scene.forward_dynamics(q[:9], v[:9], tau[:9])
    out, ticks, stop = np.empty_like(v), [0], threading.Event()

    def tick():
        while not stop.wait(1e-4):
            ticks[0] += 1

    other = threading.Thread(target=tick)
    other.start()
    before = ticks[0]
    for _ in range(3):
        scene.forward_dynamics(q, v, tau, threads=1, out=out)
    during = ticks[0] - before
    stop.set()
    other.join()
    assert during > 0  # each call takes longer than the interpreter's switch interval: held, none would come within it
    assert np.array_equal(out[:1000], out[-1000:])


@pytest.mark.parametrize("optional", [0, 1])
def test_the_module_is_what_llvm_accepts(optional):
    program = asked()[0].evaluator.kernel(ForwardDynamics("auto")).program
    compiler.llvm().parse_assembly(call.module(program, ("q", "v", "tau"), optional, compiler.lanes(), 10**7)).verify()


QUESTIONS = {
    "bias_forces": ("qv", {}),
    "mass_matrix": ("q", {}),
    "reactions": ("qvx", {"frame": "world", "part": "total"}),
    "momentum": ("qv", {}),
    "link_poses": ("q", {}),
    "kinetic_energy": ("qv", {}),
    "potential_energy": ("q", {}),
}


@pytest.mark.parametrize("name", QUESTIONS)
def test_what_is_asked_again_is_answered_alike(name):
    scene, _ = asked()
    q, v, x = states(scene.robot, 300)
    needs, options = QUESTIONS[name]
    given = {"q": q, "v": v, "x": x}

    def ask(*arrays, **more):
        found = getattr(scene, name)(*arrays, **options, **more)
        return getattr(found, "array", found)

    for n in (None, 1, 7, 9, 300):
        arrays = [given[k][0] if n is None else given[k][:n] for k in needs]
        first = ask(*arrays, dtype=np.dtype(float))  # as the default, and no plain call
        for _ in range(3):
            again = ask(*arrays)
            assert again.shape == first.shape
            assert np.array_equal(again, first)
        if "energy" in name:
            continue
        out = np.full_like(first, np.nan)
        assert ask(*arrays, out=out) is out
        assert np.array_equal(out, first)
        strided = np.empty((*first.shape, 2))[..., 0]
        for wrong in (strided, np.empty((*first.shape, 1)), np.swapaxes(np.empty_like(first), -1, -2) if first.ndim > 1 else q):
            if wrong.shape != first.shape or not wrong.flags.c_contiguous:
                with pytest.raises(rd.InputError, match="out"):
                    ask(*arrays, out=wrong)


def test_zeros_stand_for_what_is_not_given_and_bad_numbers_are_named():
    scene, other = asked()
    q, v, x = states(scene.robot, 20)
    for _ in range(3):
        assert np.array_equal(scene.reactions(q, v).array, other.reactions(q, v, np.zeros_like(v), dtype=np.dtype(float)).array)
        with pytest.raises(rd.InputError, match=r"tau\[3, 1\]"):
            scene.reactions(q, v, np.where(np.arange(v.size).reshape(v.shape) == 3 * v.shape[1] + 1, np.inf, x))
        with pytest.raises(rd.InputError, match="q has the shape"):
            scene.mass_matrix(q[:, 1:])
        with pytest.raises(rd.InputError, match="threads=0"):
            scene.mass_matrix(q, threads=0)


class Damped(rd.Robot):
    """A robot whose user changed a method."""

    def forward_dynamics(self, q, v, tau=None, **options):
        return super().forward_dynamics(q, v, (0 if tau is None else tau) - 10 * np.asarray(v), **options)


def test_methods_of_subclasses_are_called():
    robot = case(2).robot
    q, v, tau = (x[0] for x in states(robot, 1))
    damped = Damped.of(robot)
    for _ in range(3):
        assert np.array_equal(damped.forward_dynamics(q, v, tau), robot.forward_dynamics(q, v, tau - 10 * v))


@pytest.mark.parametrize("kind", ["robot", "scene"])
def test_help_still_shows_the_arguments(kind):
    scene, _ = asked()
    owner, (q, v, x) = getattr(scene, kind, scene), (x[0] for x in states(scene.robot, 1))
    for name in ("forward_dynamics", "inverse_dynamics"):
        before = inspect.signature(getattr(owner, name))
        getattr(owner, name)(q, v, x)
        function = getattr(owner, name)
        assert isinstance(function, types.BuiltinFunctionType)
        after = inspect.signature(function)
        assert [(p.name, p.kind) for p in after.parameters.values()] == [(p.name, p.kind) for p in before.parameters.values()]
        assert function.__doc__.startswith(inspect.getdoc(getattr(type(owner), name))[:20])


FORKING = """
import gc, os, signal, threading, time, numpy as np, robodyn as rd
small, large = (rd.random_robot(np.random.default_rng(3), n) for n in (2, 12))
assert not large.alone.evaluator.routes.loops  # so it is traced by two routes, and compared
ask = lambda robot: robot.forward_dynamics(robot.neutral(), np.zeros(robot.nv))
thread = threading.Thread(target=ask, args=(large,))
def fork():
    global child
    child = os.fork()
    if not child:
        signal.alarm(20)
        os._exit(0 if gc.isenabled() and all(np.isfinite(ask(robot)).all() for robot in (small, large)) else 1)
"""


def child_ends_well(code):
    """In a new process that runs code in which a child is forked: it gets answers of the robot that a thread asks, and of another."""
    code = FORKING + code + "thread.join(); print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))"
    environment = {**os.environ, "ROBODYN_CACHE": "off"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert done.stdout.strip() == "0", done.stderr[-2000:]


def test_a_fork_waits_for_another_threads_compiler():
    code = """
small.reactions(small.neutral(), np.zeros(small.nv))
from robodyn.engine.run import compile as compiler
compiling, whole = threading.Event(), compiler._optimised
compiler._optimised = lambda ir: (compiling.set(), whole(ir))[1]
thread.start()
compiling.wait()
time.sleep(0.01)
fork()
"""
    child_ends_well(code)


def test_a_fork_waits_for_another_threads_call_of_llvmlite():
    """Any call, even the end of an object that Python throws away, holds llvmlite's own lock."""
    code = """
import llvmlite.binding as binding
ask(small)
calling = threading.Event()
def slow():
    if threading.current_thread() is thread:
        calling.set()
        time.sleep(0.3)
binding.ffi.register_lock_callback(slow, lambda: None)
thread = threading.Thread(target=binding.get_default_triple)
thread.start()
calling.wait()
fork()
"""
    child_ends_well(code)


def test_a_fork_waits_for_another_threads_import_of_llvmlite():
    code = """
import builtins, sys
importing, whole = threading.Event(), builtins.__import__
def slow(name, *arguments):
    if name == "llvmlite.binding":
        importing.set()
    return whole(name, *arguments)
builtins.__import__ = slow
thread.start()
importing.wait()
time.sleep(0.01)
fork()
"""
    child_ends_well(code)


def test_a_fork_in_the_middle_of_another_threads_trace():
    """The child finds all locks free, those of lazily computed values too, and Python looking for garbage again."""
    code = """
from robodyn.dynamics.questions import ForwardDynamics
tracing, forked, whole = threading.Event(), threading.Event(), ForwardDynamics.answer
def answer(*arguments, **options):
    if threading.current_thread() is thread:
        tracing.set()
        forked.wait()
    return whole(*arguments, **options)
ForwardDynamics.answer = answer
thread.start()
tracing.wait()
assert not gc.isenabled()
fork()
forked.set()
"""
    child_ends_well(code)


def test_a_bad_row_is_found_whichever_thread_computes_it():
    robot, n = case(2).robot, 200_000
    q, v, tau = (np.repeat(x, n, axis=0) for x in states(robot, 1))
    for row in (3, n // 2 + 1, n - 3):
        v[row, 0] = np.nan
        with pytest.raises(rd.InputError, match=rf"v\[{row}, 0\]"):
            robot.forward_dynamics(q, v, tau, threads=3)
        v[row, 0] = 0.0


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="asks Linux for one core")
def test_threads_are_as_many_as_the_process_may_use():
    code = "import os; os.sched_setaffinity(0, [min(os.sched_getaffinity(0))]); from robodyn.system.processes import cores; print(cores())"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "1"


def test_kernels_of_few_gravities_are_kept():
    robot = case(2).robot
    for k in range(2 * REMEMBERED):
        robot.inverse_dynamics(robot.neutral(), np.zeros(robot.nv), np.zeros(robot.nv), gravity=(0, 0, -float(k)), backend="numpy")
    assert len(robot._elsewhere) == REMEMBERED + 1


def test_methods_can_be_pickled_after_use():
    robot = case(2).robot
    q, v, tau = (x[0] for x in states(robot, 1))
    for _ in range(2):
        expected = robot.forward_dynamics(q, v, tau)
    again = pickle.loads(pickle.dumps(robot.forward_dynamics))
    assert np.array_equal(again(q, v, tau), expected)
    assert np.array_equal(copy.deepcopy(robot).forward_dynamics(q, v, tau), expected)


def test_robots_are_collected_whole():
    """In memory that is overwritten when freed: what CPython reads of a function last must still be there."""
    code = """
import gc, numpy as np, robodyn as rd
for n in range(5):
    robot = rd.random_robot(np.random.default_rng(3), 3)
    q, v = robot.random_state(np.random.default_rng(0))
    for _ in range(3):
        robot.forward_dynamics(q, v); robot.mass_matrix(q); method = robot.inverse_dynamics
    del robot
    gc.collect()
    print(method(q, v, v).sum())
"""
    environment = {**os.environ, "PYTHONMALLOC": "malloc", "MALLOC_PERTURB_": "255"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


def test_results_of_no_states_have_a_place_too():
    robot = case(2).robot
    empty = np.empty((0, len(robot.link_names), 4, 4))
    for _ in range(3):
        assert robot.link_poses(np.zeros((0, robot.nq)), out=empty) is empty


def test_another_gravity_keeps_its_kernels(monkeypatch):
    robot = case(2).robot
    q, v, _ = (x[0] for x in states(robot, 1))
    expected = robot.forward_dynamics(q, v, gravity=(0, 0, -1.62))
    assert np.array_equal(robot.forward_dynamics(q, v, gravity=[0, 0, -9.81]), robot.forward_dynamics(q, v))
    monkeypatch.setattr("robodyn.evaluation.tracing.Tracing.program", None)  # nothing is traced again
    assert np.array_equal(robot.forward_dynamics(q, v, gravity=np.array([0, 0, -1.62])), expected)


def test_an_interrupted_batch_leaves_no_thread_at_work():
    code = """
import signal, numpy as np, robodyn as rd
robot = rd.random_robot(np.random.default_rng(3), 8)
q = np.tile(robot.neutral(), (300_000, 1)); v = np.ones((len(q), robot.nv))
ask = lambda: robot.reactions(q.astype(np.float32), v.astype(np.float32), threads=4, dtype=np.float32)
ask()
signal.signal(signal.SIGALRM, lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
for delay in np.linspace(0.02, 0.3, 15):
    signal.setitimer(signal.ITIMER_REAL, delay)
    try:
        while True:
            ask()
    except KeyboardInterrupt:
        pass
again = robot.forward_dynamics(q[:100], v[:100], threads=1)
print(np.isfinite(again).all())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "True"), done.stderr[-2000:]
