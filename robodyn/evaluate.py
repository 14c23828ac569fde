"""How a question is answered: by the formalism itself on float64 or 50-digit numbers, or by a kernel traced from it.

The only place that knows both the equations and the engine.
"""

import threading
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from importlib.util import find_spec

import numpy as np

from . import inputs
from .arithmetic import Array, precision
from .engine.graph import Graph
from .engine.kernel import Kernel
from .engine.program import Program, program
from .equations import SADDLES, SWEEPS, Views
from .errors import InputError, ModelError
from .loads import Load
from .model import Mechanism
from .questions import Answer, Evolution, ForwardDynamics, JointReactions, Question
from .trust import margin, refuse_impossible, refuse_infinite, refuse_massless, refuse_undetermined

BACKENDS = ("native", "numpy", "mpmath")
DEFAULT = "native" if find_spec("llvmlite") else "numpy"


_NOW, _ZERO = 0.0, np.zeros(1)  # the time where none is given


class Evaluator:
    """Answers questions about one robot under one gravity and its loads."""

    def __init__(self, robot: Mechanism, gravity: Array, loads: tuple[Load, ...]) -> None:
        self.robot = robot
        # Kernels are traced on the float64 equations: their constants are float64.
        self._views = {backend: Views(robot, gravity, loads, backend) for backend in BACKENDS}
        self._kernels: dict[Question, Kernel] = {}
        self._lock = threading.Lock()

    def views(self, backend: str = "numpy") -> Views:
        """The equations of a backend."""
        return self._views[backend]

    def ask(
        self,
        question: Question,
        backend: str = DEFAULT,
        *,
        t: Array | float = _NOW,
        threads: int | None = None,
        out: Array | None = None,
        **arrays: object,
    ) -> dict[str, Array]:
        """The arrays of the answer, with the leading dimensions that the given arrays have together; None stands for zeros.

        out: where the one array of the answer goes; float64, C-contiguous, of its shape, apart from the given arrays.
        """
        inputs.choice("backend", backend, BACKENDS)
        if threads is not None and (not isinstance(threads, int) or threads < 1):
            raise InputError(f"threads={threads!r} must be a whole number of at least 1, or None for all cores")
        # The saddle-point routes are oracles: they choose pivots, which no kernel can.
        if backend == "native" and getattr(question, "formalism", "") not in SADDLES:
            answer = self._natively(question, t, threads, out, arrays)
            if answer is not None:
                return answer
        # The readable reference; and what names the cause where a kernel found that something is wrong.
        answer = self._directly(question, "mpmath" if backend == "mpmath" else "numpy", t, arrays)
        if out is not None:
            ((name, values),) = answer.items()
            if values.dtype == object:
                raise InputError("out is of float64 and cannot hold the digits of backend='mpmath': leave it out")
            inputs.target(out, values.shape, arrays)[...] = values
            answer = {name: out}
        return answer

    def _natively(
        self, question: Question, t: Array | float, threads: int | None, out: Array | None, arrays: Mapping[str, object]
    ) -> dict[str, Array] | None:
        """The kernel's answer; None where it is not to be trusted."""
        batch, quick = inputs.quick(self.robot, arrays)
        try:
            kernel = self.kernel(question)
        except ZeroDivisionError:  # a pivot is zero whatever the state
            return None
        shapes = question.shapes(self.robot)
        given = {name: inputs.target(out, batch + shape, quick) for name, shape in shapes.items()} if out is not None else {}
        values, bad = kernel(batch, {**quick, "t": _ZERO if t is _NOW else np.asarray(t, dtype=float)[..., None]}, threads, given)
        if bad >= 0:
            return None
        if out is not None:
            return given
        return {name: x.reshape(batch + shapes[name]) for name, x in values.items()}

    def _directly(self, question: Question, backend: str, t: Array | float, arrays: Mapping[str, object]) -> dict[str, Array]:
        views = self.views(backend)
        checked = inputs.checked(self.robot, arrays, objects=backend == "mpmath")
        if "q" in checked and question.admissible:
            inputs.unit_quaternions(self.views().lumped.side_conditions(checked["q"]))
        if backend == "mpmath":
            checked = {name: inputs.as_exact(x) for name, x in checked.items()}
        if hasattr(question, "formalism"):
            refuse_impossible(self.robot, self.views().lumped.tree)
        with precision(backend), np.errstate(all="ignore"):
            try:
                answer = question.answer(views, t, **checked)
            except (np.linalg.LinAlgError, ZeroDivisionError):
                refuse_massless(self.robot, views.lumped.tree)
                if getattr(question, "formalism", "") in SADDLES:  # does not know which joint it is; the minimal form does
                    self._directly(replace(question, formalism="nonrecursive"), backend, t, arrays)  # type: ignore[call-arg]
                raise ModelError(f"the equations of robot {self.robot.name!r} are singular at this state") from None
        if answer.solution is not None:
            refuse_undetermined(self.robot, self.views().lumped.tree, answer.solution)
        refuse_infinite(answer.values)
        batch, shapes = next(iter(checked.values())).shape[:-1], question.shapes(self.robot)
        return {name: np.array(np.broadcast_to(x, batch + shapes[name])) for name, x in answer.values.items()}

    # --- kernels ---

    def kernel(self, question: Question) -> Kernel:
        """The question's kernel; traced at first use."""
        if question not in self._kernels:
            with self._lock:
                if question not in self._kernels:
                    if hasattr(question, "formalism"):
                        refuse_impossible(self.robot, self.views().lumped.tree)
                    self._kernels[question] = Kernel(self._traced(self._decided(question)))
        return self._kernels[question]

    def _decided(self, question: Question) -> Question:
        """The question with "auto" replaced by the formalism of the fewest operations."""
        if getattr(question, "formalism", "") != "auto":
            return question
        # Where wrenches are asked for as well, what both share counts too.
        counts = self._counted(question) if isinstance(question, JointReactions) else self.operations
        return replace(question, formalism=_cheapest(counts))  # type: ignore[call-arg]

    @cached_property
    def operations(self) -> dict[str, int]:
        """Floating-point operations of forward dynamics by each formalism that can be traced."""
        return self._counted(ForwardDynamics("auto"))

    def _counted(self, question: Question) -> dict[str, int]:
        routes = ["nonrecursive"] if self.views().lumped.tree.has_mimic else list(SWEEPS)
        return {route: self._traced(replace(question, formalism=route)).operations for route in routes}  # type: ignore[call-arg]

    @cached_property
    def cheapest(self) -> str:
        """The formalism of the fewest operations for forward dynamics of this scene."""
        return _cheapest(self.operations)

    def _traced(self, question: Question) -> Program:
        """The question, asked of symbols."""
        graph = Graph()
        sizes = {name: inputs.size(self.robot, name) for name in question.needs} | {"t": 1}
        arrays = {name: graph.inputs(name, (n,)) for name, n in sizes.items()}
        t = arrays.pop("t")[0]
        with np.errstate(all="ignore"):  # a constant pivot of zero becomes a guard that fails
            answer = question.answer(self.views("native"), t, **arrays)
        guards = guards_of(self.robot, self.views(), answer, arrays.get("q") if question.admissible else None)
        values = {name: np.asarray(x) for name, x in answer.values.items()}
        return program(graph, sizes, values, guards)

    # --- integration ---

    def evolution(self, formalism: str, *, semi_implicit: bool = False) -> Program:
        """dx = ẋ of x = (β, η, w) at ("t", 1), ("x", nq + nv + 1).

        semi_implicit: β̇ belongs to the velocity after a step of ("h", 1), so that Euler's explicit step becomes the semi-implicit one.
        """
        refuse_impossible(self.robot, self.views().lumped.tree)
        graph, nq, nv = Graph(), self.robot.nq, self.robot.nv
        sizes = {"t": 1, "x": nq + nv + 1} | ({"h": 1} if semi_implicit else {})
        arrays = {name: graph.inputs(name, (n,)) for name, n in sizes.items()}
        q, v = arrays["x"][:nq], arrays["x"][nq : nq + nv]
        answer = Evolution(self.cheapest if formalism == "auto" else formalism).answer(
            self.views("native"), arrays["t"][0], q, v, np.zeros(nv)
        )
        qdot, vdot, power = (np.asarray(answer.values[name]) for name in ("qdot", "vdot", "power"))
        if semi_implicit:
            qdot = self.views().lumped.rate(q, v + vdot * arrays["h"])
        dx = np.concatenate([qdot, vdot, power.reshape(1)])
        return program(graph, sizes, {"dx": dx}, guards_of(self.robot, self.views(), answer, None))

    def projection(self) -> Program | None:
        """x with its Euler parameters at unit length; None where there are none."""
        equations, graph, nq, nv = self.views().lumped, Graph(), self.robot.nq, self.robot.nv
        if not equations.side_conditions(self.robot.neutral()):
            return None
        x = graph.inputs("x", (nq + nv + 1,))
        return program(graph, {"x": len(x)}, {"x": np.concatenate([equations.project(x[:nq]), x[nq:]])})


def _cheapest(operations: Mapping[str, int]) -> str:
    return min(operations, key=lambda route: operations[route])


def guards_of(robot: Mechanism, views: Views, answer: Answer, q: Array | None) -> list[object]:
    """What must be positive for an answer to be trusted: pivots above rounding, quaternions near unit length."""
    guards: list[object] = []
    if q is not None:
        guards += [inputs.UNIT_TOLERANCE - abs(phi) for _, phi in views.lumped.side_conditions(q)]
    if answer.solution is not None:
        scales = margin(robot.nv) * views.lumped.tree.pivot_scales
        guards += [pivot - scale for pivot, scale in zip(answer.solution.pivots, scales, strict=True)]
    return [guard[()] if isinstance(guard, np.ndarray) else guard for guard in guards]
