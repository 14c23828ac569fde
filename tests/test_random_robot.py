"""Random robots: the same from the same seed, generic, and numbered as a file would be read."""

import numpy as np
import pytest
from tools import EPS, SEEDS

import robodyn as rd
from robodyn.joints import JOINT_TYPES
from robodyn.random import MIXED
from robodyn.simulation.storage import to_json

ALL = pytest.mark.parametrize("seed", SEEDS)


def robot_of(seed, n=8, **options):
    return rd.random_robot(np.random.default_rng([77, seed]), n, **options)


@ALL
def test_the_seed_decides_everything(seed):
    assert to_json(robot_of(seed)) == to_json(robot_of(seed))
    assert to_json(robot_of(seed)) != to_json(robot_of(seed + 1000))


def test_the_generator_is_the_callers():
    """Two robots from one generator differ: no state is hidden anywhere."""
    rng = np.random.default_rng(0)
    assert to_json(rd.random_robot(rng, 3)) != to_json(rd.random_robot(rng, 3))


@ALL
def test_inertias_are_those_of_solids(seed):
    """Positive principal moments that satisfy the triangle inequality, all three different, centre off the origin, axes askew."""
    for link in robot_of(seed).links:
        assert 0.5 <= link.inertia.mass <= 3.0
        a, b, c = np.linalg.eigvalsh(link.inertia.about_own_centre)
        # The tensor about the centre is a difference of numbers up to m (0.15 · √3)² ≈ 0.2: a few roundings of those.
        assert a > 0
        assert a + b > c - 50 * EPS * 0.2
        assert min(b - a, c - b) > 1e-9
        assert np.linalg.norm(link.inertia.centre) > 1e-3
        assert abs(link.inertia.tensor[np.triu_indices(3, 1)]).min() > 1e-9
        assert np.array_equal(link.inertia.tensor, link.inertia.tensor.T)


@ALL
def test_joints_stand_depth_first(seed):
    """Each subtree is one run of numbers: a joint's parent is the link before it or one of that link's ancestors."""
    robot = robot_of(seed, 12, branching=0.7)
    parents = [joint.parent for joint in robot.joints]
    for i in range(1, len(parents)):
        path = [i - 1]
        while path[-1] > 0:
            path.append(parents[path[-1]])
        assert parents[i] in path
    assert [joint.name for joint in robot.joints] == ["ground", *(f"joint_{i}" for i in range(1, 13))]
    assert robot.link_names == tuple(f"link_{i}" for i in range(13))


@ALL
def test_placements_are_rotations_and_short_ways(seed):
    for joint in robot_of(seed).joints[1:]:
        assert np.allclose(joint.rotation.T @ joint.rotation, np.eye(3), rtol=0, atol=4 * EPS)
        assert np.linalg.det(joint.rotation) > 0
        assert abs(joint.translation).max() <= 0.3


def test_branching():
    """0 is a chain; 1 leaves a chain of 30 links only by a chance of 1/29!."""
    assert [joint.parent for joint in robot_of(1, 30, branching=0.0).joints] == list(range(-1, 30))
    assert len({joint.parent for joint in robot_of(1, 30, branching=1.0).joints}) < 30


def test_joint_types():
    assert set(MIXED) == set(JOINT_TYPES)
    kinds = {joint.type.kind for seed in range(20) for joint in robot_of(seed).joints[1:]}
    assert kinds == set(MIXED)
    assert {joint.type.kind for joint in robot_of(0, 20, joint_types=("prismatic",)).joints[1:]} == {"prismatic"}


def test_share_of_fixed_joints():
    def share(**options):
        joints = robot_of(0, 400, **options).joints[1:]
        return sum(joint.type.kind == "fixed" for joint in joints) / len(joints)

    assert share(fixed=0.0) == 0
    assert share(fixed=1.0) == 1
    assert abs(share(fixed=0.3) - 0.3) < 4 * np.sqrt(0.3 * 0.7 / 400)  # four standard deviations of a binomial share
    assert share(joint_types=("revolute",)) == 0


def test_bases():
    assert robot_of(0).joints[0].type.kind == "fixed"
    free = robot_of(0, floating_base=True)
    assert free.joints[0].type.kind == "floating"
    assert free.joint_names[0] == "ground"


def test_no_joints_at_all():
    robot = robot_of(0, 0)
    assert (robot.nq, len(robot.links)) == (0, 1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n": -1}, "n=-1"),
        ({"branching": 1.5}, "branching=1.5"),
        ({"branching": float("nan")}, "branching=nan"),
        ({"joint_types": ("revolute", "hinge")}, "hinge"),
        ({"joint_types": ()}, "joint_types"),
        ({"joint_types": ("fixed",), "fixed": 0.5}, "joint_types"),
        ({"fixed": 1.5}, "fixed"),
    ],
)
def test_what_cannot_be_drawn_is_refused(options, message):
    with pytest.raises(rd.InputError, match=message):
        robot_of(0, **options)
