"""Additions from outside the package, each as one class: a load with a state of its own, a joint that moves by the time, a question."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
from tools import EPS, SEEDS, case, error

import robodyn as rd
from robodyn.arithmetic import cos, sin
from robodyn.arithmetic.vectors import column, joined, mul, rotation
from robodyn.dynamics.questions import Answer, Evolution, Question
from robodyn.joints.base import AxisJoint
from robodyn.loads import LOADS, Load

METHODS = ("dop853", "rk45", "rk4", "radau")
BACKENDS = ("native", "numpy")
C = 200  # tolerances of single answers are C eps

# --- a load with a state of its own: joint torque that lags behind what is asked for ---


@dataclass(frozen=True, eq=False)
class Lag(Load):
    """u = z in a joint, with ż = (wanted − z) / delay: a drive of first order."""

    joint: str
    wanted: float  # [N m, N]
    delay: float  # [s]

    def initial_state(self, mechanism) -> np.ndarray:
        return np.zeros(1)

    def state_rate(self, state):
        return (self.wanted - state.z) / self.delay

    def joint_forces(self, state) -> Mapping:
        return {state.mechanism.joint_index(self.joint): state.z}


def slider() -> rd.Robot:
    """A link of 2 kg that slides along x without gravity's help."""
    link = rd.Inertia.about_centre(2.0, np.zeros(3), 0.1 * np.eye(3))
    slide = rd.Joint("slide", rd.joints.Prismatic.from_axis([1, 0, 0]), 0)
    return rd.Robot("slider", (rd.Link("base"), rd.Link("block", link)), (rd.Joint("ground", rd.joints.Fixed(), -1), slide))


def lagging(t, force=3.0, delay=0.2, mass=2.0):
    """q, v, z of the slider at times t, in closed form."""
    left = np.exp(-t / delay)
    z = force * (1 - left)
    v = force / mass * (t - delay * (1 - left))
    q = force / mass * (t * t / 2 - delay * t + delay * delay * (1 - left))
    return q, v, z


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_load_with_a_state_is_integrated(method, backend):
    """Against the closed form; beside another load of the same kind, so that each has to find its own z."""
    robot = slider()
    scene = rd.Scene(robot, loads=[Lag("slide", 1.0, 0.2), rd.JointForce({"slide": 0.0}), Lag("slide", 2.0, 0.2)])
    run = rd.simulate(scene, t_end=0.5, method=method, backend=backend, rtol=1e-10, dt=1e-3)
    q, v, z = lagging(run.t)
    tolerance = 1e-8 if method == "radau" else 1e-9  # rtol 1e-10 times the 20 to 200 steps; RK4: h⁴ / 120 T⁴ = 5e-12
    assert abs(run.q[:, 0] - q).max() < tolerance
    assert abs(run.v[:, 0] - v).max() < tolerance
    assert abs(run.z.sum(-1) - z).max() < 3 * tolerance
    assert abs(run.z[:, 1] - 2 * run.z[:, 0]).max() < 3 * tolerance
    assert abs(run.a[:, 0] - z / 2).max() < 3 * tolerance
    assert run.energy().drift < 1e-8  # the work of u = z, which the integrator finds beside


def test_many_and_files_know_the_state(tmp_path, monkeypatch):
    scene = rd.Scene(slider(), loads=[Lag("slide", 3.0, 0.2)])
    many = rd.simulate_many(scene, t_end=0.1, q0=np.linspace(0, 1, 5)[:, None], dt=2e-3)
    one = rd.simulate(scene, t_end=0.1, q0=[0.25], method="rk4", dt=2e-3)
    assert np.array_equal(many[1].z, one.z)
    assert np.array_equal(many[1].a, one.a)
    monkeypatch.setitem(LOADS, "Lag", Lag)
    one.save(tmp_path / "run.npz")
    again = rd.Trajectory.load(tmp_path / "run.npz")
    assert np.array_equal(again.z, one.z)
    assert np.array_equal(again.reactions().array, one.reactions().array)


@pytest.mark.parametrize("wrong", [lambda state: np.zeros(2), lambda state: [1j], lambda state: "fast"])
def test_a_rate_that_is_none_is_refused(wrong):
    kind = type("Odd", (Lag,), {"state_rate": lambda self, state: wrong(state)})
    with pytest.raises(rd.InputError, match=r"Odd\.state_rate returned"):
        rd.simulate(rd.Scene(slider(), loads=[kind("slide", 1.0, 0.2)]), t_end=0.1)


