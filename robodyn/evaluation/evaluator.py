"""How a question is answered: by the formalism itself on float64 or 50-digit numbers, or by a kernel traced from it.

With `looped` and `shortcuts` the only place that knows both questions and engine.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from ..arithmetic import Array, precision
from ..checks import inputs
from ..checks.motion import refuse_impossible, refuse_infinite, refuse_infinite_loads, refuse_massless, refuse_undetermined, smallest_pivots
from ..dynamics.equations import SADDLES, SWEEPS, Views
from ..dynamics.questions import Answer, Evolution, ForwardDynamics, JointReactions, MassMatrix, Question
from ..engine.run.kernel import DOUBLE, Kernel
from ..engine.trace.graph import Graph
from ..engine.trace.layout import Looped
from ..engine.trace.program import Program, program
from ..engine.trace.sweeps import Recorder
from ..errors import InputError, ModelError
from ..loads import Load, State
from ..model import Mechanism
from ..system.processes import cached_property, lock, without_collections
from . import composed, remembered
from .laws import Unchanged
from .looped import LoopedViews
from .shortcuts import Shortcuts

UNROLLED = 50  # moving bodies and freedoms up to which a kernel is straight-line code: beyond, that takes seconds to compile
WRITTEN_OUT = 100  # up to which "nonrecursive", which has no loops, is compiled all the same; beyond, NumPy answers
BACKENDS = ("native", "numpy", "mpmath")
DEFAULT = "native" if find_spec("llvmlite") else "numpy"
_NOW, _ZERO = 0.0, np.zeros(1)  # the time where none is given


class Evaluator:
    """Answers questions about one robot under one gravity and its loads."""

    def __init__(self, robot: Mechanism, gravity: Array, loads: tuple[Load, ...]) -> None:
        self.robot, self._gravity = robot, gravity
        # Kernels are traced on the float64 equations: their constants are float64.
        self._views = {backend: Views(robot, gravity, loads, backend) for backend in BACKENDS}
        self._kernels: dict[tuple[Question, np.dtype], Kernel] = {}
        self.step_loops: dict[tuple, Any] = {}  # compiled integrators, by what `simulation.native` compiles them for
        self._spare: dict[Question, Program | Looped] = {}
        self._shortcuts, self._lock = Shortcuts(robot), lock()

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
        dtype: DTypeLike = np.float64,
        out: Array | None = None,
        **arrays: object,
    ) -> dict[str, Array]:
        """The arrays of the answer, with the leading dimensions that the given arrays have together; None stands for zeros.

        out: where the one array of the answer goes; of the dtype, C-contiguous, of its shape, apart from the given arrays.
        """
        if backend == "native" and dtype is np.float64 and type(t) is float and t == 0.0:
            quick = self._shortcuts.answer(question, self._kernels.get((question, DOUBLE)), threads, out, arrays)
            if quick is not None:
                return quick
        inputs.choice("backend", backend, BACKENDS)
        precise = inputs.precision(dtype, backend)
        inputs.thread_count(threads)
        formalism = getattr(question, "formalism", None)
        natively = backend == "native" and self.compiles(formalism)
        if natively and isinstance(question, MassMatrix) and self.loops:
            return self._written({"M": composed.mass_matrix(self, question, threads, precise, arrays)}, out, arrays)
        if natively:
            answer = self._natively(question, t, threads, precise, out, arrays)
            if answer is not None:
                return answer
        if backend == "native" and formalism == "auto" and self.composes:
            _ = self._possible
            answer = composed.answer(self, question, t, threads, precise, arrays)
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
        batch, quick = inputs.quick(self.robot, arrays)
        try:
            kernel = self.kernel(question, dtype)
        except ZeroDivisionError:  # a pivot is zero whatever the state
            return None
        shapes = question.shapes(self.robot)
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

    @cached_property
    def unloaded(self) -> "Evaluator":
        """That of the robot alone, without gravity and loads."""
        return Evaluator(self.robot, np.zeros(3), ())

    def checked(
        self, question: Question, arrays: Mapping[str, object], dtype: np.dtype = DOUBLE, *, objects: bool = False
    ) -> dict[str, Array]:
        """The arrays of a question as `inputs.checked` has them; rounded to float32 where that is asked for, and still float64."""
        found = inputs.checked(self.robot, arrays, objects=objects)
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
        if hasattr(question, "formalism"):
            refuse_impossible(self.robot, self.views().lumped.tree)
        with precision(backend), np.errstate(all="ignore"):
            try:
                answer = question.answer(views, t, **checked)
            except (np.linalg.LinAlgError, ZeroDivisionError):
                self._refuse_loads(t, arrays)
                refuse_massless(self.robot, views.lumped.tree)
                if getattr(question, "formalism", "") in SADDLES:  # does not know which joint it is; the minimal form does
                    self._directly(replace(question, formalism="nonrecursive"), backend, t, arrays)  # type: ignore[call-arg]
                if backend == "mpmath":  # float64 arithmetic does not raise: it comes to where the joint is named
                    self._directly(question, "numpy", t, {name: np.asarray(x, dtype=float) for name, x in checked.items()})
                raise ModelError(f"the equations of robot {self.robot.name!r} are singular at this state") from None
            values = answer.values if dtype == DOUBLE else {name: np.asarray(x).astype(dtype) for name, x in answer.values.items()}
        batch, shapes = next(iter(checked.values())).shape[:-1], question.shapes(self.robot)
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
            checked = inputs.checked(self.robot, {name: arrays[name] for name in ("q", "v")}, objects=True)
            q, v = (x.astype(float) for x in checked.values())
            with np.errstate(all="ignore"):
                refuse_infinite_loads(equations.loads, State(self.robot, equations.tree, t, q, v))

    def hasten(self, owner: object, method: FunctionType, question: Question) -> None:
        """From now on, answer an object's plain calls of a method by a built-in function, see `Shortcuts.hasten`."""
        if DEFAULT != "native" or not self.compiles(getattr(question, "formalism", None)):
            return
        try:
            self._shortcuts.hasten(owner, method, question, partial(self.kernel, question))
        except ZeroDivisionError:  # a pivot is zero whatever the state: the method itself says which
            return

    # --- kernels ---

    def kernel(self, question: Question, dtype: np.dtype = DOUBLE) -> Kernel:
        """The question's kernel in float64 or float32; traced at first use."""
        key = question, dtype
        if key not in self._kernels:
            with self._lock:
                if key not in self._kernels:
                    if hasattr(question, "formalism"):
                        refuse_impossible(self.robot, self.views().lumped.tree)
                    self.unchanged.confirm(question.loaded, compiling=True)
                    decided = self._decided(question)
                    spare = self._spare.pop(decided, None) if dtype == DOUBLE else None
                    self._kernels[key] = Kernel(spare or self._traced(decided, dtype), dtype)
        return self._kernels[key]

    @cached_property
    def unchanged(self) -> Unchanged:
        """The loads' code, as kernels were compiled from it."""
        return Unchanged(self.robot, self.views().lumped.tree, self.views().lumped.loads, large=self.loops)

    def _decided(self, question: Question) -> Question:
        """The question with "auto" replaced by the cheapest formalism."""
        if getattr(question, "formalism", "") != "auto":
            return question
        # Where wrenches are asked for as well, what both share counts too.
        return replace(question, formalism=self._cheapest(question) if isinstance(question, JointReactions) else self.cheapest)  # type: ignore[call-arg]

    @cached_property
    def operations(self) -> dict[str, int]:
        """Floating-point operations of forward dynamics by each formalism that is compiled for this scene."""
        return self._compared(ForwardDynamics("auto"))[1]

    def operations_with(self, *, reduce: bool) -> int | None:
        """Those of "nonrecursive" with base inertial parameters, or on the bodies as they are; None where it is not compiled."""
        if "nonrecursive" not in self._routes:
            return None
        return self._traced(ForwardDynamics("nonrecursive"), views=self.views_with(reduce=reduce)).operations

    def views_with(self, *, reduce: bool) -> Views:
        """The equations to trace, with base inertial parameters or without, whatever those cost."""
        return Views(self.robot, self._gravity, self.views().lumped.loads, "native", reduce=reduce)

    @cached_property
    def cheapest(self) -> str:
        """The formalism that is cheapest for forward dynamics of this scene."""
        return self._cheapest(ForwardDynamics("auto"))

    def _cheapest(self, question: Question) -> str:
        """The formalism that is cheapest for a question."""
        if len(self._routes) == 1:
            return self._routes[0]
        what = question, self._gravity, self.views().lumped.loads
        return remembered.choice(self.robot, what, self._routes, lambda: self._compared(question)[0])

    def _compared(self, question: Question) -> tuple[str, dict[str, int]]:
        """The cheapest formalism for a question, and the operations of each."""
        asked = {route: replace(question, formalism=route) for route in self._routes}  # type: ignore[call-arg]
        programs = {route: self._traced(x) for route, x in asked.items()}
        operations = {route: x.operations for route, x in programs.items()}
        best, least = "", math.inf
        for route in sorted(operations, key=lambda route: operations[route]):
            if operations[route] < least and (cost := programs[route].cost) < least:  # operations alone may be too many already
                best, least = route, cost
        self._spare[asked[best]] = programs[best]  # whoever counts is about to compile it
        return best, operations

    @property
    def _routes(self) -> list[str]:
        return ["nonrecursive"] if self.views().lumped.tree.has_mimic else ["recursive"] if self.loops else list(SWEEPS)

    @cached_property
    def loops(self) -> bool:
        """Whether kernels loop over the bodies: there are too many to write out."""
        tree = self.views().lumped.tree
        return max(len(tree.bodies), tree.nv) > UNROLLED

    @cached_property
    def composes(self) -> bool:
        """Whether accelerations come from kernels of M̂ and k̂ instead of one of their own: no loop eliminates shared coordinates (mimic)."""
        return self.loops and self.views().lumped.tree.has_mimic

    def compiles(self, formalism: str | None) -> bool:
        """Whether a kernel answers for this route: in loops, or written out where that compiles in reasonable time; None: needs no route.

        The saddle-point routes are oracles: they choose pivots, which no kernel can.
        """
        if formalism in SADDLES or (formalism == "auto" and self.composes):
            return False
        tree = self.views().lumped.tree
        looped = self.loops and (formalism is None or not (tree.has_mimic or formalism == "nonrecursive"))
        return looped or max(len(tree.bodies), tree.nv) <= WRITTEN_OUT

    def compiles_steps(self, formalism: str) -> bool:
        """Whether an integrator's loop is compiled. Written out, it is worth a longer wait than the answer to a question."""
        return self.compiles("nonrecursive" if formalism == "auto" and self.composes else formalism)

    def _symbolic(self, looped: bool) -> tuple[Graph | Recorder, Views]:
        """What records operations on symbols, and the equations to trace on it."""
        if not looped:
            return Graph(), self.views("native")
        recorder = Recorder()
        return recorder, LoopedViews(self.views(), recorder)

    @without_collections
    def _traced(self, question: Question, dtype: np.dtype = DOUBLE, *, views: Views | None = None) -> Program | Looped:
        """The question, asked of symbols; of other equations than the backend's where they are given."""
        graph, own = self._symbolic(self.loops and getattr(question, "formalism", "recursive") == "recursive")
        views = views or own
        sizes = {name: inputs.size(self.robot, name) for name in question.needs} | {"t": 1}
        arrays = {name: graph.inputs(name, (n,)) for name, n in sizes.items()}
        t = arrays.pop("t")[0]
        with np.errstate(all="ignore"):  # a constant pivot of zero becomes a guard that fails
            answer = question.answer(views, t, **arrays)
        guards = guards_of(self.robot, views, answer, arrays.get("q") if question.admissible else None, dtype)
        values = {name: np.asarray(x) for name, x in answer.values.items()}
        return finished(graph, sizes, values, guards)

    # --- integration ---

    @without_collections
    def evolution(self, formalism: str, *, semi_implicit: bool = False, held: bool = False) -> Program | Looped:
        """dx = ẋ of x = (β, η, w) at ("t", 1), ("x", nq + nv + 1).

        semi_implicit: β̇ belongs to the velocity after a step of ("h", 1), so that Euler's explicit step becomes the semi-implicit one.
        held: joint forces ("held", nv) act beside the loads.
        """
        refuse_impossible(self.robot, self.views().lumped.tree)
        self.unchanged.confirm(compiling=True)
        formalism = self.cheapest if formalism == "auto" else formalism
        (graph, views), nq, nv = self._symbolic(self.loops and formalism == "recursive"), self.robot.nq, self.robot.nv
        sizes = {"t": 1, "x": nq + nv + 1} | ({"h": 1} if semi_implicit else {}) | ({"held": nv} if held else {})
        arrays = {name: graph.inputs(name, (n,)) for name, n in sizes.items()}
        q, v, tau = arrays["x"][:nq], arrays["x"][nq : nq + nv], arrays.get("held", np.zeros(nv))
        with np.errstate(all="ignore"):  # as in `_traced`
            answer = Evolution(formalism).answer(views, arrays["t"][0], q, v, tau)
        qdot, vdot, power = (np.asarray(answer.values[name]) for name in ("qdot", "vdot", "power"))
        if semi_implicit:
            qdot = views.lumped.rate(q, v + vdot * arrays["h"])
        dx = np.concatenate([qdot, vdot, power.reshape(1)])
        return finished(graph, sizes, {"dx": dx}, guards_of(self.robot, views, answer, None))

    def projection(self) -> Program | Looped | None:
        """x with its Euler parameters at unit length; None where there are none."""
        if not self.views().lumped.tree.rated:
            return None
        (graph, views), nq, nv = self._symbolic(self.loops), self.robot.nq, self.robot.nv
        x = graph.inputs("x", (nq + nv + 1,))
        return finished(graph, {"x": len(x)}, {"x": np.concatenate([views.lumped.project(x[:nq]), x[nq:]])}, [])


def finished(graph: Graph | Recorder, sizes: Mapping[str, int], outputs: Mapping[str, Array], guards: list[object]) -> Program | Looped:
    """The program of what was traced or recorded."""
    return graph.finish(sizes, outputs, guards) if isinstance(graph, Recorder) else program(graph, sizes, outputs, guards, optional=("t",))


def guards_of(robot: Mechanism, views: Views, answer: Answer, q: Array | None, dtype: np.dtype = DOUBLE) -> list[object]:
    """What must be positive for an answer to be trusted: pivots above rounding, quaternions near unit length."""
    guards: list[object] = []
    if q is not None:
        guards += [inputs.UNIT_TOLERANCE - abs(phi) for _, phi in views.lumped.side_conditions(q)]
    if answer.solution is not None:
        smallest = smallest_pivots(views.lumped.tree, answer.solution, float(np.finfo(dtype).eps))
        guards += [pivot - least for pivot, least in zip(answer.solution.pivots, smallest, strict=True)]
    return [guard[()] if isinstance(guard, np.ndarray) else guard for guard in guards]
