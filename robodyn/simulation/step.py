"""What every integrator yields: one accepted step at a time, with the states in between on demand."""

from collections.abc import Callable
from dataclasses import dataclass

from ..arithmetic import Array

RightHandSide = Callable[[float, Array], Array]  # ẋ = Ψ(x, t)
Projection = Callable[[Array], Array]  # x with its Euler parameters at unit length


@dataclass(frozen=True, eq=False)
class Step:
    """From t_old to t, arriving at x."""

    t_old: float
    t: float
    x: Array  # (nx,)
    between: Callable[[Array], Array]  # times (k,) within the step → states (k, nx)
