"""Energies and momentum of a state."""

import numpy as np

from ..arithmetic import Array
from ..arithmetic.vectors import dot, mul
from ..model import Body, Tree
from .kinematics import Motion, world_poses
from .spatial import Pose, RigidInertia, wrench_to_parent


def kinetic(tree: Tree, state: Motion) -> Array:
    """½ Σ v̌ᵀ M v̌ (...) [J]."""
    return tree.total(lambda body, x: 0.5 * dot(x, RigidInertia.of(body.inertia).times(x)), state.twist)


def potential(tree: Tree, state: Motion, gravity: Array) -> Array:
    """−Σ m gᵀ r_S (...) [J], zero where the centre of mass is in the ground's origin."""

    def of_body(body: Body, X: Pose) -> Array:
        return -dot(np.asarray(gravity), body.inertia.mass * X.r + mul(X.R, body.inertia.moment))

    return tree.total(of_body, world_poses(tree, state.pose))


def momentum(tree: Tree, state: Motion) -> Array:
    """Angular momentum about the ground's origin and linear momentum (..., 6) [N m s, N s], resolved in the ground's frame."""

    def of_body(body: Body, X: Pose, twist: Array) -> Array:
        return wrench_to_parent(X, RigidInertia.of(body.inertia).times(twist))

    return np.zeros(6) + tree.total(of_body, world_poses(tree, state.pose), state.twist)
