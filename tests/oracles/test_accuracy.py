"""The claim of accuracy: on every real robot, native code is within 50 κ eps of 50 digits, relative to the result's largest entry.

κ of forward dynamics: Skeel's condition number of M̂ η̇ = k̂ (`robodyn.report.accuracy`), which is never above ‖M̂‖ ‖M̂⁻¹‖. κ of inverse
dynamics, where nothing is solved for: 1. κ of reactions: that of the accelerations they rest on, times how much of the robot's weight
cancels in them. That is nothing where the base is fixed, and nearly all where the robot falls freely.
"""

import numpy as np
import pytest

pytest.importorskip("pinocchio", reason="the robots come with pin and example-robot-data: pip install '.[test]'")
pytest.importorskip("mpmath")

import real_robots
from real_robots import ROBOTS

import robodyn as rd
from robodyn.arithmetic import EPS
from robodyn.evaluation.base_parameters import costs_digits
from robodyn.report.accuracy import condition, error

BOUND = 50.0
STATES = 4


@pytest.fixture(scope="module", params=[(name, free) for name in ROBOTS for free in (False, True)], ids=lambda p: p[0] + "-free" * p[1])
def asked(request):
    """A robot, some of its states with random forces and accelerations, κ, and the exact accelerations."""
    robot = real_robots.load(request.param[0], floating_base=request.param[1])
    rng = np.random.default_rng(11)
    q, v = map(np.array, zip(*(robot.random_state(rng) for _ in range(STATES)), strict=True))
    tau, a = rng.normal(size=v.shape), rng.normal(size=v.shape)
    exact = robot.forward_dynamics(q, v, tau, backend="mpmath")
    kappa = np.array([condition(robot, *state) for state in zip(q, exact, strict=True)])
    return robot, q, v, tau, a, exact, kappa


def worst(found, exact, kappa):
    """The largest error of any state in units of its own κ eps."""
    return max(error(x[None], y[None]) / float(k * EPS) for x, y, k in zip(found, exact, kappa, strict=True))


def test_forward_dynamics(asked, record_property):
    robot, q, v, tau, _, exact, kappa = asked
    ratio = worst(robot.forward_dynamics(q, v, tau, backend="native"), exact, kappa)
    record_property("error / (κ eps)", ratio)
    assert ratio <= BOUND


def test_inverse_dynamics(asked, record_property):
    robot, q, v, _, a, *_ = asked
    exact = robot.inverse_dynamics(q, v, a, backend="mpmath")
    ratio = worst(robot.inverse_dynamics(q, v, a, backend="native"), exact, np.ones(STATES))
    record_property("error / eps", ratio)
    assert ratio <= BOUND


def test_reactions(asked, record_property):
    robot, q, v, tau, _, _, kappa = asked
    part = "total" if robot.joints[0].type.nv else "constraint"  # each has its kernel, and compiling takes most of the time here
    exact = robot.reactions(q, v, tau, part=part, backend="mpmath").array
    weight = sum(link.inertia.mass for link in robot.links) * 9.81
    cancelled = np.maximum(1.0, weight / abs(exact).max((1, 2)).astype(float))
    ratio = worst(robot.reactions(q, v, tau, part=part, backend="native").array, exact, kappa * cancelled)
    record_property("error / (κ eps)", ratio)
    assert ratio <= BOUND


@pytest.mark.parametrize(("name", "costs"), [("ur5", False), ("panda", False), ("talos_reduced", False), ("bolt", True), ("solo12", True)])
def test_base_parameters_are_used_where_accuracy_does_not_suffer(name, costs):
    """Legs that fold lose digits by them, arms and humanoids hardly any; then the bodies stay as they are."""
    robot = real_robots.load(name)
    assert costs_digits(robot) == costs
    evaluator = rd.Scene(robot).evaluator
    assert evaluator.routes.operations_with(reduce=True) < evaluator.routes.operations_with(reduce=False)
    assert evaluator.routes.operations["nonrecursive"] == evaluator.routes.operations_with(reduce=not costs)
