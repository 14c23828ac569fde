"""Dry friction of constant size in joints: u = −c tanh(η / w). What a URDF declares by <dynamics friction="c">."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..arithmetic import Array, tanh
from ..errors import InputError
from ..model import Mechanism
from .base import Load, State, joint_numbers, joint_table


@dataclass(frozen=True, eq=False)
class JointFriction(Load):
    """`JointFriction({"elbow_joint": 2.0})`: Coulomb friction [N m or N] that does not depend on the joint's reaction.

    The jump at rest is smoothed over the speed `width` [rad/s or m/s]: within it a joint creeps instead of sticking.
    InputError where a coefficient is negative or the width is not positive.
    """

    coefficients: Mapping[str, float]
    width: float = 1e-2

    def check(self, mechanism: Mechanism) -> None:
        for i, c in joint_table(mechanism, self.coefficients, "friction").items():
            if (c < 0).any():
                raise InputError(f"friction of joint {mechanism.joints[i].name!r} is {c.tolist()}: it must not be negative")
        if not self.width > 0:
            raise InputError(f"friction is smoothed over the speed width={self.width!r}: it must be positive")

    def joint_forces(self, state: State) -> Mapping[int, Array]:
        c = joint_numbers(state.mechanism, self.coefficients, "friction")
        return c.by_joint(-c.values * tanh(c.velocities(state) / self.width))
