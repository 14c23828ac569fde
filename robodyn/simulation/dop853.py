"""Dormand and Prince's method of order 8 with error control. Hairer, Nørsett, Wanner, Solving ODEs I, section II.5."""

from ..engine.emit.tableau import Tableau
from .scipy_steps import scipy_steps

steps = scipy_steps("DOP853")


def tableau() -> Tableau:
    """The coefficients, as SciPy carries them."""
    from scipy.integrate import DOP853 as D

    return Tableau(D.A, D.B, D.C, order=7, errors=(D.E5, D.E3), extra_a=D.A_EXTRA, extra_c=D.C_EXTRA, dense=D.D)
