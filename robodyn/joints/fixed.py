"""Fixed joint: no freedom. What it carries is all reaction."""

from dataclasses import dataclass

import numpy as np

from ..arithmetic import Array
from .base import JointType


@dataclass(frozen=True, eq=False)
class Fixed(JointType):
    """The child's frame stays where the joint's is."""

    kind = "fixed"
    coordinates = ()
    velocities = ()
    rigid = True

    def pose(self, q: Array) -> tuple[Array, Array]:
        return np.eye(3), np.zeros(3)

    def motion(self, q: Array) -> Array:
        return np.zeros((6, 0))
