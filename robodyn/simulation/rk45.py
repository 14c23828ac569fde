"""Dormand and Prince's method of order 5 with error control. Hairer, Nørsett, Wanner, Solving ODEs I, table II.5.2."""

from ..engine.emit.tableau import Tableau
from .scipy_steps import scipy_steps

steps = scipy_steps("RK45")


def tableau() -> Tableau:
    """The coefficients, as SciPy carries them. Its interpolant is the cubic Hermite one and a term of fourth power."""
    from scipy.integrate import RK45

    return Tableau(RK45.A, RK45.B, RK45.C, order=4, errors=(RK45.E,), dense=RK45.P[:, 3:].T)
