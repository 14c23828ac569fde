"""Newton and Euler for each body, about its reference point O: M ǎ = f̌ᶜ + f̌ᵗ + f̌ᵏ, eq. (7)."""

from collections.abc import Mapping

import numpy as np

from ..arithmetic import Array
from ..arithmetic.vectors import cross, joined, mul, transpose
from ..model import Body, Field, Inertia, Tree
from .kinematics import Motion, accelerations, falling_ground
from .spatial import RigidInertia, angular

Wrenches = Mapping[int, Array]  # body index → applied wrench f̌ᵗ (..., 6) about O_i, resolved in K_i


def gyroscopic(inertia: Inertia, twist: Array) -> Array:
    """f̌ᶜ = (−ω̃ Θ ω, −m ω̃ ω̃ ρ) (..., 6)."""
    w = angular(twist)
    return joined(-cross(w, mul(inertia.tensor, w)), -cross(w, cross(w, inertia.moment)))


def weight(inertia: Inertia, R_world: Array, gravity: Array) -> Array:
    """The wrench (..., 6) of gravity (3,) on a body with the orientation R_world (..., 3, 3), about O, in the body's frame."""
    g = mul(transpose(R_world), gravity)
    return joined(cross(inertia.moment, g), inertia.mass * g)


def resultants(tree: Tree, motion: Motion, accelerations: Field, wrenches: Wrenches) -> Field:
    """f̌ᵏ_i = M ǎ − f̌ᶜ − f̌ᵗ (..., 6) of all bodies: what their joints together must supply."""

    def resultant(body: Body, twist: Array, a: Array, applied: Array | None) -> Array:
        f = RigidInertia.of(body.inertia).times(a) - gyroscopic(body.inertia, twist)
        return f if applied is None else f - applied

    return tree.each(resultant, motion.twist, accelerations, tree.on_bodies(wrenches))


def bias_resultants(tree: Tree, motion: Motion, wrenches: Wrenches, gravity: Array) -> Field:
    """f̌ᵏ_i (..., 6) at η̇ = 0: M ā − f̌ᶜ − f̌ᵗ, gravity included."""
    return resultants(tree, motion, accelerations(tree, motion, falling_ground(gravity)), wrenches)


def added_resultants(tree: Tree, motion: Motion, vdot: Array) -> Field:
    """M J η̇ (..., 6): what η̇ adds to f̌ᵏ_i of η̇ = 0."""
    still = motion._replace(bias=tree.each(lambda _: np.zeros(6)))
    changes = accelerations(tree, still, np.zeros(6), vdot)
    return tree.each(lambda body, a: RigidInertia.of(body.inertia).times(a), changes)
