"""The inertia of a rigid body about its reference point."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from ..arithmetic import Array
from ..arithmetic.vectors import frozen, mirrored, outer, skew
from ..errors import ModelError


@dataclass(frozen=True, eq=False)
class Inertia:
    """Mass properties about the reference point O, resolved in the body's frame; the blocks of M_i in eq. (7).

    ModelError where a shape is wrong; whether a body can have these numbers is asked when it has to move.
    """

    mass: float  # m [kg]
    moment: Array  # m ρ (3,) [kg m]; ρ leads from O to the centre of mass
    tensor: Array  # Θ (3, 3) [kg m²] about O

    def __post_init__(self) -> None:
        if isinstance(self.mass, str) or np.shape(self.moment) != (3,) or np.shape(self.tensor) != (3, 3):
            raise ModelError(f"an inertia needs a mass, a moment (3,) and a tensor (3, 3), not {self.mass!r}, {self.moment}, {self.tensor}")

    @classmethod
    def zero(cls) -> Self:
        """A body without mass."""
        return cls(0.0, frozen(np.zeros(3)), frozen(np.zeros((3, 3))))

    @classmethod
    def about_centre(cls, mass: float, centre: Array, tensor: Array) -> Self:
        """From the mass [kg], the centre of mass ρ (3,) [m] and the tensor (3, 3) [kg m²] about it, axes as the body's."""
        centre = np.asarray(centre, dtype=float)
        steiner = mass * (centre @ centre * np.eye(3) - outer(centre, centre))
        return cls(float(mass), frozen(mass * centre), frozen(mirrored(np.asarray(tensor, dtype=float) + steiner)))

    @property
    def centre(self) -> Array:
        """Centre of mass ρ (3,) [m] in the body's frame; the origin for a body without mass."""
        return self.moment / self.mass if self.mass else np.zeros(3)

    @property
    def about_own_centre(self) -> Array:
        """Tensor (3, 3) [kg m²] about the centre of mass, axes as the body's."""
        c = self.centre
        return self.tensor - self.mass * (c @ c * np.eye(3) - outer(c, c))

    @property
    def is_zero(self) -> bool:
        """Whether nothing here can be accelerated: neither mass nor moments of inertia."""
        return self.mass == 0 and not self.tensor.any()

    def seen_from(self, R: Array, r: Array) -> "Inertia":
        """The same matter about the origin of a frame in which this one's frame has the pose (R, r)."""
        h, x = R @ self.moment, skew(np.asarray(r))
        tensor = R @ self.tensor @ R.T - x @ skew(h) - skew(h) @ x - self.mass * (x @ x)
        return Inertia(self.mass, frozen(h + self.mass * r), frozen(mirrored(tensor)))

    def __add__(self, other: "Inertia") -> "Inertia":
        return Inertia(self.mass + other.mass, frozen(self.moment + other.moment), frozen(self.tensor + other.tensor))

    def __sub__(self, other: "Inertia") -> "Inertia":
        return Inertia(self.mass - other.mass, frozen(self.moment - other.moment), frozen(self.tensor - other.tensor))
