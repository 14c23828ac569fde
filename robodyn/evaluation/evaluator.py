"""Who answers a question: a kernel traced from it, or the formalism itself on float64 or 50-digit numbers."""

from collections.abc import Mapping
from functools import partial
from importlib.util import find_spec
from types import FunctionType

import numpy as np
from numpy.typing import DTypeLike

from ..arithmetic import Array, precision
from ..checks import inputs
from ..checks.motion import refuse_impossible, refuse_infinite, refuse_infinite_loads, refuse_massless, refuse_undetermined
from ..dynamics.equations import SADDLES
from ..dynamics.questions import MassMatrix, Question, Solved
from ..dynamics.state_vector import StateVector
from ..dynamics.views import Views
from ..engine.run.kernel import DOUBLE, Kernel
from ..errors import InputError, ModelError
from ..loads import Load
from ..model import Mechanism
from ..system.processes import cached_property, lock
from .base_parameters import reduced
from .composed import Composed
from .integrator_programs import IntegratorPrograms
from .laws import Unchanged
from .routes import Routes
from .shortcuts import Shortcuts
from .tracing import Tracing

BACKENDS = ("native", "numpy", "mpmath")
DEFAULT = "native" if find_spec("llvmlite") else "numpy"
_NOW, _ZERO = 0.0, np.zeros(1)  # the time where none is given


