"""Vectors, matrices, rotations and quaternions on arrays of any arithmetic, with any number of leading dimensions."""

from collections.abc import Sequence

import numpy as np

from ..errors import ModelError
from .functions import sqrt
from .numbers import Array, dtype_of, known, mpmath, zeros


def frozen(x: object, shape: tuple[int, ...] | None = None) -> Array:
    """A read-only float64 copy (objects stay objects)."""
    x = np.array(x) if np.asarray(x).dtype == object else np.array(x, dtype=float)
    x = x if shape is None else x.reshape(shape)
    x.flags.writeable = False
    return x


def column(x: Array, dimensions: int = 1) -> Array:
    """x (...) with trailing dimensions of length 1, ready to scale vectors (1) or matrices (2).

    NumPy hands out a scalar of an object array bare, as the object itself: it becomes an array again here.
    """
    return np.asarray(x)[(..., *(None,) * dimensions)]


def transpose(A: Array) -> Array:
    """Aᵀ over the last two dimensions."""
    return np.swapaxes(A, -1, -2)


def mul(A: Array, x: Array) -> Array:
    """A x for matrices A (..., m, n) and vectors x (..., n)."""
    return (A @ x[..., None])[..., 0]


def dot(a: Array, b: Array) -> Array:
    """aᵀ b for vectors (..., n)."""
    return (a[..., None, :] @ b[..., :, None])[..., 0, 0]


def outer(a: Array, b: Array) -> Array:
    """a bᵀ for vectors (..., m), (..., n)."""
    return a[..., :, None] * b[..., None, :]


def cross(a: Array, b: Array) -> Array:
    """a × b for vectors (..., 3)."""
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    return np.stack(np.broadcast_arrays(a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0), axis=-1)


def skew(a: Array) -> Array:
    """ã, the matrix (..., 3, 3) with ã b = a × b."""
    A = zeros((*a.shape, 3), a.dtype)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        A[..., k, j] = a[..., i]
        A[..., j, k] = -a[..., i]
    return A


def mirrored(A: Array) -> Array:
    """A symmetric matrix from the upper triangle of A: the lower one is copied, never computed a second time."""
    A = np.array(A)
    for i in range(A.shape[-1]):
        for j in range(i):
            A[..., i, j] = A[..., j, i]
    return A


def congruent(R: Array, A: Array) -> Array:
    """R A Rᵀ (..., 3, 3) for a rotation R: the same map A, resolved in the turned frame."""
    plane = _plane(R) if R.dtype == object and R.ndim == A.ndim == 2 else None
    if plane is None:
        return R @ A @ transpose(R)

    # R turns the plane of i and j by the angle with cosine x and sine −y, then names the axes anew: rows b, c, a of R. In the plane,
    # what is left of 1 under the turn needs x² = 1 − y² alone: half the products.
    (b, c, a), (i, j, k), (x, y, sign, up) = plane
    w = x * (A[i, i] - A[j, j]) + y * (A[i, j] + A[j, i])
    B = zeros((3, 3), np.dtype(object))
    B[b, b], B[c, c], B[a, a] = A[j, j] + x * w, A[i, i] - x * w, A[k, k]
    B[b, c], B[c, b] = sign * (A[i, j] - y * w), sign * (A[j, i] - y * w)
    B[a, b], B[b, a] = up * (x * A[k, i] + y * A[k, j]), up * (x * A[i, k] + y * A[j, k])
    B[a, c], B[c, a] = up * sign * (x * A[k, j] - y * A[k, i]), up * sign * (x * A[j, k] - y * A[i, k])
    return B


def _plane(R: Array) -> tuple[tuple[int, int, int], tuple[int, int, int], tuple[object, object, float, float]] | None:
    """What `congruent` needs of a rotation (3, 3) that is known to keep an axis: R[a, k] = ±1; None for others."""
    for a, k in np.ndindex(3, 3):
        up = known(R[a, k])
        if up not in (1, -1) or any(known(R[a, (k + n) % 3]) != 0 or known(R[(a + n) % 3, k]) != 0 for n in (1, 2)):
            continue
        b, c, i, j = (a + 1) % 3, (a + 2) % 3, (k + 1) % 3, (k + 2) % 3
        # Rows (x, y) and ±(−y, x); the determinant is 1, and so the sign that of R[a, k].
        return (b, c, a), (i, j, k), (R[b, i], R[b, j], float(up), float(up))
    return None


