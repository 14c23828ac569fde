"""LSODA, which switches between Adams' methods and backward differentiation as stiffness asks. Petzold (1983)."""

from .scipy_solver import ScipySolver

method = ScipySolver("LSODA", multistep=True)
