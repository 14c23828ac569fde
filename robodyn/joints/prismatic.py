"""Prismatic joint: one translation along a fixed axis."""

from dataclasses import dataclass

import numpy as np

from ..arithmetic import Array
from .base import AxisJoint


@dataclass(frozen=True, eq=False)
class Prismatic(AxisJoint):
    """β the displacement along the axis [m], η its rate."""

    kind = "prismatic"
    coordinates = (("", "m"),)
    velocities = (("", "m/s"),)
    bounded = True

    def pose(self, q: Array) -> tuple[Array, Array]:
        return np.eye(3), q * self.axis

    def motion(self, q: Array) -> Array:
        return np.concatenate([np.zeros(3), self.axis])[:, None]

    def indifferent(self, mass: float, moment: Array, tensor: Array) -> tuple[float, Array, Array]:
        return 0.0, np.zeros(3), tensor
