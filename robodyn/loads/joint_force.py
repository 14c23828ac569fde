"""Constant forces or torques in joints."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..arithmetic import Array
from ..model import Mechanism
from .base import Load, State, joint_numbers, joint_table


@dataclass(frozen=True, eq=False)
class JointForce(Load):
    """`JointForce({"elbow_joint": 12.0})`: torque [N m] or force [N], one number per joint or one per freedom."""

    values: Mapping[str, float]

    def check(self, mechanism: Mechanism) -> None:
        joint_table(mechanism, self.values, "force")

    def joint_forces(self, state: State) -> Mapping[int, Array]:
        u = joint_numbers(state.mechanism, self.values, "force")
        return u.by_joint(u.values + 0.0 * u.velocities(state))
