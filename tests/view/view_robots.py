"""A robot whose motion is known in closed form: a still base, an arm that turns at 2 rad/s, a slide that moves at 0.3 m/s."""

from dataclasses import dataclass

import numpy as np

from robodyn.arithmetic.vectors import homogeneous, rotation
from robodyn.joints import Fixed
from robodyn.model import Joint, Mechanism, Visual

ORANGE = (1.0, 0.5, 0.0, 1.0)
AXIS = np.array([1.0, 2.0, 2.0]) / 3.0


def visual(geometry, colour=None, at=(0.0, 0.0, 0.0)):
    return Visual(geometry, np.eye(3), np.array(at), colour)


def chain(*links, joints=None):
    """Links in a row, 0.2 m apart."""
    joints = joints or [Fixed() for _ in links]
    frames = [{"rotation": np.eye(3), "translation": np.array([0.0, 0.0, 0.2 if i else 0.0])} for i in range(len(links))]
    names = ["ground", *(f"joint {i}" for i in range(1, len(links)))]
    return Mechanism("chain", links, tuple(Joint(n, t, i - 1, **f) for i, (n, t, f) in enumerate(zip(names, joints, frames, strict=True))))


@dataclass
class Run:
    mechanism: Mechanism
    times: np.ndarray

    def pose(self, t):
        """World poses (3, 4, 4) at the time t, whether it is a frame or not."""
        arm = homogeneous(rotation(AXIS, np.cos(2.0 * np.asarray(t)), np.sin(2.0 * np.asarray(t))), np.array([0.1, -0.2, 0.4]))
        slide = homogeneous(np.eye(3), np.array([0.3 * t, 0.5, 0.2]))
        return np.stack([np.eye(4), arm, slide])

    @property
    def poses(self):
        return np.stack([self.pose(t) for t in self.times])

    @property
    def arguments(self):
        return {"times": self.times, "poses": self.poses}
