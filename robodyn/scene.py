"""What is modelled: a robot, gravity, loads. And every question that can be asked of it at given states."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import DTypeLike

from .arithmetic import Array
from .arithmetic.vectors import frozen
from .checks import inputs
from .dynamics import questions
from .dynamics.equations import FORMALISMS, Equations
from .errors import InputError, ModelError
from .evaluation.evaluator import DEFAULT, Evaluator
from .formalism.reactions import FRAMES, PARTS, Reactions
from .loads import JointDamping, JointFriction, Load, Sampled
from .model import Mechanism
from .system.processes import cached_property

EARTH = (0.0, 0.0, -9.81)
CHOICES = {"formalism": FORMALISMS, "frame": FRAMES, "part": PARTS}


@dataclass(frozen=True, eq=False)
class Scene:
    """A robot with what acts on it.

    gravity: acceleration (3,) [m/s²] in the ground's frame. loads: see `robodyn.loads`. declared: add what the URDF declares
    by <dynamics>: damping and friction of its joints.

    Every method takes one state or any number in leading dimensions: q (..., nq), v, tau and a (..., nv); and
    backend: "native" (compiled at first use), "numpy" (the readable reference) or "mpmath" (50 digits, slow). NumPy also answers for
    robots of more than 100 bodies or freedoms by "nonrecursive": their kernels would take minutes to compile. Of robots with mimic joints
    and more than 50 bodies or freedoms, "auto" solves for accelerations by LAPACK, on the mass matrix that kernels find;
    threads: how many share a large batch; all cores if not given, 1 for none; and
    dtype: np.float64, or np.float32 for kernels with twice the lanes and answers in float32. Arrays of other types are converted. Angles,
    positions and pivots then carry 7 digits; backend="numpy" rounds the arrays and its float64 answer to float32.
    out, where there is one: a C-contiguous array of the result's shape and dtype to write it into, as in NumPy. Fresh memory costs time
    in large batches. Its contents are undefined after an error.
    Raises InputError for an argument of the wrong shape or value, ModelError where the motion is undetermined.
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

    def _answered(self, t: float, q: object, v: object, backend: str) -> Array | None:
        """What the sampled controllers answer at time t and states q, v: (..., nv); None where there are none."""
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

    def _supplied(self, t: float, q: object, v: object, tau: object, backend: str) -> object:
        """tau, and what the sampled controllers add to it."""
        answered = self._answered(t, q, v, backend)
        if answered is None or tau is None:
            return tau if answered is None else answered
        arrays = inputs.checked(self.robot, {"tau": tau, "v": answered})
        return arrays["tau"] + arrays["v"]

    def _plain(self, t: float, backend: str, dtype: object) -> bool:
        """Whether a call asks for nothing but what a built-in function answers."""
        return t == 0.0 and backend == DEFAULT and dtype is np.float64 and not self.sampled

    def equations(self, backend: str = "numpy", *, opened: bool = False) -> Equations:
        """The scene's equations in one arithmetic: links on fixed joints lumped, or `opened` at every joint to show its reaction."""
        views = self.evaluator.views(backend)
        return views.opened if opened else views.lumped

    def __getstate__(self) -> dict[str, object]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)

    # --- how it moves ---

    def forward_dynamics(
        self,
        q,
        v,
        tau=None,
        *,
        t: float = 0.0,
        formalism: str = "auto",
        backend: str = DEFAULT,
        threads: int | None = None,
        dtype: DTypeLike = np.float64,
        out: Array | None = None,
    ) -> Array:
        """η̇ (..., nv) [rad/s², m/s²] under the joint forces tau (..., nv) [N m, N], none if not given, and the loads at time t [s].

        formalism: "recursive", "nonrecursive", "saddle_joint" or "saddle_body", the routes of M̂ η̇ = k̂ and eqs. (18), (19); "auto" takes
        the cheaper of the first two, counted in operations and in values that wait for long. The saddle-point routes are oracles and
        always run on NumPy.
        """
        question, t = questions.ForwardDynamics(inputs.choice("formalism", formalism, FORMALISMS)), inputs.number("t", t)
        if formalism == "auto" and self._plain(t, backend, dtype):
            self.evaluator.hasten(self, Scene.forward_dynamics, question)
        tau = self._supplied(t, q, v, tau, backend)
        return self.evaluator.ask(question, backend, t=t, threads=threads, dtype=dtype, out=out, q=q, v=v, tau=tau)["vdot"]

    # --- what it takes and carries ---

    def inverse_dynamics(
        self,
        q,
        v,
        a,
        *,
        t: float = 0.0,
        backend: str = DEFAULT,
        threads: int | None = None,
        dtype: DTypeLike = np.float64,
        out: Array | None = None,
    ) -> Array:
        """tau (..., nv) [N m, N] that the joints must supply, beside the loads, for the acceleration a (..., nv)."""
        question, t = questions.InverseDynamics(), inputs.number("t", t)
        if self._plain(t, backend, dtype):
            self.evaluator.hasten(self, Scene.inverse_dynamics, question)
        tau = self.evaluator.ask(question, backend, t=t, threads=threads, dtype=dtype, out=out, q=q, v=v, a=a)["tau"]
        if (answered := self._answered(t, q, v, backend)) is not None:
            tau[...] = tau - answered
        return tau

    def bias_forces(
        self,
        q,
        v,
        *,
        t: float = 0.0,
        backend: str = DEFAULT,
        threads: int | None = None,
        dtype: DTypeLike = np.float64,
        out: Array | None = None,
    ) -> Array:
        """−k̂ᶜ − k̂ᵗ (..., nv): `inverse_dynamics` at a = 0; gravity, Coriolis and centrifugal forces, loads."""
        return self.inverse_dynamics(q, v, None, t=t, backend=backend, threads=threads, dtype=dtype, out=out)

    def mass_matrix(
        self, q, *, backend: str = DEFAULT, threads: int | None = None, dtype: DTypeLike = np.float64, out: Array | None = None
    ) -> Array:
        """M̂ = JᵀMJ (..., nv, nv)."""
        return self.evaluator.ask(questions.MassMatrix(), backend, threads=threads, dtype=dtype, out=out, q=q)["M"]

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
        backend: str = DEFAULT,
        threads: int | None = None,
        dtype: DTypeLike = np.float64,
        out: Array | None = None,
    ) -> Reactions:
        """The wrench [M, F] (..., 6) [N m, N] on each joint's child link, from its parent, about the joint's origin.

        frame: resolved in the "child" link, the "parent" link or the "world". part: "constraint" is f̌ᵖ, which does no work on
        the free motion; "total" adds what actuator, damping, spring and friction transmit along the free axes.
        joints: names, all of them if not given: `ground`, fixed and mimic joints included. out: becomes the `array` of the result.
        """
        names, question = self._about(questions.JointReactions, joints, formalism=formalism, frame=frame, part=part)
        t = inputs.number("t", t)
        tau = self._supplied(t, q, v, tau, backend)
        wrenches = self.evaluator.ask(question, backend, t=t, threads=threads, dtype=dtype, out=out, q=q, v=v, tau=tau)["wrenches"]
        return Reactions(names, wrenches, frame, part)

    def reactions_of(
        self, q, v, a, u, *, t: float | Array = 0.0, frame: str = "child", part: str = "constraint", joints: Iterable[str] | None = None
    ) -> Reactions:
        """The same at known accelerations a (..., nv) and joints' own forces u (..., nu), as a `Trajectory` holds them."""
        names, question = self._about(questions.KnownReactions, joints, frame=frame, part=part)
        if not np.isfinite(t).all():
            raise InputError(f"t={t} must be finite")
        wrenches = self.evaluator.ask(question, t=t, q=q, v=v, a=a, u=u)["wrenches"]
        return Reactions(names, wrenches, frame, part)

    @cached_property
    def _questions(self) -> dict[tuple, questions.Question]:
        return {}

    def _about(
        self, kind: type[questions.Question], joints: Iterable[str] | None, **options: str
    ) -> tuple[tuple[str, ...], questions.Question]:
        """The names of joints, and the question of a kind about them, put together once."""
        if isinstance(joints, str):
            raise InputError(f"joints={joints!r} must be a list of names: joints=[{joints!r}]")
        names = self.robot.all_joint_names if joints is None else tuple(joints)
        key = kind, names, *(inputs.choice(name, value, CHOICES[name]) for name, value in options.items())
        if key not in self._questions:
            self._questions[key] = kind(joints=tuple(map(self.robot.joint_index, names)), **options)  # type: ignore[call-arg]
        return names, self._questions[key]

    # --- energies, places ---

    def kinetic_energy(self, q, v, *, backend: str = DEFAULT, threads: int | None = None, dtype: DTypeLike = np.float64) -> Array:
        """½ v̌ᵀ M v̌ (...) [J]."""
        return self.evaluator.ask(questions.Energies(), backend, threads=threads, dtype=dtype, q=q, v=v)["kinetic"][()]

    def potential_energy(
        self, q, *, t: float = 0.0, backend: str = DEFAULT, threads: int | None = None, dtype: DTypeLike = np.float64
    ) -> Array:
        """Potential energy (...) [J] of gravity, zero with the centre of mass in the ground's origin, and of springs."""
        return self.evaluator.ask(questions.Energies(), backend, t=inputs.number("t", t), threads=threads, dtype=dtype, q=q, v=None)[
            "potential"
        ][()]

    def momentum(
        self, q, v, *, backend: str = DEFAULT, threads: int | None = None, dtype: DTypeLike = np.float64, out: Array | None = None
    ) -> Array:
        """Angular momentum about the ground's origin [N m s] and linear momentum [N s] (..., 6), in the ground's frame."""
        return self.evaluator.ask(questions.Momentum(), backend, threads=threads, dtype=dtype, out=out, q=q, v=v)["momentum"]

    def link_poses(
        self, q, *, backend: str = DEFAULT, threads: int | None = None, dtype: DTypeLike = np.float64, out: Array | None = None
    ) -> Array:
        """The pose (..., nlinks, 4, 4) of every link's frame in the ground's, in the order of `robot.link_names`."""
        return self.evaluator.ask(questions.LinkPoses(), backend, threads=threads, dtype=dtype, out=out, q=q)["poses"]
