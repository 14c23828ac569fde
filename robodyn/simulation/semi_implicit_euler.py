"""Euler's method with the new velocity in the positions, equal steps: order 1, symplectic for a separable energy.

Its right-hand side knows h: β̇ belongs to η + h η̇ (see `evaluate.Evaluator.evolution`). The step itself is then Euler's explicit one.
"""

from collections.abc import Iterator

import numpy as np

from ..arithmetic import Array
from ..engine.emit.tableau import Tableau
from .step import Projection, RightHandSide, Step, equal_steps, hermite


def tableau() -> Tableau:
    """One stage."""
    return Tableau(np.zeros((1, 1)), np.ones(1), np.zeros(1))


def steps(f: RightHandSide, t0: float, x0: Array, t_end: float, project: Projection, *, dt: float, **_: object) -> Iterator[Step]:
    """Steps of the largest h ≤ dt that divides the time span."""
    x, k = x0, f(t0, x0)
    for t, t_new, h in equal_steps(t0, t_end, dt):
        x_new = project(x + h * k)
        k_new = f(t_new, x_new)
        yield Step(t, t_new, x_new, hermite(t, h, x, x_new, k, k_new))
        x, k = x_new, k_new
