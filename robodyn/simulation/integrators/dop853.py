"""Dormand and Prince's method of order 8 with error control. Hairer, Nørsett, Wanner, Solving ODEs I, section II.5."""

from typing import Any

from ...engine.emit.tableau import Tableau
from .scipy_solver import ScipySolver


def coefficients(D: Any) -> Tableau:
    """Those that SciPy's class carries."""
    return Tableau(D.A, D.B, D.C, order=7, errors=(D.E5, D.E3), extra_a=D.A_EXTRA, extra_c=D.C_EXTRA, dense=D.D)


method = ScipySolver("DOP853", coefficients)
