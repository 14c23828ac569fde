"""Every question that can be asked of a robot at given states, with its signature and its explanation, once: for `Scene` and `Robot`.

Options that questions share are typed keywords (PEP 692): a type checker knows each, and `explained` shows them whole to `help`.
"""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from textwrap import fill
from typing import Any, Protocol, TypedDict, TypeVar, Unpack, cast, get_args

import numpy as np
from numpy.typing import DTypeLike

from ..arithmetic import Array
from ..checks import inputs
from ..dynamics import questions
from ..dynamics.equations import FORMALISMS
from ..formalism.reactions import FRAMES, PARTS, Reactions
from .evaluator import DEFAULT, Evaluator

EARTH = (0.0, 0.0, -9.81)
CHOICES = {"formalism": FORMALISMS, "frame": FRAMES, "part": PARTS}


# --- options ----------------------------------------------------------------------------------------------------------


class Computed(TypedDict, total=False):
    """When, and how an answer is computed."""

    t: float
    backend: str
    threads: int | None
    dtype: DTypeLike


class Written(Computed, total=False):
    """And where its one array goes."""

    out: Array | None


class Acting(TypedDict, total=False):
    """What acts beside loads."""

    gravity: Array | Sequence[float]


class Potential(Acting, Computed, total=False):
    """Options of potential energy."""


class Dynamic(Acting, Written, total=False):
    """Options of equations of motion."""


class Solved(Dynamic, total=False):
    """And by which formalism they are solved."""

    formalism: str


class Reacting(Solved, total=False):
    """And which wrenches are wanted, in which frame."""

    frame: str
    part: str
    joints: Iterable[str] | None


# What arguments mean.
ARGUMENTS = {
    "q": "joint coordinates (..., nq) [rad, m]: one state, or any number in leading dimensions, as in all arrays here.",
    "v": "joint velocities (..., nv) [rad/s, m/s], at rest if None.",
    "tau": "joint forces (..., nv) [N m, N], none if not given.",
    "a": "joint accelerations (..., nv) [rad/s², m/s²], zero if None.",
}
# Each option's default and meaning, in the order in which signatures show them.
OPTIONS: dict[str, tuple[object, str]] = {
    "gravity": (EARTH, "acceleration (3,) [m/s²] in the ground's frame. For a `Robot` only: a `Scene` has its own."),
    "t": (0.0, "time [s], for loads and joints that depend on it."),
    "frame": ("child", 'wrenches are resolved in the "child" link, the "parent" link or the "world".'),
    "part": (
        "constraint",
        '"constraint" is f̌ᵖ, which does no work on the free motion; "total" adds what actuator, damping, spring and friction '
        "transmit along the free axes.",
    ),
    "joints": (None, "names of the joints that are asked for; all if not given: `ground`, fixed and mimic joints included."),
    "formalism": (
        "auto",
        '"recursive" and "nonrecursive" are two routes of M̂ η̇ = k̂; "auto" takes the cheaper, counted in operations and in values that '
        'wait for long; on NumPy, by how deep the tree is. "saddle_joint" and "saddle_body", eqs. (18) and (19), are oracles and always '
        'run on NumPy. So does "nonrecursive" '
        "for robots of more than 100 bodies or freedoms: their kernels would take minutes to compile. Of robots with mimic joints and more "
        'than 50 bodies or freedoms, "auto" solves for accelerations by LAPACK, on the mass matrix that kernels find.',
    ),
    "backend": (DEFAULT, '"native" (compiled at first use), "numpy" (the readable reference) or "mpmath" (50 digits, slow).'),
    "threads": (None, "how many share a large batch: all cores if not given, 1 for none beside the caller's."),
    "dtype": (
        np.float64,
        "np.float64, or np.float32 for kernels with twice the lanes and answers in float32. Arrays of other types are converted. "
        'Angles, positions and pivots then carry 7 digits; backend="numpy" rounds the arrays and its float64 answer to float32.',
    ),
    "out": (
        None,
        "a C-contiguous array of the result's shape and dtype to write it into, as in NumPy. Fresh memory costs time in large batches. "
        "Its contents are undefined after an error.",
    ),
}
ERRORS = (
    "InputError for an argument of the wrong shape or value, ModelError where the motion is undetermined or the answer is not finite, "
    "TypeError for an option that the method does not have."
)