class Evaluator:
    """Answers questions about one robot under one gravity and its loads."""

    def __init__(self, robot: Mechanism, gravity: Array, loads: tuple[Load, ...]) -> None:
        self.robot = robot
        self._views = {backend: Views(robot, gravity, loads, backend) for backend in ("numpy", "mpmath")}
        # Kernels are traced on float64 equations, whose constants they take; there, operations count.
        self._traced = Views(robot, gravity, loads, "native", fewest=partial(reduced, robot))
        self._kernels: dict[tuple[Question, np.dtype], Kernel] = {}
        self._shortcuts, self._lock = Shortcuts(robot), lock()

    def views(self, backend: str = "numpy") -> Views:
        """The equations of a backend, "numpy" or "mpmath"."""
        return self._views[backend]

    # --- who does what ---

    @cached_property
    def tracing(self) -> Tracing:
        """Questions to programs."""
        return Tracing(self.robot, self._traced, self.views())

    @cached_property
    def routes(self) -> Routes:
        """Which formalism, and what is compiled of it."""
        return Routes(self.views().lumped, self.tracing)

    @cached_property
    def unchanged(self) -> Unchanged:
        """The loads' code, as kernels were compiled from it."""
        lumped = self.views().lumped
        return Unchanged(self.robot, lumped.tree, lumped.loads, large=self.routes.loops)

    @cached_property
    def integrators(self) -> IntegratorPrograms:
        """What native integrators call."""
        return IntegratorPrograms(self.state_vector, self.tracing, self.routes, self.unchanged)

    @cached_property
    def _composed(self) -> Composed:
        unloaded = Evaluator(self.robot, np.zeros(3), ())
        return Composed(self.views().lumped.tree, self.ask, unloaded.ask)

    # --- the state ---

    @cached_property
    def initial_state(self) -> Array:
        """z (nz,): the loads' own states at the start of a motion."""
        return self.views().lumped.initial_state

    @cached_property
    def state_vector(self) -> StateVector:
        """Where the parts of x stand."""
        return StateVector(self.robot.nq, self.robot.nv, len(self.initial_state))

    def start(self, q: Array, v: Array) -> Array:
        """x (..., size) where a motion starts: at q (..., nq), its Euler parameters brought to unit length, and v (..., nv)."""
        return self.state_vector.join(self.views().lumped.project(q), v, self.initial_state, 0.0)

    # --- asking ---

    def ask(
        self,
        question: Question,
        backend: str = DEFAULT,
        *,
        t: Array | float = _NOW,
        threads: int | None = None,
        dtype: DTypeLike = np.float64,
        out: Array | None = None,
        **arrays: object,
    ) -> dict[str, Array]:
        """The arrays of the answer, with the leading dimensions that the given arrays have together.

        arrays: what the question needs, by name; None stands for zeros. z (..., nz): the loads' own states, initial where not given.
        out: where the one array of the answer goes; of the dtype, C-contiguous, of its shape, apart from the given arrays.
        InputError for an argument that cannot be; ModelError where there is no answer to be trusted.
        """
        if not (self.state_vector.nz and question.loaded):
            arrays.pop("z", None)
        elif arrays.get("z") is None:
            arrays["z"] = self.initial_state
        if "z" not in arrays and backend == "native" and dtype is np.float64 and type(t) is float and t == 0.0:
            quick = self._shortcuts.answer(question, self._kernels.get((question, DOUBLE)), threads, out, arrays)
            if quick is not None:
                return quick
        inputs.choice("backend", backend, BACKENDS)
        precise = inputs.precision(dtype, backend)
        inputs.thread_count(threads)
        formalism = question.formalism if isinstance(question, Solved) else None
        natively = backend == "native" and self.routes.compiles(formalism)
        if natively and isinstance(question, MassMatrix) and self.routes.loops:
            M = self._composed.mass_matrix(self.checked(question, arrays)["q"], t, threads, precise)
            return self._written({"M": M}, out, arrays)
        if natively:
            answer = self._natively(question, t, threads, precise, out, arrays)
            if answer is not None:
                return answer
        if backend == "native" and isinstance(question, Solved) and formalism == "auto" and self.routes.composes:
            _ = self._possible
            checked = self.checked(question, arrays, precise)
            answer = self._composed.answer(question, self._shapes(question), t, threads, precise, checked)
            if answer is not None:
                return self._written(answer, out, arrays)
        # The readable reference; and what names the cause where a kernel found that something is wrong.
        answer = self._directly(question, "mpmath" if backend == "mpmath" else "numpy", t, arrays, precise)
        if natively and precise == np.float32:
            raise ModelError(
                f"float32 cannot hold what the answer for robot {self.robot.name!r} takes: a number on the way is too large, or a pivot is "
                "lost in rounding. Leave dtype out: float64 can"
            )
        return self._written(answer, out, arrays)

    def _shapes(self, question: Question) -> dict[str, tuple[int, ...]]:
        return question.shapes(self.robot, self.state_vector.nz)

    def _written(self, answer: dict[str, Array], out: Array | None, arrays: Mapping[str, object]) -> dict[str, Array]:
        """The answer, its one array moved to `out` where that is given."""
        if out is None:
            return answer
        ((name, values),) = answer.items()
        if values.dtype == object:
            raise InputError("out is an array of floats and cannot hold the digits of backend='mpmath': leave it out")
        inputs.target(out, values.shape, arrays, values.dtype)[...] = values
        return {name: out}

    def _natively(
        self,
        question: Question,
        t: Array | float,
        threads: int | None,
        dtype: np.dtype,
        out: Array | None,
        arrays: Mapping[str, object],
    ) -> dict[str, Array] | None:
        """The kernel's answer; None where it is not to be trusted."""
        batch, quick = inputs.quick(self.robot, arrays, self.state_vector.nz)
        try:
            kernel = self.kernel(question, dtype)
        except ZeroDivisionError:  # a pivot is zero whatever the state
            return None
        shapes = self._shapes(question)
        given = {name: inputs.target(out, batch + shape, quick, dtype) for name, shape in shapes.items()} if out is not None else {}
        values, bad = kernel(batch, {**quick, "t": _ZERO if t is _NOW else np.asarray(t, dtype=float)[..., None]}, threads, given)
        if bad >= 0:
            return None
        if out is not None:
            return given
        return {name: x.reshape(batch + shapes[name]) for name, x in values.items()}

    @cached_property
    def _possible(self) -> bool:
        refuse_impossible(self.robot, self.views().lumped.tree)
        return True

    def checked(
        self, question: Question, arrays: Mapping[str, object], dtype: np.dtype = DOUBLE, *, objects: bool = False
    ) -> dict[str, Array]:
        """The arrays of a question as `inputs.checked` has them; rounded to float32 where that is asked for, and still float64."""
        found = inputs.checked(self.robot, arrays, nz=self.state_vector.nz, objects=objects)
        if dtype != DOUBLE:
            found = {name: inputs.rounded(name, x, dtype) for name, x in found.items()}
        if "q" in found and question.admissible:
            inputs.unit_quaternions("q", self.views().lumped.side_conditions(found["q"]))
        return found

    def _directly(
        self, question: Question, backend: str, t: Array | float, arrays: Mapping[str, object], dtype: np.dtype = DOUBLE
    ) -> dict[str, Array]:
        """The formalism's own answer: for float32, on arrays rounded to it, computed in float64 and rounded at the end."""
        views = self.views(backend)
        checked = self.checked(question, arrays, dtype, objects=backend == "mpmath")
        if backend == "mpmath":
            checked = {name: inputs.as_exact(x) for name, x in checked.items()}
        if isinstance(question, Solved):
            refuse_impossible(self.robot, self.views().lumped.tree)
        with precision(backend), np.errstate(all="ignore"):
            try:
                answer = self.routes.decided_on_arrays(question).answer(views, t, **checked)
            except (np.linalg.LinAlgError, ZeroDivisionError):
                self._refuse_loads(t, arrays)
                refuse_massless(self.robot, views.lumped.tree)
                if isinstance(question, Solved) and question.formalism in SADDLES:  # which do not know the joint; the minimal form does
                    self._directly(question.by("nonrecursive"), backend, t, arrays)
                if backend == "mpmath":  # float64 arithmetic does not raise: it comes to where the joint is named
                    self._directly(question, "numpy", t, {name: np.asarray(x, dtype=float) for name, x in checked.items()})
                raise ModelError(f"the equations of robot {self.robot.name!r} are singular at this state") from None
            values = answer.values if dtype == DOUBLE else {name: np.asarray(x).astype(dtype) for name, x in answer.values.items()}
        batch, shapes = next(iter(checked.values())).shape[:-1], self._shapes(question)
        try:
            if answer.solution is not None:
                refuse_undetermined(self.robot, self.views().lumped.tree, answer.solution, float(np.finfo(dtype).eps))
            refuse_infinite(values, shapes)
        except ModelError:
            self._refuse_loads(t, arrays)
            raise
        return {name: np.array(np.broadcast_to(x, batch + shapes[name])) for name, x in values.items()}

    def _refuse_loads(self, t: Array | float, arrays: Mapping[str, object]) -> None:
        """ModelError where it is a load that is not finite."""
        equations = self.views().lumped
        if "v" in arrays and equations.loads:
            given = {name: arrays[name] for name in ("q", "v", "z") if name in arrays}
            checked = inputs.checked(self.robot, given, nz=self.state_vector.nz, objects=True)
            with np.errstate(all="ignore"):
                state = equations.state(t, *(x.astype(float) for x in checked.values()))
                refuse_infinite_loads(equations.seen(state), state)

    def hasten(self, owner: object, method: FunctionType, question: Question) -> None:
        """From now on, answer an object's plain calls of a method by a built-in function, see `Shortcuts.hasten`."""
        formalism = question.formalism if isinstance(question, Solved) else None
        if DEFAULT != "native" or self.state_vector.nz or not self.routes.compiles(formalism):
            return
        try:
            self._shortcuts.hasten(owner, method, question, partial(self.kernel, question))
        except ZeroDivisionError:  # a pivot is zero whatever the state: the method itself says which
            return

    def kernel(self, question: Question, dtype: np.dtype = DOUBLE) -> Kernel:
        """The question's kernel in float64 or float32; traced at first use."""
        key = question, dtype
        if key not in self._kernels:
            with self._lock:
                if key not in self._kernels:
                    if isinstance(question, Solved):
                        refuse_impossible(self.robot, self.views().lumped.tree)
                    self.unchanged.confirm(question.loaded, compiling=True)
                    self._kernels[key] = Kernel(self.routes.program(self.routes.decided(question), dtype), dtype)
        return self._kernels[key]
