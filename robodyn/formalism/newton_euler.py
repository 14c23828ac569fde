"""Newton and Euler for each body, about its reference point O: M ǎ = f̌ᶜ + f̌ᵗ + f̌ᵏ, eq. (7)."""

from collections.abc import Mapping

from ..algebra import cross, joined, mul, transpose
from ..arithmetic import Array
from ..model import Body, Inertia, Tree
from .kinematics import Motion
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


def resultants(tree: Tree, state: Motion, accelerations: list[Array], wrenches: Wrenches) -> list[Array]:
    """f̌ᵏ_i = M ǎ − f̌ᶜ − f̌ᵗ (..., 6) of all bodies: what their joints together must supply."""

    def resultant(i: int, body: Body) -> Array:
        f = RigidInertia.of(body.inertia).times(accelerations[i]) - gyroscopic(body.inertia, state.twist[i])
        return f - wrenches[i] if i in wrenches else f

    return [resultant(i, body) for i, body in enumerate(tree.bodies)]
