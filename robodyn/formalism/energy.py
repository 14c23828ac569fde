"""Energies and momentum of a state."""

import numpy as np

from ..algebra import dot, joined, mul
from ..arithmetic import Array
from ..model import Tree
from .kinematics import Motion, world_poses
from .spatial import RigidInertia, wrench_to_parent


def kinetic(tree: Tree, state: Motion) -> Array:
    """½ Σ v̌ᵀ M v̌ (...) [J]."""
    bodies = zip(tree.bodies, state.twist, strict=True)
    return sum((0.5 * dot(x, RigidInertia.of(b.inertia).times(x)) for b, x in bodies), start=np.zeros(()))


def potential(tree: Tree, state: Motion, gravity: Array) -> Array:
    """−Σ m gᵀ r_S (...) [J], zero where the centre of mass is in the ground's origin."""
    world = world_poses(tree, state.pose)
    total = np.zeros(())
    for body, X in zip(tree.bodies, world, strict=True):
        total = total - dot(np.asarray(gravity), body.inertia.mass * X.r + mul(X.R, body.inertia.moment))
    return total


def momentum(tree: Tree, state: Motion) -> Array:
    """Angular momentum about the ground's origin and linear momentum (..., 6) [N m s, N s], resolved in the ground's frame."""
    world = world_poses(tree, state.pose)
    total = joined(np.zeros(3), np.zeros(3))
    for body, X, twist in zip(tree.bodies, world, state.twist, strict=True):
        total = total + wrench_to_parent(X, RigidInertia.of(body.inertia).times(twist))
    return total
