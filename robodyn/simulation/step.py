"""What every integrator in Python yields: one accepted step at a time, with the states in between on demand."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..arithmetic import Array
from ..errors import InputError

RightHandSide = Callable[[float, Array], Array]  # ẋ = Ψ(x, t)
EPS = float(np.finfo(float).eps)
Projection = Callable[[Array], Array]  # x with its Euler parameters at unit length


@dataclass(frozen=True, eq=False)
class Step:
    """From t_old to t, arriving at x."""

    t_old: float
    t: float
    x: Array  # (nx,)
    between: Callable[[Array], Array]  # times (k,) within the step → states (k, nx)
    h: float | None = None  # the step that error control would take next, whatever the end of the span; None: start anew


def resolution(t0: float, t_end: float) -> float:
    """Times closer than this [s] are one: sums such as t0 + k dt, and the user's own, are a few roundings off."""
    return 32 * EPS * max(abs(t0), abs(t_end))


def refuse_empty(t0: float, t_end: float) -> None:
    """InputError where a span of time [s] ends no later than it starts, or times within it are all one."""
    if not t_end > t0:
        raise InputError(f"t_end={t_end} must be later than t0={t0}")
    if t_end - t0 <= (same := resolution(t0, t_end)):
        raise InputError(f"t0={t0} and t_end={t_end} are closer than {same:.3g} s, which is too close to tell times apart: start from t0=0")


def step_count(t0: float, t_end: float, dt: float) -> int:
    """How many equal steps of at most dt the time span takes; a span that dt divides up to rounding takes no extra one."""
    return max(1, math.ceil((t_end - t0 - resolution(t0, t_end)) / dt * (1 - 1e-12)))


def step_times(t0: float, t_end: float, dt: float) -> Array:
    """t0 and the end of every step, to the bit as native code has them: t0 + k h rounded once, and t_end."""
    n = step_count(t0, t_end, dt)
    (a, c), (b, d) = t0.as_integer_ratio(), ((t_end - t0) / n).as_integer_ratio()
    whole = max(c, d)  # both are powers of two; a quotient of integers is rounded once
    a, b = a * (whole // c), b * (whole // d)
    return np.array([(a + k * b) / whole for k in range(n)] + [t_end])


def equal_steps(t0: float, t_end: float, dt: float) -> Iterator[tuple[float, float, float]]:
    """Start, end and length of each step; the last one ends at t_end."""
    n = step_count(t0, t_end, dt)
    h = (t_end - t0) / n
    for i in range(n):
        yield t0 + i * h, t0 + (i + 1) * h if i + 1 < n else t_end, h


def hermite(t: float, h: float, x: Array, x_new: Array, f: Array, f_new: Array) -> Callable[[Array], Array]:
    """The cubic through both states with both derivatives."""

    def between(times: Array) -> Array:
        s = ((np.asarray(times) - t) / h)[:, None]
        value = (1 + 2 * s) * (1 - s) ** 2 * x + s**2 * (3 - 2 * s) * x_new
        return value + h * s * (1 - s) * ((1 - s) * f - s * f_new)

    return between
