"""Errors, and the condition numbers that they are held against."""

import numpy as np

from ..arithmetic import Array
from ..dynamics.questions import MassMatrix
from ..model import Mechanism
from ..scene import Scene


def error(found: Array, exact: Array) -> float:
    """The largest error of any state (N, …), relative to the largest entry of that state's exact result."""
    exact = np.asarray(exact).reshape(len(exact), -1)
    errors = abs(np.asarray(found).reshape(exact.shape) - exact).max(-1) / abs(exact).max(-1)
    return float(errors.max())


def condition(robot: Mechanism, q: Array, vdot: Array) -> float:
    """κ of forward dynamics at a state: Skeel's condition number ‖ |M̂⁻¹| |M̂| |η̇| ‖ / ‖η̇‖ of M̂ η̇ = k̂ in the maximum norm, at least 1.

    Relative errors ε of the entries of M̂ move η̇ by at most κ ε, relative to its largest entry. It never exceeds the usual
    ‖M̂‖ ‖M̂⁻¹‖, and unlike that it does not change with the units of the equations: metres beside radians cost nothing.
    Higham, Accuracy and Stability of Numerical Algorithms, section 7.2.
    """
    M = Scene(robot, declared=False).evaluator.ask(MassMatrix(), "numpy", q=q)["M"]
    vdot = abs(np.asarray(vdot, dtype=float))
    return max(1.0, float((abs(np.linalg.inv(M)) @ (abs(M) @ vdot)).max() / vdot.max()))
