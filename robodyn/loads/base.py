"""What every load answers. Each load is an immutable record of plain numbers, generic over the scalar when evaluated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from ..arithmetic import Array, exact, is_exact
from ..arithmetic.symbols import symbols
from ..arithmetic.vectors import frozen
from ..errors import InputError
from ..formalism.kinematics import motion, world_poses
from ..formalism.spatial import Pose, twist_to_child
from ..model import Field, Mechanism, Tree
from ..system.processes import cached_property


@dataclass(frozen=True, eq=False)
class State:
    """What a load may look at: the time, the coordinates, and on demand where the links are and how fast.

    The arrays of its methods are float64, mpmath numbers or symbols; NumPy's functions take them all, as far as `dispatch` goes, and so
    do those of `arithmetic`. A choice is np.where, not a branch.
    """

    mechanism: Mechanism
    tree: Tree
    t: Array | float
    q: Array  # (..., nq)
    v: Array  # (..., nv)

    def position(self, joint: int) -> Array:
        """β (..., nq_i) of a joint by its index; a mimic joint's follows its leader."""
        beta, mimic = self.q[..., self.mechanism.q_slices[joint]], self.mechanism.joints[joint].mimic
        return symbols(beta if mimic is None else mimic.ratio * beta + mimic.offset)

    def velocity(self, joint: int) -> Array:
        """η (..., nv_i) of a joint by its index."""
        eta, mimic = self.v[..., self.mechanism.v_slices[joint]], self.mechanism.joints[joint].mimic
        return symbols(eta if mimic is None else mimic.ratio * eta)

    @cached_property
    def velocities(self) -> Array:
        """The velocity (..., nu) in the direction of each joint force of u, mimic joints' included."""
        columns, ratios = self.mechanism.driven
        return ratios * self.v[..., columns]

    def constant(self, x: object) -> Array:
        """Numbers of a load, in the state's own arithmetic: sums of them must not round in float64 where the state has 50 digits."""
        return exact(x) if is_exact(self.q) else np.array(x, dtype=float)

    @cached_property
    def _motion(self):
        return motion(self.tree, self.q, self.v)

    @cached_property
    def _world(self) -> Field:
        return world_poses(self.tree, self._motion.pose)

    def placement(self, link: int) -> Pose:
        """A link's frame in its body's."""
        return Pose(self.tree.link_rotation[link], self.tree.link_translation[link])

    def pose(self, link: int) -> Pose:
        """A link's frame in the ground's, by the link's index."""
        body, X = self.tree.link_body[link], self.placement(link)
        return X if body < 0 else Pose(*map(symbols, self._world[body] @ X))

    def twist(self, link: int) -> Array:
        """A link's twist (..., 6) at its origin, resolved in it."""
        body, X = self.tree.link_body[link], self.placement(link)
        return symbols(twist_to_child(X, self._motion.twist[body])) if body >= 0 else np.zeros(6)


@dataclass(frozen=True, eq=False)
class Load:
    """Forces f̌ᵗ in joints and on links. Override what the load has."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():  # the user's dictionaries, lists and arrays may change, the load does not
            object.__setattr__(self, name, _kept(value))

    conservative: ClassVar[bool] = False  # its work is minus the change of `potential`

    def check(self, mechanism: Mechanism) -> None:
        """Raise ModelError or InputError where the load does not fit the robot."""

    def joint_forces(self, state: State) -> Mapping[int, Array]:
        """Force or torque (..., nv_i) of the load in joints, by joint index; positive along the joint's velocity."""
        return {}

    def link_wrenches(self, state: State) -> Mapping[int, Array]:
        """Wrench [M, F] (..., 6) on links, by link index, about the link's origin and resolved in the link."""
        return {}

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
    """`{"joint": number or one number per freedom}` by joint index, each checked and of size nv_i."""
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
