"""Joint forces from a function of time and state."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..arithmetic import Array
from ..errors import InputError, ModelError
from .base import Load, State


@dataclass(frozen=True, eq=False)
class ControlLaw(Load):
    """`ControlLaw(lambda t, q, v: -50 * q - 5 * v)`: called with t, q (nq,), v (nv,), returns tau (nv,).

    A mimic joint's coordinate is driven at its leader.
    """

    law: Callable[[float, Array, Array], Array]

    def joint_forces(self, state: State) -> Mapping[int, Array]:
        if state.q.dtype == object:
            raise ModelError("a ControlLaw is a Python function of float64 arrays: it cannot run with backend='mpmath'")
        nv, batch = state.mechanism.nv, np.broadcast_shapes(np.shape(state.t), state.q.shape[:-1], state.v.shape[:-1])
        t, q, v = np.broadcast_to(state.t, batch), state.q, state.v
        q, v = (np.broadcast_to(x, (*batch, x.shape[-1])) for x in (q, v))
        tau = np.empty((*batch, nv))
        for i in np.ndindex(batch):
            answer = np.asarray(self.law(float(t[i]), q[i], v[i]), dtype=float)
            if answer.shape != (nv,):
                raise InputError(f"the control law returned an array of shape {answer.shape} at t={float(t[i])}: it must be ({nv},)")
            tau[i] = answer
        return {i: tau[..., state.mechanism.v_slices[i]] for i in state.mechanism.owners}
