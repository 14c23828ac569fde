"""The classical Runge-Kutta method of order 4, equal steps. Kutta (1901); Hairer, Nørsett, Wanner, Solving ODEs I, table II.1.2."""

from collections.abc import Iterator

import numpy as np

from ..arithmetic import Array
from ..engine.emit.tableau import Tableau
from .step import Projection, RightHandSide, Step, equal_steps, hermite


def tableau() -> Tableau:
    """The coefficients."""
    a = np.array([[0, 0, 0, 0], [1 / 2, 0, 0, 0], [0, 1 / 2, 0, 0], [0, 0, 1, 0]])
    return Tableau(a, np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6]), np.array([0, 1 / 2, 1 / 2, 1]))


def steps(f: RightHandSide, t0: float, x0: Array, t_end: float, project: Projection, *, dt: float, **_: object) -> Iterator[Step]:
    """Steps of the largest h ≤ dt that divides the time span; cubic Hermite in between, of the method's own order."""
    x, k1 = x0, f(t0, x0)
    for t, t_new, h in equal_steps(t0, t_end, dt):
        k2 = f(t + h / 2, x + h / 2 * k1)
        k3 = f(t + h / 2, x + h / 2 * k2)
        k4 = f(t_new, x + h * k3)
        x_new = project(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
        k1_new = f(t_new, x_new)
        yield Step(t, t_new, x_new, hermite(t, h, x, x_new, k1, k1_new))
        x, k1 = x_new, k1_new
