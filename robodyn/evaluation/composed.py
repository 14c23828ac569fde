"""Robots of many bodies: M̂ and k̂ by kernels that loop over the bodies, column by column, and M̂ η̇ = k̂ by LAPACK.

No loop eliminates coordinates that several joints share (mimic); and the mass matrix itself is many times as large as the robot.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..arithmetic import Array
from ..checks.motion import smallest_pivots
from ..dynamics.questions import Balance, Evolution, ForwardDynamics, JointReactions, KnownReactions, Question, Result
from ..formalism.ldl import solve_dense
from ..formalism.solution import Solution

if TYPE_CHECKING:
    from .evaluator import Evaluator

NUMBERS = 2**21  # entries of the mass matrices that are held at a time
BESIDE = {ForwardDynamics: (), Evolution: ("qdot", "power"), Result: ("u",), JointReactions: ("u",)}  # what they need beside η̇


def mass_matrix(evaluator: "Evaluator", question: Question, threads: int | None, dtype: np.dtype, arrays: Mapping[str, object]) -> Array:
    """M̂ (..., nv, nv) at q (..., nq): what unit accelerations take at rest, without gravity and loads."""
    return _columns(evaluator, evaluator.checked(question, arrays)["q"], threads, dtype)


def answer(
    evaluator: "Evaluator", question: Question, t: Array | float, threads: int | None, dtype: np.dtype, arrays: Mapping[str, object]
) -> dict[str, Array] | None:
    """The answer to a question about accelerations; None where a pivot is not to be trusted."""
    robot, tree, x = evaluator.robot, evaluator.views().lumped.tree, evaluator.checked(question, arrays, dtype)
    found = evaluator.ask(Balance(("residual", *BESIDE[type(question)])), t=t, threads=threads, q=x["q"], v=x["v"], a=None, tau=x["tau"])
    k = found.pop("residual")
    q, b = x["q"].reshape(-1, robot.nq), k.reshape(-1, robot.nv)
    step = max(1, NUMBERS // robot.nv**2)
    try:
        blocks = (slice(i, i + step) for i in range(0, max(1, len(b)), step))
        with np.errstate(all="ignore"):  # what is not finite is found below
            parts = [solve_dense(_columns(evaluator, q[block], threads, np.dtype(float)), b[block]) for block in blocks]
    except np.linalg.LinAlgError:
        return None
    solution = Solution(*(np.concatenate(part).reshape(k.shape) for part in zip(*parts, strict=True)))
    if not (solution.pivots > smallest_pivots(tree, solution, float(np.finfo(dtype).eps))).all():
        return None
    found["vdot"] = solution.vdot
    if isinstance(question, JointReactions):
        known = KnownReactions(question.frame, question.part, question.joints)
        found = evaluator.ask(known, t=t, threads=threads, q=x["q"], v=x["v"], a=solution.vdot, u=found["u"])
    with np.errstate(over="ignore"):
        values = {name: found[name].astype(dtype, copy=False) for name in question.shapes(robot)}
    return values if all(np.isfinite(a).all() for a in values.values()) else None


def _columns(evaluator: "Evaluator", q: Array, threads: int | None, dtype: np.dtype) -> Array:
    units = np.eye(evaluator.robot.nv)
    asked = {"q": q[..., None, :], "v": None, "a": -units, "tau": None}
    M = evaluator.unloaded.ask(Balance(("residual",)), threads=threads, dtype=dtype, **asked)["residual"]
    return np.triu(M) + np.swapaxes(np.triu(M, 1), -1, -2)
