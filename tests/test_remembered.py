"""The choice of a formalism, kept on disk."""

from dataclasses import replace

import numpy as np
import pytest
from tools import case

import robodyn as rd
from robodyn.evaluation import remembered
from robodyn.evaluation.routes import Routes
from robodyn.joints import Revolute
from robodyn.system import cache


@pytest.fixture
def counted(tmp_path, monkeypatch):
    """The questions for which formalisms were compared, with an empty cache on disk."""
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    compared, counted = Routes.compared, []

    def counting(self, question):
        counted.append(question)
        return compared(self, question)

    monkeypatch.setattr(Routes, "compared", counting)
    return counted


def again(robot: rd.Robot) -> rd.Robot:
    """The same robot, that nothing was asked of."""
    return replace(robot)


def test_formalisms_are_compared_once(counted):
    c = case(1, n=5)
    first, second = (again(c.robot).forward_dynamics(c.q, c.v, c.tau) for _ in range(2))
    assert len(counted) == 1
    assert np.array_equal(first, second)
    carried = [again(c.robot).reactions(c.q, c.v, c.tau).array for _ in range(2)]
    assert len(counted) == 2  # reactions are another question
    assert np.array_equal(*carried)
    # Who asks for the counts gets them, whatever is remembered.
    assert set(rd.Scene(again(c.robot)).evaluator.routes.operations) == {"recursive", "nonrecursive"}


@pytest.mark.parametrize("kept", ["recursive", "nonrecursive"])
def test_what_is_remembered_is_taken(counted, monkeypatch, kept):
    c = case(1, n=5)
    monkeypatch.setattr(cache, "get", lambda name: kept.encode())
    evaluator = rd.Scene(c.robot).evaluator
    assert evaluator.routes.cheapest == kept
    assert not counted


@pytest.mark.parametrize("damaged", [None, b"", b"saddle_joint", b"\xff"])
def test_what_is_damaged_is_found_anew(counted, monkeypatch, damaged):
    c = case(1, n=5)
    monkeypatch.setattr(cache, "get", lambda name: damaged)
    assert rd.Scene(c.robot).evaluator.routes.cheapest in ("recursive", "nonrecursive")
    assert len(counted) == 1


def test_what_is_another_scene_or_another_robodyn_is_compared_for_itself(counted, monkeypatch):
    c = case(1, n=5)
    heavier = replace(c.robot, links=tuple(replace(x, inertia=replace(x.inertia, mass=2 * x.inertia.mass)) for x in c.robot.links))
    scenes = [rd.Scene(c.robot), rd.Scene(c.robot, gravity=(0, 0, -1.6)), rd.Scene(heavier)]
    for n, scene in enumerate(scenes, 1):
        assert scene.evaluator.routes.cheapest
        assert len(counted) == n
    monkeypatch.setattr(remembered, "source", lambda folder: "another")
    assert rd.Scene(c.robot).evaluator.routes.cheapest
    assert len(counted) == 4


def test_what_is_numbers_alone_is_remembered_with_its_loads(counted):
    c = case(1, n=5)
    loads = [rd.LinkWrench("link_1", force=(1.0, 0.0, 0.0)), rd.JointDamping({c.robot.joints[2].name: 0.5})]
    for some in (loads, loads[:1], [rd.LinkWrench("link_1", force=(2.0, 0.0, 0.0)), loads[1]]):
        before = len(counted)
        for _ in range(2):
            assert rd.Scene(again(c.robot), loads=some).evaluator.routes.cheapest
        assert len(counted) == before + 1


def law(t, q, v):
    return -v


def test_functions_are_counted_every_time(counted):
    """Pickles know a function, and a class, by its name alone."""
    robot = case(1, n=3, joint_types=("revolute",), floating_base=False).robot
    for n in (1, 2):
        assert rd.Scene(robot, loads=[rd.ControlLaw(law)]).evaluator.routes.cheapest
        assert len(counted) == n


def test_questions_about_reactions_differ_by_frame_and_part(counted):
    c = case(1, n=5)
    for n, options in enumerate(({"frame": "world"}, {"frame": "child"}, {"part": "total"}), 1):
        assert again(c.robot).reactions(c.q, c.v, c.tau, **options)
        assert len(counted) == n


def test_every_file_of_the_source_counts(tmp_path):
    file = tmp_path / "engine" / "graph.py"
    file.parent.mkdir()
    found = []
    for text in ("a = 1", "a = 2"):
        file.write_text(text)
        found.append(remembered.source.__wrapped__(tmp_path))
    assert len({*found, remembered.source(tmp_path / "nothing")}) == 3


def test_types_of_joints_of_ones_own_are_counted_every_time(counted):
    class Own(Revolute):
        pass

    c = case(1, n=3, joint_types=("revolute",), floating_base=False)
    joints = tuple(replace(x, type=Own(x.type.axis)) if x.type.nv else x for x in c.robot.joints)
    for n in (1, 2):
        robot = replace(c.robot, joints=joints)
        assert np.allclose(robot.forward_dynamics(c.q, c.v, c.tau), c.reference.forward_dynamics(c.q, c.v, c.tau), rtol=1e-9)
        assert len(counted) == n