Method = TypeVar("Method", bound=Callable[..., Any])
_known: dict[str, list[str]] = {}  # a method's name → its options
_PLAIN = frozenset({"t", "backend", "threads", "out"})  # options that a built-in function may stand in for


def explained(method: Method) -> Method:
    """The same method; its options stand one by one in its signature, and all that it takes is explained in its docstring."""
    signature = inspect.signature(method)
    *arguments, collected = signature.parameters.values()
    names = _known[method.__name__] = [name for name in OPTIONS if name in get_args(collected.annotation)[0].__optional_keys__]
    options = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=OPTIONS[name][0]) for name in names]
    method.__signature__ = signature.replace(parameters=[*arguments, *options])  # type: ignore[attr-defined]
    meanings = {x.name: ARGUMENTS[x.name] for x in arguments[1:]} | {name: OPTIONS[name][1] for name in names}
    lines = (fill(f"{name}: {meaning}", 100, subsequent_indent="    ") for name, meaning in meanings.items())
    method.__doc__ = "\n\n".join([inspect.cleandoc(method.__doc__ or ""), "\n".join(lines), fill(ERRORS, 100)])
    return method


# --- questions --------------------------------------------------------------------------------------------------------


class Modelled(Protocol):
    """What answers: a robot with what acts on it."""

    @property
    def evaluator(self) -> Evaluator:
        """The equations and their kernels."""
        ...

    @property
    def sampled(self) -> Sequence[object]:
        """Digital controllers, which are no part of the equations."""
        ...

    def answered(self, t: float, q: object, v: object, backend: str) -> Array | None:
        """What the digital controllers answer: (..., nv); None where there are none."""
        ...

    def about(
        self, kind: type[questions.Question], joints: Iterable[str] | None, **options: str
    ) -> tuple[tuple[str, ...], questions.Question]:
        """The names of joints, and the question of a kind about them."""
        ...


