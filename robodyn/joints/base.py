"""What every joint type answers: the same small set of functions, each generic over the scalar.

A joint connects a frame fixed to the parent body (the joint's frame, where β = 0 puts the child) to the child's frame.
All six-vectors are angular first and resolved in the child's frame, at the child's reference point O.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from ..arithmetic import Array, exact
from ..arithmetic.vectors import frozen, unit


@dataclass(frozen=True)
class Attribute:
    """Where a URDF gives a constant: <joint> <tag name="0.5"/> </joint>, or in <joint> itself where no tag is named."""

    name: str
    tag: str = ""
    size: int = 1  # how many numbers
    default: tuple[float, ...] | None = None  # what absent means; None: it must be there
    use: str = "a constant of the joint"


@dataclass(frozen=True, eq=False)
class JointType(ABC):
    """A kind of joint, with its own constants (an axis, a pitch)."""

    kind: ClassVar[str]  # the word in <joint type="…">
    coordinates: ClassVar[tuple[tuple[str, str], ...]]  # name and unit of each entry of β; "" where there is only one
    velocities: ClassVar[tuple[tuple[str, str], ...]]  # name and unit of each entry of η
    attributes: ClassVar[Mapping[str, Attribute]] = {}  # a constant of the joint, as its field is called → where a URDF gives it
    bounded: ClassVar[bool] = False  # <limit lower upper> means something
    rated: ClassVar[bool] = False  # β̇ ≠ η: the rate needs H(β)
    rigid: ClassVar[bool] = False  # the child never moves in the parent: links on such joints are lumped into one body
    rheonomic: ClassVar[bool] = False  # it moves by the time as well: see `at` and `drift`

    @property
    def nq(self) -> int:
        """Number of joint coordinates β."""
        return len(self.coordinates)

    @property
    def nv(self) -> int:
        """Degrees of freedom: number of joint velocities η."""
        return len(self.velocities)

    @classmethod
    def from_axis(cls, axis: Array, **constants: Any) -> Self:
        """The joint about or along the axis (3,) of a URDF file, in the child's frame; types without an axis ignore it.

        constants: its other fields.
        """
        return cls(**constants)

    def exact(self) -> Self:
        """The same joint with its constants as mpmath numbers."""
        return self

    def neutral(self) -> Array:
        """β (nq,) at which the child's frame coincides with the joint's."""
        return np.zeros(self.nq)

    def random(self, rng: np.random.Generator) -> Array:
        """A random β (nq,)."""
        return rng.uniform(-1.0, 1.0, self.nq)

    @abstractmethod
    def pose(self, q: Array) -> tuple[Array, Array]:
        """Rotation R (..., 3, 3) and origin r (..., 3) [m] of the child's frame in the joint's frame."""

    @abstractmethod
    def motion(self, q: Array) -> Array:
        """S (..., 6, nv): the child's twist relative to the parent is S η. This joint's block of C, eq. (10)."""

    def at(self, t: Array | float) -> "JointType":
        """The joint as it is at time t [s], with numbers in place of what depends on it: itself, unless it is rheonomic."""
        return self

    def drift(self, q: Array) -> Array | None:
        """v̄_rel (..., 6) of eq. (10): the child's twist relative to the parent at η = 0; None where it is zero."""
        return None

    def bias(self, q: Array, v: Array) -> Array | None:
        """The child's acceleration (ε, a) (..., 6) relative to the parent at η̇ = 0, this joint's share of ā_rel; None where it is zero."""
        return None

    def actuation(self, q: Array) -> Array:
        """W (..., 6, nv): the wrench on the child of joint forces u is W u, and Sᵀ W = 1."""
        return self.motion(q)

    @property
    def line(self) -> Array | None:
        """Direction (3,), in the child's frame, along which the child's reference point may be put elsewhere: it turns about this line."""
        return None

    def indifferent(self, mass: float, moment: Array, tensor: Array) -> tuple[float, Array, Array] | None:
        """The part of the child's inertia (m, m ρ, Θ) that moves alike, whatever β is, if the parent has it; None where there is none."""
        return None

    def rate(self, q: Array, v: Array) -> Array:
        """β̇ = H(β) η (..., nq), eq. (5)."""
        return v

    def side_condition(self, q: Array) -> Array | None:
        """φ(β) (...), zero where β is admissible, eq. (6); None where every β is."""
        return None

    def project(self, q: Array) -> Array:
        """The admissible β (..., nq) that means what q means."""
        return q


@dataclass(frozen=True, eq=False)
class AxisJoint(JointType):
    """A joint whose constant is one unit axis (3,)."""

    attributes = {"axis": Attribute("xyz", "axis", 3, (1.0, 0.0, 0.0), "direction of the joint, brought to length 1")}

    axis: Array

    @classmethod
    def from_axis(cls, axis: Array, **constants: Any) -> Self:
        return cls(frozen(unit(frozen(axis, (3,)))), **constants)

    def exact(self) -> Self:
        return replace(self, axis=unit(exact(self.axis)))
