"""SciPy's solvers, one accepted step at a time."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..arithmetic import Array
from ..errors import SimulationError
from .step import Projection, RightHandSide, Step


def scipy_steps(name: str, *, multistep: bool = False) -> Callable[..., Iterator[Step]]:
    """Steps of `scipy.integrate.<name>`, with its error control and its interpolant.

    multistep: it starts with small steps of low order, so that the step of an earlier span is of no use to it.
    """

    def steps(
        f: RightHandSide,
        t0: float,
        x0: Array,
        t_end: float,
        project: Projection,
        *,
        rtol: float,
        atol: float,
        first_step: float | None = None,
        **_: object,
    ) -> Iterator[Step]:
        import scipy.integrate

        h = None if multistep else first_step
        solver: Any = getattr(scipy.integrate, name)(f, t0, x0, t_end, rtol=rtol, atol=atol, first_step=h and min(h, t_end - t0))
        explicit = hasattr(solver, "f") and hasattr(solver, "A")  # Runge-Kutta: no memory beyond the last derivative
        while solver.status == "running":
            message = solver.step()
            if solver.status == "failed":
                raise SimulationError(too_small(solver.t, message))
            interpolant = None

            def between(times: Array) -> Array:
                nonlocal interpolant
                interpolant = interpolant or solver.dense_output()  # may cost evaluations: only where it is asked for
                return interpolant(np.asarray(times)).T

            x = project(solver.y)
            if not multistep:  # the end of the span may have cut the last step short
                h = max(h or 0.0, float(solver.h_abs)) if solver.t == t_end else float(solver.h_abs)
            yield Step(float(solver.t_old), float(solver.t), x, between, h)
            if explicit and not np.array_equal(x, solver.y):
                solver.y, solver.f = x, f(solver.t, x)

    return steps


def too_small(t: float, reason: str | None = None) -> str:
    """What is said when the step size went to zero."""
    return (
        f"the step size went to zero at t={t:.9g} s{f' ({reason})' if reason else ''}: the motion is too stiff or has a jump there. "
        "Loosen rtol or atol, soften the load, or use method='radau' or 'rk4' with a small dt"
    )
