"""What every load answers. Each load is an immutable record of plain numbers, generic over the scalar when evaluated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from ..arithmetic import Array
from ..arithmetic.symbols import symbols
from ..arithmetic.vectors import frozen
from ..errors import InputError
from ..formalism.state import State
from ..model import Mechanism
from ..system.processes import cached_property


@dataclass(frozen=True, eq=False)
class Load:
    """Forces f̌ᵗ in joints and on links. Override what the load has."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():  # the user's dictionaries, lists and arrays may change, the load does not
            object.__setattr__(self, name, _kept(value))

    conservative: ClassVar[bool] = False  # its work is minus the change of `potential`

    def initial_state(self, mechanism: Mechanism) -> Array:
        """The load's own states z (n,) at the start of a motion; most loads have none."""
        return np.zeros(0)

    def check(self, mechanism: Mechanism) -> None:
        """Raise ModelError or InputError where the load does not fit the robot."""

    def joint_forces(self, state: State) -> Mapping[int, Array]:
        """Force or torque (..., nv_i) of the load in joints, by joint index; positive along the joint's velocity."""
        return {}

    def link_wrenches(self, state: State) -> Mapping[int, Array]:
        """Wrench [M, F] (..., 6) on links, by link index, about the link's origin and resolved in the link."""
        return {}

    def state_rate(self, state: State) -> Array:
        """ż (..., n) of the load's own states, which are `state.z` (..., n)."""
        return np.zeros(0)

    def potential(self, state: State) -> Array | float:
        """Potential energy (...) [J] of a conservative load."""
        return 0.0


def _kept(value: Any) -> Any:
    """A value that its giver can no longer change, as far as it is made of dictionaries, lists and arrays."""
    if isinstance(value, dict):
        return {key: _kept(x) for key, x in value.items()}
    if isinstance(value, list):
        return tuple(map(_kept, value))
    return frozen(value) if isinstance(value, np.ndarray) and value.dtype.kind in "biuf" else value


@dataclass(frozen=True, eq=False)
class JointNumbers:
    """One number per freedom of some joints, so that a load computes all of its joint forces at once."""

    table: Mapping[int, Array]  # by joint index

    @cached_property
    def values(self) -> Array:
        """The numbers (n,), one joint behind the other."""
        return np.concatenate([np.zeros(0), *self.table.values()])

    def velocities(self, state: State) -> Array:
        """η (..., n) of these joints."""
        return symbols(state.velocities[..., self._places(state.mechanism.u_slices)])

    def positions(self, state: State) -> Array:
        """β (..., n) of these joints, which are none with Euler parameters."""
        mimics = [state.mechanism.joints[i].mimic for i, x in self.table.items() for _ in x]
        beta = symbols(state.q[..., self._places(state.mechanism.q_slices)])
        if not any(mimics):
            return beta
        return np.array([m.ratio if m else 1.0 for m in mimics]) * beta + np.array([m.offset if m else 0.0 for m in mimics])

    def by_joint(self, forces: Array) -> dict[int, Array]:
        """Forces (..., n) by joint index."""
        ends = np.cumsum([0, *map(len, self.table.values())]).tolist()
        return {i: forces[..., a:b] for i, (a, b) in zip(self.table, pairwise(ends), strict=True)}

    def _places(self, slices: Sequence[slice]) -> Array:
        return np.array([k for i in self.table for k in range(slices[i].start, slices[i].stop)], dtype=np.int64)


def joint_numbers(mechanism: Mechanism, values: Mapping[str, object], what: str) -> JointNumbers:
    """`joint_table`, to compute with."""
    return JointNumbers(joint_table(mechanism, values, what))


def joint_table(mechanism: Mechanism, values: Mapping[str, object], what: str) -> dict[int, Array]:
    """`{"joint": number or one number per freedom}` by joint index, each (nv_i,); InputError where it is not that, or a joint is fixed."""
    if not isinstance(values, Mapping):
        raise InputError(f'{what}={values!r} must name the joints it belongs to: {{"joint": number}}')
    table = {}
    for name, given in values.items():
        i = mechanism.joint_index(name)
        n, value = mechanism.joints[i].type.nv, numbers(given, f"{what} of joint {name!r}")
        if n == 0:
            raise InputError(f"{what} of joint {name!r}: it is {mechanism.joints[i].type.kind} and has no freedom to act on")
        if value.shape not in ((), (n,)) or not np.isfinite(value).all():
            raise InputError(f"{what} of joint {name!r} is {value.tolist()}: give one finite number, or {n} of them")
        table[i] = np.broadcast_to(value, (n,))
    return table


def numbers(value: object, what: str) -> Array:
    """`value` as an array of floats; InputError where it is none."""
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{what} is {value!r}: it must be made of numbers") from None
