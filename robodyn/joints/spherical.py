"""Spherical joint: free rotation about a point. Our addition to URDF: <joint type="spherical">."""

from dataclasses import dataclass

import numpy as np

from ..arithmetic import Array
from ..arithmetic.vectors import dot, normalised, quaternion_rate, rotation_from_quaternion
from .base import JointType


@dataclass(frozen=True, eq=False)
class Spherical(JointType):
    """β the unit quaternion (w, x, y, z), η the relative angular velocity [rad/s] resolved in the child."""

    kind = "spherical"
    coordinates = (("qw", "1"), ("qx", "1"), ("qy", "1"), ("qz", "1"))
    velocities = (("wx", "rad/s"), ("wy", "rad/s"), ("wz", "rad/s"))
    rated = True

    def neutral(self) -> Array:
        return np.array([1.0, 0.0, 0.0, 0.0])

    def random(self, rng: np.random.Generator) -> Array:
        return normalised(rng.normal(size=4))

    def pose(self, q: Array) -> tuple[Array, Array]:
        return rotation_from_quaternion(q), np.zeros(3)

    def motion(self, q: Array) -> Array:
        return np.eye(6)[:, :3]

    def rate(self, q: Array, v: Array) -> Array:
        return quaternion_rate(q, v)

    def side_condition(self, q: Array) -> Array:
        return dot(q, q) - 1.0

    def project(self, q: Array) -> Array:
        return normalised(q)
