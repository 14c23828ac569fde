"""Six-vectors, angular first, and how they pass from a body's frame to its parent's and back.

A pose (R, r) is the rotation and the origin of the child's frame in the parent's. Twists and accelerations travel outward,
wrenches and inertias inward. Together these are the blocks of B in eqs. (8), (10) and (11).
"""

from typing import NamedTuple

import numpy as np

from ..arithmetic import Array, dtype_of, known, zeros
from ..arithmetic.vectors import column, congruent, cross, dot, joined, mirrored, mul, skew, stacked, transpose
from ..model import Inertia


class Pose(NamedTuple):
    """Rotation R (..., 3, 3) and origin r (..., 3) of a frame in another."""

    R: Array
    r: Array

    def __matmul__(self, other: "Pose") -> "Pose":  # type: ignore[override]
        """The pose of a frame known in this one's frame."""
        return Pose(self.R @ other.R, self.r + mul(self.R, other.r))


def angular(x: Array) -> Array:
    """The first three of six: ω, ε or M."""
    return x[..., :3]


def linear(x: Array) -> Array:
    """The last three of six: v, a or F."""
    return x[..., 3:]


def twist_to_child(X: Pose, twist: Array) -> Array:
    """What a twist (or an acceleration) (..., 6) of the parent at its O is at the child's O, resolved in the child."""
    Rt, omega = transpose(X.R), angular(twist)
    return joined(mul(Rt, omega), mul(Rt, linear(twist) + cross(omega, X.r)))


def wrench_to_parent(X: Pose, wrench: Array) -> Array:
    """What a wrench (..., 6) about the child's O is about the parent's O, resolved in the parent."""
    F = mul(X.R, linear(wrench))
    return joined(mul(X.R, angular(wrench)) + cross(X.r, F), F)


def twist_matrix(X: Pose) -> Array:
    """The matrix (..., 6, 6) of `twist_to_child`: −B_i,p(i)."""
    Rt = transpose(X.R)
    return blocks(Rt, np.zeros((3, 3)), -Rt @ skew(X.r), Rt)


def blocks(A: Array, B: Array, C: Array, D: Array) -> Array:
    """[[A, B], [C, D]] (..., 6, 6) from 3 × 3 blocks."""
    shape = np.broadcast_shapes(*(a.shape[:-2] for a in (A, B, C, D)))
    X = zeros((*shape, 6, 6), dtype_of(A, B, C, D))
    X[..., :3, :3], X[..., :3, 3:], X[..., 3:, :3], X[..., 3:, 3:] = A, B, C, D
    return X


class RigidInertia(NamedTuple):
    """M_i of one rigid body, or of several that move as one: eq. (7) in its ten numbers."""

    tensor: Array  # Θ (..., 3, 3) about O
    moment: Array  # m ρ (..., 3)
    mass: Array | float  # m

    @classmethod
    def of(cls, inertia: Inertia) -> "RigidInertia":
        """That of a body."""
        return cls(inertia.tensor, inertia.moment, inertia.mass)

    def __add__(self, other: "RigidInertia") -> "RigidInertia":  # type: ignore[override]
        return RigidInertia(self.tensor + other.tensor, self.moment + other.moment, self.mass + other.mass)

    def times(self, x: Array) -> Array:
        """M x (..., 6)."""
        w, u, h = angular(x), linear(x), self.moment
        return joined(mul(self.tensor, w) + cross(h, u), self.mass * u - cross(h, w))

    def to_parent(self, X: Pose) -> "RigidInertia":
        """The same matter about the parent's O, resolved in the parent: Steiner's theorem, from O to O."""
        R, x, h = X.R, skew(X.r), mul(X.R, self.moment)
        xh = x @ skew(h)
        turned = mirrored(congruent(R, self.tensor))
        return RigidInertia(mirrored(turned - xh - transpose(xh) - self.mass * (x @ x)), h + self.mass * X.r, self.mass)

    def matrix(self) -> Array:
        """M_i (..., 6, 6)."""
        hx = skew(self.moment)
        return blocks(self.tensor, hx, -hx, self.mass * np.eye(3))


class ArticulatedInertia(NamedTuple):
    """The inertia that a body shows when the joints beyond it are free to move: [[Θ, H], [Hᵀ, M]], symmetric."""

    Theta: Array  # (..., 3, 3)
    H: Array  # (..., 3, 3)
    M: Array  # (..., 3, 3)

    @classmethod
    def of(cls, inertia: Inertia) -> "ArticulatedInertia":
        """That of a body."""
        return cls(inertia.tensor, skew(inertia.moment), inertia.mass * np.eye(3))

    def __add__(self, other: "ArticulatedInertia") -> "ArticulatedInertia":  # type: ignore[override]
        return ArticulatedInertia(self.Theta + other.Theta, self.H + other.H, self.M + other.M)

    def times(self, x: Array) -> Array:
        """The wrench (..., 6) that an acceleration (..., 6) needs."""
        e, a = angular(x), linear(x)
        return joined(mul(self.Theta, e) + mul(self.H, a), mul(transpose(self.H), e) + mul(self.M, a))

    def size(self, r: Array | None = None) -> Array:
        """(tr Θ, tr M) (..., 2); about a point at the distance r (..., 3), where it is given, a bound of it."""
        turning, sliding = np.trace(self.Theta, axis1=-2, axis2=-1), np.trace(self.M, axis1=-2, axis2=-1)
        return stacked([turning if r is None else 2.0 * (turning + dot(r, r) * sliding), sliding])

    def without(self, s: Array, U: Array, d: Array) -> "ArticulatedInertia":
        """A − U d Uᵀ: the freedom s (..., 6), with U = A s and d = 1 / sᵀU, no longer transmits anything.

        Where s is a coordinate axis, its row and column are exactly zero, and are written as such.
        """
        Uw, Uv = angular(U), linear(U)
        dU = column(d) * U
        dUw, dUv = angular(dU)[..., None], linear(dU)[..., None]
        Theta = mirrored(self.Theta - dUw * Uw[..., None, :])
        H = self.H - dUw * Uv[..., None, :]
        M = mirrored(self.M - dUv * Uv[..., None, :])
        row = coordinate_axis(s)
        if row is not None and row < 3:
            Theta[..., row, :] = Theta[..., :, row] = H[..., row, :] = 0.0
        elif row is not None:
            M[..., row - 3, :] = M[..., :, row - 3] = H[..., :, row - 3] = 0.0
        return ArticulatedInertia(Theta, H, M)

    def to_parent(self, X: Pose) -> "ArticulatedInertia":
        """The same about the parent's O, resolved in the parent."""
        R, x = X.R, skew(X.r)
        Theta, H, M = mirrored(congruent(R, self.Theta)), congruent(R, self.H), mirrored(congruent(R, self.M))
        shifted = H + x @ M
        return ArticulatedInertia(mirrored(Theta + x @ transpose(H) - shifted @ x), shifted, M)


def coordinate_axis(s: Array) -> int | None:
    """The entry that alone is not zero in a constant s (6,); None where there are several, or s varies."""
    rows = [i for i, x in enumerate(s) if known(x) != 0] if s.ndim == 1 else []
    return rows[0] if len(rows) == 1 else None
