"""From a scene and its initial state to a trajectory.

single, many      `simulate` and `simulate_many`
integrators       one file per method, by one contract; `native`: their compiled step loop, driven from Python
integration       one run under way, in native code or in Python; `sampling`: when digital controllers are asked
times, progress   steps and outputs in time; what is shown meanwhile
trajectory        the result; `quantities`: the table of what it holds, stores and shows; `storage`: its scene as JSON
"""

from .integrators import METHODS
from .many import Trajectories, simulate_many
from .single import simulate
from .trajectory import Energy, Trajectory

__all__ = ["METHODS", "Energy", "Trajectories", "Trajectory", "simulate", "simulate_many"]
