"""Forward dynamics and reactions of random states, in batches and one at a time, beside Pinocchio; one thread each."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..dynamics.questions import ForwardDynamics
from ..engine.run.peak import fused_multiply_adds
from .accuracy import error
from .subject import Contest, Subject

THINNED = 16  # a Python loop of Pinocchio takes every so many states of the batch: the time per state is the same
SINGLES = 256


def batch(subject: Subject) -> Iterator[Contest]:
    """The user's C-ordered arrays in one call, beside Pinocchio's abaInParallel with one thread on arrays of its own order.

    Both write into an array that is there already.
    """
    robot, (q, v, tau), n = subject.robot, subject.states, len(subject.states[0])
    vdot = np.empty((n, robot.nv))

    def ours() -> Any:
        return robot.forward_dynamics(q, v, tau, threads=1, out=vdot)

    theirs: dict[str, Any] = {"note": subject.pinocchio}
    if not isinstance(pair := subject.pinocchio, str):
        pin, name = _pinocchio()
        pool, out = pin.ModelPool(pair.model, 1), np.zeros((pair.model.nv, n), order="F")
        arrays = [np.asfortranarray(x) for x in (np.stack([pair.q(x) for x in q]).T, pair.G @ v.T, pair.G @ tau.T)]

        def aba() -> Any:
            pin.abaInParallel(1, pool, *arrays, out)

        aba()
        found = None if pair.has_mimic else error((pair.G.T @ out[:, : len(subject.exact)]).T, subject.exact)
        theirs = {"peer": f"{name} abaInParallel", "theirs": aba, "peer_units": n, "peer_error": found, "note": _remark(pair)}
    yield Contest("batch", f"forward dynamics, batch of {n}", ours, n, error=error(ours()[: len(subject.exact)], subject.exact), **theirs)


def reactions(subject: Subject) -> Iterator[Contest]:
    """The same, and the whole wrench through every moving joint, beside a loop of pin.aba and pin.rnea; then through the fixed ones too.

    That loop finds the wrenches of the moving joints alone, which it goes on doing beside all of robodyn's.
    """
    robot, few = subject.robot, subject.few
    moving = [joint.name for joint in robot.joints if joint.type.nv]
    every = [joint.name for joint in robot.joints]

    def asked(joints: list[str]) -> tuple[Callable[[], Any], Any]:
        (q, v, tau), wrenches = subject.states, np.empty((len(subject.states[0]), len(joints), 6))
        exact = robot.reactions(*few, part="total", joints=joints, backend="mpmath").array
        return lambda: robot.reactions(q, v, tau, part="total", joints=joints, threads=1, out=wrenches), exact

    theirs: dict[str, Any] = {"note": subject.pinocchio}
    if not isinstance(pair := subject.pinocchio, str):
        pin, name = _pinocchio()
        model, data, (q, v, tau) = pair.model, pair.data, subject.states
        states = [(pair.q(q[i]), pair.G @ v[i], pair.G @ tau[i]) for i in range(0, len(q), THINNED)]

        def loop() -> None:
            for state in states:
                a = pin.aba(model, data, *state)
                pin.rnea(model, data, state[0], state[1], a)

        found = [pair.joint_wrenches(q, v, pair.forward_dynamics(q, v, tau)) for q, v, tau in zip(*few, strict=True)]
        here = np.array([[wrench[joint] for joint in moving] for wrench in found])
        theirs = {"peer": f"{name} loop of aba + rnea", "theirs": loop, "peer_units": len(states), "note": _remark(pair)}
        theirs["peer_error"] = error(here, asked(moving)[1])
    for joints in (moving, every) if every != moving else (moving,):
        ours, exact = asked(joints)
        work, units = "every moving joint's wrench" if joints is moving else f"all {len(every)} joints' wrenches", len(subject.states[0])
        yield Contest("reactions", f"… and {work}", ours, units, error=error(ours().array[: len(exact)], exact), **theirs)
        theirs |= {"note": "the peer finds those of moving joints"} if theirs.get("peer") else {}


def call(subject: Subject) -> Iterator[Contest]:
    """One forward_dynamics(q, v, tau) from Python, beside one pin.aba(model, data, q, v, tau)."""
    states = [tuple(x.copy() for x in state) for state in zip(*(x[:SINGLES] for x in subject.states), strict=True)]
    forward_dynamics = subject.robot.forward_dynamics
    forward_dynamics(*states[0])
    forward_dynamics = subject.robot.forward_dynamics  # answered by a built-in function from the second call on

    def ours() -> Any:
        return [forward_dynamics(q, v, tau) for q, v, tau in states]

    theirs: dict[str, Any] = {"note": subject.pinocchio}
    if not isinstance(pair := subject.pinocchio, str):
        pin, name = _pinocchio()
        aba, model, data = pin.aba, pair.model, pair.data
        there = [(pair.q(q), pair.G @ v, pair.G @ tau) for q, v, tau in states]

        def loop() -> Any:
            return [aba(model, data, q, v, tau) for q, v, tau in there]

        answers = np.stack([pair.forward_dynamics(*state) for state in zip(*subject.few, strict=True)])
        theirs = {"peer": f"{name} aba", "theirs": loop, "peer_units": len(there), "peer_error": error(answers, subject.exact)}
        theirs["note"] = _remark(pair)
    found = np.array(ours()[: len(subject.exact)])
    yield Contest("call", "forward dynamics, one call from Python", ours, len(states), error=error(found, subject.exact), **theirs)


def peak(subject: Subject) -> Iterator[Contest]:
    """The batch beside as many operations in fused multiply-adds that wait for nothing: the ratio is the share of the peak rate."""
    robot, (q, v, tau), n = subject.robot, subject.states, len(subject.states[0])
    operations = subject.scene.evaluator.kernel(ForwardDynamics("auto")).program.operations * n
    function, per_turn = fused_multiply_adds()
    turns = max(1, round(operations / per_turn))

    vdot = np.empty((n, robot.nv))

    def ours() -> Any:
        return robot.forward_dynamics(q, v, tau, threads=1, out=vdot)

    work = f"the batch's {operations // n} operations per state"
    units = {"units": n, "peer_units": n * turns * per_turn / operations}
    yield Contest("peak", work, ours, peer="bare multiply-adds", theirs=lambda: function(turns), **units)


def _pinocchio() -> tuple[Any, str]:
    from .peers.pinocchio import NAME, pin

    return pin, NAME


def _remark(pair: Any) -> str:
    return f"Pinocchio moves mimic joints freely: {pair.model.nv} dof" if pair.has_mimic else ""
