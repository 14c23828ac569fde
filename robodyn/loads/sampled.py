"""A digital controller: joint forces that are computed once per period and held in between."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arithmetic import Array
from ..errors import InputError
from ..model import Mechanism
from .base import Load
from .checked import law_forces


@dataclass(frozen=True, eq=False)
class Sampled(Load):
    """`Sampled(law, dt=0.001)`: law(t, q (nq,), v (nv,)) returns tau (nv,) [N m, N], held from t until t + dt [s]: a zero-order hold.

    A simulation calls the law once at t0, t0 + dt, t0 + 2 dt, … before t_end, in this order, on states that the motion passes through,
    never on trial states. It is ordinary Python and is not compiled: it may branch, remember and print. q and v are copies, its to keep.
    A question at one state (`Scene.forward_dynamics`, …) calls it there and then, and a law with a memory remembers that call too.
    A mimic joint's coordinate is driven at its leader. Several at one instant are called in the order of the scene's loads.
    InputError where the law is no function or dt is no positive, finite number.
    """

    law: Callable[[float, Array, Array], Array]
    dt: float

    def check(self, mechanism: Mechanism) -> None:
        if not callable(self.law):
            raise InputError(f"Sampled({self.law!r}): the law must be a function of (t, q, v) that returns tau ({mechanism.nv},)")
        try:
            dt = float(self.dt)
        except (TypeError, ValueError):
            dt = np.nan
        if not 0 < dt < np.inf:
            raise InputError(f"Sampled(…, dt={self.dt!r}): the period must be a positive, finite number of seconds")

    def forces(self, mechanism: Mechanism, t: float, q: Array, v: Array) -> Array:
        """What the law answers (nv,). InputError where that is no finite array of this shape; what the law itself raises, passes."""
        tau = law_forces(self.law(t, q.copy(), v.copy()), mechanism, "sampled control law", t)
        tau = np.array(tau, dtype=float)  # a copy: the law may go on to use its own
        # The sum is a cheap question; where it is not finite, the entries are asked.
        if not math.isfinite(sum(tau.tolist())) and not np.isfinite(tau).all():
            k = int(np.argmin(np.isfinite(tau)))
            name = mechanism.coordinate_names()[1][k][0]
            raise InputError(f"the sampled control law returned {tau[k]} for {name!r} at t={t:.9g} s: every force must be finite")
        return tau
