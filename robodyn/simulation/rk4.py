"""The classical Runge-Kutta method of order 4, equal steps. Kutta (1901); Hairer, Nørsett, Wanner, Solving ODEs I, table II.1.2."""

from collections.abc import Iterator

import numpy as np

from ..arithmetic import Array
from .step import Projection, RightHandSide, Step


def rk4(f: RightHandSide, t0: float, x0: Array, t_end: float, project: Projection, *, dt: float, **_: object) -> Iterator[Step]:
    """Steps of the largest h ≤ dt that divides the time span; cubic Hermite in between, of the method's own order."""
    n = max(1, int(np.ceil((t_end - t0) / dt * (1 - 1e-12))))
    h, x, k1 = (t_end - t0) / n, x0, f(t0, x0)
    for i in range(n):
        t, t_new = t0 + i * h, t0 + (i + 1) * h if i + 1 < n else t_end
        k2 = f(t + h / 2, x + h / 2 * k1)
        k3 = f(t + h / 2, x + h / 2 * k2)
        k4 = f(t_new, x + h * k3)
        x_new = project(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
        k1_new = f(t_new, x_new)
        yield Step(t, t_new, x_new, _hermite(t, h, x, x_new, k1, k1_new))
        x, k1 = x_new, k1_new


def _hermite(t: float, h: float, x: Array, x_new: Array, f: Array, f_new: Array):
    def between(times: Array) -> Array:
        s = ((np.asarray(times) - t) / h)[:, None]
        value = (1 + 2 * s) * (1 - s) ** 2 * x + s**2 * (3 - 2 * s) * x_new
        return value + h * s * (1 - s) * ((1 - s) * f - s * f_new)

    return between
