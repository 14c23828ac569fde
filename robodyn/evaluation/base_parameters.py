"""Base inertial parameters for forward dynamics, where they cost no digits: whether they do is measured, once per robot.

Where a leg folds, or comes to lie along an axis that turns it, its inertia there is small: a difference of large numbers on base
parameters, a sum on the bodies as they are.
"""

from dataclasses import replace

import numpy as np

from ..formalism.nonrecursive import mass_matrix, nonrecursive
from ..formalism.recursive import recursive
from ..formalism.state import State
from ..model import Mechanism, Minimal, Tree, lump, minimal
from . import remembered

STATES = 256  # random ones
LOSS = 1.5  # of the root mean square of errors; in as many other states it is found anew within a fifth
PUSH = 30.0  # [rad/s², m/s²]: what joint forces could do to the mean inertia of their own coordinate, as motors are sized
WEIGHT = np.array([0.0, 0.0, -9.81])  # [m/s²]


def reduced(mechanism: Mechanism, tree: Tree) -> Minimal | None:
    """The lumped tree of a robot with base inertial parameters; None where these cost digits."""
    known = remembered.choice(mechanism, "base parameters", ("yes", "no"), lambda: "no" if costs_digits(mechanism) else "yes")
    return minimal(tree) if known == "yes" else None


def costs_digits(mechanism: Mechanism) -> bool:
    """Whether accelerations of a robot are rounded worse on base parameters than on the bodies as they are."""
    plain, base = rounding(mechanism)
    return base > LOSS * plain


def rounding(mechanism: Mechanism) -> tuple[float, float]:
    """Root mean square errors of accelerations (of the largest one) on the bodies as they are, and on base parameters.

    Both are compared with the articulated-body recursion, whose own errors count for both. It cannot eliminate coordinates that joints
    share, so each mimic joint moves for itself here: M̂ is made of the same numbers.
    """
    if not mechanism.nv:
        return 0.0, 0.0
    free = replace(mechanism, joints=tuple(replace(joint, mimic=None) for joint in mechanism.joints))
    tree, rng = lump(free), np.random.default_rng(0)
    q, v = (np.stack(x) for x in zip(*(free.random_state(rng) for _ in range(STATES)), strict=True))
    state = State(free, tree, 0.0, q, v)
    inertias = mass_matrix(tree, state.motion, q.dtype).diagonal(axis1=-2, axis2=-1)
    acts = rng.uniform(-PUSH, PUSH, v.shape) * inertias.mean(0), {}, WEIGHT
    with np.errstate(all="ignore"):
        exact = recursive(state, *acts).vdot
        found = [nonrecursive(state.on(bodies), *acts).vdot for bodies in (tree, minimal(tree).tree)]
        plain, base = (np.sqrt(np.mean((abs(x - exact).max(-1) / abs(exact).max(-1)) ** 2)) for x in found)
    return float(plain), float(base)
