"""SciPy's solvers as integrators, with their error control and their interpolants."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...arithmetic import Array
from ...engine.emit.tableau import Tableau
from .contract import Integrator, Outcome, Problem, Step


class Memory(NamedTuple):
    """A solver of SciPy's, which moves on in place; the state that it is to go on from, and the step due [s]."""

    solver: Any
    x: Array
    h: float | None


@dataclass(frozen=True, eq=False)
class ScipySolver(Integrator):
    """`scipy.integrate.<name>`."""

    name: str
    coefficients: Callable[[Any], Tableau] | None = None  # of SciPy's class: native code makes the same steps
    multistep: bool = False  # starts with small steps of low order: the step of an earlier span is of no use to it

    @property
    def native(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether there are coefficients."""
        return self.coefficients is not None

    def tableau(self) -> Tableau:
        assert self.coefficients is not None
        return self.coefficients(self._solver)

    @property
    def _solver(self) -> Any:
        import scipy.integrate  # takes a while: only for those who use it

        return getattr(scipy.integrate, self.name)

    def init(self, problem: Problem, t: float, x: Array, first_step: float | None = None) -> Memory:
        h, t_end = None if self.multistep else first_step, problem.t_end
        settings = {"rtol": problem.rtol, "atol": problem.atol, "first_step": h and min(h, t_end - t)}
        return Memory(self._solver(problem.f, t, x, t_end, **settings), x, h)

    def step(self, problem: Problem, memory: Memory) -> tuple[Step, Memory]:
        solver, x, h = memory
        explicit = hasattr(solver, "f") and hasattr(solver, "A")  # Runge-Kutta: no memory beyond the last derivative
        if explicit and not np.array_equal(x, solver.y):
            solver.y, solver.f = x, problem.f(solver.t, x)
        message, interpolant = solver.step(), None

        def between(times: Array) -> Array:
            nonlocal interpolant
            interpolant = interpolant or solver.dense_output()  # may cost evaluations: only where it is asked for
            return interpolant(np.asarray(times)).T

        t = float(solver.t)
        if solver.status == "failed":
            return Step(t, t, x, between, outcome=Outcome.STEP_TOO_SMALL, reason=message), memory
        x = problem.project(solver.y)
        if not self.multistep:  # the end of the span may have cut the last step short
            h = max(h or 0.0, float(solver.h_abs)) if t == problem.t_end else float(solver.h_abs)
        return Step(float(solver.t_old), t, x, between, h), Memory(solver, x, h)
