"""One file per kind of load; `LOADS` maps the name of each to its class."""

from .base import Load, State
from .control_law import ControlLaw
from .joint_damping import JointDamping
from .joint_force import JointForce
from .joint_friction import JointFriction
from .joint_spring import JointSpring
from .link_wrench import LinkWrench
from .sampled import Sampled

LOADS: dict[str, type[Load]] = {
    load.__name__: load for load in (ControlLaw, JointDamping, JointForce, JointFriction, JointSpring, LinkWrench, Sampled)
}

__all__ = ["LOADS", "ControlLaw", "JointDamping", "JointForce", "JointFriction", "JointSpring", "LinkWrench", "Load", "Sampled", "State"]
