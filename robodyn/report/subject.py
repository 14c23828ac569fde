"""What is measured: one robot, its random states, and its twins in other libraries."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arithmetic import Array
from ..errors import InputError, RobodynError
from ..evaluation.asking import EARTH
from ..robot import Robot, load
from ..scene import Scene
from ..system.processes import cached_property, cores
from .timing import Job

if TYPE_CHECKING:
    from .peers.mujoco import Twin
    from .peers.pinocchio import Pair


@dataclass(frozen=True)
class Settings:
    """How much is measured."""

    batch: int = 4096  # states
    rounds: int = 9
    seed: int = 0
    t_end: float = 10.0  # [s] of one trajectory
    dt: float = 1e-3  # [s]
    crowd: int = 1024  # trajectories at a time
    crowd_steps: int = 100
    threads: int = cores()  # of the crowd; all else runs on one
    checked: int = 8  # states whose results are compared with 50 digits before any time is taken

    @classmethod
    def quick(cls) -> "Settings":
        """So little that the figures mean nothing: whether it runs at all."""
        return cls(batch=64, rounds=1, t_end=0.05, crowd=16, crowd_steps=10, checked=2)


@dataclass(frozen=True, eq=False)
class Subject:
    """A robot of a URDF file under measurement."""

    path: str | os.PathLike[str]
    settings: Settings = field(default_factory=Settings)
    options: Mapping[str, Any] = field(default_factory=dict)  # of `robodyn.load`

    @cached_property
    def robot(self) -> Robot:
        """The robot; InputError where it cannot move."""
        robot = load(self.path, **self.options)
        if not robot.nv:
            raise InputError(f"robot {robot.name!r} has no degree of freedom: there is nothing to measure")
        return robot

    @cached_property
    def scene(self) -> Scene:
        """The robot under gravity alone."""
        return Scene(self.robot, declared=False)

    @cached_property
    def states(self) -> tuple[Array, Array, Array]:
        """Random q (batch, nq), v and tau (batch, nv), C-ordered as a user has them."""
        rng, n = np.random.default_rng(self.settings.seed), self.settings.batch
        q = np.stack([self.robot.random_state(rng)[0] for _ in range(n)])
        return q, rng.uniform(-2.0, 2.0, (n, self.robot.nv)), rng.uniform(-5.0, 5.0, (n, self.robot.nv))

    @property
    def few(self) -> tuple[Array, Array, Array]:
        """Those of them whose results are checked."""
        q, v, tau = (x[: self.settings.checked] for x in self.states)
        return q, v, tau

    @cached_property
    def exact(self) -> Array:
        """η̇ (checked, nv) of the few in 50 digits."""
        return self.robot.forward_dynamics(*self.few, backend="mpmath")

    @cached_property
    def pinocchio(self) -> "Pair | str":
        """The robot's twin in Pinocchio, or why there is none."""
        return self._peer("Pinocchio", self._pinocchio)

    @cached_property
    def mujoco(self) -> "Twin | str":
        """The robot's twin in MuJoCo, or why there is none."""
        return self._peer("MuJoCo", self._mujoco)

    def _pinocchio(self) -> "Pair":
        from .peers.pinocchio import Pair

        return Pair(self.robot, self.path, self.options.get("locked"))

    def _mujoco(self) -> "Twin":
        from .peers.mujoco import Twin

        return Twin(self.robot, self.settings.dt, EARTH)

    def _peer(self, name: str, make: Callable[[], Any]) -> Any:
        try:
            return make()
        except ImportError:
            return f"{name} is not installed: pip install 'robodyn[bench]'"
        except (RobodynError, ValueError) as error:
            return str(error)


@dataclass(frozen=True)
class Contest:
    """One kind of work, done by robodyn and by a peer: two jobs, prepared and compared, not yet timed."""

    kind: str
    work: str
    ours: Job
    units: float  # of work in one run: seconds are reported per unit
    peer: str = ""
    theirs: Job | None = None
    peer_units: float = 1.0
    error: float | None = None
    peer_error: float | None = None
    note: str = ""
