"""Backward differentiation of orders 1 to 5, implicit, for stiff scenes. Shampine, Reichelt, The MATLAB ODE suite (1997)."""

from .scipy_solver import ScipySolver

method = ScipySolver("BDF", multistep=True)
