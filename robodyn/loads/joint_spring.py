"""Linear springs in joints: u = −k (β − β₀)."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..arithmetic import Array
from ..errors import InputError
from ..model import Mechanism
from .base import JointNumbers, Load, State, joint_numbers, joint_table


@dataclass(frozen=True, eq=False)
class JointSpring(Load):
    """`JointSpring({"knee": 40.0}, rest={"knee": 0.3})`: stiffness [N m/rad or N/m], rest position [rad or m], 0 if not given.

    InputError for a joint whose coordinates are Euler parameters, and for a rest position without stiffness.
    """

    stiffness: Mapping[str, float]
    rest: Mapping[str, float] = field(default_factory=dict)

    conservative = True

    def check(self, mechanism: Mechanism) -> None:
        for i in {**self._table(mechanism, self.stiffness), **self._table(mechanism, self.rest)}:
            if mechanism.joints[i].type.rated:
                kind, name = mechanism.joints[i].type.kind, mechanism.joints[i].name
                raise InputError(f"joint {name!r} is {kind}: a joint spring needs coordinates that are angles or displacements")
        if stray := set(self.rest) - set(self.stiffness):
            raise InputError(f"rest positions are given for joints without stiffness: {sorted(stray)}")

    def _table(self, mechanism: Mechanism, values: Mapping[str, float]) -> dict[int, Array]:
        return joint_table(mechanism, values, "spring")

    def _stretch(self, state: State) -> tuple[JointNumbers, Array]:
        stiffness = joint_numbers(state.mechanism, self.stiffness, "spring")
        given = self._table(state.mechanism, self.rest)
        rest = JointNumbers({i: given.get(i, np.zeros(len(k))) for i, k in stiffness.table.items()})
        return stiffness, stiffness.positions(state) - rest.values

    def joint_forces(self, state: State) -> Mapping[int, Array]:
        k, x = self._stretch(state)
        return k.by_joint(-k.values * x)

    def potential(self, state: State) -> Array | float:
        k, x = self._stretch(state)
        return (0.5 * k.values * x * x).sum(-1)
