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
    """How an answer is computed."""

    backend: str
    threads: int | None
    dtype: DTypeLike


class Written(Computed, total=False):
    """And where its one array goes."""

    out: Array | None


class Acting(TypedDict, total=False):
    """What acts: gravity, and loads at a time."""

    gravity: Array | Sequence[float]
    t: float


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


# Each option's default and explanation, in the order in which signatures show them.
OPTIONS: dict[str, tuple[object, str]] = {
    "gravity": (EARTH, "acceleration (3,) [m/s²] in the ground's frame; of a `Robot` alone, a `Scene` has its own."),
    "t": (0.0, "time [s], for loads that depend on it."),
    "frame": ("child", 'wrenches are resolved in the "child" link, the "parent" link or the "world".'),
    "part": (
        "constraint",
        '"constraint" is f̌ᵖ, which does no work on the free motion; "total" adds what actuator, damping, spring and friction '
        "transmit along the free axes.",
    ),
    "joints": (None, "names, all of them if not given: `ground`, fixed and mimic joints included."),
    "formalism": (
        "auto",
        '"recursive", "nonrecursive", "saddle_joint" or "saddle_body", the routes of M̂ η̇ = k̂ and eqs. (18), (19); "auto" takes the '
        "cheaper of the first two, counted in operations and in values that wait for long. The saddle-point routes are oracles and "
        'always run on NumPy. NumPy also answers for robots of more than 100 bodies or freedoms by "nonrecursive": their kernels would '
        'take minutes to compile. Of robots with mimic joints and more than 50 bodies or freedoms, "auto" solves for accelerations by '
        "LAPACK, on the mass matrix that kernels find.",
    ),
    "backend": (DEFAULT, '"native" (compiled at first use), "numpy" (the readable reference) or "mpmath" (50 digits, slow).'),
    "threads": (None, "how many share a large batch; all cores if not given, 1 for none."),
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
ERRORS = """Raises InputError for an argument of the wrong shape or value, ModelError where the motion is undetermined or the answer is
not finite, TypeError for an option that the method does not have."""

Method = TypeVar("Method", bound=Callable[..., Any])
_known: dict[str, frozenset[str]] = {}  # a method's name → its options
_PLAIN = frozenset({"threads", "out"})  # options that built-in functions take


def explained(method: Method) -> Method:
    """The same method; its options stand one by one in its signature, and explained in its docstring."""
    signature = inspect.signature(method)
    *arguments, collected = signature.parameters.values()
    types = get_args(collected.annotation)[0].__annotations__
    options = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=types[name])
        for name, (default, _) in OPTIONS.items()
        if name in types
    ]
    _known[method.__name__] = frozenset(types)
    method.__signature__ = signature.replace(parameters=[*arguments, *options])  # type: ignore[attr-defined]
    lines = (fill(f"{option.name}: {OPTIONS[option.name][1]}", 100, subsequent_indent="    ") for option in options)
    method.__doc__ = "\n\n".join([inspect.cleandoc(method.__doc__ or ""), "\n".join(lines), ERRORS])
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
        if options:
            if not options.keys() <= _known[method]:
                self._refuse(method, options)
            if "t" in options:
                options["t"] = inputs.number("t", options["t"])
        return self._modelled(options), options

    def _refuse(self, method: str, options: Mapping[str, Any]) -> None:
        known = [name for name in OPTIONS if name in _known[method]]
        wrong = next(name for name in options if name not in known)
        raise TypeError(f"{type(self).__name__}.{method}() got an unexpected keyword argument {wrong!r}: it takes {', '.join(known)}")

    def _hasten(self, modelled: Modelled, method: Any, question: questions.Question, given: Mapping[str, Any]) -> None:
        """Answer plain calls by a built-in function from now on, where nothing but what it answers was asked for."""
        if given.keys() <= _PLAIN and not modelled.sampled:
            modelled.evaluator.hasten(self, method, question)

    # --- how it moves ---

    @explained
    def forward_dynamics(self, q, v, tau=None, **options: Unpack[Solved]) -> Array:
        """η̇ (..., nv) [rad/s², m/s²] under the joint forces tau (..., nv) [N m, N], none if not given, and the loads at time t.

        The solution of M̂ η̇ = k̂.
        """
        elsewhere = "gravity" in options
        modelled, rest = self._asked("forward_dynamics", options)
        question = questions.ForwardDynamics(inputs.choice("formalism", rest.pop("formalism", "auto"), FORMALISMS))
        if question.formalism == "auto" and not elsewhere:
            self._hasten(modelled, Asking.forward_dynamics, question, rest)
        tau = _supplied(modelled, q, v, tau, rest)
        return modelled.evaluator.ask(question, q=q, v=v, tau=tau, **rest)["vdot"]

    # --- what it takes and carries ---

    @explained
    def inverse_dynamics(self, q, v, a, **options: Unpack[Dynamic]) -> Array:
        """tau (..., nv) [N m, N] that the joints must supply, beside the loads, for the acceleration a (..., nv) [rad/s², m/s²]."""
        elsewhere = "gravity" in options
        modelled, rest = self._asked("inverse_dynamics", options)
        question = questions.InverseDynamics()
        if not elsewhere:
            self._hasten(modelled, Asking.inverse_dynamics, question, rest)
        tau = modelled.evaluator.ask(question, q=q, v=v, a=a, **rest)["tau"]
        if modelled.sampled and (answered := modelled.answered(rest.get("t", 0.0), q, v, rest.get("backend", DEFAULT))) is not None:
            tau[...] = tau - answered
        return tau

    @explained
    def bias_forces(self, q, v, **options: Unpack[Dynamic]) -> Array:
        """−k̂ᶜ − k̂ᵗ (..., nv) [N m, N]: `inverse_dynamics` at a = 0; gravity, Coriolis and centrifugal forces, loads."""
        if not options.keys() <= _known["bias_forces"]:
            self._refuse("bias_forces", cast(dict[str, Any], options))
        # Of the class: a built-in function that stands before it takes no a that is not given.
        return type(self).inverse_dynamics(self, q, v, None, **options)

    @explained
    def mass_matrix(self, q, **options: Unpack[Written]) -> Array:
        """M̂ = JᵀMJ (..., nv, nv) [kg m², kg m, kg]."""
        modelled, rest = self._asked("mass_matrix", options)
        return modelled.evaluator.ask(questions.MassMatrix(), q=q, **rest)["M"]

    @explained
    def reactions(self, q, v, tau=None, **options: Unpack[Reacting]) -> Reactions:
        """The wrench [M, F] (..., 6) [N m, N] on each joint's child link, from its parent, about the joint's origin.

        tau: joint forces (..., nv) [N m, N], none if not given. `out` becomes the `array` of the result.
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


def _supplied(modelled: Modelled, q: object, v: object, tau: object, options: Mapping[str, Any]) -> object:
    """tau, and what the digital controllers add to it."""
    if not modelled.sampled:
        return tau
    answered = modelled.answered(options.get("t", 0.0), q, v, options.get("backend", DEFAULT))
    if answered is None or tau is None:
        return tau if answered is None else answered
    # Both are (..., nv): checked under the names that have this shape.
    arrays = inputs.checked(modelled.evaluator.robot, {"tau": tau, "v": answered})
    return arrays["tau"] + arrays["v"]
