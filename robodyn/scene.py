"""What is modelled: a robot, gravity, loads. And every question that can be asked of it at given states."""

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from . import inputs
from .algebra import frozen
from .arithmetic import Array, exact, mpmath
from .equations import FORMALISMS, Applied, Equations
from .errors import InputError, ModelError
from .formalism.reactions import FRAMES, PARTS, Reactions
from .formalism.solution import Solution
from .loads import JointDamping, JointFriction, Load
from .model import Mechanism, lump

BACKENDS = ("numpy", "mpmath")
DIGITS = 50  # of backend="mpmath"
EARTH = (0.0, 0.0, -9.81)


@dataclass(frozen=True, eq=False)
class Scene:
    """A robot with what acts on it.

    gravity: acceleration (3,) [m/s²] in the ground's frame. loads: see `robodyn.loads`. declared: add what the URDF declares
    by <dynamics>: damping and friction of its joints.

    Every method takes one state or any number in leading dimensions: q (..., nq), v, tau and a (..., nv).
    Raises InputError for an argument of the wrong shape or value, ModelError where the motion is undetermined.
    """

    robot: Mechanism
    gravity: Array | Sequence[float] = EARTH
    loads: Sequence[Load] = ()
    declared: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "gravity", frozen(inputs.vector3("gravity", self.gravity)))
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
    def _equations(self) -> dict[tuple[str, bool], Equations]:
        return {}

    @cached_property
    def _dynamics(self) -> Equations:
        """The float64 equations, once no body makes nonsense of them."""
        self._refuse_impossible()
        return self.equations()

    def equations(self, backend: str = "numpy", *, opened: bool = False) -> Equations:
        """The scene's equations in one arithmetic: links on fixed joints lumped, or `opened` at every joint to show its reaction."""
        key = (inputs.choice("backend", backend, BACKENDS), opened)
        if key not in self._equations:
            with arithmetic(backend):
                robot, gravity = (self.robot, self.gravity) if backend == "numpy" else (self.robot.exact(), exact(self.gravity))
                tree = lump(robot, cut=range(len(robot.joints)) if opened else ())
            self._equations[key] = Equations(self.robot, tree, np.asarray(gravity), self.all_loads)
        return self._equations[key]

    def _door(self, backend: str, **arrays: object) -> Sequence[Array]:
        """The arrays, checked and in the backend's arithmetic, all with the same leading dimensions; None becomes zeros."""
        robot, objects = self.robot, inputs.choice("backend", backend, BACKENDS) == "mpmath"
        q_names, v_names = robot.coordinate_names()
        checked: dict[str, Array] = {}
        for name, value in arrays.items():
            size, meaning, labels = (robot.nq, "nq", q_names) if name == "q" else (robot.nv, "nv", v_names)
            value = np.zeros(size) if value is None else value
            checked[name] = inputs.array(name, value, size, f"{meaning} of {robot.name!r}", [n for n, _ in labels], objects=objects)
        batch = inputs.broadcast(**checked)
        if "q" in checked:
            inputs.unit_quaternions(self.equations().side_conditions(checked["q"]))
        stretched = [np.broadcast_to(x, (*batch, x.shape[-1])) for x in checked.values()]
        return inputs.as_exact(*stretched) if objects else stretched

    # --- how it moves ---

    def forward_dynamics(self, q, v, tau=None, *, t: float = 0.0, formalism: str = "auto", backend: str = "numpy") -> Array:
        """η̇ (..., nv) [rad/s², m/s²] under the joint forces tau (..., nv) [N m, N], none if not given, and the loads at time t [s].

        formalism: "auto", "recursive", "nonrecursive", "saddle_joint" or "saddle_body", the routes of eqs. (18), (19) and M̂ η̇ = k̂.
        """
        q, v, tau = self._door(backend, q=q, v=v, tau=tau)
        return self._forward(q, v, tau, t, formalism, backend)[1]

    def _forward(self, q: Array, v: Array, tau: Array, t: Array | float, formalism: str, backend: str) -> tuple[Applied, Array]:
        inputs.choice("formalism", formalism, FORMALISMS)
        equations = self._dynamics if backend == "numpy" else self.equations(backend)
        with arithmetic(backend), np.errstate(all="ignore"):
            acts = equations.applied(t, q, v, tau)
            try:
                solution = equations.accelerate(q, v, acts, formalism)
            except (np.linalg.LinAlgError, ZeroDivisionError):
                self._refuse_undetermined()
                raise ModelError(f"the equations of robot {self.robot.name!r} are singular at this state") from None
        self._check(solution, q)
        return acts, np.broadcast_to(solution.vdot, v.shape)

    def _refuse_impossible(self) -> None:
        """ModelError where a body has a negative moment of inertia: no matter moves so."""
        for body in self.equations().tree.bodies:
            moments = np.linalg.eigvalsh(body.inertia.about_own_centre)
            # The sums and Steiner terms of a lumped body leave a few roundings of Θ about O.
            if moments[0] < -64 * np.finfo(float).eps * np.trace(abs(body.inertia.tensor)):
                name, values = self.robot.links[body.link].name, ", ".join(f"{m:.6g}" for m in moments)
                raise ModelError(
                    f"the body of link {name!r} has the principal moments of inertia {values}: no matter has a negative one. "
                    "Correct its <inertial> and those of the links fixed to it"
                )

    def _refuse_undetermined(self) -> None:
        """ModelError where a joint moves nothing that has mass: the motion is undetermined whatever the state."""
        tree = self.equations().tree
        heavy = [not body.inertia.is_zero for body in tree.bodies]
        for i in reversed(range(len(tree.bodies))):
            if (p := tree.bodies[i].parent) >= 0:
                heavy[p] = heavy[p] or heavy[i]
        light = [self.robot.joints[b.link].name for b, h in zip(tree.bodies, heavy, strict=True) if b.joint.nv and not h]
        if light:
            raise ModelError(
                f"the motion of robot {self.robot.name!r} is undetermined: the links moved by {', '.join(map(repr, light))} have no mass. "
                f"Give one of them an <inertial>, or lock the joint: rd.load(…, locked={{{light[0]!r}: 0.0}})"
            )

    def _check(self, solution: Solution, q: Array) -> None:
        """ModelError where a freedom showed no inertia, or a result is not finite."""
        pivots, scales = solution.pivots.astype(float), solution.scales.astype(float)
        # A pivot is what is left of sums of about nv terms of the size of its scale; below their rounding it is noise.
        lost = ~(pivots > 4 * (self.robot.nv + 1) * np.finfo(float).eps * abs(scales))
        if lost.any():
            self._refuse_undetermined()
            index = tuple(int(i) for i in np.argwhere(lost)[0])
            raise ModelError(
                f"joint {self._joint_of(index[-1])!r} of robot {self.robot.name!r} has no inertia to accelerate{_at(index[:-1])}: "
                f"its pivot is {pivots[index]:.3g} of {scales[index]:.3g}. Give the links beyond it mass off its axis, or lock it"
            )
        bad = np.argwhere(~np.isfinite(solution.vdot.astype(float)))
        if len(bad):
            index = tuple(int(i) for i in bad[0])
            raise ModelError(
                f"the acceleration of joint {self._joint_of(index[-1])!r} is not finite{_at(index[:-1])}: "
                "velocities or forces are too large for float64"
            )

    def _joint_of(self, column: int) -> str:
        return next(
            self.robot.joints[i].name for i in self.robot.owners if self.robot.v_slices[i].start <= column < self.robot.v_slices[i].stop
        )

    # --- what it takes and carries ---

    def inverse_dynamics(self, q, v, a, *, t: float = 0.0, backend: str = "numpy") -> Array:
        """tau (..., nv) [N m, N] that the joints must supply, beside the loads, for the acceleration a (..., nv)."""
        q, v, a = self._door(backend, q=q, v=v, a=a)
        equations = self.equations(backend)
        with arithmetic(backend):
            acts = equations.applied(t, q, v, 0.0 * v)
            return equations.inverse(q, v, a, acts.wrenches) - acts.tau

    def bias_forces(self, q, v, *, t: float = 0.0, backend: str = "numpy") -> Array:
        """−k̂ᶜ − k̂ᵗ (..., nv): `inverse_dynamics` at a = 0; gravity, Coriolis and centrifugal forces, loads."""
        return self.inverse_dynamics(q, v, np.zeros(self.robot.nv), t=t, backend=backend)

    def mass_matrix(self, q, *, backend: str = "numpy") -> Array:
        """M̂ = JᵀMJ (..., nv, nv)."""
        (q,) = self._door(backend, q=q)
        with arithmetic(backend):
            M = self.equations(backend).mass_matrix(q)
        return np.array(np.broadcast_to(M, (*q.shape[:-1], self.robot.nv, self.robot.nv)))

    def reactions(
        self,
        q,
        v,
        tau=None,
        *,
        t: float = 0.0,
        frame: str = "child",
        part: str = "constraint",
        joints: Iterable[str] | None = None,
        formalism: str = "auto",
        backend: str = "numpy",
    ) -> Reactions:
        """The wrench [M, F] (..., 6) [N m, N] on each joint's child link, from its parent, about the joint's origin.

        frame: resolved in the "child" link, the "parent" link or the "world". part: "constraint" is f̌ᵖ, which does no work on
        the free motion; "total" adds what actuator, damping, spring and friction transmit along the free axes.
        joints: names, all of them if not given: `ground`, fixed and mimic joints included.
        """
        q, v, tau = self._door(backend, q=q, v=v, tau=tau)
        acts, vdot = self._forward(q, v, tau, t, formalism, backend)
        return self._reactions(q, v, vdot, acts, frame, part, joints, backend)

    def _reactions(self, q, v, vdot, acts: Applied, frame: str, part: str, joints: Iterable[str] | None, backend: str) -> Reactions:
        inputs.choice("frame", frame, FRAMES)
        inputs.choice("part", part, PARTS)
        if isinstance(joints, str):
            raise InputError(f"joints={joints!r} must be a list of names: joints=[{joints!r}]")
        names = self.robot.all_joint_names if joints is None else tuple(joints)
        indices = tuple(self.robot.joint_index(name) for name in names)
        equations = self.equations(backend, opened=True)
        with arithmetic(backend):
            # Wrenches on links that ride on fixed joints belong to other bodies of the opened tree.
            wrenches = equations.applied(0.0, q, v, 0.0 * v).wrenches if acts.wrenches else {}
            return equations.reactions(q, v, vdot, acts._replace(wrenches=wrenches), frame, part, indices)

    # --- energies, places ---

    def kinetic_energy(self, q, v, *, backend: str = "numpy") -> Array:
        """½ v̌ᵀ M v̌ (...) [J]."""
        q, v = self._door(backend, q=q, v=v)
        with arithmetic(backend):
            return np.broadcast_to(self.equations(backend).kinetic(q, v), q.shape[:-1])[()]

    def potential_energy(self, q, *, t: float = 0.0, backend: str = "numpy") -> Array:
        """Potential energy (...) [J] of gravity, zero with the centre of mass in the ground's origin, and of springs."""
        (q,) = self._door(backend, q=q)
        with arithmetic(backend):
            return np.broadcast_to(self.equations(backend).potential(t, q, np.zeros(self.robot.nv)), q.shape[:-1])[()]

    def momentum(self, q, v, *, backend: str = "numpy") -> Array:
        """Angular momentum about the ground's origin [N m s] and linear momentum [N s] (..., 6), in the ground's frame."""
        q, v = self._door(backend, q=q, v=v)
        with arithmetic(backend):
            return self.equations(backend).momentum(q, v)

    def link_poses(self, q, *, backend: str = "numpy") -> Array:
        """The pose (..., nlinks, 4, 4) of every link's frame in the ground's, in the order of `robot.link_names`."""
        (q,) = self._door(backend, q=q)
        with arithmetic(backend):
            return self.equations(backend).link_poses(q)


def arithmetic(backend: str) -> AbstractContextManager[object]:
    """The working precision of a backend, for as long as it computes."""
    return mpmath().workdps(DIGITS) if backend == "mpmath" else nullcontext()


def _at(index: tuple[int, ...]) -> str:
    return f" in state [{', '.join(map(str, index))}]" if index else ""
