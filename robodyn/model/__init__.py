"""Immutable data: the robot as its file describes it, and the tree of bodies that its motion needs."""

from .geometry import Box, Cylinder, Geometry, Mesh, Sphere, Visual
from .inertia import Inertia
from .mechanism import GROUND, Joint, Limits, Link, Mechanism, Mimic
from .minimal import Minimal, minimal
from .tree import Body, Field, Tree, lump

__all__ = [
    "GROUND",
    "Body",
    "Box",
    "Cylinder",
    "Field",
    "Geometry",
    "Inertia",
    "Joint",
    "Limits",
    "Link",
    "Mechanism",
    "Mesh",
    "Mimic",
    "Minimal",
    "Sphere",
    "Tree",
    "Visual",
    "lump",
    "minimal",
]
