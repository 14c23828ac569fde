"""Integrators, `simulate` and `Trajectory`."""

from .run import METHODS, simulate
from .trajectory import Energy, Trajectory

__all__ = ["METHODS", "Energy", "Trajectory", "simulate"]
