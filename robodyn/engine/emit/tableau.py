"""An explicit Runge-Kutta method as data: what native code and Python step by."""

from dataclasses import dataclass

import numpy as np

from ...arithmetic import Array


@dataclass(frozen=True, eq=False)
class Tableau:
    """Stages k_i = f(t + c_i h, x + h Σ a_ij k_j), then x_new = x + h Σ b_i k_i; k_s = f(t + h, x_new) starts the next step.

    Without an error estimate the steps are equal, and the stages a chain: each needs the derivative before it alone, a_ij = 0 elsewhere.
    """

    a: Array  # (s, s), strictly lower
    weights: Array  # (s,): b times the divisor
    c: Array  # (s,)
    order: int = 4  # of the error estimate, for the step size
    errors: tuple[Array, ...] = ()  # weights (s + 1,) of the error: none for equal steps, one, or DOP853's pair (order 5, order 3)
    extra_a: Array | None = None  # further stages (m, s + 1 + m) for dense output
    extra_c: Array | None = None
    divisor: float = 1.0  # common to the weights
    dense: Array | None = None  # weights of the derivatives (…, s + 1 + m) in the terms of dense output beyond cubic Hermite

    def __post_init__(self) -> None:
        if not self.errors and (np.tril(self.a, -2).any() or self.extra_a is not None):
            raise ValueError("a method without error estimate must be a chain: each stage from the derivative before it alone")

    @property
    def b(self) -> Array:
        """The weights b_i (s,) of the new state."""
        return self.weights / self.divisor
