"""Which formalism "auto" stands for, and what is compiled of each: written out, in loops, or not at all."""

import math
from collections.abc import Callable

import numpy as np

from ..dynamics.equations import SADDLES, SWEEPS, Equations
from ..dynamics.questions import ForwardDynamics, JointReactions, Question, Solved
from ..dynamics.views import Views
from ..engine.run.kernel import DOUBLE
from ..engine.trace.layout import Looped
from ..engine.trace.program import Program
from ..model import Minimal, Tree, minimal
from ..system.processes import cached_property
from . import remembered
from .tracing import Tracing

UNROLLED = 50  # moving bodies and freedoms up to which a kernel is straight-line code: beyond, that takes seconds to compile
WRITTEN_OUT = 100  # up to which "nonrecursive", which has no loops, is compiled all the same; beyond, NumPy answers


class Routes:
    """The routes of one robot under one gravity and its loads."""

    def __init__(self, equations: Equations, tracing: Tracing) -> None:
        """equations: those of the lumped links."""
        self._equations, self._tree, self._tracing = equations, equations.tree, tracing
        self._spare: dict[Question, Program | Looped] = {}

    # --- what is compiled ---

    @cached_property
    def loops(self) -> bool:
        """Whether kernels loop over the bodies: there are too many to write out."""
        return max(len(self._tree.bodies), self._tree.nv) > UNROLLED

    @cached_property
    def composes(self) -> bool:
        """Whether accelerations come from kernels of M̂ and k̂ instead of one of their own: no loop eliminates shared coordinates (mimic)."""
        return self.loops and self._tree.has_mimic

    @property
    def names(self) -> list[str]:
        """The formalisms that are compiled for this robot, one of which "auto" stands for."""
        return ["nonrecursive"] if self._tree.has_mimic else ["recursive"] if self.loops else list(SWEEPS)

    def compiles(self, formalism: str | None) -> bool:
        """Whether a kernel answers for this route: in loops, or written out where that compiles in reasonable time; None: needs no route.

        The saddle-point routes are oracles: they choose pivots, which no kernel can.
        """
        if formalism in SADDLES or (formalism == "auto" and self.composes):
            return False
        looped = self.loops and (formalism is None or not (self._tree.has_mimic or formalism == "nonrecursive"))
        return looped or max(len(self._tree.bodies), self._tree.nv) <= WRITTEN_OUT

    def compiles_steps(self, formalism: str) -> bool:
        """Whether an integrator's loop is compiled. Written out, it is worth a longer wait than the answer to a question."""
        return self.compiles("nonrecursive" if formalism == "auto" and self.composes else formalism)

    def program(self, question: Question, dtype: np.dtype = DOUBLE, *, views: Views | None = None) -> Program | Looped:
        """The program of a question, which no longer says "auto"; one that was made to be compared is used once."""
        if dtype == DOUBLE and views is None and question in self._spare:
            return self._spare.pop(question)
        return self._tracing.program(question, dtype, looped=self.looped(question), views=views)

    def looped(self, question: Question) -> bool:
        """Whether a question's kernel loops over the bodies."""
        return self.loops and (not isinstance(question, Solved) or question.formalism == "recursive")

    # --- what "auto" stands for ---

    def decided(self, question: Question) -> Question:
        """The question with "auto" replaced by the formalism that is cheapest for a kernel."""
        if not isinstance(question, Solved) or question.formalism != "auto":
            return question
        # Where wrenches are asked for as well, what both share counts too.
        return question.by(self._cheapest(question) if isinstance(question, JointReactions) else self.cheapest)

    def decided_on_arrays(self, question: Question) -> Question:
        """The same for NumPy, whose cost per call decides: one sweep per body against one entry per pair of bodies."""
        if not isinstance(question, Solved) or question.formalism != "auto":
            return question
        depth = [0]
        for body in self._tree.bodies:
            depth.append(depth[body.parent + 1] + 1)
        return question.by("nonrecursive" if self._tree.has_mimic or sum(depth) <= 8 * len(self._tree.bodies) else "recursive")

    @cached_property
    def cheapest(self) -> str:
        """The formalism that is cheapest for forward dynamics in a kernel."""
        return self._cheapest(ForwardDynamics("auto"))

    @cached_property
    def operations(self) -> dict[str, int]:
        """Floating-point operations of forward dynamics by each formalism that is compiled for this scene."""
        return self.compared(ForwardDynamics("auto"))[1]

    def operations_with(self, *, reduce: bool) -> int | None:
        """Those of "nonrecursive" with base inertial parameters, or on the bodies as they are; None where it is not compiled."""
        if "nonrecursive" not in self.names:
            return None
        return self.program(ForwardDynamics("nonrecursive"), views=self.views_with(reduce=reduce)).operations

    def views_with(self, *, reduce: bool) -> Views:
        """The equations to trace, with base inertial parameters or without, whatever those cost."""
        fewest: Callable[[Tree], Minimal | None] = minimal if reduce else lambda tree: None
        equations = self._equations
        return Views(equations.mechanism, equations.gravity, equations.loads, "native", fewest=fewest)

    def _cheapest(self, question: Solved) -> str:
        if len(self.names) == 1:
            return self.names[0]
        what = question, self._equations.gravity, self._equations.loads
        return remembered.choice(self._equations.mechanism, what, self.names, lambda: self.compared(question)[0])

    def compared(self, question: Solved) -> tuple[str, dict[str, int]]:
        """The cheapest formalism for a question, and the operations of each."""
        asked = {route: question.by(route) for route in self.names}
        programs = {route: self.program(x) for route, x in asked.items()}
        operations = {route: x.operations for route, x in programs.items()}
        best, least = "", math.inf
        for route in sorted(operations, key=lambda route: operations[route]):
            if operations[route] < least and (cost := programs[route].cost) < least:  # operations alone may be too many already
                best, least = route, cost
        self._spare[asked[best]] = programs[best]  # whoever counts is about to compile it
        return best, operations
