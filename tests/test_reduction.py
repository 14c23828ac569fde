"""Base inertial parameters are used where they cost no digits."""

from dataclasses import replace

import numpy as np
import pytest

import robodyn as rd
from robodyn.arithmetic import EPS
from robodyn.evaluation import base_parameters as reduction
from robodyn.joints import Fixed, Revolute
from robodyn.model import GROUND, Inertia, Joint, Limits, Link, Mimic
from robodyn.report.accuracy import condition, error
from robodyn.system import cache

X, Y = np.eye(3)[:2]


def leg(swing: float = np.inf) -> rd.Robot:
    """Hip roll, hip pitch and a knee between two rods of one length; pitch and knee turn up to `swing` [rad]."""
    rod = Inertia.about_centre(1.0, np.array([0.0, 0.0, -0.25]), np.diag([0.02, 0.02, 1e-4]))
    hip = Inertia.about_centre(0.1, np.zeros(3), 1e-4 * np.eye(3))
    joints = (
        Joint(GROUND, Fixed(), -1),
        Joint("roll", Revolute.from_axis(X), 0),
        Joint("pitch", Revolute.from_axis(Y), 1, limits=Limits(-swing, swing)),
        Joint("knee", Revolute.from_axis(Y), 2, translation=np.array([0.0, 0.0, -0.5]), limits=Limits(-swing, swing)),
    )
    return rd.Robot("leg", (Link("base"), Link("hip", hip), Link("thigh", rod), Link("shank", rod)), joints)


def test_a_leg_that_folds_keeps_its_inertias():
    """Stretched along the roll axis or folded, what it takes to roll is what large numbers leave; a leg that hangs down keeps a sum."""
    assert reduction.costs_digits(leg())
    assert not reduction.costs_digits(leg(swing=0.5))
    for robot, taken in ((leg(), False), (leg(swing=0.5), True)):
        evaluator = rd.Scene(robot).evaluator
        counts = {reduce: evaluator.routes.operations_with(reduce=reduce) for reduce in (False, True)}
        assert counts[True] < counts[False]
        assert evaluator.routes.operations["nonrecursive"] == counts[taken]


def test_the_errors_are_those_against_50_digits():
    """The recursion that both are compared with stands for exact numbers, at any states."""
    robot = leg()
    plain, base = reduction.rounding(robot)
    rng = np.random.default_rng(5)
    q, v = (np.stack(x) for x in zip(*(robot.random_state(rng) for _ in range(200)), strict=True))
    tau = rng.normal(size=v.shape)
    exact = robot.forward_dynamics(q, v, tau, backend="mpmath").astype(float)
    errors = {}
    for reduce in (False, True):
        views = rd.Scene(robot).evaluator.routes.views_with(reduce=reduce)
        state = views.lumped.state(0.0, q, v)
        found = views.lumped.accelerate(state, views.lumped.applied(state, tau), "nonrecursive").vdot
        errors[reduce] = np.sqrt(np.mean((abs(found - exact).max(-1) / abs(exact).max(-1)) ** 2))
    assert errors[True] > reduction.LOSS * errors[False]
    assert errors[True] / errors[False] == pytest.approx(base / plain, rel=0.7)


@pytest.mark.parametrize("robot", [leg(), leg(swing=0.5)], ids=["folds", "does not"])
def test_either_way_answers_are_those_of_the_robot(robot):
    rng = np.random.default_rng(1)
    q, v = robot.random_state(rng)
    tau = rng.normal(size=3)
    exact = robot.forward_dynamics(q, v, tau, backend="mpmath")
    bound = 50 * float(condition(robot, q, exact)) * EPS
    assert error(robot.forward_dynamics(q, v, tau, formalism="nonrecursive")[None], exact[None]) < bound
    carried = robot.reactions(q, v, tau, backend="mpmath").array
    assert error(robot.reactions(q, v, tau, formalism="nonrecursive").array[None], carried[None]) < bound


def test_joints_that_follow_are_judged_as_if_they_were_free():
    def following(robot):
        knee = replace(robot.joints[3], mimic=Mimic(2, -1.0))
        return replace(robot, joints=(*robot.joints[:3], knee))

    assert reduction.rounding(following(leg())) == reduction.rounding(leg())
    q, v, tau = np.array([0.3, 0.8]), np.ones(2), np.zeros(2)
    robot = following(leg())
    assert np.allclose(robot.forward_dynamics(q, v, tau), robot.forward_dynamics(q, v, tau, backend="numpy"), rtol=1e-12)


def test_it_is_found_once_and_only_where_accelerations_are_asked_for(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    measured, rounding = [], reduction.rounding
    monkeypatch.setattr(reduction, "rounding", lambda robot: (measured.append(1), rounding(robot))[1])
    q = np.array([0.1, 0.2, 0.3])
    leg().link_poses(q)
    leg().mass_matrix(q)
    leg().inverse_dynamics(q, q, q)
    leg().potential_energy(q)
    assert not measured
    found = [leg().forward_dynamics(q, q, q) for _ in range(2)]
    assert len(measured) == 1
    assert np.array_equal(*found)
    leg(swing=1.0).forward_dynamics(q, q, q)
    assert len(measured) == 2


def test_robots_without_freedoms_and_without_mass():
    still = replace(leg(), joints=tuple(replace(joint, type=Fixed()) for joint in leg().joints))
    assert not reduction.costs_digits(still)
    massless = replace(leg(), links=tuple(Link(link.name) for link in leg().links))
    assert not reduction.costs_digits(massless)  # whoever asks for accelerations is told so