class Asking(ABC):
    """What can be asked at given states.

    Every method takes one state or any number in leading dimensions: q (..., nq), v, tau and a (..., nv).
    """

    @abstractmethod
    def _modelled(self, options: dict[str, Any]) -> Modelled:
        """What answers under these options; takes gravity out of them."""

    def _asked(self, method: str, given: object) -> tuple[Modelled, dict[str, Any]]:
        """What answers a method's call, and the options that are left for the evaluator. TypeError for an option it does not have."""
        options = cast(dict[str, Any], given)
        for name in options:
            if name not in _known[method]:
                known = ", ".join(_known[method])
                raise TypeError(f"{type(self).__name__}.{method}() got an unexpected keyword argument {name!r}: it takes {known}")
        if "t" in options:
            options["t"] = inputs.number("t", options["t"])
        return self._modelled(options), options

    def _hasten(self, modelled: Modelled, method: Any, question: questions.Question, given: Mapping[str, Any]) -> None:
        """Answer plain calls by a built-in function from now on, where this one asked for nothing but what that answers."""
        plain = given.keys() <= _PLAIN and given.get("t", 0.0) == 0.0 and given.get("backend", DEFAULT) == DEFAULT
        if plain and not modelled.sampled and modelled is self._modelled({}):
            modelled.evaluator.hasten(self, method, question)

    # --- how it moves ---

    @explained
    def forward_dynamics(self, q, v, tau=None, **options: Unpack[Solved]) -> Array:
        """η̇ (..., nv) [rad/s², m/s²], the solution of M̂ η̇ = k̂: the acceleration under the joint forces tau and the loads at time t."""
        modelled, rest = self._asked("forward_dynamics", options)
        question = questions.ForwardDynamics(inputs.choice("formalism", rest.pop("formalism", "auto"), FORMALISMS))
        if question.formalism == "auto":
            self._hasten(modelled, Asking.forward_dynamics, question, rest)
        tau = _supplied(modelled, q, v, tau, rest)
        return modelled.evaluator.ask(question, q=q, v=v, tau=tau, **rest)["vdot"]

    # --- what it takes and carries ---

    @explained
    def inverse_dynamics(self, q, v, a, **options: Unpack[Dynamic]) -> Array:
        """tau (..., nv) [N m, N] that the joints must supply, beside the loads at time t, for the acceleration a."""
        modelled, rest = self._asked("inverse_dynamics", options)
        self._hasten(modelled, Asking.inverse_dynamics, questions.InverseDynamics(), rest)
        return _required(modelled, q, v, a, rest)

    @explained
    def bias_forces(self, q, v, **options: Unpack[Dynamic]) -> Array:
        """−k̂ᶜ − k̂ᵗ (..., nv) [N m, N]: `inverse_dynamics` at a = 0; gravity, Coriolis and centrifugal forces, loads."""
        modelled, rest = self._asked("bias_forces", options)
        return _required(modelled, q, v, None, rest)

    @explained
    def mass_matrix(self, q, **options: Unpack[Written]) -> Array:
        """M̂ = JᵀMJ (..., nv, nv) [kg m², kg m, kg]."""
        modelled, rest = self._asked("mass_matrix", options)
        return modelled.evaluator.ask(questions.MassMatrix(), q=q, **rest)["M"]

    @explained
    def reactions(self, q, v, tau=None, **options: Unpack[Reacting]) -> Reactions:
        """The wrench [M, F] (..., 6) [N m, N] on each joint's child link, from its parent, about the joint's origin.

        By the joint's name: `robot.reactions(q, v)["elbow_joint"]`. `out` becomes the `array` (..., njoints, 6) of the result.
        """
        modelled, rest = self._asked("reactions", options)
        frame, part = rest.pop("frame", "child"), rest.pop("part", "constraint")
        formalism = rest.pop("formalism", "auto")
        names, question = modelled.about(questions.JointReactions, rest.pop("joints", None), formalism=formalism, frame=frame, part=part)
        tau = _supplied(modelled, q, v, tau, rest)
        return Reactions(names, modelled.evaluator.ask(question, q=q, v=v, tau=tau, **rest)["wrenches"], frame, part)

    # --- energies, places ---

    @explained
    def kinetic_energy(self, q, v, **options: Unpack[Computed]) -> Array:
        """½ v̌ᵀ M v̌ (...) [J]."""
        modelled, rest = self._asked("kinetic_energy", options)
        return modelled.evaluator.ask(questions.Energies(), q=q, v=v, **rest)["kinetic"][()]

    @explained
    def potential_energy(self, q, **options: Unpack[Potential]) -> Array:
        """Potential energy (...) [J] of gravity, zero with the centre of mass in the ground's origin, and of springs."""
        modelled, rest = self._asked("potential_energy", options)
        return modelled.evaluator.ask(questions.Energies(), q=q, v=None, **rest)["potential"][()]

    @explained
    def momentum(self, q, v, **options: Unpack[Written]) -> Array:
        """Angular momentum about the ground's origin [N m s] and linear momentum [N s] (..., 6), in the ground's frame."""
        modelled, rest = self._asked("momentum", options)
        return modelled.evaluator.ask(questions.Momentum(), q=q, v=v, **rest)["momentum"]

    @explained
    def link_poses(self, q, **options: Unpack[Written]) -> Array:
        """The pose (..., nlinks, 4, 4) of every link's frame in the ground's [1, m], in the order of the robot's `link_names`."""
        modelled, rest = self._asked("link_poses", options)
        return modelled.evaluator.ask(questions.LinkPoses(), q=q, **rest)["poses"]


def _sampled(modelled: Modelled, q: object, v: object, options: Mapping[str, Any]) -> Array | None:
    """What the digital controllers answer to a question with these options: (..., nv); None where there are none."""
    return modelled.answered(options.get("t", 0.0), q, v, options.get("backend", DEFAULT)) if modelled.sampled else None


def _supplied(modelled: Modelled, q: object, v: object, tau: object, options: Mapping[str, Any]) -> object:
    """tau, and what the digital controllers add to it."""
    answered = _sampled(modelled, q, v, options)
    if answered is None or tau is None:
        return tau if answered is None else answered
    # Both are (..., nv): checked under the names that have this shape.
    arrays = inputs.checked(modelled.evaluator.robot, {"tau": tau, "v": answered})
    return arrays["tau"] + arrays["v"]


def _required(modelled: Modelled, q: object, v: object, a: object, options: Mapping[str, Any]) -> Array:
    """tau (..., nv) for the acceleration a (..., nv), less what the digital controllers supply."""
    tau = modelled.evaluator.ask(questions.InverseDynamics(), q=q, v=v, a=a, **options)["tau"]
    answered = _sampled(modelled, q, v, options)
    if answered is not None:
        tau[...] = tau - answered
    return tau
