"""Viscous damping in joints: u = −d η. What a URDF declares by <dynamics damping="d">."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..arithmetic import Array
from ..errors import InputError
from ..model import Mechanism
from .base import Load, State, joint_numbers, joint_table


@dataclass(frozen=True, eq=False)
class JointDamping(Load):
    """`JointDamping({"elbow_joint": 0.5})`: coefficients [N m s/rad or N s/m], one per joint or one per freedom.

    InputError where one is negative.
    """

    coefficients: Mapping[str, float]

    def check(self, mechanism: Mechanism) -> None:
        for i, d in joint_table(mechanism, self.coefficients, "damping").items():
            if (d < 0).any():
                raise InputError(f"damping of joint {mechanism.joints[i].name!r} is {d.tolist()}: it must not be negative")

    def joint_forces(self, state: State) -> Mapping[int, Array]:
        d = joint_numbers(state.mechanism, self.coefficients, "damping")
        return d.by_joint(-d.values * d.velocities(state))
