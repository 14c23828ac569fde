"""Dormand and Prince's method of order 5 with error control. Hairer, Nørsett, Wanner, Solving ODEs I, table II.5.2."""

from typing import Any

from ...engine.emit.tableau import Tableau
from .scipy_solver import ScipySolver


def coefficients(D: Any) -> Tableau:
    """Those that SciPy's class carries. Its interpolant is the cubic Hermite one and a term of fourth power."""
    return Tableau(D.A, D.B, D.C, order=4, errors=(D.E,), dense=D.P[:, 3:].T)


method = ScipySolver("RK45", coefficients)
