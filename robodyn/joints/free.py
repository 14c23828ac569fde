"""Free joint, URDF's `floating`: all six freedoms, no reaction."""

from dataclasses import dataclass

import numpy as np

from ..arithmetic import Array
from ..arithmetic.vectors import cross, dot, joined, mul, normalised, quaternion_rate, rotation_from_quaternion
from .base import JointType


@dataclass(frozen=True, eq=False)
class Free(JointType):
    """β = (position of O in the joint's frame [m], quaternion (w, x, y, z)); η = (ω, v) of O, resolved in the child."""

    kind = "floating"
    coordinates = (("x", "m"), ("y", "m"), ("z", "m"), ("qw", "1"), ("qx", "1"), ("qy", "1"), ("qz", "1"))
    velocities = (("wx", "rad/s"), ("wy", "rad/s"), ("wz", "rad/s"), ("vx", "m/s"), ("vy", "m/s"), ("vz", "m/s"))
    rated = True

    def neutral(self) -> Array:
        return np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])

    def random(self, rng: np.random.Generator) -> Array:
        return np.concatenate([rng.uniform(-1.0, 1.0, 3), normalised(rng.normal(size=4))])

    def pose(self, q: Array) -> tuple[Array, Array]:
        return rotation_from_quaternion(q[..., 3:]), q[..., :3]

    def motion(self, q: Array) -> Array:
        return np.eye(6)

    def bias(self, q: Array, v: Array) -> Array:
        return joined(np.zeros(3), cross(v[..., :3], v[..., 3:]))

    def rate(self, q: Array, v: Array) -> Array:
        p = q[..., 3:]
        return joined(mul(rotation_from_quaternion(p), v[..., 3:]), quaternion_rate(p, v[..., :3]))

    def side_condition(self, q: Array) -> Array:
        p = q[..., 3:]
        return dot(p, p) - 1.0

    def project(self, q: Array) -> Array:
        return joined(q[..., :3], normalised(q[..., 3:]))
