"""Positions, velocities and accelerations of all bodies: one outward sweep each, eqs. (10)-(15).

Everything is resolved in the body's own frame K_i, so nothing depends on how far the robot is from the origin.
"""

from typing import NamedTuple

import numpy as np

from ..arithmetic import Array, known
from ..arithmetic.vectors import cross, joined, mul, transpose
from ..model import Body, Field, Tree
from .spatial import Pose, angular, linear, twist_to_child


class Motion(NamedTuple):
    """What one state (t, q, v) of the tree fixes, an entry per body."""

    pose: Field  # Pose of K_i in K_p(i)
    subspace: Field  # S_i (6, k), with a mimic joint's ratio: the block of C in eq. (10)
    twist: Field  # v̌_i (..., 6)
    bias: Field  # the block of ā_rel (..., 6): what of ǎ_i neither ǎ_p(i) nor η̇ explains, eq. (11)


def joint_position(body: Body, beta: Array) -> Array:
    """β_i (..., nq_i) of one joint from its own or its leader's coordinates."""
    return beta if known(body.ratio) == 1 and known(body.offset) == 0 else body.ratio * beta + body.offset


def joint_velocity(body: Body, eta: Array) -> Array:
    """η_i (..., nv_i) of one joint from its own or its leader's velocities."""
    return eta if known(body.ratio) == 1 else body.ratio * eta


def relative_pose(body: Body, beta: Array, t: Array | float = 0.0) -> Pose:
    """The pose of K_i in K_p(i): ř = ř(ř_p, β, t), eq. (9)."""
    return Pose(body.rotation, body.translation) @ Pose(*body.joint.at(t).pose(joint_position(body, beta)))


def poses(tree: Tree, q: Array, t: Array | float = 0.0) -> Field:
    """The pose of every body in its parent's frame, at q (..., nq) and the time t [s]."""
    return tree.each(relative_pose, tree.split(q, "q"), *_times(tree, t))


def _times(tree: Tree, t: Array | float) -> tuple[Field, ...]:
    """The time as a record of every body, where a joint depends on it."""
    return (tree.everywhere(np.asarray(t)),) if tree.rheonomic else ()


def world_poses(tree: Tree, pose: Field) -> Field:
    """The pose of every body in the ground's frame."""

    def outward(_: Body, parent: Pose, X: Pose) -> tuple[Pose, Pose]:
        return (world := parent @ X), world

    return tree.outward(outward, Pose(np.eye(3), np.zeros(3)), pose)


def motion(tree: Tree, q: Array, v: Array, t: Array | float = 0.0) -> Motion:
    """Poses, motion subspaces, twists and bias accelerations at q (..., nq), v (..., nv) and the time t [s]."""

    def outward(body: Body, parent: Array, beta: Array, eta: Array, t: Array | float = 0.0) -> tuple[Array, tuple]:
        X, joint = relative_pose(body, beta, t), body.joint.at(t)
        beta, eta = joint_position(body, beta), joint_velocity(body, eta)
        S = joint.motion(beta)
        relative = mul(S, eta)
        if (drift := joint.drift(beta)) is not None:
            relative = relative + drift

        # v̌_i = −B_ip v̌_p + S_i η_i + v̄_rel,i; the ground rests.
        carried = twist_to_child(X, parent)
        twist = carried + relative

        # Centripetal, Coriolis and the joint's own share.
        w, wp = angular(carried), angular(parent)
        centripetal = mul(transpose(X.R), cross(wp, cross(wp, X.r)))
        bias = joined(cross(w, angular(relative)), centripetal + 2.0 * cross(w, linear(relative)))
        own = joint.bias(beta, eta)
        bias = bias if own is None else bias + own
        return twist, (X, S if known(body.ratio) == 1 else body.ratio * S, twist, bias)

    kept = tree.outward(outward, np.zeros(6), tree.split(q, "q"), tree.split(v, "v"), *_times(tree, t))
    return Motion(*tree.unzip(kept, 4))


def accelerations(tree: Tree, motion: Motion, ground: Array, vdot: Array | None = None) -> Field:
    """ǎ_i (..., 6) of all bodies for η̇ (..., nv) and the ground's acceleration (6,), eq. (11). η̇ = None gives ā of eq. (15)."""

    def outward(_: Body, parent: Array, X: Pose, S: Array, bias: Array, change: Array | None = None) -> tuple[Array, Array]:
        a = twist_to_child(X, parent) + bias
        a = a if change is None else a + mul(S, change)
        return a, a

    changes = () if vdot is None else (tree.split(vdot, "v"),)
    return tree.outward(outward, ground, motion.pose, motion.subspace, motion.bias, *changes)


def falling_ground(gravity: Array) -> Array:
    """The ground's acceleration (6,) that acts like gravity (3,): free fall is rest in a ground that accelerates by −g."""
    return joined(np.zeros(3), -np.asarray(gravity))


def rate(tree: Tree, q: Array, v: Array) -> Array:
    """β̇ = H(β) η (..., nq), eq. (5)."""
    if not tree.rated:
        return v
    return tree.coordinates(tree.each(lambda body, beta, eta: body.joint.rate(beta, eta), tree.split(q, "q"), tree.split(v, "v")))


def side_conditions(tree: Tree, q: Array) -> list[tuple[Body, Array]]:
    """φ(β) (...) of each joint that has one, eq. (6)."""
    phi = tree.each(lambda body, beta: body.joint.side_condition(beta), tree.split(q, "q")) if tree.rated else []
    return [(tree.bodies[i], phi[i]) for i in tree.rated]


def project(tree: Tree, q: Array) -> Array:
    """q (..., nq) with every Euler-parameter quadruple back at unit length."""
    return tree.coordinates(tree.each(lambda body, beta: body.joint.project(beta), tree.split(q, "q"))) if tree.rated else q
