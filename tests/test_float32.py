"""Kernels and answers in single precision."""

import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest
from tools import case, condition, error

import robodyn as rd
from robodyn.arithmetic import functions as arithmetic
from robodyn.dynamics.questions import ForwardDynamics
from robodyn.engine.run.compile import lanes
from robodyn.engine.run.kernel import SINGLE, Kernel
from robodyn.engine.trace.graph import Graph
from robodyn.engine.trace.program import program

EPS = float(np.finfo(np.float32).eps)
C = 20  # a sweep of some dozens of roundings, which add up like their square root
FILES = sorted((Path(__file__).parents[1] / "robots").glob("*.urdf"))
BOTH = pytest.mark.parametrize("backend", ["native", "numpy"])


def single(*arrays):
    return [np.asarray(x, dtype=np.float32) for x in arrays]


def robot_of(source):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rd.RobodynWarning)
        return rd.load(source)


# --- elementary functions ----------------------------------------------------------------------------------------------


def kernel(function, arguments=1):
    graph = Graph()
    x = graph.inputs("x", (arguments,))
    return Kernel(program(graph, {"x": arguments}, {"y": np.atleast_1d(function(*x))}), SINGLE)


def floats(low, high, step=997):
    """Every `step`-th number between two positive ones."""
    first, last = (int(np.float32(x).view(np.int32)) for x in (low, high))
    return np.arange(first, last, step, dtype=np.int32).view(np.float32)


DOMAINS = {
    "sin": [(1e-30, 3.4e38)],
    "cos": [(1e-30, 3.4e38)],
    "exp": [(1e-30, 88.72), (-1e-30, -103.2)],
    "log": [(1.5e-45, 3.4e38)],
    "tanh": [(1e-42, 30.0), (-1e-42, -30.0)],
    "sqrt": [(1e-37, 3.4e38)],
    "arctan": [(1e-30, 1e30)],
}


