"""Linear springs in joints: u = −k (β − β₀)."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..arithmetic import Array
from ..errors import InputError
from ..model import Mechanism
from .base import Load, State, joint_table


@dataclass(frozen=True, eq=False)
class JointSpring(Load):
    """`JointSpring({"knee": 40.0}, rest={"knee": 0.3})`: stiffness [N m/rad or N/m], rest position [rad or m], 0 if not given."""

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

    def _stretch(self, state: State) -> dict[int, tuple[Array, Array]]:
        rest = self._table(state.mechanism, self.rest)
        stiffness = self._table(state.mechanism, self.stiffness)
        return {i: (k, state.position(i) - rest.get(i, 0.0)) for i, k in stiffness.items()}

    def joint_forces(self, state: State) -> Mapping[int, Array]:
        return {i: -k * x for i, (k, x) in self._stretch(state).items()}

    def potential(self, state: State) -> Array | float:
        return sum((0.5 * k * x * x).sum(-1) for k, x in self._stretch(state).values())
