"""Whether a motion is determined: what is refused, by name, when accelerations are asked for."""

from collections.abc import Iterable, Mapping

import numpy as np

from ..arithmetic import EPS, Array
from ..errors import ModelError
from ..formalism.solution import Solution
from ..loads import Load, State
from ..loads.checked import joint_forces, link_wrenches
from ..model import Mechanism, Tree

FEW = 60  # freedoms up to which the bound of the inertia that a joint can have to move, in any position, is a useful scale


def smallest_pivots(tree: Tree, solution: Solution, eps: float = EPS) -> Array:
    """What each pivot (nv,) must exceed: it is left over from eliminations of some dozens of roundings each.

    For few freedoms, a share of what it can have to move in any position, after nv eliminations, whose roundings add up as a random walk
    does: were all of one sign, float32 would refuse robots that it can do. (What is left of a pivot that is zero is one such rounding at
    most: tests/test_trust.py.) In a chain of thousands that bound grows without saying anything; there it is what the joint has to move
    with its children locked, if the route knows it: errors from further away have passed through the freedoms between.
    """
    if tree.nv <= FEW or solution.moved is None:
        return 64 * np.sqrt(tree.nv + 1) * eps * tree.pivot_scales
    return 128 * eps * solution.moved


def refuse_impossible(mechanism: Mechanism, tree: Tree) -> None:
    """ModelError where a body has a negative moment of inertia: no matter moves so."""
    for body in tree.bodies:
        moments = np.linalg.eigvalsh(body.inertia.about_own_centre)
        if body.inertia.mass < 0:
            raise ModelError(
                f"the body of link {mechanism.links[body.link].name!r} has the mass {body.inertia.mass:.6g} kg: it cannot be negative"
            )
        # The sums and Steiner terms of a lumped body leave a few roundings of Θ about O.
        if moments[0] < -64 * EPS * np.trace(abs(body.inertia.tensor)):
            name, values = mechanism.links[body.link].name, ", ".join(f"{m:.6g}" for m in moments)
            raise ModelError(
                f"the body of link {name!r} has the principal moments of inertia {values}: no matter has a negative one. "
                "Correct its <inertial> and those of the links fixed to it"
            )


def refuse_massless(mechanism: Mechanism, tree: Tree) -> None:
    """ModelError where a joint moves nothing that has mass: the motion is undetermined whatever the state."""
    heavy = [not body.inertia.is_zero for body in tree.bodies]
    for i in reversed(range(len(tree.bodies))):
        if (p := tree.bodies[i].parent) >= 0:
            heavy[p] = heavy[p] or heavy[i]
    light = [mechanism.joints[b.link].name for b, h in zip(tree.bodies, heavy, strict=True) if b.joint.nv and not h]
    if light:
        raise ModelError(
            f"the motion of robot {mechanism.name!r} is undetermined: the links moved by {', '.join(map(repr, light))} have no mass. "
            f"Give one of them an <inertial>, or lock the joint: rd.load(…, locked={{{light[0]!r}: 0.0}})"
        )


def refuse_undetermined(mechanism: Mechanism, tree: Tree, solution: Solution, eps: float = EPS) -> None:
    """ModelError where a freedom showed no inertia, or an acceleration is not finite; it names the joint and the state."""
    pivots, smallest = solution.pivots.astype(float), smallest_pivots(tree, solution, eps).astype(float)
    lost = ~((pivots > smallest) & np.isfinite(pivots))
    if lost.any():
        refuse_massless(mechanism, tree)
        # Of the first state with one, the freedom eliminated first: what comes after it is spoilt by it.
        first = tuple(int(i) for i in np.argwhere(lost.any(-1))[0])
        index = (*first, int(np.flatnonzero(lost[first])[-1]))
        if not np.isfinite(pivots[index]):
            name = _joint(mechanism, index[-1])
            raise ModelError(f"the inertia that joint {name!r} moves is not finite{_at(first)}: displacements are too large for float64")
        least = np.broadcast_to(smallest, pivots.shape)[index]
        raise ModelError(
            f"joint {_joint(mechanism, index[-1])!r} of {mechanism.name!r} has no inertia to accelerate{_at(index[:-1])}: "
            f"its pivot is {pivots[index]:.3g} and must exceed {least:.3g}. Give the links beyond it mass off its axis, or lock it"
            + ("; or leave dtype out, as float64 may resolve it" if eps > EPS else "")
        )
    bad = np.argwhere(~np.isfinite(solution.vdot.astype(float)))
    if len(bad):
        index = tuple(int(i) for i in bad[0])
        raise ModelError(
            f"the acceleration of joint {_joint(mechanism, index[-1])!r} is not finite{_at(index[:-1])}: "
            "velocities or forces are too large for float64"
        )


def _joint(mechanism: Mechanism, column: int) -> str:
    """The joint that owns a column of v."""
    return next(mechanism.joints[i].name for i in mechanism.owners if mechanism.v_slices[i].start <= column < mechanism.v_slices[i].stop)


def _at(index: tuple[int, ...]) -> str:
    return f" in state [{', '.join(map(str, index))}]" if index else ""


HUGE = 1e150  # beyond this the square of a number is beyond float64


def refuse_infinite_loads(loads: Iterable[tuple[Load, State]], state: State) -> None:
    """ModelError where a load's force is not finite, or too large at a state that is not: it names the load, where and when.

    loads: each with the state as it sees it.
    """
    batch = np.broadcast_shapes(np.shape(state.t), state.q.shape[:-1], state.v.shape[:-1])
    bound = HUGE if all((abs(x) < HUGE**0.5).all() for x in (state.q, state.v)) else np.inf
    for load, seen in loads:
        forces = [("force in joint", i, force) for i, force in joint_forces(load, seen).items()]
        wrenches = [("wrench on link", i, wrench) for i, wrench in link_wrenches(load, seen).items()]
        for what, i, values in forces + wrenches:
            values = np.broadcast_to(values, (*batch, values.shape[-1]))
            bad = np.argwhere(~(abs(values) < bound))
            if not len(bad):
                continue
            index = tuple(int(k) for k in bad[0])
            value, t = values[index], float(np.broadcast_to(state.t, batch)[index[:-1]])
            name = state.mechanism.link_names[i] if "link" in what else state.mechanism.joints[i].name
            why = "too large for float64" if np.isfinite(value) else "not finite, as after a division by zero or growth without bound"
            raise ModelError(
                f"the {what} {name!r} that the load {type(load).__name__} gives is {value:.6g} at t={t:.9g} s{_at(index[:-1])}: {why}. "
                "Correct its law, or limit it with np.clip"
            )


def refuse_infinite(values: Mapping[str, Array], shapes: Mapping[str, tuple[int, ...]]) -> None:
    """ModelError where an answer is not finite although every argument was; shapes: of one state's answer."""
    for name, x in values.items():
        bad = np.argwhere(~np.isfinite(np.asarray(x).astype(float)))
        if len(bad):
            index = tuple(int(i) for i in bad[0])[: len(bad[0]) - len(shapes[name])]
            kind = "float32" if np.asarray(x).dtype == np.float32 else "float64"
            raise ModelError(f"the result{_at(index)} is not finite: displacements, velocities or forces are too large for {kind}")