@pytest.mark.parametrize("name", DOMAINS)
def test_functions_within_one_ulp(name):
    """All over their domains, against float64, whose own error is 1e-8 of a unit here."""
    xs = np.concatenate([np.sign(a) * floats(abs(a), abs(b)) for a, b in DOMAINS[name]]).astype(np.float32)
    near = (np.arange(1, 60000, 7) * (np.pi / 2)).astype(np.float32)  # all but a multiple of π/2: the hardest to reduce
    xs = np.concatenate([xs, near]) if name in ("sin", "cos") else xs
    k = kernel(getattr(arithmetic, name))
    found, bad = k((len(xs),), {"x": xs[:, None]})
    assert bad == -1
    exact = getattr(np, name)(xs.astype(float))
    assert (abs(found["y"][:, 0] - exact) / np.spacing(abs(exact).astype(np.float32))).max() <= 1.0
    for i in range(0, len(xs), len(xs) // 20):
        assert k((1,), {"x": xs[i : i + 1]})[0]["y"][0, 0] == found["y"][i, 0]


def test_pow_within_one_ulp():
    rng = np.random.default_rng(0)
    xs = np.stack([rng.uniform(0.1, 10, 50_000), rng.uniform(-38, 38, 50_000)], 1).astype(np.float32)
    found, bad = kernel(arithmetic.power, 2)((len(xs),), {"x": xs})
    assert bad == -1
    exact = xs[:, 0].astype(float) ** xs[:, 1].astype(float)
    assert (abs(found["y"][:, 0] - exact) / np.spacing(abs(exact).astype(np.float32))).max() <= 1.0


SPECIAL = single([0.0, -0.0, 1.0, -1.0, 0.5, 3.0, 1e30, -1e30, 1e-40, 89.0, -104.0, np.inf, -np.inf, np.nan])[0]


@pytest.mark.parametrize("name", ["exp", "log", "tanh", "minimum", "maximum", "power"])
def test_special_cases_are_numpys(name):
    n = 2 if name in ("minimum", "maximum", "power") else 1
    k, ufunc = kernel(getattr(arithmetic, name), n), getattr(np, name)
    for xs in np.stack([x.ravel() for x in np.meshgrid(*[SPECIAL] * n)], 1):
        if name == "power" and xs[1] == 0.5:  # NumPy takes the square root
            continue
        with np.errstate(all="ignore"):
            expected = np.float32(ufunc(*xs.astype(float)))
        for y in (*k((1,), {"x": xs})[0]["y"][:, 0], *k((2 * lanes(),), {"x": xs})[0]["y"][:, 0]):  # one block of lanes
            assert y == expected or (np.isnan(y) and np.isnan(expected)) or abs(y - expected) <= np.spacing(abs(expected))


# --- answers -----------------------------------------------------------------------------------------------------------


def check(robot, *, seed=0):
    """The answers at a state, against 50 digits at the very same state."""
    rng = np.random.default_rng(seed)
    q, v = robot.random_state(rng)
    q, v, tau, a = single(q, v, rng.normal(size=robot.nv), rng.normal(size=robot.nv))
    states = (q, v, tau)
    tolerance = C * condition(robot, q.astype(float)) * EPS
    found = robot.forward_dynamics(*states, dtype=np.float32)
    assert found.dtype == np.float32
    assert error(found, robot.forward_dynamics(*states, backend="mpmath")) < tolerance
    assert error(robot.reactions(*states, dtype=np.float32).array, robot.reactions(*states).array) < tolerance
    for found, expected in (
        (robot.inverse_dynamics(q, v, a, dtype=np.float32), robot.inverse_dynamics(q, v, a)),
        (robot.mass_matrix(q, dtype=np.float32), robot.mass_matrix(q)),
        (robot.link_poses(q, dtype=np.float32), robot.link_poses(q)),
    ):
        assert found.dtype == np.float32
        assert error(found, expected) < C * EPS


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_robots_of_the_repository(path):
    check(robot_of(path))


@pytest.mark.parametrize("name", ["ur5", "panda", "talos_reduced"])
def test_real_robots(name):
    pytest.importorskip("pinocchio", reason="comes with example-robot-data: pip install '.[test]'")
    from oracles.real_robots import DATA, ROBOTS

    check(robot_of(DATA / ROBOTS[name]))


@BOTH
def test_every_question_answers_in_the_dtype(backend):
    c = case(7, n=4)
    options = {"backend": backend, "dtype": np.float32}
    for subject in (c.robot, rd.Scene(c.robot)):
        answers = {
            "forward_dynamics": (c.q, c.v, c.tau),
            "inverse_dynamics": (c.q, c.v, c.a),
            "bias_forces": (c.q, c.v),
            "mass_matrix": (c.q,),
            "link_poses": (c.q,),
            "momentum": (c.q, c.v),
            "kinetic_energy": (c.q, c.v),
            "potential_energy": (c.q,),
        }
        for name, arguments in answers.items():
            found, expected = getattr(subject, name)(*arguments, **options), getattr(subject, name)(*single(*arguments), backend="numpy")
            assert found.dtype == np.float32, name
            assert expected.dtype == np.float64, name
            solved = condition(c.robot, c.q) if name == "forward_dynamics" else 1.0
            assert error(found, expected) < C * solved * EPS, name
        assert subject.reactions(c.q, c.v, c.tau, **options).array.dtype == np.float32
    assert c.robot.forward_dynamics(*single(c.q, c.v, c.tau)).dtype == np.float64


def test_the_same_bits_whatever_the_batch_and_the_threads():
    c = case(1, n=4)
    rng = np.random.default_rng(1)
    q, v, tau = single(np.stack([c.robot.random_state(rng)[0] for _ in range(4099)]), *rng.normal(size=(2, 4099, c.robot.nv)))
    ask = lambda *arrays, **options: c.robot.forward_dynamics(*arrays, dtype=np.float32, **options)  # noqa: E731
    whole = ask(q, v, tau, threads=1)
    assert np.array_equal(whole, ask(q, v, tau, threads=2))
    assert np.array_equal(whole[:17], ask(q[:17], v[:17], tau[:17]))
    assert np.array_equal(whole[:9], ask(q[:9], v[:9], tau[:9]))
    assert np.array_equal(whole[7], ask(q[7], v[7], tau[7]))
    assert np.array_equal(whole, ask(*(x.astype(float) for x in (q, v, tau))))
    assert np.array_equal(whole, ask(np.asfortranarray(q), v[::-1][::-1], tau.repeat(2, axis=0)[::2]))
    assert np.array_equal(whole, pickle.loads(pickle.dumps(c.robot)).forward_dynamics(q, v, tau, dtype="float32"))
    code = c.robot.alone.evaluator.kernel(ForwardDynamics("auto"), SINGLE)
    assert code is not c.robot.alone.evaluator.kernel(ForwardDynamics("auto"))


# An arm that swings about the vertical, with a rod on it that rolls about itself: 1e-9 kg m² beside its 1 kg m².
NEEDLE = """<robot name="needle"><link name="base"/><link name="arm"/>
<link name="rod"><inertial><origin xyz="1 0 0"/><mass value="1"/>
<inertia ixx="1e-9" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="swing" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
<joint name="roll" type="continuous"><parent link="arm"/><child link="rod"/><axis xyz="1 0 0"/></joint></robot>"""


@BOTH
def test_what_float32_cannot_hold_is_refused(backend, tmp_path):
    """A number of the state, or a result, beyond 3.4e38; and a joint whose inertia drowns in the rounding of float32, not of float64."""
    c = case(3, n=3)
    options = {"backend": backend, "dtype": np.float32}
    with pytest.raises(rd.InputError, match=r"tau\[0\].*float32"):
        c.robot.forward_dynamics(c.q, c.v, c.tau * 0 + 1e39, **options)
    with pytest.raises(rd.ModelError, match=r"not finite|float32"):
        c.robot.forward_dynamics(c.q, c.v * 0 + 1e25, c.tau, **options)
    (tmp_path / "needle.urdf").write_text(NEEDLE)
    robot = robot_of(tmp_path / "needle.urdf")
    state = np.zeros(robot.nq), np.zeros(robot.nv), np.ones(robot.nv)
    assert np.isfinite(robot.forward_dynamics(*state, backend=backend)).all()
    with pytest.raises(rd.ModelError, match=r"joint 'roll'.*no inertia"):
        robot.forward_dynamics(*state, **options)


def test_an_overflow_on_the_way_is_no_answer(tmp_path):
    """10⁸ kg at 10¹⁶ rad/s: forces of 10⁴⁰ N are beyond float32, the acceleration is not. The kernel says so; the reference has room."""
    (tmp_path / "heavy.urdf").write_text(NEEDLE.replace("1e-9", "1e7").replace('value="1"', 'value="1e8"').replace("0.1", "1e7"))
    robot = robot_of(tmp_path / "heavy.urdf")
    state = np.array([0.3, 0.4]), np.array([1e16, 1e16])
    assert np.isfinite(robot.forward_dynamics(*state, backend="numpy", dtype=np.float32)).all()
    with pytest.raises(rd.ModelError, match=r"float32 cannot hold.*too large"):
        robot.forward_dynamics(*state, dtype=np.float32)


def test_a_plain_call_before_changes_nothing():
    """A robot answers plain calls by a built-in function; dtype= goes past it."""
    c = case(3, n=3)
    first = c.robot.forward_dynamics(c.q, c.v, c.tau)
    found = c.robot.forward_dynamics(c.q, c.v, c.tau, dtype=np.float32)
    assert found.dtype == np.float32
    again = c.robot.forward_dynamics(c.q, c.v, c.tau)
    assert again.dtype == np.float64
    assert np.array_equal(first, again)
    assert c.robot.forward_dynamics(*single(c.q, c.v, c.tau)).dtype == np.float64


@pytest.mark.parametrize("dtype", [np.float16, np.int32, np.complex64, object, None, "single digits", ">f4", np.longdouble])
def test_other_dtypes_are_refused(dtype):
    c = case(3, n=3)
    with pytest.raises(rd.InputError, match=r"dtype=.*np\.float64 or np\.float32"):
        c.robot.forward_dynamics(c.q, c.v, dtype=dtype)


def test_fifty_digits_are_no_float32():
    c = case(3, n=3)
    with pytest.raises(rd.InputError, match=r"float32.*mpmath"):
        c.robot.mass_matrix(c.q, backend="mpmath", dtype=np.float32)


def test_loads_in_float32():
    """Friction, damping and a control law with choices: the float64 answer, within the rounding of float32."""
    robot = robot_of(FILES[0].parent / "ur5e.urdf")
    q, v = single(*robot.random_state(np.random.default_rng(2)))
    law = rd.ControlLaw(lambda t, q, v: np.where(v > 0, -np.exp(-t) * v, np.abs(q) ** 1.5) + np.clip(q, -1, 1) + np.arctan2(q, v))
    friction = rd.JointFriction(dict.fromkeys(robot.joint_names, 2.0))
    scene = rd.Scene(robot, loads=[law, friction])
    tolerance = C * condition(robot, q.astype(float)) * EPS
    for backend in ("native", "numpy"):
        found = scene.forward_dynamics(q, v, t=0.7, backend=backend, dtype=np.float32)
        assert error(found, scene.forward_dynamics(q, v, t=0.7, backend="numpy")) < tolerance


@pytest.mark.parametrize("formalism", ["recursive", "nonrecursive"])
def test_sound_robots_of_many_freedoms_are_not_refused(formalism):
    """Thirty freedoms and more, κ up to some thousands: what is left of a pivot is far above what its roundings add up to."""
    for seed in range(8):
        types = ("spherical", "planar", "prismatic")
        robot = rd.random_robot(np.random.default_rng(seed), 12, joint_types=types, floating_base=True, fixed=0.0)
        assert robot.nv >= 28
        q, v = single(*robot.random_state(np.random.default_rng(seed + 100)))
        exact = robot.forward_dynamics(q, v)
        found = robot.forward_dynamics(q, v, dtype=np.float32, formalism=formalism)
        assert error(found, exact) < C * condition(robot, q) * np.finfo(np.float32).eps
