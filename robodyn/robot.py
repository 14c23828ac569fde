"""`Robot`: a mechanism that answers questions about its dynamics. `load` reads one from a URDF file."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

from .evaluation.asking import EARTH, Asking
from .model import Mechanism
from .scene import Scene
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
class Robot(Mechanism, Asking):
    """An immutable robot. Its methods know rigid bodies and gravity alone; a `Scene` adds damping, friction and loads.

    By hand, without a file: a joint per link, the root link's, named `ground`, first; `parent` is the number of a link that stands before.

        bob = rd.Inertia.about_centre(2.0, [0.0, 0.0, -0.5], 0.01 * np.eye(3))  # [kg], [m], [kg m²]
        hinge = rd.joints.Revolute.from_axis([0.0, 1.0, 0.0])
        robot = rd.Robot(
            name="pendulum",
            links=(rd.Link("stand"), rd.Link("rod", bob)),
            joints=(
                rd.Joint("ground", rd.joints.Fixed(), parent=-1),
                rd.Joint("hinge", hinge, parent=0, translation=np.array([0.0, 0.0, 1.0]), limits=rd.Limits(-1.5, 1.5)),
            ),
        )
        robot.forward_dynamics([0.3], [0.0])

    `Limits` are shown and kept; nothing is enforced. `mimic=rd.Mimic(leader=1, ratio=2.0)` makes a joint follow joint number 1: it has no
    coordinate of its own. ModelError where links and joints are no tree.

    Every method takes one state or any number in leading dimensions: q (..., nq), v, tau and a (..., nv).
    """

    @classmethod
    def of(cls, mechanism: Mechanism) -> Self:
        """The robot with a mechanism's data."""
        return cls(**{f.name: getattr(mechanism, f.name) for f in fields(mechanism)})

    def __getstate__(self) -> dict[str, object]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)

    @cached_property
    def alone(self) -> Scene:
        """The scene of this robot alone under the Earth's gravity: without loads, and without those that the URDF declares."""
        return Scene(self, declared=False)

    @cached_property
    def _elsewhere(self) -> dict[tuple[float, ...], Scene]:
        return {EARTH: self.alone}

    def _modelled(self, options: dict[str, Any]) -> Scene:
        """The scene under a gravity, with its kernels where it is one of the last."""
        gravity = options.pop("gravity", EARTH) if options else EARTH
        if gravity is EARTH:
            return self.alone
        scene = Scene(self, gravity=gravity, declared=False)
        key = tuple(map(float, scene.gravity))
        if key not in self._elsewhere and len(self._elsewhere) > REMEMBERED:
            self._elsewhere.pop(list(self._elsewhere)[1], None)
        return self._elsewhere.setdefault(key, scene)
