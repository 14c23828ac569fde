"""What is modelled: a robot, gravity, loads. And every question that can be asked of it at given states."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np

from .arithmetic import Array
from .arithmetic.vectors import frozen
from .checks import inputs
from .dynamics import questions
from .dynamics.equations import Equations
from .errors import InputError, ModelError
from .evaluation.asking import CHOICES, EARTH, Asking
from .evaluation.evaluator import Evaluator
from .formalism.reactions import Reactions
from .loads import JointDamping, JointFriction, Load, Sampled
from .model import Mechanism
from .system.processes import cached_property


@dataclass(frozen=True, eq=False)
class Scene(Asking):
    """A robot with what acts on it.

    gravity: acceleration (3,) [m/s²] in the ground's frame. loads: see `robodyn.loads`. declared: add what the URDF declares
    by <dynamics>: damping and friction of its joints. InputError where one of these is not what it should be.

    Every method takes one state or any number in leading dimensions: q (..., nq), v, tau and a (..., nv).
    """

    robot: Mechanism
    gravity: Array | Sequence[float] = EARTH
    loads: Sequence[Load] = ()
    declared: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Mechanism):
            raise InputError(f'a Scene is made of a robot, not of {self.robot!r}: rd.Scene(rd.load("file.urdf"))')
        object.__setattr__(self, "gravity", frozen(inputs.vector3("gravity", self.gravity)))
        if isinstance(self.loads, str) or not isinstance(self.loads, Iterable):
            raise InputError(f"loads={self.loads!r} must be a list: loads=[…]")
        object.__setattr__(self, "loads", tuple(self.loads))
        for load in self.loads:
            if not isinstance(load, Load):
                raise InputError(f"loads contains {load!r}: each must be one of robodyn.loads, such as JointDamping({{...}})")
            load.check(self.robot)

    # --- what is modelled ---

    @cached_property
    def all_loads(self) -> tuple[Load, ...]:
        """The loads, and those that the URDF declares."""
        if not self.declared:
            return tuple(self.loads)
        damping = {joint.name: joint.damping for joint in self.robot.joints if joint.damping}
        friction = {joint.name: joint.friction for joint in self.robot.joints if joint.friction}
        declared = [JointDamping(damping)] * bool(damping) + [JointFriction(friction)] * bool(friction)
        return (*self.loads, *declared)

    @cached_property
    def sampled(self) -> tuple[Sampled, ...]:
        """The loads that are digital controllers: no functions of the state, and so no part of the equations."""
        return tuple(load for load in self.loads if isinstance(load, Sampled))

    @cached_property
    def evaluator(self) -> Evaluator:
        """What answers: the formalism's equations, and kernels compiled from them. What `sampled` holds is given to it as tau."""
        return Evaluator(self.robot, np.asarray(self.gravity), tuple(x for x in self.all_loads if not isinstance(x, Sampled)))

    def answered(self, t: float, q: object, v: object, backend: str) -> Array | None:
        """What the sampled controllers answer at time t and states q, v: (..., nv); None where there are none.

        ModelError where they would have to be asked in 50 digits.
        """
        if not self.sampled:
            return None
        if backend == "mpmath":
            raise ModelError("a Sampled is a Python function of float64 arrays: it cannot run with backend='mpmath'")
        q, v = inputs.checked(self.robot, {"q": q, "v": v}).values()
        tau = np.zeros(v.shape)
        for i in np.ndindex(v.shape[:-1]):
            for load in self.sampled:
                tau[i] += load.forces(self.robot, t, q[i], v[i])
        return tau

    def equations(self, backend: str = "numpy", *, opened: bool = False) -> Equations:
        """The scene's equations in one arithmetic: links on fixed joints lumped, or `opened` at every joint to show its reaction."""
        views = self.evaluator.views(backend)
        return views.opened if opened else views.lumped

    def __getstate__(self) -> dict[str, object]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)

    # --- what is asked ---

    def _modelled(self, options: dict[str, Any]) -> Self:
        if "gravity" in options:
            raise TypeError("a Scene has its own gravity: make another by Scene(robot, gravity=…)")
        return self

    def reactions_of(
        self,
        q,
        v,
        a,
        u,
        *,
        t: float | Array = 0.0,
        z: Array | None = None,
        frame: str = "child",
        part: str = "constraint",
        joints: Iterable[str] | None = None,
    ) -> Reactions:
        """As `reactions`, at known accelerations a (..., nv), joints' own forces u (..., nu), loads' states z: what a `Trajectory` holds.

        InputError for an argument of the wrong shape or value.
        """
        names, question = self.about(questions.KnownReactions, joints, frame=frame, part=part)
        if not np.isfinite(t).all():
            raise InputError(f"t={t} must be finite")
        wrenches = self.evaluator.ask(question, t=t, q=q, v=v, a=a, u=u, z=z)["wrenches"]
        return Reactions(names, wrenches, frame, part)

    @cached_property
    def _questions(self) -> dict[tuple, questions.Question]:
        return {}

    def about(
        self, kind: type[questions.Question], joints: Iterable[str] | None, **options: str
    ) -> tuple[tuple[str, ...], questions.Question]:
        """The names of joints, and the question of a kind about them, put together once. InputError where joints is no list of names."""
        if isinstance(joints, str):
            raise InputError(f"joints={joints!r} must be a list of names: joints=[{joints!r}]")
        names = self.robot.all_joint_names if joints is None else tuple(joints)
        key = kind, names, *(inputs.choice(name, value, CHOICES[name]) for name, value in options.items())
        if key not in self._questions:
            self._questions[key] = kind(joints=tuple(map(self.robot.joint_index, names)), **options)  # type: ignore[call-arg]
        return names, self._questions[key]
