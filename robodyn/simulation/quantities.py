"""What a trajectory holds and shows at each of its times: one table, from which files, checks, CSV tables and docstrings are made."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arithmetic import Array
from ..scene import Scene

Labels = list[tuple[str, str]]  # name and unit of each column of a CSV table

COMPONENTS = (("Mx", "N m"), ("My", "N m"), ("Mz", "N m"), ("Fx", "N"), ("Fy", "N"), ("Fz", "N"))
RATES = {"rad/s": "rad/s²", "m/s": "m/s²"}
ENERGIES = ("kinetic", "potential", "work", "balance")


def unlabelled(scene: Scene) -> Labels:
    """No columns."""
    return []


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A quantity over time: an array (T, *shape), the shape stated in `sizes` and numbers; columns of a CSV table where it names one."""

    name: str
    shape: tuple[str | int, ...]
    unit: str
    meaning: str
    found: Callable[..., Array]  # from a Trajectory
    csv: str | None = None  # the table; a new name is a new file
    labels: Callable[[Scene], Labels] = unlabelled  # of as many columns as the shape has numbers

    def of(self, trajectory: Any) -> Array:
        """The array (T, *shape) of a Trajectory."""
        return self.found(trajectory)

    def rows(self, trajectory: Any) -> Array:
        """The same with all numbers of one time in a row (T, n)."""
        return self.of(trajectory).reshape(len(trajectory.t), self.numbers(trajectory.scene))

    def numbers(self, scene: Scene) -> int:
        """How many there are at one time."""
        return math.prod(self.shape_in(scene))

    def shape_in(self, scene: Scene) -> tuple[int, ...]:
        """The shape at one time, in numbers."""
        known = sizes(scene)
        return tuple(n if isinstance(n, int) else known[n] for n in self.shape)


@dataclass(frozen=True, kw_only=True)
class Recorded(Quantity):
    """A quantity that a Trajectory holds, as its attribute of that name, and stores in its file.

    It is found when the integration has ended, from the times (T,), the states as `Parts`, and the arrays of the question `Result`.
    """

    optional: bool = False  # not in the file where it has no numbers

    def of(self, trajectory: Any) -> Array:
        return getattr(trajectory, self.name)

    def fits(self, array: Array, count: int, scene: Scene) -> bool:
        """Whether an array can be this quantity at so many times."""
        return array.shape == (count, *self.shape_in(scene)) and array.dtype == float and bool(np.isfinite(array).all())


def sizes(scene: Scene) -> dict[str, int]:
    """The numbers that shapes are stated in."""
    robot = scene.robot
    return {"nq": robot.nq, "nv": robot.nv, "nz": scene.evaluator.state_vector.nz, "nu": robot.nu, "njoints": len(robot.joints)}


def _coordinates(symbol: str) -> Callable[[Scene], Labels]:
    return lambda scene: [(f"{symbol}.{name}", unit) for name, unit in scene.robot.coordinate_names()[0]]


def _velocities(symbol: str, units: dict[str, str] | None = None) -> Callable[[Scene], Labels]:
    return lambda scene: [(f"{symbol}.{name}", (units or {}).get(unit, unit)) for name, unit in scene.robot.coordinate_names()[1]]


QUANTITIES: dict[str, Quantity] = {
    quantity.name: quantity
    for quantity in (
        Recorded(name="t", shape=(), unit="s", meaning="time", found=lambda t, x, result: t),
        Recorded(
            name="q",
            shape=("nq",),
            unit="rad, m, quaternions 1",
            meaning="joint coordinates β; of a free joint the position in the parent's frame, then (w, x, y, z)",
            found=lambda t, x, result: x.q,
            csv="states",
            labels=_coordinates("q"),
        ),
        Recorded(
            name="v",
            shape=("nv",),
            unit="rad/s, m/s",
            meaning="joint velocities η; of free and spherical joints in the body's frame, angular first",
            found=lambda t, x, result: x.v,
            csv="states",
            labels=_velocities("v"),
        ),
        Recorded(
            name="z",
            shape=("nz",),
            unit="of the load",
            meaning="the loads' own states",
            found=lambda t, x, result: x.z,
            optional=True,
        ),
        Recorded(
            name="a",
            shape=("nv",),
            unit="rad/s², m/s²",
            meaning="joint accelerations η̇, as v",
            found=lambda t, x, result: result["vdot"],
            csv="states",
            labels=_velocities("a", RATES),
        ),
        Recorded(
            name="u",
            shape=("nu",),
            unit="N m, N",
            meaning="what loads supply within the joints, along their free axes",
            found=lambda t, x, result: result["u"],
        ),
        Recorded(
            name="work",
            shape=(),
            unit="J",
            meaning="work of the loads without a potential since the start; damping takes out, so its share is negative",
            found=lambda t, x, result: x.work,
        ),
        Quantity(
            name="reactions",
            shape=("njoints", 6),
            unit="N m, N",
            meaning="constraint wrench of each joint on its child, at the joint's origin, in the child's frame, moment first",
            found=lambda trajectory: trajectory.reactions().array,
            csv="reactions",
            labels=lambda scene: [(f"{joint}.{c}", unit) for joint in scene.robot.all_joint_names for c, unit in COMPONENTS],
        ),
        Quantity(
            name="energy",
            shape=(len(ENERGIES),),
            unit="J",
            meaning="kinetic and potential energy, work of the loads, and their balance",
            found=lambda trajectory: np.stack(trajectory.energy(), axis=-1),
            csv="energy",
            labels=lambda scene: [(name, "J") for name in ENERGIES],
        ),
    )
}


def recorded() -> list[Recorded]:
    """What a trajectory holds and its file stores."""
    return [quantity for quantity in QUANTITIES.values() if isinstance(quantity, Recorded)]


def described(quantities: Iterable[Quantity], *leading: str) -> str:
    """Lines of a docstring: what arrays with these dimensions before the time are."""
    lines = []
    for x in quantities:
        dimensions = [str(n) for n in (*(leading if x.name != "t" else ()), "T", *x.shape)]
        lines.append(f"{x.name} ({', '.join(dimensions)}{',' * (len(dimensions) == 1)}) [{x.unit}]: {x.meaning}.")
    return "\n    ".join(lines)