# --- a joint that moves by the time ---


@dataclass(frozen=True, eq=False)
class Driven(AxisJoint):
    """A turn about an axis by an angle that is a function of time; `law` gives the angle and its first two derivatives."""

    kind = "driven"
    coordinates = ()
    velocities = ()
    rheonomic = True

    law: Callable = lambda t: (0.0 * t, 0.0 * t, 0.0 * t)
    now: tuple = ()

    def at(self, t):
        return type(self)(self.axis, self.law, self.law(t))

    def pose(self, q):
        angle = np.asarray(self.now[0])
        return rotation(self.axis, cos(angle), sin(angle)), np.zeros(3)

    def motion(self, q):
        return np.zeros((6, 0))

    def drift(self, q):
        return joined(column(np.asarray(self.now[1])) * self.axis, np.zeros(3))

    def bias(self, q, v):
        return joined(column(np.asarray(self.now[2])) * self.axis, np.zeros(3))


def swung(t):
    """0.4 sin 3t + t², and its derivatives."""
    return 0.4 * sin(3.0 * t) + t * t, 1.2 * cos(3.0 * t) + 2.0 * t, 2.0 - 3.6 * sin(3.0 * t)


def swinging_arm(law=swung) -> rd.Robot:
    """An arm about z, driven; on it a block of 1.5 kg that slides along the arm."""
    arm = rd.Inertia.about_centre(2.0, np.array([0.3, 0.0, 0.0]), np.diag([0.01, 0.05, 0.05]))
    block = rd.Inertia.about_centre(1.5, np.zeros(3), 0.02 * np.eye(3))
    joints = [
        rd.Joint("ground", rd.joints.Fixed(), -1),
        rd.Joint("drive", Driven(np.array([0.0, 0.0, 1.0]), law), 0),
        rd.Joint("slide", rd.joints.Prismatic.from_axis([1, 0, 0]), 1),
    ]
    return rd.Robot("swinging", (rd.Link("base"), rd.Link("arm", arm), rd.Link("block", block)), tuple(joints))


T = np.array([0.0, 0.3, 1.1])


@pytest.mark.parametrize("backend", [*BACKENDS, "mpmath"])
@pytest.mark.parametrize("formalism", ["recursive", "nonrecursive", "saddle_joint"])
def test_a_driven_arm_throws_its_block_out(backend, formalism):
    """r̈ = r φ̇², and the drive's moment d/dt(I + m r²) φ̇: closed forms, at each time."""
    if backend == "mpmath" and formalism == "saddle_joint":
        pytest.skip("the same lines as the others, slowly")
    scene, r, rate, m, I = rd.Scene(swinging_arm()), 0.7, 0.25, 1.5, 0.05 + 2.0 * 0.09 + 0.02
    for t in T:
        _, w, e = (float(x) for x in swung(t))
        found = scene.forward_dynamics([r], [rate], t=float(t), formalism=formalism, backend=backend)
        assert error(found, [r * w * w]) < C * EPS
        moment = scene.reactions([r], [rate], t=float(t), formalism=formalism, backend=backend)["drive"][2]
        assert error([moment], [(I + m * r * r) * e + 2 * m * r * rate * w]) < C * EPS


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_driven_joint_is_simulated(backend):
    """At a constant rate w the block's distance is r₀ cosh wt; the pages' poses go with the time."""
    w, robot = 2.0, swinging_arm(lambda t: (2.0 * t, 2.0 + 0.0 * t, 0.0 * t))
    run = rd.simulate(robot, t_end=0.8, q0=[0.4], rtol=1e-11, backend=backend)
    assert abs(run.q[:, 0] - 0.4 * np.cosh(w * run.t)).max() < 1e-9
    block = run.link_poses()[:, 2, :3, 3]
    assert np.allclose(block, np.stack([run.q[:, 0] * np.cos(w * run.t), run.q[:, 0] * np.sin(w * run.t), 0 * run.t], -1), atol=1e-12)


