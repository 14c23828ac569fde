"""Radau IIA of order 5, implicit, for stiff scenes. Hairer, Wanner, Solving ODEs II, section IV.8."""

from .scipy_solver import ScipySolver

method = ScipySolver("Radau")
