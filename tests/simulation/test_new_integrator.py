"""A new integrator takes one class or one tableau and an entry in METHODS: two that are added here, from outside the package."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import robodyn as rd
from robodyn.engine.emit.tableau import Tableau
from robodyn.simulation import METHODS
from robodyn.simulation.integrators import EqualSteps, Integrator, Outcome, Step
from robodyn.simulation.integrators.equal_steps import hermite
from robodyn.simulation.times import step_count

ROBOTS = Path(__file__).parents[2] / "robots"
BACKENDS = ("native", "numpy")


def heun3():
    """Heun's method of order 3. Hairer, Nørsett, Wanner, Solving ODEs I, table II.1.1."""
    a = np.array([[0, 0, 0], [1 / 3, 0, 0], [0, 2 / 3, 0]])
    return EqualSteps(Tableau(a, np.array([1.0, 0, 3]), np.array([0, 1 / 3, 2 / 3]), divisor=4))


class Memory(NamedTuple):
    h: float
    count: int
    i: int
    t0: float
    t: float
    x: np.ndarray


class Midpoint(Integrator):
    """The implicit midpoint rule, of order 2, by Newton's method with a Jacobian of differences."""

    adaptive = False

    def init(self, problem, t, x, first_step=None):
        count = step_count(t, problem.t_end, problem.dt)
        return Memory((problem.t_end - t) / count, count, 0, t, t, x)

    def step(self, problem, memory):
        h, count, i, t0, t, x = memory
        t_new, middle = t0 + (i + 1) * h if i + 1 < count else problem.t_end, t + h / 2
        k = problem.f(t, x)
        d = 1e-7 * (1 + abs(x))
        J = np.stack([(problem.f(t, x + d[j] * e) - k) / d[j] for j, e in enumerate(np.eye(len(x)))], axis=1)
        for _ in range(20):
            change = np.linalg.solve(np.eye(len(x)) - h / 2 * J, problem.f(middle, x + h / 2 * k) - k)
            k = k + change
            if abs(change).max() < 1e-12 * (1 + abs(k).max()):
                break
        else:
            return Step(t, t, x, lambda times: x, outcome=Outcome.NOT_CONVERGED), memory
        x_new = problem.project(x + h * k)
        step = Step(t, t_new, x_new, hermite(t, h, x, x_new, k, k))
        return step, memory._replace(i=i + 1, t=t_new, x=x_new)


@pytest.fixture(autouse=True)
def added(monkeypatch):
    monkeypatch.setitem(METHODS, "heun3", heun3())
    monkeypatch.setitem(METHODS, "midpoint", Midpoint())


def ends(method, backend):
    """The pendulum's angle and speed after 0.8 s with halved steps."""
    robot = rd.load(ROBOTS / "pendulum.urdf")
    runs = [rd.simulate(robot, t_end=0.8, q0=[1.0], method=method, dt=dt, backend=backend) for dt in (0.02, 0.01, 0.005)]
    exact = rd.simulate(robot, t_end=0.8, q0=[1.0], rtol=1e-13)
    return np.array([max(abs(run.q[-1] - exact.q[-1]).max(), abs(run.v[-1] - exact.v[-1]).max()) for run in runs])


@pytest.mark.parametrize(("method", "order"), [("heun3", 3), ("midpoint", 2)])
@pytest.mark.parametrize("backend", BACKENDS)
def test_observed_order(method, order, backend):
    errors = ends(method, backend)
    assert np.allclose(np.log2(errors[:-1] / errors[1:]), order, rtol=0, atol=0.2)


def test_a_tableau_runs_natively_and_in_a_crowd():
    robot = rd.load(ROBOTS / "pendulum.urdf")
    options = {"t_end": 0.2, "method": "heun3", "dt": 0.01}
    native, python = (rd.simulate(robot, q0=[1.0], backend=backend, **options) for backend in BACKENDS)
    assert native.stats["evaluations"] == python.stats["evaluations"] == 1 + 3 * 20
    assert np.allclose(native.q, python.q, rtol=1e-12, atol=0)
    many = rd.simulate_many(robot, q0=np.array([[0.2], [1.0], [-1.0]]), **options)
    assert np.array_equal(many.q[1], native.q)


def test_a_step_that_does_not_converge_says_so():
    """Forces that no Newton iteration follows: the result code becomes the error, with what had been computed."""
    scene = rd.Scene(rd.load(ROBOTS / "pendulum.urdf"), loads=[rd.ControlLaw(lambda t, q, v: 1e4 * np.sign(np.sin(1e9 * v)))])
    with pytest.raises(rd.SimulationError, match=r"the step from t=.* reduce dt") as found:
        rd.simulate(scene, t_end=0.5, v0=[1.0], q0=[1.0], method="midpoint", dt=0.1, backend="numpy")
    assert not found.value.trajectory.completed
