"""Articulated bodies: outward velocities, inward inertias, outward accelerations. O(n).

Featherstone, The calculation of robot dynamics using articulated-body inertias, Int. J. Robotics Research 2, 1983; Rigid Body Dynamics
Algorithms, Springer 2008, section 7.3.
"""

from typing import NamedTuple

from ..arithmetic import Array
from ..arithmetic.vectors import column, dot, stacked
from ..errors import ModelError
from ..model import Body
from .kinematics import falling_ground
from .newton_euler import Wrenches, gyroscopic
from .solution import Solution
from .spatial import ArticulatedInertia, Pose, angular, linear, twist_to_child, wrench_to_parent
from .state import State


class Freedom(NamedTuple):
    """One freedom s, eliminated from the inertia A and the bias wrench p that it moves."""

    U: Array  # A s (..., 6)
    e: Array  # τ − sᵀp (...)
    d: Array  # 1 / pivot (...)
    pivot: Array  # sᵀ A s (...)
    moved: Array  # (...): how large sᵀ A s would be, were the joints of the children locked: what rounding errors are measured by


def recursive(state: State, tau: Array, wrenches: Wrenches, gravity: Array) -> Solution:
    """η̇ (..., nv) of a state for the coordinate forces tau (..., nv). ModelError where joints share coordinates (mimic).

    A joint of several freedoms is eliminated one freedom at a time: every pivot is a scalar.
    """
    tree = state.tree
    if tree.has_mimic:
        raise ModelError("formalism='recursive' cannot eliminate coordinates that several joints share (mimic): use 'nonrecursive'")

    # Pass 1, outward: positions, velocities, velocity-dependent accelerations.
    motion = state.motion

    # Pass 2, inward: what each joint lets through of the inertia A and the bias wrench p beyond it.
    def inward(body: Body, arrived: list, X: Pose, S: Array, twist: Array, bias: Array, tau_i: Array, applied: Array | None):
        A, p = ArticulatedInertia.of(body.inertia), -gyroscopic(body.inertia, twist)
        p, size = p if applied is None else p - applied, A.size()
        for A_child, p_child, size_child in arrived:
            A, p, size = A + A_child, p + p_child, size + size_child

        freedoms, locked = [], A
        for k in reversed(range(body.joint.nv)):
            s = S[..., :, k]
            U = A.times(s)
            pivot, e = dot(s, U), tau_i[..., k] - dot(s, p)
            d = 1.0 / pivot
            moved = dot(angular(s), angular(s)) * size[..., 0] + dot(linear(s), linear(s)) * size[..., 1]
            freedoms.insert(0, Freedom(U, e, d, pivot, moved))
            A, p = A.without(s, U, d), p + U * column(d * e)
        return (A.to_parent(X), wrench_to_parent(X, p + A.times(bias)), locked.size(X.r)), tuple(freedoms)

    eliminated = tree.inward(inward, *motion, tree.split(tau, "v"), tree.on_bodies(wrenches))

    # Pass 3, outward: accelerations.
    def outward(_: Body, parent: Array, X: Pose, S: Array, bias: Array, freedoms: tuple[Freedom, ...]):
        a, found = twist_to_child(X, parent) + bias, []
        for k, freedom in enumerate(freedoms):
            found.append((freedom.e - dot(freedom.U, a)) * freedom.d)
            a = a + S[..., :, k] * column(found[k])
        return a, (stacked(found), stacked([freedom.pivot for freedom in freedoms]), stacked([freedom.moved for freedom in freedoms]))

    found = tree.outward(outward, falling_ground(gravity), motion.pose, motion.subspace, motion.bias, eliminated)
    return Solution(*(tree.gathered(x) for x in tree.unzip(found, 3)))
