"""Joint forces from a function of time and state."""

import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arithmetic import Array, is_exact
from ..arithmetic.symbols import symbols
from ..errors import InputError, ModelError
from ..model import Mechanism
from .base import Load, State
from .checked import law_forces

_ROBODYN = Path(__file__).parents[1]
LINE = 100  # characters of a line of the user's that are shown
_INSTEAD = (
    "rd.Sampled(law, dt) runs it as it is, as a digital controller asked once per period; backend='numpy' asks it at every evaluation"
)


@dataclass(frozen=True, eq=False)
class ControlLaw(Load):
    """`ControlLaw(lambda t, q, v: -50 * q - 5 * v)`: called with t, q (nq,), v (nv,), returns tau (nv,).

    A mimic joint's coordinate is driven at its leader. Compiled, the law runs once per kernel, on symbols: what it reads beside t, q and v
    keeps the value that it has then, so other gains need a new Scene. (`simulate`, and kernels made later, refuse a law that has changed;
    a question that has its kernel does not look.) Arithmetic, comparisons joined by & | ^ ~, np.where, np.select, np.clip, np.minimum,
    np.maximum, np.sign, np.floor, % (to wrap an angle), np.linalg.norm and NumPy's elementary functions pass; a branch on a value does not.
    What np.where does not choose is computed all the same. InputError where the law is no function.
    """

    law: Callable[[float, Array, Array], Array]

    def check(self, mechanism: Mechanism) -> None:
        if not callable(self.law):
            raise InputError(f"ControlLaw({self.law!r}): the law must be a function of (t, q, v) that returns tau ({mechanism.nv},)")

    def _traced(self, state: State) -> Array:
        """The law on symbols: NumPy's arithmetic and functions pass, a branch on a value does not."""
        q, v = symbols(state.q), symbols(state.v)
        try:
            answers = [self.law(state.t, q.copy(), v.copy()) for _ in range(2)]  # type: ignore[arg-type]
        except Exception as error:
            frames = [f for f in traceback.extract_tb(error.__traceback__) if not Path(f.filename).is_relative_to(_ROBODYN)]
            # The user's own last line, not one of a library that it called; a library's where the law is one.
            own = [f for f in frames if f.line and "site-packages" not in Path(f.filename).parts] or frames
            line = (own[-1].line or "") if own else ""
            line = line if len(line) <= LINE else line[:LINE] + " …"
            where = f" at {own[-1].filename}:{own[-1].lineno}, `{line}`" if own else ""
            raise InputError(
                f"the control law cannot be compiled{where}: {error}. Write it with arithmetic and NumPy functions such as np.tanh, "
                f"without branches on values; or {_INSTEAD}"
            ) from error
        tau, again = (law_forces(x, state.mechanism, "control law") for x in answers)
        # Compiled, its first answer would hold for ever.
        first, second = ([getattr(x, "number", x) for x in answer.flat] for answer in (tau, again))
        if any(x != y and x == x for x, y in zip(first, second, strict=False)):  # a NaN differs from itself
            raise InputError(f"the control law answers the same call differently each time: it has a memory. {_INSTEAD}")
        return tau

    def joint_forces(self, state: State) -> Mapping[int, Array]:
        """What the law returns (nv_i,), by joint.

        InputError where that is no array (nv,) of real numbers, where the law fails or cannot be compiled; ModelError in 50 digits.
        """
        if is_exact(state.q):
            raise ModelError("a ControlLaw is a Python function of float64 arrays: it cannot run with backend='mpmath'")
        if state.q.dtype == object:
            tau = self._traced(state)
            return {i: tau[state.mechanism.v_slices[i]] for i in state.mechanism.owners}
        nv, batch = state.mechanism.nv, np.broadcast_shapes(np.shape(state.t), state.q.shape[:-1], state.v.shape[:-1])
        t, q, v = np.broadcast_to(state.t, batch), state.q, state.v
        q, v = (np.broadcast_to(x, (*batch, x.shape[-1])) for x in (q, v))
        tau = np.empty((*batch, nv))
        for i in np.ndindex(batch):
            try:
                answer = self.law(float(t[i]), q[i].copy(), v[i].copy())
            except (TypeError, ValueError, ZeroDivisionError, np.linalg.LinAlgError) as error:
                raise InputError(f"the control law raised {type(error).__name__} at t={float(t[i])}: {error}") from error
            tau[i] = law_forces(answer, state.mechanism, "control law", float(t[i]))
        return {i: tau[..., state.mechanism.v_slices[i]] for i in state.mechanism.owners}
