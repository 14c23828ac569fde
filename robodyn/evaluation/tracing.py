"""From a question to a program: it is asked of symbols, and what it does with them is recorded."""

from collections.abc import Mapping

import numpy as np

from ..arithmetic import Array
from ..checks import inputs
from ..checks.motion import smallest_pivots
from ..dynamics.questions import Answer, Question
from ..dynamics.views import Views
from ..engine.run.kernel import DOUBLE
from ..engine.trace.graph import Graph
from ..engine.trace.layout import Looped
from ..engine.trace.program import Program, program
from ..engine.trace.sweeps import Recorder
from ..model import Mechanism
from ..system.processes import without_collections
from .looped import LoopedViews


class Tracing:
    """The programs of one robot under one gravity and its loads."""

    def __init__(self, robot: Mechanism, written_out: Views, looping: Views) -> None:
        """written_out, looping: the float64 equations that straight-line code and loops are traced on."""
        self.robot, self._written_out, self._looping = robot, written_out, looping

    def symbolic(self, *, looped: bool) -> tuple[Graph | Recorder, Views]:
        """What records operations on symbols, and the equations to trace on it."""
        if not looped:
            return Graph(), self._written_out
        recorder = Recorder()
        return recorder, LoopedViews(self._looping, recorder)

    @without_collections
    def program(
        self, question: Question, dtype: np.dtype = DOUBLE, *, looped: bool = False, views: Views | None = None
    ) -> Program | Looped:
        """The question, asked of symbols; of other equations than its own where they are given. dtype: what its guards are to hold in."""
        graph, own = self.symbolic(looped=looped)
        views = views or own
        nz = len(views.lumped.initial_state) if question.loaded else 0
        sizes = {name: inputs.size(self.robot, name) for name in question.needs} | ({"z": nz} if nz else {}) | {"t": 1}
        arrays = {name: graph.inputs(name, (n,)) for name, n in sizes.items()}
        t = arrays.pop("t")[0]
        with np.errstate(all="ignore"):  # a constant pivot of zero becomes a guard that fails
            answer = question.answer(views, t, **arrays)
        guards = self.guards(views, answer, arrays.get("q") if question.admissible else None, dtype)
        return finished(graph, sizes, {name: np.asarray(x) for name, x in answer.values.items()}, guards)

    def guards(self, views: Views, answer: Answer, q: Array | None, dtype: np.dtype = DOUBLE) -> list[object]:
        """What must be positive for an answer to be trusted: pivots above rounding, quaternions near unit length."""
        guards: list[object] = []
        if q is not None:
            guards += [inputs.UNIT_TOLERANCE - abs(phi) for _, phi in views.lumped.side_conditions(q)]
        if answer.solution is not None:
            smallest = smallest_pivots(views.lumped.tree, answer.solution, float(np.finfo(dtype).eps))
            guards += [pivot - least for pivot, least in zip(answer.solution.pivots, smallest, strict=True)]
        return [guard[()] if isinstance(guard, np.ndarray) else guard for guard in guards]


def finished(graph: Graph | Recorder, sizes: Mapping[str, int], outputs: Mapping[str, Array], guards: list[object]) -> Program | Looped:
    """The program of what was traced or recorded."""
    return graph.finish(sizes, outputs, guards) if isinstance(graph, Recorder) else program(graph, sizes, outputs, guards, optional=("t",))
