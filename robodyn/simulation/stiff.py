"""Implicit methods for stiff scenes, by SciPy: Radau IIA of order 5, backward differentiation of orders 1 to 5, and LSODA."""

from .scipy_steps import scipy_steps

radau, bdf, lsoda = scipy_steps("Radau"), scipy_steps("BDF", multistep=True), scipy_steps("LSODA", multistep=True)
