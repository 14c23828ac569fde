"""The classical Runge-Kutta method of order 4, equal steps. Kutta (1901); Hairer, Nørsett, Wanner, Solving ODEs I, table II.1.2."""

import numpy as np

from ...engine.emit.tableau import Tableau
from .equal_steps import EqualSteps

A = np.array([[0, 0, 0, 0], [1 / 2, 0, 0, 0], [0, 1 / 2, 0, 0], [0, 0, 1, 0]])
method = EqualSteps(Tableau(A, np.array([1.0, 2, 2, 1]), np.array([0, 1 / 2, 1 / 2, 1]), divisor=6))
