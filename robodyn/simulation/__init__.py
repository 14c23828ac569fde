"""Integrators, `simulate` and `Trajectory`."""

from .integrators import METHODS
from .many import Trajectories, simulate_many
from .single import simulate
from .trajectory import Energy, Trajectory

__all__ = ["METHODS", "Energy", "Trajectories", "Trajectory", "simulate", "simulate_many"]