def test_a_driven_joint_runs_in_loops(monkeypatch):
    """The same kernels, looped over the bodies: the time reaches each step."""
    expected = rd.Scene(swinging_arm()).forward_dynamics([0.7], [0.2], t=0.3)
    monkeypatch.setattr("robodyn.evaluation.routes.UNROLLED", 0)
    scene = rd.Scene(swinging_arm())
    assert scene.evaluator.routes.loops
    assert error(scene.forward_dynamics([0.7], [0.2], t=0.3), expected) < C * EPS
    run = rd.simulate(scene, t_end=0.2, q0=[0.4], method="rk4")
    assert error(run.q, rd.simulate(scene, t_end=0.2, q0=[0.4], method="rk4", backend="numpy").q) < C * EPS


def driven_and_coupled(n=20) -> rd.Robot:
    """A driven joint at the foot of a chain in which two joints share a coordinate, and a free slider at its end."""
    chain = rd.random_robot(np.random.default_rng(6), n, branching=0.0, joint_types=("revolute",), fixed=0.0)
    joints = list(chain.joints)
    joints[1] = replace(joints[1], type=Driven(joints[1].type.axis, swung))
    joints[5] = replace(joints[5], mimic=rd.Mimic(4, 0.7, 0.1))
    return replace(chain, joints=tuple(joints))


@pytest.mark.parametrize("t", [0.0, 0.4])
def test_composed_answers_know_the_time_and_the_loads_states(monkeypatch, t):
    """M̂ and k̂ by kernels and LAPACK, where several joints share a coordinate: driven joints and z as on NumPy."""
    monkeypatch.setattr("robodyn.evaluation.routes.UNROLLED", 0)
    robot = driven_and_coupled()
    rng = np.random.default_rng(2)
    q, v = rng.uniform(-1, 1, (3, robot.nq)), rng.uniform(-1, 1, (3, robot.nv))
    scene = rd.Scene(robot, loads=[Lag(robot.joint_names[-1], 1.0, 0.2)])
    assert scene.evaluator.routes.composes
    kappa = np.linalg.cond(scene.mass_matrix(q[0], t=t, backend="numpy"))
    assert error(scene.mass_matrix(q, t=t), scene.mass_matrix(q, t=t, backend="numpy")) < C * EPS
    assert error(scene.forward_dynamics(q, v, t=t), scene.forward_dynamics(q, v, t=t, backend="numpy")) < C * kappa * EPS
    z = rng.uniform(-1, 1, (3, 1))
    found, expected = (scene.evaluator.ask(Evolution("auto"), b, t=t, q=q, v=v, tau=None, z=z) for b in BACKENDS)
    assert set(found) == set(expected) == {"qdot", "vdot", "zdot", "power"}
    for name in found:
        assert error(found[name], expected[name]) < C * kappa * EPS, name


# --- a question ---


@dataclass(frozen=True)
class LinkTwist(Question):
    """The twist (ω, v) (..., 6) of a link's origin, resolved in the link."""

    link: int
    needs = ("q", "v")
    loaded = ()

    def shapes(self, robot, nz=0):
        return {"twist": (6,)}

    def answer(self, views, t, q, v):
        return Answer({"twist": views.lumped.state(t, q, v).twist(self.link)})


@pytest.mark.parametrize("seed", list(SEEDS)[:8])
def test_a_question_is_one_class(seed):
    """Natively, on NumPy and in 50 digits; against the momentum of the link alone."""
    c = case(seed, n=5)
    evaluator, link = rd.Scene(c.robot).evaluator, len(c.robot.links) - 1
    exact = evaluator.ask(LinkTwist(link), "mpmath", q=c.q, v=c.v)["twist"]
    for backend in BACKENDS:
        assert error(evaluator.ask(LinkTwist(link), backend, q=c.q, v=c.v)["twist"], exact) < C * EPS
    h = 1e-6
    poses = c.reference.link_poses(np.stack([_moved(c, h), _moved(c, -h)]))[:, link]
    R, slope = c.reference.link_poses(c.q)[link, :3, :3], (poses[0] - poses[1]) / (2 * h)
    assert np.allclose(mul(R.T, slope[:3, 3]), exact[3:].astype(float), atol=1e-8)  # h² and eps / h
    assert np.allclose((R.T @ slope[:3, :3])[[2, 0, 1], [1, 2, 0]], exact[:3].astype(float), atol=1e-8)


def _moved(c, h):
    equations = rd.Scene(c.robot).equations()
    return equations.project(c.q + h * equations.rate(c.q, c.v))
