"""Dormand and Prince's method of order 8 with error control, by SciPy. Hairer, Nørsett, Wanner, Solving ODEs I, section II.5."""

from collections.abc import Iterator

import numpy as np
from scipy.integrate import DOP853

from ..arithmetic import Array
from ..errors import SimulationError
from .step import Projection, RightHandSide, Step


def dop853(
    f: RightHandSide, t0: float, x0: Array, t_end: float, project: Projection, *, rtol: float, atol: float, **_: object
) -> Iterator[Step]:
    """Steps whose estimated error stays within atol + rtol |x|; the method's own interpolant, of order 7, in between."""
    solver = DOP853(f, t0, x0, t_end, rtol=rtol, atol=atol)
    while solver.status == "running":
        message = solver.step()
        if solver.status == "failed":
            raise SimulationError(
                f"the step size went to zero at t={solver.t:.9g} s ({message or 'no reason given'}): "
                "the motion is too stiff or has a jump there. Loosen rtol, soften the load, or use method='rk4' with a small dt"
            )
        interpolant = None

        def between(times: Array) -> Array:
            nonlocal interpolant
            interpolant = interpolant or solver.dense_output()  # costs three evaluations: only where it is asked for
            return interpolant(np.asarray(times)).T

        x = project(solver.y)
        yield Step(float(solver.t_old), float(solver.t), x, between)  # type: ignore[arg-type]
        if not np.array_equal(x, solver.y):
            solver.y, solver.f = x, f(solver.t, x)
