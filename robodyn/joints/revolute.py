"""Revolute and continuous joints: one rotation about a fixed axis."""

from dataclasses import dataclass

import numpy as np

from ..arithmetic import Array, cos, sin
from ..arithmetic.vectors import rotation
from .base import AxisJoint


@dataclass(frozen=True, eq=False)
class Revolute(AxisJoint):
    """β the angle about the axis [rad], η its rate."""

    kind = "revolute"
    coordinates = (("", "rad"),)
    velocities = (("", "rad/s"),)
    bounded = True

    def random(self, rng: np.random.Generator) -> Array:
        return rng.uniform(-np.pi, np.pi, 1)

    def pose(self, q: Array) -> tuple[Array, Array]:
        angle = q[..., 0]
        return rotation(self.axis, cos(angle), sin(angle)), np.zeros(3)

    def motion(self, q: Array) -> Array:
        return np.concatenate([self.axis, np.zeros(3)])[:, None]

    @property
    def line(self) -> Array:
        return self.axis

    def indifferent(self, mass: float, moment: Array, tensor: Array) -> tuple[float, Array, Array]:
        # What a turn about the axis leaves as it is and the axis does not feel: mass on the axis, and equal moments across it.
        e = self.axis
        across = int(np.argmin(abs(e)))
        return mass, (moment @ e) * e, tensor[across, across] * (np.eye(3) - np.outer(e, e))


@dataclass(frozen=True, eq=False)
class Continuous(Revolute):
    """A revolute joint without limits; its angle is not wrapped."""

    kind = "continuous"
    bounded = False
