"""Integrators, `simulate` and `Trajectory`."""

from .methods import METHODS
from .run import simulate
from .trajectory import Energy, Trajectory

__all__ = ["METHODS", "Energy", "Trajectory", "simulate"]
