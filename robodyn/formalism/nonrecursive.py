"""The equations of motion in minimal form: M̂ η̇ = k̂ᶜ + k̂ᵗ with M̂ = JᵀMJ, solved by a sparse LᵀDL.

JᵀMJ is never multiplied out: the inertia of all that hangs on a joint is composed once (composite bodies), and k̂ is one
inward sweep of f̌ᵏ at η̇ = 0. The fewest operations on small robots.
"""

import numpy as np

from ..arithmetic import Array, dtype_of, zeros
from ..arithmetic.vectors import skew, stacked, transpose
from ..model import Body, Field, Tree
from . import ldl
from .constraints import batch_of, coordinate_forces
from .kinematics import Motion
from .newton_euler import Wrenches, bias_resultants
from .reactions import inward
from .solution import Solution
from .spatial import Pose, RigidInertia
from .state import State


def nonrecursive(state: State, tau: Array, wrenches: Wrenches, gravity: Array, *, inertias: Tree | None = None) -> Solution:
    """η̇ (..., nv) of a state for the coordinate forces tau (..., nv), and f̌ᵏ of its bodies at η̇ = 0, which k̂ is made of.

    inertias: another tree with the same M̂, to compose it from; k̂ is that of the state's own.
    """
    tree, composed = state.tree, state if inertias is None else state.on(inertias)
    resting = bias_resultants(tree, state.motion, wrenches, gravity)
    k = tau - bias_forces(tree, state.motion, resting)
    meets = ldl.couplings(tree)
    M = mass_matrix(composed.tree, composed.motion, dtype_of(state.q, state.v, tau))
    rows, pivots, reciprocals = ldl.factorise(M, meets)
    vdot = ldl.solve(rows, reciprocals, [k[..., i] for i in range(tree.nv)], meets)
    return Solution(stacked(vdot), stacked(pivots), resting=resting)


def composites(tree: Tree, motion: Motion) -> Field:
    """The inertia of all that hangs on each joint, as one rigid body."""

    def inward(body: Body, arrived: list[RigidInertia], X: Pose) -> tuple[RigidInertia, RigidInertia]:
        composite = sum(arrived, start=RigidInertia.of(body.inertia))
        return composite.to_parent(X), composite

    return tree.inward(inward, motion.pose)


def mass_matrix(tree: Tree, motion: Motion, dtype: np.dtype) -> Array:
    """M̂ = JᵀMJ (..., nv, nv), symmetric."""
    composite = composites(tree, motion)
    M = zeros((*batch_of(motion), tree.nv, tree.nv), dtype)
    for i, body in enumerate(tree.bodies):
        if not body.joint.nv:
            continue
        # The wrench (..., 6, k) that unit accelerations of joint i need, carried towards the root.
        F = momentum_columns(composite[i], motion.subspace[i])
        M[..., body.v, body.v] += transpose(motion.subspace[i]) @ F
        j = i
        while tree.bodies[j].parent >= 0:
            F, j = columns_to_parent(motion.pose[j], F), tree.bodies[j].parent
            block = transpose(motion.subspace[j]) @ F
            M[..., tree.bodies[j].v, body.v] += block
            M[..., body.v, tree.bodies[j].v] += transpose(block)
    return M


def bias_forces(tree: Tree, motion: Motion, resting: Field) -> Array:
    """−k̂ᶜ − k̂ᵗ (..., nv) of everything but the joint forces: Jᵀ f̌ᵏ with f̌ᵏ (..., 6) of the bodies at η̇ = 0, gravity included."""
    return coordinate_forces(tree, motion, inward(tree, motion, resting))


def momentum_columns(inertia: RigidInertia, S: Array) -> Array:
    """M S (..., 6, k), column by column."""
    return np.stack([inertia.times(S[..., :, k]) for k in range(S.shape[-1])], axis=-1)


def columns_to_parent(X: Pose, F: Array) -> Array:
    """`wrench_to_parent` for the columns of F (..., 6, k)."""
    linear = X.R @ F[..., 3:, :]
    angular = X.R @ F[..., :3, :] + skew(X.r) @ linear
    return np.concatenate(np.broadcast_arrays(angular, linear), axis=-2)
