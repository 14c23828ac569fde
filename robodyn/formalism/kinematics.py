"""Positions, velocities and accelerations of all bodies: one outward sweep each, eqs. (10)-(15).

Everything is resolved in the body's own frame K_i, so nothing depends on how far the robot is from the origin.
"""

from typing import NamedTuple

import numpy as np

from ..algebra import cross, joined, mul, transpose
from ..arithmetic import Array
from ..model import Body, Tree
from .spatial import Pose, angular, linear, twist_to_child


class Motion(NamedTuple):
    """What one state (q, v) of the tree fixes, a list entry per body."""

    pose: list[Pose]  # of K_i in K_p(i)
    subspace: list[Array]  # S_i (6, k), with a mimic joint's ratio: the block of C in eq. (10)
    twist: list[Array]  # v̌_i (..., 6)
    bias: list[Array]  # the block of ā_rel (..., 6): what of ǎ_i neither ǎ_p(i) nor η̇ explains, eq. (11)


def joint_position(body: Body, q: Array) -> Array:
    """β_i (..., nq_i) of one joint; a mimic joint's follows its leader."""
    beta = q[..., body.q]
    return beta if body.ratio == 1 and body.offset == 0 else body.ratio * beta + body.offset


def joint_velocity(body: Body, v: Array) -> Array:
    """η_i (..., nv_i) of one joint."""
    return v[..., body.v] if body.ratio == 1 else body.ratio * v[..., body.v]


def poses(tree: Tree, q: Array) -> list[Pose]:
    """The pose of every body in its parent's frame, at q (..., nq)."""

    def pose(body: Body) -> Pose:
        return Pose(body.rotation, body.translation) @ Pose(*body.joint.pose(joint_position(body, q)))

    return [pose(body) for body in tree.bodies]


def world_poses(tree: Tree, pose: list[Pose]) -> list[Pose]:
    """The pose of every body in the ground's frame."""
    world: list[Pose] = []
    for body, X in zip(tree.bodies, pose, strict=True):
        world.append(world[body.parent] @ X if body.parent >= 0 else X)
    return world


def motion(tree: Tree, q: Array, v: Array) -> Motion:
    """Poses, motion subspaces, twists and bias accelerations at q (..., nq), v (..., nv)."""
    out = Motion(poses(tree, q), [], [], [])
    for body, X in zip(tree.bodies, out.pose, strict=True):
        beta, eta = joint_position(body, q), joint_velocity(body, v)
        S = body.joint.motion(beta)
        relative = mul(S, eta)

        # Outward: v̌_i = −B_ip v̌_p + S_i η_i; the ground rests.
        parent = out.twist[body.parent] if body.parent >= 0 else np.zeros(6)
        carried = twist_to_child(X, parent)
        out.twist.append(carried + relative)

        # Centripetal, Coriolis and the joint's own share.
        w, wp = angular(carried), angular(parent)
        centripetal = mul(transpose(X.R), cross(wp, cross(wp, X.r)))
        bias = joined(cross(w, angular(relative)), centripetal + 2.0 * cross(w, linear(relative)))
        own = body.joint.bias(beta, eta)
        out.bias.append(bias if own is None else bias + own)
        out.subspace.append(S if body.ratio == 1 else body.ratio * S)
    return out


def accelerations(tree: Tree, state: Motion, ground: Array, vdot: Array | None = None) -> list[Array]:
    """ǎ_i (..., 6) of all bodies for η̇ (..., nv) and the ground's acceleration (6,), eq. (11). η̇ = None gives ā of eq. (15)."""
    out: list[Array] = []
    for body, X, S, bias in zip(tree.bodies, state.pose, state.subspace, state.bias, strict=True):
        a = twist_to_child(X, out[body.parent] if body.parent >= 0 else ground) + bias
        out.append(a if vdot is None else a + mul(S, vdot[..., body.v]))
    return out


def falling_ground(gravity: Array) -> Array:
    """The ground's acceleration (6,) that acts like gravity (3,): free fall is rest in a ground that accelerates by −g."""
    return joined(np.zeros(3), -np.asarray(gravity))


def rate(tree: Tree, q: Array, v: Array) -> Array:
    """β̇ = H(β) η (..., nq), eq. (5)."""
    owners = [body for body in _owners(tree) if body.joint.nq]
    if not any(body.joint.rated for body in owners):
        return v
    return joined(*(body.joint.rate(q[..., body.q], v[..., body.v]) for body in owners))


def side_conditions(tree: Tree, q: Array) -> list[tuple[Body, Array]]:
    """φ(β) (...) of each joint that has one, eq. (6)."""
    found = ((body, body.joint.side_condition(q[..., body.q])) for body in _owners(tree))
    return [(body, phi) for body, phi in found if phi is not None]


def project(tree: Tree, q: Array) -> Array:
    """q (..., nq) with every Euler-parameter quadruple back at unit length."""
    if not any(body.joint.rated for body in tree.bodies):
        return q
    return joined(*(body.joint.project(q[..., body.q]) for body in _owners(tree) if body.joint.nq))


def _owners(tree: Tree) -> list[Body]:
    """The first body of each coordinate, in the order of q: mimic joints repeat their leader's."""
    first = {body.q.start: body for body in reversed(tree.bodies) if body.joint.nq}
    return [first[start] for start in sorted(first)]
