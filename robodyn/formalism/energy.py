"""Energies and momentum of a state."""

import numpy as np

from ..arithmetic import Array
from ..arithmetic.vectors import dot, mul
from ..model import Body
from .spatial import Pose, RigidInertia, wrench_to_parent
from .state import State


def kinetic(state: State) -> Array:
    """½ Σ v̌ᵀ M v̌ (...) [J]."""
    return state.tree.total(lambda body, x: 0.5 * dot(x, RigidInertia.of(body.inertia).times(x)), state.motion.twist)


def potential(state: State, gravity: Array) -> Array:
    """−Σ m gᵀ r_S (...) [J], zero where the centre of mass is in the ground's origin."""

    def of_body(body: Body, X: Pose) -> Array:
        return -dot(np.asarray(gravity), body.inertia.mass * X.r + mul(X.R, body.inertia.moment))

    return state.tree.total(of_body, state.world)


def momentum(state: State) -> Array:
    """Angular momentum about the ground's origin and linear momentum (..., 6) [N m s, N s], resolved in the ground's frame."""

    def of_body(body: Body, X: Pose, twist: Array) -> Array:
        return wrench_to_parent(X, RigidInertia.of(body.inertia).times(twist))

    return np.zeros(6) + state.tree.total(of_body, state.world, state.motion.twist)
