"""A native method from outside the package: the implicit midpoint rule, as one class that knows nothing of the step loop around it."""

import numpy as np
import pytest

import robodyn as rd
from robodyn.engine.emit.stepper import Stepper
from robodyn.engine.emit.value import ONE, Value, Variable, constant, fma
from robodyn.engine.emit.vectors import Vectors
from robodyn.simulation.integrators import METHODS, Integrator

EPS = np.finfo(float).eps
ITERATIONS = 30  # each gains a factor h L / 2, at most 1/4 here


class ImplicitMidpoint(Stepper):
    """x_new = x + h f(t + h/2, (x + x_new)/2), by fixed-point iteration. Hairer, Lubich, Wanner, Geometric Numerical Integration, II.1."""

    calls = 2

    def step(self, v: Vectors, t_old: Value, t_new: Value, h: Value) -> Value | None:
        middle, half = fma(h, 0.5, t_old), h * 0.5
        v.put(lambda i: fma(v.load(v.k, i), half.splat(i.type), v.load(v.x, i)), v.argument)
        n = Variable(constant(v.code, ONE, 0, "int"))
        with v.code.repeat(lambda: n.value < ITERATIONS):
            v.call(middle)
            v.put(lambda i: fma(v.load(v.dx, i), half.splat(i.type), v.load(v.x, i)), v.argument)
            n.value = n.value + 1
        v.put(lambda i: fma(v.load(v.dx, i), h.splat(i.type), v.load(v.x, i)), v.new)
        return None


class ControlledMidpoint(ImplicitMidpoint):
    """The same with error control: half the distance from the trapezoid's step is an estimate of order h²."""

    order, rows = 1, 2

    def step(self, v: Vectors, t_old: Value, t_new: Value, h: Value) -> Value | None:
        super().step(v, t_old, t_new, h)
        change = [lambda i: v.load(v.dx, i) - v.load(v.k, i)]  # h/2 (k_middle − k_0) = h² ẍ/4 + …
        return v.root_mean(v.squares(change, v.x, v.new)[0]) * h * 0.5


class Native(Integrator):
    """A method that steps in native code alone."""

    native = True

    def __init__(self, stepper, adaptive):
        self.tableau, self.adaptive = stepper, adaptive

    def init(self, problem, t, x, first_step=None):
        raise NotImplementedError

    step = init


@pytest.fixture(autouse=True)
def known(monkeypatch):
    """Both methods under names of their own."""
    monkeypatch.setitem(METHODS, "midpoint", Native(ImplicitMidpoint, adaptive=False))
    monkeypatch.setitem(METHODS, "controlled_midpoint", Native(ControlledMidpoint, adaptive=True))


def arm(n=3, **options):
    """A robot, and a state of it."""
    rng = np.random.default_rng(3)
    robot = rd.random_robot(rng, n, **options)
    return rd.Scene(robot), robot.neutral(), rng.standard_normal(robot.nv)


def test_an_oscillator_turns_by_the_angle_of_the_cayley_transform():
    """Of q̈ = −ω² q the rule turns (ω q, v) by 2 arctan(ω h/2) a step, and keeps its length."""
    robot = rd.random_robot(np.random.default_rng(0), 1, joint_types=("prismatic",))
    free = rd.Scene(robot, gravity=(0, 0, 0))
    mass, stiffness, h = float(free.robot.mass_matrix(robot.neutral())[0, 0]), 40.0, 1e-2
    scene = rd.Scene(robot, gravity=(0, 0, 0), loads=[rd.JointSpring({robot.joint_names[-1]: stiffness})])
    omega = np.sqrt(stiffness / mass)
    assert omega * h / 2 < 0.25
    run = rd.simulate(scene, t_end=1.0, q0=[0.1], v0=[0.0], method="midpoint", dt=h, fps=None, backend="native")
    angle = 2 * np.arctan(omega * h / 2) * np.arange(len(run.t))
    assert len(run.t) == 101
    assert np.allclose(run.q[:, 0], 0.1 * np.cos(angle), rtol=0, atol=100 * len(run.t) * EPS)
    assert np.allclose(run.v[:, 0], -0.1 * omega * np.sin(angle), rtol=0, atol=100 * omega * len(run.t) * EPS)


@pytest.mark.parametrize("options", [{"joint_types": ("revolute",)}, {"joint_types": ("spherical", "revolute")}])
def test_its_order_is_two(options):
    """At the end and in between; beside DOP853. Side conditions of Euler parameters come from the loop."""
    scene, q, v = arm(**options)
    settings = {"t_end": 0.2, "q0": q, "v0": v, "times": [0.0937, 0.2]}
    exact = rd.simulate(scene, method="dop853", rtol=1e-12, atol=1e-12, **settings)
    runs = [rd.simulate(scene, method="midpoint", dt=dt, **settings) for dt in (4e-3, 2e-3, 1e-3)]
    errors = np.array([[abs(run.q[k] - exact.q[k]).max() for k in (0, 1)] for run in runs])
    assert errors[-1].max() < 1e-4
    assert np.all(abs(np.log2(errors[:-1] / errors[1:]) - 2) < 0.2)


def test_many_have_the_bits_of_each():
    scene, q, v = arm(joint_types=("spherical", "revolute"))
    v0 = v * np.linspace(0.5, 1.0, 11)[:, None]
    many = rd.simulate_many(scene, t_end=0.05, q0=q, v0=v0, method="midpoint", dt=2e-3, fps=100)
    for k in (0, 10):
        one = rd.simulate(scene, t_end=0.05, q0=q, v0=v0[k], method="midpoint", dt=2e-3, fps=100)
        assert np.array_equal(one.q, many.q[k])


def test_an_error_estimate_is_all_that_error_control_needs():
    scene, q, v = arm(joint_types=("revolute",))
    settings = {"t_end": 0.2, "q0": q, "v0": v, "times": [0.2]}
    exact = rd.simulate(scene, method="dop853", rtol=1e-12, atol=1e-12, **settings)
    runs = [rd.simulate(scene, method="controlled_midpoint", rtol=tol, atol=tol, **settings) for tol in (1e-4, 1e-6)]
    errors = [abs(run.q[-1] - exact.q[-1]).max() for run in runs]
    # The step of order 2 is controlled by an error of h²: both go with the tolerance.
    assert errors[1] < errors[0] / 30 < 1e-3
    assert 5 < runs[1].stats["steps"] / runs[0].stats["steps"] < 20
