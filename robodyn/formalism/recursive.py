"""Articulated bodies: outward velocities, inward inertias, outward accelerations. O(n)."""

from ..algebra import column, dot
from ..arithmetic import Array
from ..errors import ModelError
from ..model import Tree
from .kinematics import falling_ground, motion
from .newton_euler import Wrenches, gyroscopic
from .solution import Solution
from .spatial import ArticulatedInertia, twist_to_child, wrench_to_parent


def recursive(tree: Tree, q: Array, v: Array, tau: Array, wrenches: Wrenches, gravity: Array) -> Solution:
    """η̇ (..., nv) at q (..., nq), v (..., nv) for the coordinate forces tau (..., nv).

    A joint of several freedoms is eliminated one freedom at a time: every pivot is a scalar.
    """
    if tree.has_mimic:
        raise ModelError("formalism='recursive' cannot eliminate coordinates that several joints share (mimic): use 'nonrecursive'")

    # Pass 1, outward: positions, velocities, velocity-dependent accelerations.
    state = motion(tree, q, v)
    A = [ArticulatedInertia.of(body.inertia) for body in tree.bodies]
    p = [-gyroscopic(body.inertia, twist) for body, twist in zip(tree.bodies, state.twist, strict=True)]
    for i, f in wrenches.items():
        p[i] = p[i] - f

    # Pass 2, inward: what each joint lets through of the inertia A and the bias wrench p beyond it.
    eliminated: dict[int, tuple[Array, Array, Array, Array]] = {}
    for i in reversed(range(len(tree.bodies))):
        body = tree.bodies[i]
        for k in reversed(range(body.joint.nv)):
            s = state.subspace[i][..., :, k]
            U = A[i].times(s)
            pivot, e = dot(s, U), tau[..., body.v.start + k] - dot(s, p[i])
            d = 1.0 / pivot
            eliminated[body.v.start + k] = (U, d, e, pivot)
            A[i] = A[i].without(s, U, d)
            p[i] = p[i] + U * column(d * e)
        if body.parent >= 0:
            X, felt = state.pose[i], p[i] + A[i].times(state.bias[i])
            A[body.parent] = A[body.parent] + A[i].to_parent(X)
            p[body.parent] = p[body.parent] + wrench_to_parent(X, felt)

    # Pass 3, outward: accelerations.
    vdot: list[Array] = []
    a: list[Array] = []
    for i, body in enumerate(tree.bodies):
        a_i = twist_to_child(state.pose[i], a[body.parent] if body.parent >= 0 else falling_ground(gravity)) + state.bias[i]
        for k in range(body.joint.nv):
            U, d, e, _ = eliminated[body.v.start + k]
            vdot.append((e - dot(U, a_i)) * d)
            a_i = a_i + state.subspace[i][..., :, k] * column(vdot[-1])
        a.append(a_i)
    return Solution.stack(vdot, [eliminated[k][3] for k in range(tree.nv)])
