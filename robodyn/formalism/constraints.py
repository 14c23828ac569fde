"""The explicit joint constraints as matrices: B v̌ = C η + v̄_rel, eq. (10), and the global Jacobian J = B⁻¹ C, eq. (13).

The saddle-point routes solve with these; the sweeps of the other routes are the same matrices, never written down.
"""

import numpy as np

from ..arithmetic import Array, zeros
from ..arithmetic.vectors import mul, transpose
from ..model import Field, Tree
from .kinematics import Motion
from .spatial import twist_matrix


def batch_of(motion: Motion, *arrays: Array) -> tuple[int, ...]:
    """The leading dimensions of a state and of vectors beside it."""
    shapes = [x.shape[:-1] for x in (*motion.twist, *arrays)] + [X.R.shape[:-2] for X in motion.pose]
    return np.broadcast_shapes((), *shapes)


def B_matrix(tree: Tree, motion: Motion, dtype: np.dtype) -> Array:
    """B (..., 6n, 6n), unit block triangular: B_ii = 1, B_i,p(i) = −(shift from O_p(i) to O_i)."""
    n = len(tree.bodies)
    B = zeros((*batch_of(motion), 6 * n, 6 * n), dtype)
    for i, (body, X) in enumerate(zip(tree.bodies, motion.pose, strict=True)):
        B[..., _rows(i), _rows(i)] = np.eye(6)
        if body.parent >= 0:
            B[..., _rows(i), _rows(body.parent)] = -twist_matrix(X)
    return B


def C_matrix(tree: Tree, motion: Motion, dtype: np.dtype) -> Array:
    """C (..., 6n, nv): each joint's motion subspace in its columns; a mimic joint shares its leader's."""
    C = zeros((*batch_of(motion), 6 * len(tree.bodies), tree.nv), dtype)
    for i, (body, S) in enumerate(zip(tree.bodies, motion.subspace, strict=True)):
        C[..., _rows(i), body.v] = S
    return C


def J_matrix(tree: Tree, motion: Motion, dtype: np.dtype) -> Array:
    """J = B⁻¹ C (..., 6n, nv) by an outward sweep: v̌ = J η + v̄."""
    J = C_matrix(tree, motion, dtype)
    for i, (body, X) in enumerate(zip(tree.bodies, motion.pose, strict=True)):
        if body.parent >= 0:
            J[..., _rows(i), :] += twist_matrix(X) @ J[..., _rows(body.parent), :]
    return J


def relative_accelerations(tree: Tree, motion: Motion, dtype: np.dtype) -> Array:
    """ā_rel (..., 6n) of eq. (11), with the ground at rest."""
    a = zeros((*batch_of(motion), 6 * len(tree.bodies)), dtype)
    for i, bias in enumerate(motion.bias):
        a[..., _rows(i)] = bias
    return a


def coordinate_forces(tree: Tree, motion: Motion, wrenches: Field) -> Array:
    """Cᵀ f̌ (..., nv) of one wrench (..., 6) per joint."""
    return tree.gathered(tree.each(lambda _, S, f: mul(transpose(S), f), motion.subspace, wrenches))


def _rows(i: int) -> slice:
    return slice(6 * i, 6 * i + 6)
