"""Explicit Runge-Kutta methods with equal steps: one stepper for any tableau. Hairer, Nørsett, Wanner, Solving ODEs I, section II.1."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import NamedTuple

import numpy as np

from ...arithmetic import Array
from ...engine.emit.tableau import Tableau
from ..times import step_count
from .contract import Integrator, Problem, Step


class Memory(NamedTuple):
    """Where step i of `count` starts: t0 + i h [s], the state there, and its derivative, which was the last of the step before."""

    t0: float
    h: float
    count: int
    i: int
    t: float
    x: Array
    dx: Array


@dataclass(frozen=True, eq=False)
class EqualSteps(Integrator):
    """Steps of the largest h ≤ dt that divides the span of time; cubic Hermite in between."""

    coefficients: Tableau
    semi_implicit: bool = False

    adaptive = False
    native = True

    def tableau(self) -> Tableau:
        return self.coefficients

    def init(self, problem: Problem, t: float, x: Array, first_step: float | None = None) -> Memory:
        count = step_count(t, problem.t_end, problem.dt)
        return Memory(t, (problem.t_end - t) / count, count, 0, t, x, problem.f(t, x))

    def step(self, problem: Problem, memory: Memory) -> tuple[Step, Memory]:
        m, (t0, h, count, i, t, x, dx) = self.coefficients, memory
        t_new = t0 + (i + 1) * h if i + 1 < count else problem.t_end
        k = [dx]
        for row, c in zip(m.a[1:], m.c[1:], strict=True):
            k.append(problem.f(t_new if c == 1 else t + c * h, x + total(h * row, k)))
        x_new = problem.project(x + h / m.divisor * total(m.weights, k))
        dx_new = problem.f(t_new, x_new)
        return Step(t, t_new, x_new, hermite(t, h, x, x_new, dx, dx_new)), Memory(t0, h, count, i + 1, t_new, x_new, dx_new)


def total(weights: Array, k: Sequence[Array]) -> Array:
    """Σ w_j k_j, smallest index first."""
    return reduce(add, [weights[j] * k[j] for j in np.flatnonzero(weights).tolist()])


def hermite(t: float, h: float, x: Array, x_new: Array, f: Array, f_new: Array) -> Callable[[Array], Array]:
    """The cubic through both states (nx,) with both derivatives: times (k,) → states (k, nx)."""

    def between(times: Array) -> Array:
        s = ((np.asarray(times) - t) / h)[:, None]
        value = (1 + 2 * s) * (1 - s) ** 2 * x + s**2 * (3 - 2 * s) * x_new
        return value + h * s * (1 - s) * ((1 - s) * f - s * f_new)

    return between