def rotation(axis: Array, c: Array, s: Array) -> Array:
    """Rotation matrix (..., 3, 3) about a unit axis (3,) by the angle with cosine c and sine s (...)."""
    along = outer(axis, axis)
    return along + column(c, 2) * (np.eye(3) - along) + column(s, 2) * skew(axis)


def rotation_from_quaternion(p: Array) -> Array:
    """Rotation matrix (..., 3, 3) of Euler parameters p = (w, x, y, z), (..., 4).

    The division by p·p makes it an exact rotation for any p ≠ 0: a p that drifts from unit length between two
    projections still means the same orientation.
    """
    w, e = p[..., 0], skew(p[..., 1:])
    scale = 2.0 / dot(p, p)
    return np.eye(3) + column(scale, 2) * (column(w, 2) * e + e @ e)


def quaternion_rate(p: Array, omega: Array) -> Array:
    """ṗ = H(p) ω for Euler parameters p (..., 4) and the angular velocity ω (..., 3) resolved in the body."""
    w, e = p[..., :1], p[..., 1:]
    return joined(column(-0.5 * dot(e, omega)), 0.5 * (w * omega + cross(e, omega)))


def joined(*parts: Array) -> Array:
    """The vectors one behind the other, (..., m + n + …), leading dimensions broadcast."""
    batch = np.broadcast_shapes(*(a.shape[:-1] for a in parts))
    return np.concatenate([np.broadcast_to(a, batch + a.shape[-1:]) for a in parts], axis=-1)


def stacked(entries: Sequence[Array]) -> Array:
    """One array (..., n) of n entries (...), leading dimensions broadcast."""
    return np.stack(np.broadcast_arrays(*(np.asarray(x) for x in entries)), axis=-1) if len(entries) else np.zeros(0)


def normalised(p: Array) -> Array:
    """p / |p|."""
    return p / column(sqrt(dot(p, p)))


def snapped(R: Array) -> Array:
    """R (3, 3) with entries that differ from 0 or ±1 by rounding alone (≤ 1e-15) set to them.

    cos(π/2) is 6e-17 in float64: without this, every right angle of a file would leave a term that means nothing.
    """
    near = np.round(R)
    return np.where(abs(R - near) <= 1e-15, near, R) + 0.0  # + 0.0 turns −0 into 0


def homogeneous(R: Array, r: Array) -> Array:
    """The pose (R, r) as a matrix (..., 4, 4)."""
    batch = np.broadcast_shapes(R.shape[:-2], r.shape[:-1])
    T = zeros((*batch, 4, 4), dtype_of(R, r))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, r, 1.0
    return T


def orthonormal(R: Array) -> Array:
    """The rotation nearest to a matrix that is one up to rounding, to the last digit of its own arithmetic.

    Newton's iteration for the polar factor, R ← R (3·1 − RᵀR) / 2, doubles the correct digits at every step.
    """
    steps = 1 if R.dtype != object else 3
    for _ in range(steps):
        R = R @ (3.0 * np.eye(3) - np.swapaxes(R, -1, -2) @ R) / 2
    return R


def unit(a: Array) -> Array:
    """a / |a|, to the last digit of its own arithmetic."""
    return a / sqrt((a * a).sum(-1))


def solve(A: Array, b: Array) -> Array:
    """x with A x = b for a dense, indefinite A (..., n, n) and b (..., n), by LU with partial pivoting.

    Floats go to LAPACK, and one step of iterative refinement cleans what bad scaling left; mpmath numbers go to mpmath.
    ModelError for a traced A, which has no pivots to choose from: the routes that need this function are oracles, not kernels.
    """
    if A.dtype != object:
        x = np.linalg.solve(A, b[..., None])
        return (x + np.linalg.solve(A, b[..., None] - A @ x))[..., 0]
    mp = mpmath()
    if not all(isinstance(a, (mp.mpf, float, int)) for a in A.flat):
        raise ModelError("the saddle-point routes choose pivots and cannot be traced: use 'nonrecursive' or 'recursive'")
    shape = np.broadcast_shapes(A.shape[:-2], b.shape[:-1])
    A, b = np.broadcast_to(A, shape + A.shape[-2:]), np.broadcast_to(b, shape + b.shape[-1:])
    x = np.empty(b.shape, dtype=object)
    for i in np.ndindex(shape):
        x[i] = list(mp.lu_solve(mp.matrix(A[i].tolist()), mp.matrix(b[i].tolist())))
    return x
