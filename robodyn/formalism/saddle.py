"""The saddle-point systems (18) and (19): all accelerations, constraint wrenches and η̇ in one linear system.

O(n³), with the constraint wrenches as unknowns of their own and gravity as a wrench on every body: the slow, independent oracle.
"""

import numpy as np

from ..arithmetic import Array, dtype_of, zeros
from ..arithmetic.vectors import mul, solve, transpose
from .constraints import B_matrix, C_matrix, J_matrix, batch_of, relative_accelerations
from .kinematics import joint_position
from .newton_euler import Wrenches, gyroscopic, weight
from .spatial import RigidInertia, wrench_to_parent
from .state import State


class Saddle:
    """The pieces of (18) and (19) at one state: M, B, C, J, ā_rel, ā and the known wrenches f̌ᵗ + f̌ᶜ."""

    def __init__(self, state: State, u: Array, wrenches: Wrenches, gravity: Array) -> None:
        tree, motion = state.tree, state.motion
        self.tree, self.n, self.dtype = tree, 6 * len(tree.bodies), dtype_of(state.q, state.v, u, gravity)
        self.batch = batch_of(motion, u, *wrenches.values())
        self.B, self.C, self.J = (matrix(tree, motion, self.dtype) for matrix in (B_matrix, C_matrix, J_matrix))
        self.a_rel = relative_accelerations(tree, motion, self.dtype)
        self.M = self._masses()
        self.f = self._known_wrenches(state, u, wrenches, gravity)

    def _masses(self) -> Array:
        M = zeros((self.n, self.n), self.dtype)
        for i, body in enumerate(self.tree.bodies):
            M[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = RigidInertia.of(body.inertia).matrix()
        return M

    def _known_wrenches(self, state: State, u: Array, wrenches: Wrenches, gravity: Array) -> Array:
        f = zeros((*self.batch, self.n), self.dtype)
        for i, body in enumerate(self.tree.bodies):
            rows = slice(6 * i, 6 * i + 6)
            f[..., rows] += gyroscopic(body.inertia, state.motion.twist[i]) + weight(body.inertia, state.world[i].R, gravity)
            if i in wrenches:
                f[..., rows] += wrenches[i]

            # An actuator pushes the child and pulls the parent.
            pushed = mul(body.joint.actuation(joint_position(body, state.q[..., body.q])), u[..., body.u])
            f[..., rows] += pushed
            if body.parent >= 0:
                f[..., 6 * body.parent : 6 * body.parent + 6] -= wrench_to_parent(state.motion.pose[i], pushed)
        return f

    def solve(self, coupling: Array, freedom: Array, offset: Array) -> Array:
        """x with [[M, −Xᵀ, 0], [−X, 0, Y], [0, Yᵀ, 0]] x = (f̌ᵗ + f̌ᶜ, −offset, 0)."""
        n, nv = self.n, self.tree.nv
        K = zeros((*self.batch, 2 * n + nv, 2 * n + nv), self.dtype)
        K[..., :n, :n] = self.M
        K[..., :n, n : 2 * n], K[..., n : 2 * n, :n] = -transpose(coupling), -coupling
        K[..., n : 2 * n, 2 * n :], K[..., 2 * n :, n : 2 * n] = freedom, transpose(freedom)
        rhs = zeros((*self.batch, 2 * n + nv), self.dtype)
        rhs[..., :n], rhs[..., n : 2 * n] = self.f, -offset
        return solve(K, rhs)


def saddle_joint(state: State, u: Array, wrenches: Wrenches, gravity: Array) -> tuple[Array, Array, Array]:
    """Eq. (18): ǎ (..., 6n), the constraint wrench of each joint f̌ᵖ (..., 6n), η̇ (..., nv)."""
    s = Saddle(state, u, wrenches, gravity)
    x = s.solve(s.B, s.C, s.a_rel)
    return x[..., : s.n], x[..., s.n : 2 * s.n], x[..., 2 * s.n :]


def saddle_body(state: State, u: Array, wrenches: Wrenches, gravity: Array) -> tuple[Array, Array, Array]:
    """Eq. (19): ǎ (..., 6n), the resultant constraint wrench on each body f̌ᵏ (..., 6n), η̇ (..., nv)."""
    s = Saddle(state, u, wrenches, gravity)
    abar = solve(s.B, s.a_rel)
    x = s.solve(zeros((s.n, s.n), s.dtype) + np.eye(s.n), s.J, abar)
    return x[..., : s.n], x[..., s.n : 2 * s.n], x[..., 2 * s.n :]
