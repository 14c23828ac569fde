"""Euler's method with the new velocity in the positions, equal steps: order 1, symplectic for a separable energy.

Its right-hand side knows h: β̇ belongs to η + h η̇ (see `evaluation.integrator_programs`). The step itself is then Euler's explicit one.
"""

import numpy as np

from ...engine.emit.tableau import Tableau
from .equal_steps import EqualSteps

method = EqualSteps(Tableau(np.zeros((1, 1)), np.ones(1), np.zeros(1)), semi_implicit=True)
