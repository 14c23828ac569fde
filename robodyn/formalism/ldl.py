"""M̂ = Lᵀ D L with the zeros of the tree kept: from the leaves to the root no fill-in appears where two branches do not meet.

Featherstone, Efficient factorization of the joint-space inertia matrix for branched kinematic trees, Int. J. Robotics Research 24, 2005.
"""

import numpy as np

from ..arithmetic import Array
from ..model import Tree
from .solution import Solution

Couplings = list[list[int]]  # for each coordinate k, the lower coordinates i < k with L_ki ≠ 0, ascending


def couplings(tree: Tree) -> Couplings:
    """Which coordinates meet in M̂ = LᵀDL: those of one joint and those on its way to the root.

    Coordinates that several joints share (mimic) join branches; the elimination then fills in, and the fill is found here.
    """
    meets: list[set[int]] = [set() for _ in range(tree.nv)]
    for body in tree.bodies:
        own = range(body.v.start, body.v.stop)
        path, j = [*own], body.parent
        while j >= 0:
            path += range(tree.bodies[j].v.start, tree.bodies[j].v.stop)
            j = tree.bodies[j].parent
        for k in own:
            for m in path:
                if m != k:
                    meets[max(k, m)].add(min(k, m))
    for k in reversed(range(tree.nv)):
        for i in meets[k]:
            meets[i] |= {j for j in meets[k] if j < i}
    return [sorted(m) for m in meets]


def factorise(M: Array, meets: Couplings) -> tuple[list[dict[int, Array]], list[Array], dict[int, Array]]:
    """L as one dictionary of its entries per row, the pivots D and their reciprocals, for M (..., n, n)."""
    n = M.shape[-1]
    reciprocals: dict[int, Array] = {}
    rows = [{i: M[..., k, i] for i in (*meets[k], k)} for k in range(n)]
    for k in reversed(range(n)):
        reciprocals[k] = 1.0 / rows[k][k]
        L = {i: rows[k][i] * reciprocals[k] for i in meets[k]}
        for i in meets[k]:
            for j in (*(j for j in meets[k] if j < i), i):
                rows[i][j] = rows[i][j] - L[i] * rows[k][j]
        rows[k].update(L)
    return rows, [rows[k][k] for k in range(n)], reciprocals


def solve_dense(M: Array, b: Array) -> Solution:
    """η̇ (n, nv) with M̂ η̇ = b for n matrices M̂ (n, nv, nv) of float64, by LAPACK; LinAlgError where a pivot is not positive.

    Powers of two bring the diagonal near 1 first, without rounding: no unit of a coordinate costs digits.
    """
    diagonal = np.diagonal(M, axis1=-2, axis2=-1)
    if not ((diagonal > 0) & np.isfinite(diagonal)).all():
        raise np.linalg.LinAlgError("an entry of the diagonal is not positive")
    scale = np.exp2(-np.round(np.log2(diagonal) / 2))
    A = M * scale[:, :, None] * scale[:, None, :]
    L = np.linalg.cholesky(A[:, ::-1, ::-1])  # from the last coordinate to the first, as LᵀDL
    pivots = (np.diagonal(L, axis1=-2, axis2=-1)[:, ::-1] / scale) ** 2
    return Solution(np.linalg.solve(A, (scale * b)[..., None])[..., 0] * scale, pivots, diagonal)


def solve(rows: list[dict[int, Array]], reciprocals: dict[int, Array], b: list[Array], meets: Couplings) -> list[Array]:
    """x with Lᵀ D L x = b, one array (...) per coordinate."""
    x = list(b)
    for k in reversed(range(len(x))):
        for i in meets[k]:
            x[i] = x[i] - rows[k][i] * x[k]
    for k in range(len(x)):
        x[k] = x[k] * reciprocals[k]
        for i in meets[k]:
            x[k] = x[k] - rows[k][i] * x[i]
    return x
