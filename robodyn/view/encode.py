"""Arrays as text that a page can carry."""

from base64 import b64encode

import numpy as np

from ..arithmetic import Array
from ..arithmetic.vectors import joined


def base64(array: Array, dtype: str) -> str:
    """The elements in C order, as base64; `dtype` names the byte order too ("<f4")."""
    return b64encode(np.ascontiguousarray(array, dtype).tobytes()).decode()


def quaternions(R: Array) -> Array:
    """Unit quaternions (w, x, y, z) (..., 4) of rotation matrices (..., 3, 3)."""
    xx, yy, zz = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    wx, wy, wz = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    xy, xz, yz = R[..., 0, 1] + R[..., 1, 0], R[..., 0, 2] + R[..., 2, 0], R[..., 1, 2] + R[..., 2, 1]

    # 4 p pᵀ is linear in R; its row with the largest diagonal entry is p, scaled by a number that is never small.
    rows = [
        [1 + xx + yy + zz, wx, wy, wz],
        [wx, 1 + xx - yy - zz, xy, xz],
        [wy, xy, 1 - xx + yy - zz, yz],
        [wz, xz, yz, 1 - xx - yy + zz],
    ]
    outer = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    largest = np.diagonal(outer, axis1=-2, axis2=-1).argmax(axis=-1)
    p = np.take_along_axis(outer, largest[..., None, None], axis=-2)[..., 0, :]
    return p / np.linalg.norm(p, axis=-1, keepdims=True)


def placement(R: Array, r: Array) -> Array:
    """The pose (R, r) as position and quaternion (..., 7)."""
    return joined(r, quaternions(R))
