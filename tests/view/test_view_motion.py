"""Poses in the page: compact, and no less exact than float32."""

from base64 import b64decode

import numpy as np
import pytest

from robodyn.arithmetic import EPS
from robodyn.arithmetic.vectors import rotation, rotation_from_quaternion
from robodyn.errors import InputError
from robodyn.view.encode import placement, quaternions
from robodyn.view.motion import motion

EPS32 = np.finfo(np.float32).eps


def rotations(rng, angles):
    axes = rng.normal(size=(len(angles), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return np.stack([rotation(a, np.cos(w), np.sin(w)) for a, w in zip(axes, angles, strict=True)])


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi])
def test_quaternions_mean_the_rotation_they_come_from(angle):
    R = rotations(np.random.default_rng(1), np.full(200, angle))
    p = quaternions(R)
    assert abs(np.linalg.norm(p, axis=-1) - 1.0).max() <= 2 * EPS
    assert abs(rotation_from_quaternion(p) - R).max() <= 16 * EPS  # κ = 1: the largest of the four numbers is at least 1/2


def test_quaternions_of_half_turns_about_the_axes():
    R = np.stack([np.diag(d) for d in ([1.0, -1, -1], [-1.0, 1, -1], [-1.0, -1, 1])])
    assert (abs(quaternions(R)) == np.eye(4)[1:]).all()


def test_a_page_carries_each_pose_once(run):
    record = motion(run.times, run.poses, 3)
    assert record["frames"] == [1, 31, 31]  # the base never moves
    stored = np.frombuffer(b64decode(record["poses"]), "<f4").reshape(-1, 7)
    true = placement(run.poses[..., :3, :3], run.poses[..., :3, 3])
    assert len(stored) == 63
    assert abs(stored[0] - true[0, 0]).max() <= EPS32
    assert abs(stored[1:32] - true[:, 1]).max() <= EPS32
    assert abs(stored[32:] - true[:, 2]).max() <= EPS32
    assert (np.frombuffer(b64decode(record["times"]), "<f8") == run.times).all()


def test_ten_seconds_of_thirty_links_stay_below_a_megabyte():
    rng = np.random.default_rng(2)
    poses = np.tile(np.eye(4), (600, 30, 1, 1))
    poses[..., :3, 3] = rng.normal(size=(600, 30, 3))
    assert sum(len(str(part)) for part in motion(np.arange(600) / 60, poses, 30).values()) < 1_000_000


@pytest.mark.parametrize(
    ("times", "shape", "message"),
    [
        ([], (0, 3, 4, 4), "at least one instant"),
        ([[0.0]], (1, 3, 4, 4), "give \\(T,\\)"),
        ([0.0, 1.0], (1, 3, 4, 4), "\\(2, 3, 4, 4\\)"),
        ([0.0], (1, 2, 4, 4), "\\(1, 3, 4, 4\\)"),
        ([0.0, np.nan], (2, 3, 4, 4), "times holds numbers that are not finite"),
        ([0.0, 2.0, 1.0], (3, 3, 4, 4), "2.0 s stands before 1.0 s"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(times, shape, message):
    with pytest.raises(InputError, match=message):
        motion(np.array(times), np.broadcast_to(np.eye(4), shape), 3)


def test_poses_that_are_not_finite_are_refused(run):
    poses = run.poses
    poses[3, 1, 0, 3] = np.inf
    with pytest.raises(InputError, match="poses holds numbers that are not finite"):
        motion(run.times, poses, 3)
