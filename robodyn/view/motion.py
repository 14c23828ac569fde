"""When each link is where."""

from typing import Any

import numpy as np

from ..arithmetic import Array
from ..errors import InputError
from .encode import base64, placement


def motion(times: Array, poses: Array, links: int) -> dict[str, Any]:
    """The page's record of times (T,) [s] and world poses (T, links, 4, 4).

    `poses` holds position and quaternion of link after link: one for a link that never moves, T for every other;
    `frames` says which.
    """
    times, poses = np.asarray(times, dtype=float), np.asarray(poses, dtype=float)
    _check(times, poses, links)

    placements = placement(poses[..., :3, :3], poses[..., :3, 3]).astype("<f4")  # (T, links, 7)
    tracks = [track if (track != track[0]).any() else track[:1] for track in placements.swapaxes(0, 1)]
    return {
        "times": base64(times, "<f8"),
        "frames": [len(track) for track in tracks],
        "poses": base64(np.concatenate(tracks), "<f4"),
    }


def _check(times: Array, poses: Array, links: int) -> None:
    if times.ndim != 1 or not times.size:
        raise InputError(f"times has the shape {times.shape}: give (T,) with at least one instant")
    if poses.shape != (times.size, links, 4, 4):
        raise InputError(f"poses has the shape {poses.shape}: give one world pose per instant and link, ({times.size}, {links}, 4, 4)")
    for name, array in (("times", times), ("poses", poses)):
        if not np.isfinite(array).all():
            raise InputError(f"{name} holds numbers that are not finite: there is nothing to draw for them")
    if (np.diff(times) < 0).any():
        late = int(np.argmax(np.diff(times) < 0))
        raise InputError(f"times must not decrease: {times[late]} s stands before {times[late + 1]} s")
