"""One file per joint type; `JOINT_TYPES` maps the word in <joint type="…"> to its class."""

from .base import Attribute, AxisJoint, JointType
from .fixed import Fixed
from .free import Free
from .planar import Planar
from .prismatic import Prismatic
from .revolute import Continuous, Revolute
from .spherical import Spherical

JOINT_TYPES: dict[str, type[JointType]] = {joint.kind: joint for joint in (Fixed, Revolute, Continuous, Prismatic, Planar, Spherical, Free)}

__all__ = [
    "JOINT_TYPES",
    "Attribute",
    "AxisJoint",
    "Continuous",
    "Fixed",
    "Free",
    "JointType",
    "Planar",
    "Prismatic",
    "Revolute",
    "Spherical",
]
