"""Planar joint: two translations in a plane and the rotation about its normal."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ..arithmetic import Array, cos, exact, sin, zeros
from ..arithmetic.vectors import cross, frozen, rotation, transpose, unit
from .base import AxisJoint


@dataclass(frozen=True, eq=False)
class Planar(AxisJoint):
    """β = (x, y, θ): x and y [m] along the plane's axes, fixed to the parent, θ [rad] about the normal; η = β̇.

    The axis of the file is the normal n. The plane's axes are u and n × u, where u is the coordinate axis that follows
    n's largest component cyclically, projected into the plane: n = z gives (x, y), n = x gives (y, z), n = y gives (z, x).
    """

    kind = "planar"
    coordinates = (("x", "m"), ("y", "m"), ("theta", "rad"))
    velocities = (("x", "m/s"), ("y", "m/s"), ("theta", "rad/s"))

    first: Array | None = None  # u (3,), found from the normal where it is not given

    def __post_init__(self) -> None:
        if self.first is None:
            u = np.eye(3)[(int(np.argmax(abs(self.axis))) + 1) % 3]
            object.__setattr__(self, "first", frozen(unit(u - self.axis * (self.axis * u).sum())))

    def exact(self) -> Self:
        return replace(self, axis=unit(exact(self.axis)), first=None)

    def plane(self) -> Array:
        """(3, 2): the plane's two axes, as columns."""
        u = np.asarray(self.first)
        return np.stack([u, cross(self.axis, u)], axis=-1)

    def random(self, rng: np.random.Generator) -> Array:
        return np.append(rng.uniform(-1.0, 1.0, 2), rng.uniform(-np.pi, np.pi))

    def pose(self, q: Array) -> tuple[Array, Array]:
        angle = q[..., 2]
        return rotation(self.axis, cos(angle), sin(angle)), q[..., :2] @ self.plane().T

    def motion(self, q: Array) -> Array:
        R, _ = self.pose(q)
        S = zeros((*q.shape[:-1], 6, 3), R.dtype)
        S[..., :3, 2] = self.axis
        S[..., 3:, :2] = transpose(R) @ self.plane()
        return S
