"""A stand-in for a robot without any visuals: joints, bones and the axes of every link's frame."""

import numpy as np

from ..arithmetic import Array
from ..arithmetic.vectors import frozen, rotation
from ..model import Cylinder, Mechanism, Sphere, Visual

BONE = (0.55, 0.58, 0.63, 1.0)
JOINT = (0.20, 0.23, 0.27, 1.0)
AXES = ((0.85, 0.20, 0.20, 1.0), (0.20, 0.65, 0.25, 1.0), (0.20, 0.40, 0.90, 1.0))  # x red, y green, z blue


def skeleton(mechanism: Mechanism) -> list[list[Visual]]:
    """Visuals of every link: bones to the joints it carries, or to its centre of mass where it carries none."""
    ends: list[list[Array]] = [[] for _ in mechanism.links]
    for joint in mechanism.joints:
        if joint.parent >= 0:
            ends[joint.parent].append(joint.translation)
    for link, own in zip(mechanism.links, ends, strict=True):
        if not own:
            own.append(link.inertia.centre)
    size = max((float(np.linalg.norm(end)) for own in ends for end in own), default=0.0) or 1.0

    sphere = Visual(Sphere(0.05 * size), frozen(np.eye(3)), frozen(np.zeros(3)), JOINT)
    axes = [_rod(0.2 * size * axis, 0.012 * size, colour) for axis, colour in zip(np.eye(3), AXES, strict=True)]
    return [[sphere, *axes, *(_rod(end, 0.025 * size, BONE) for end in own if end.any())] for own in ends]


def _rod(end: Array, radius: float, colour: tuple[float, float, float, float]) -> Visual:
    """A cylinder from the origin to `end` (3,) [m]."""
    length = float(np.linalg.norm(end))
    x, y, z = end / length
    tilt = np.hypot(x, y)  # the sine of the angle between z and the rod
    axis = np.array([-y, x, 0.0]) / tilt if tilt else np.array([1.0, 0.0, 0.0])
    return Visual(Cylinder(radius, length), frozen(rotation(axis, z, tilt)), frozen(end / 2), colour)
