"""Integrators, `simulate` and `Trajectory`."""

from .many import Trajectories, simulate_many
from .methods import METHODS
from .run import simulate
from .trajectory import Energy, Trajectory

__all__ = ["METHODS", "Energy", "Trajectories", "Trajectory", "simulate", "simulate_many"]
