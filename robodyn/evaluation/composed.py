"""Robots of many bodies: M̂ and k̂ by kernels that loop over the bodies, column by column, and M̂ η̇ = k̂ by LAPACK.

No loop eliminates coordinates that several joints share (mimic); and the mass matrix itself is many times as large as the robot.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..arithmetic import Array
from ..checks.motion import smallest_pivots
from ..dynamics.questions import Balance, JointReactions, KnownReactions, Solved
from ..formalism.ldl import solve_dense
from ..formalism.solution import Solution
from ..model import Tree

NUMBERS = 2**21  # entries of the mass matrices that are held at a time

Ask = Callable[..., dict[str, Array]]  # as `Evaluator.ask`


@dataclass(frozen=True, eq=False)
class Composed:
    """Answers made of those to other questions, which are asked of the scene itself, or of the robot without gravity and loads."""

    tree: Tree
    ask: Ask
    ask_unloaded: Ask

    def mass_matrix(self, q: Array, t: Array | float, threads: int | None, dtype: np.dtype) -> Array:
        """M̂ (..., nv, nv) at q (..., nq), checked, and t (...) [s]: what unit accelerations take at rest, without gravity and loads."""
        asked = {"q": q[..., None, :], "v": None, "tau": None, "threads": threads, "dtype": dtype}
        if self.tree.rheonomic:  # where joints are driven, that much less what they take anyway
            asked["t"] = np.asarray(t, dtype=float)[..., None] if np.ndim(t) else t
        M = self.ask_unloaded(Balance(("residual",)), a=-np.eye(self.tree.nv), **asked)["residual"]
        if self.tree.rheonomic:
            M = M - self.ask_unloaded(Balance(("residual",)), a=None, **asked)["residual"]
        return np.triu(M) + np.swapaxes(np.triu(M, 1), -1, -2)

    def answer(
        self, question: Solved, shapes: Mapping[str, object], t: Array | float, threads: int | None, dtype: np.dtype, x: dict[str, Array]
    ) -> dict[str, Array] | None:
        """The answer to a question about accelerations at arrays x, checked; None where a pivot is not to be trusted, or none is known."""
        if question.beside is None:
            return None
        nv, own = self.tree.nv, {"z": x["z"]} if "z" in x else {}
        shown = ("residual", *(name for name in question.beside if own or name != "zdot"))
        found = self.ask(Balance(shown), t=t, threads=threads, q=x["q"], v=x["v"], a=None, tau=x["tau"], **own)
        k = found.pop("residual")
        q, b = x["q"].reshape(-1, self.tree.nq), k.reshape(-1, nv)
        times = np.broadcast_to(np.asarray(t, dtype=float), k.shape[:-1]).reshape(-1)
        step = max(1, NUMBERS // nv**2)
        try:
            blocks = (slice(i, i + step) for i in range(0, max(1, len(b)), step))
            with np.errstate(all="ignore"):  # what is not finite is found below
                parts = [solve_dense(self.mass_matrix(q[block], times[block], threads, np.dtype(float)), b[block]) for block in blocks]
        except np.linalg.LinAlgError:
            return None
        pieces = (np.concatenate(part).reshape(k.shape) for part in zip(*(part[:3] for part in parts), strict=True))
        solution = Solution(*pieces)
        if not (solution.pivots > smallest_pivots(self.tree, solution, float(np.finfo(dtype).eps))).all():
            return None
        found["vdot"] = solution.vdot
        if isinstance(question, JointReactions):
            known = KnownReactions(question.frame, question.part, question.joints)
            found = self.ask(known, t=t, threads=threads, q=x["q"], v=x["v"], a=solution.vdot, u=found["u"], **own)
        with np.errstate(over="ignore"):
            values = {name: found[name].astype(dtype, copy=False) for name in shapes}
        return values if all(np.isfinite(a).all() for a in values.values()) else None
