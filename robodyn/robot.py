"""`Robot`: a mechanism that answers questions about its dynamics. `load` reads one from a URDF file."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from types import FunctionType
from typing import Self

from .arithmetic import Array
from .dynamics.questions import ForwardDynamics, InverseDynamics, Question
from .formalism.reactions import Reactions
from .model import Mechanism
from .scene import EARTH, Scene
from .system.processes import cached_property

REMEMBERED = 8  # scenes of other gravities than the Earth's whose kernels a robot keeps


def load(
    source: str | os.PathLike[str],
    *,
    floating_base: bool = False,
    package_dirs: Iterable[str | os.PathLike[str]] = (),
    locked: Mapping[str, float | Sequence[float]] | None = None,
) -> "Robot":
    """The robot of a URDF file.

    floating_base: the root link is free to move; `ground` becomes a free joint. package_dirs: where package://… meshes are looked for.
    locked: joints to freeze, with their coordinate [rad or m]: `locked={"finger_joint": 0.04}`.
    Raises UrdfError with every problem of the file, each with its line and remedy.
    """
    from .urdf import read

    return Robot.of(read(source, floating_base=floating_base, package_dirs=package_dirs, locked=locked))


@dataclass(frozen=True, eq=False, repr=False)
class Robot(Mechanism):
    """An immutable robot. Its methods know rigid bodies and gravity alone; a `Scene` adds damping, friction and loads.

    Every method takes one state or any number in leading dimensions: q (..., nq), v, tau and a (..., nv), and passes further
    keywords (formalism, backend, dtype, frame, part, …) to the method of the same name of `Scene`, where they are explained.
    """

    @classmethod
    def of(cls, mechanism: Mechanism) -> Self:
        """The robot with a mechanism's data."""
        return cls(**{f.name: getattr(mechanism, f.name) for f in fields(mechanism)})

    def _hasten(self, method: FunctionType, question: Question, gravity: object, options: Iterable[str]) -> None:
        if gravity is EARTH and all(option in ("threads", "out") for option in options):
            self._on_earth.evaluator.hasten(self, method, question)

    def __getstate__(self) -> dict[str, object]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)

    @cached_property
    def _on_earth(self) -> Scene:
        return Scene(self, declared=False)

    @cached_property
    def _elsewhere(self) -> dict[tuple[float, ...], Scene]:
        return {EARTH: self._on_earth}

    def _bare(self, gravity: Array | Sequence[float]) -> Scene:
        """The scene under a gravity, with its kernels where it is one of the last."""
        if gravity is EARTH:
            return self._on_earth
        scene = Scene(self, gravity=gravity, declared=False)
        key = tuple(map(float, scene.gravity))
        if key not in self._elsewhere and len(self._elsewhere) > REMEMBERED:
            self._elsewhere.pop(list(self._elsewhere)[1], None)
        return self._elsewhere.setdefault(key, scene)

    def forward_dynamics(self, q, v, tau=None, *, gravity: Array | Sequence[float] = EARTH, **options) -> Array:
        """η̇ (..., nv) under the joint forces tau (..., nv) [N m, N]; see `Scene.forward_dynamics`."""
        self._hasten(Robot.forward_dynamics, ForwardDynamics("auto"), gravity, options)
        return self._bare(gravity).forward_dynamics(q, v, tau, **options)

    def inverse_dynamics(self, q, v, a, *, gravity: Array | Sequence[float] = EARTH, **options) -> Array:
        """tau (..., nv) [N m, N] for the acceleration a (..., nv); see `Scene.inverse_dynamics`."""
        self._hasten(Robot.inverse_dynamics, InverseDynamics(), gravity, options)
        return self._bare(gravity).inverse_dynamics(q, v, a, **options)

    def bias_forces(self, q, v, *, gravity: Array | Sequence[float] = EARTH, **options) -> Array:
        """Gravity, Coriolis and centrifugal forces (..., nv); see `Scene.bias_forces`."""
        return self._bare(gravity).bias_forces(q, v, **options)

    def mass_matrix(self, q, **options) -> Array:
        """M̂ (..., nv, nv); see `Scene.mass_matrix`."""
        return self._on_earth.mass_matrix(q, **options)

    def reactions(self, q, v, tau=None, *, gravity: Array | Sequence[float] = EARTH, **options) -> Reactions:
        """The wrench [M, F] (..., 6) [N m, N] of every joint, by name; see `Scene.reactions`."""
        return self._bare(gravity).reactions(q, v, tau, **options)

    def kinetic_energy(self, q, v, **options) -> Array:
        """Kinetic energy (...) [J]."""
        return self._on_earth.kinetic_energy(q, v, **options)

    def potential_energy(self, q, *, gravity: Array | Sequence[float] = EARTH, **options) -> Array:
        """Potential energy (...) [J] of gravity."""
        return self._bare(gravity).potential_energy(q, **options)

    def momentum(self, q, v, **options) -> Array:
        """Angular and linear momentum (..., 6); see `Scene.momentum`."""
        return self._on_earth.momentum(q, v, **options)

    def link_poses(self, q, **options) -> Array:
        """The pose (..., nlinks, 4, 4) of every link, in the order of `link_names`."""
        return self._on_earth.link_poses(q, **options)
