"""Joints that follow others, and joints that the caller holds."""

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robodyn import InputError, ModelError, RobodynWarning
from robodyn.joints import Fixed, Revolute

EPS = np.finfo(float).eps


def chain(*joints):
    """Joints j0, j1, … in a row, each of a type and with what stands inside."""
    links = "".join(f'<link name="l{i}"/>' for i in range(len(joints) + 1))
    rows = [
        f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/><axis xyz="0 0 1"/>{inside}</joint>'
        for i, (kind, inside) in enumerate(joints)
    ]
    return f'<robot name="r">{links}{"".join(rows)}</robot>'


def mimic(leader, multiplier=1.0, offset=0.0):
    return f'<mimic joint="{leader}" multiplier="{multiplier!r}" offset="{offset!r}"/>'


def angle(joint):
    """How far a locked joint of `chain` is turned about z [rad]."""
    R = Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_matrix().T @ joint.rotation
    return np.arctan2(R[1, 0], R[0, 0])


def test_a_mimic_joint_owns_no_coordinate(load):
    mechanism = load(chain(("revolute", mimic("j1", -2.0, 0.5)), ("revolute", ""), ("prismatic", mimic("j1"))))
    assert mechanism.joint_names == ("j1",)
    first, last = mechanism.joints[1].mimic, mechanism.joints[3].mimic
    assert (first.leader, first.ratio, first.offset) == (2, -2.0, 0.5)
    assert (last.leader, last.ratio, last.offset) == (2, 1.0, 0.0)


def test_chains_are_composed(load):
    """j0 = 2 j1 + 1, j1 = 3 j2 − 4, j2 = −j3: j0 = −6 j3 − 7."""
    mechanism = load(
        chain(("revolute", mimic("j1", 2.0, 1.0)), ("revolute", mimic("j2", 3.0, -4.0)), ("revolute", mimic("j3", -1.0)), ("revolute", ""))
    )
    assert [(m.leader, m.ratio, m.offset) for m in (joint.mimic for joint in mechanism.joints[1:4])] == [
        (4, -6, -7),
        (4, -3, -4),
        (4, -1, 0),
    ]


def test_a_mimic_of_a_fixed_joint_is_ignored_with_a_warning(load, row):
    with pytest.warns(RobodynWarning, match=r"robot\.urdf: joint/mimic a fixed joint does not move and can follow no other \(line 1\)"):
        mechanism = load(chain(("revolute", ""), ("fixed", mimic("nobody"))))
    assert mechanism.joints[2].mimic is None
    assert "ignored: a fixed joint" in row(mechanism, "joint/mimic")


def test_who_follows_a_fixed_joint_is_locked(load, row):
    mechanism = load(chain(("fixed", ""), ("revolute", mimic("j0", 2.0, 0.25)), ("revolute", mimic("j1", 2.0, 0.25))))
    assert mechanism.nv == 0
    assert abs(angle(mechanism.joints[2]) - 0.25) <= 4 * EPS
    assert abs(angle(mechanism.joints[3]) - 0.75) <= 4 * EPS
    assert "the joint that leads does not move, so the one that follows is locked (2×: joint 'j1' at 0.25" in row(mechanism, "joint/mimic")


@pytest.mark.parametrize(
    ("kind", "value", "coordinates"),
    [
        ("revolute", 0.7, None),
        ("continuous", [12.0], None),
        ("prismatic", -0.7, None),
        ("planar", [0.1, 0.2, 0.3], None),
        ("spherical", (2.0, 0.0, 0.0, 2.0), (2**-0.5, 0.0, 0.0, 2**-0.5)),
        ("floating", np.array([1, 2, 3, 1, 0, 0, 0]), None),
    ],
)
def test_a_locked_joint_is_fixed_where_it_is_held(load, row, kind, value, coordinates):
    xml = chain((kind, '<dynamics damping="1"/>'), ("revolute", ""))
    free, held = load(xml), load(xml, locked={"j0": value})
    assert isinstance(held.joints[1].type, Fixed)
    assert held.joint_names == ("j1",)
    R, r = free.joints[1].type.pose(np.atleast_1d(np.array(value if coordinates is None else coordinates, dtype=float)))
    assert np.abs(held.joints[1].rotation - free.joints[1].rotation @ R).max() <= 4 * EPS
    assert np.abs(held.joints[1].translation - free.joints[1].rotation @ r - [1, 2, 3]).max() <= 16 * EPS
    assert held.joints[1].damping == 0.0
    assert "ignored: the caller locked the joint (joint 'j0' at" in row(held, "joint@type")


def test_the_base_can_be_held_too(load):
    mechanism = load(chain(("revolute", "")), floating_base=True, locked={"ground": [1, 2, 3, 1, 0, 0, 0]})
    assert mechanism.joint_names == ("j0",)
    assert np.array_equal(mechanism.joints[0].translation, [1, 2, 3])


def test_who_follows_a_locked_joint_is_locked_too(load):
    mechanism = load(
        chain(("revolute", ""), ("revolute", mimic("j0", 2.0, 0.25)), ("revolute", mimic("j1", -1.0)), ("revolute", "")), locked={"j0": 0.5}
    )
    assert mechanism.joint_names == ("j3",)
    assert [round(angle(joint), 12) for joint in mechanism.joints[1:4]] == [0.5, 1.25, -1.25]


def test_locking_a_follower_drops_its_mimic(load, row):
    """j2 follows j1: where j1 is held, j2 is; j0, which led, goes free."""
    mechanism = load(chain(("revolute", ""), ("revolute", mimic("j0")), ("revolute", mimic("j1", 2.0))), locked={"j1": 0.5})
    assert mechanism.joint_names == ("j0",)
    assert isinstance(mechanism.joints[1].type, Revolute)
    assert [round(angle(joint), 12) for joint in mechanism.joints[2:4]] == [0.5, 1.0]
    assert "ignored: the caller locked the joint (joint 'j1')" in row(mechanism, "joint/mimic")


def test_a_lock_on_an_unknown_joint_names_the_close_ones(load):
    with pytest.raises(ModelError, match="no joint named 'j00': did you mean 'j0'"):
        load(chain(("revolute", "")), locked={"j00": 0.0})


@pytest.mark.parametrize(
    ("kind", "value", "words"),
    [
        ("revolute", [1.0, 2.0], "one number"),
        ("revolute", "high", "one number"),
        ("revolute", None, "finite"),
        ("revolute", np.nan, "finite"),
        ("planar", 1.0, r"3 numbers \(x, y, theta\)"),
        ("planar", [[1.0, 2.0, 3.0]], "3 numbers"),
        ("spherical", [0, 0, 0, 0], "not zero"),
        ("fixed", 1.0, "does not move, leave it out"),
    ],
)
def test_a_lock_that_is_no_pose_is_refused(load, kind, value, words):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError, match=rf"locked\['j0'\] = .*{words}"):
            load(chain((kind, "")), locked={"j0": value})


def test_locks_come_in_a_dictionary(load):
    with pytest.raises(InputError, match="give a dictionary"):
        load(chain(("revolute", "")), locked=["j0"])
