"""Measuring: contenders take turns, medians are reported, and beside each time stands its error against 50 digits."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arithmetic import Array
from ..errors import MissingPackageError
from ..questions import ForwardDynamics
from ..robot import Robot

CHECKED = 8  # states whose results are compared with 50 digits before any time is taken


@dataclass(frozen=True)
class Row:
    """One kind of work: seconds per state and worst relative error, of robodyn and of the peer."""

    work: str
    seconds: float
    peer_seconds: float
    error: float
    peer_error: float

    def cells(self) -> tuple[str, ...]:
        """For a table."""
        ratio = self.peer_seconds / self.seconds
        return (
            self.work,
            f"{self.seconds * 1e6:.3g}",
            f"{self.peer_seconds * 1e6:.3g}",
            f"{ratio:.1f}",
            f"{self.error:.1e}",
            f"{self.peer_error:.1e}",
        )


@dataclass(frozen=True)
class Result:
    """What was measured on one robot."""

    rows: list[Row]
    operations: dict[str, int]  # floating-point operations of forward dynamics, by formalism
    first_call: float  # [s], tracing and compiling included where the cache on disk is empty
    rate: float  # Gflop/s of the batch kernel, counted operations over measured time


def measure(robot: Robot, path: str | os.PathLike[str], *, batch: int = 4096, rounds: int = 9, seed: int = 0) -> Result:
    """Forward dynamics and reactions of random states, in batches and one at a time, beside Pinocchio; one thread each."""
    try:
        from .pinocchio import Pair, pin
    except ImportError as error:
        raise MissingPackageError("the benchmark compares with Pinocchio: pip install 'robodyn[bench]'") from error
    pair, rng = Pair(robot, path), np.random.default_rng(seed)
    q = np.stack([robot.random_state(rng)[0] for _ in range(batch)])
    v, tau = rng.uniform(-2.0, 2.0, (batch, robot.nv)), rng.uniform(-5.0, 5.0, (batch, robot.nv))
    started = time.perf_counter()
    robot.forward_dynamics(q[0], v[0], tau[0])
    first_call = time.perf_counter() - started

    # The same states as Pinocchio wants them: one per column.
    pin_q = np.asfortranarray(np.stack([pair.q(x) for x in q]).T)
    pin_v, pin_tau = (np.asfortranarray(pair.G @ x.T) for x in (v, tau))
    pool, out = pin.ModelPool(pair.model, 1), np.zeros((pair.model.nv, batch), order="F")
    moving = [joint.name for joint in robot.joints if joint.type.nv]

    def pin_reactions() -> None:
        for i in range(0, batch, 16):
            a = pin.aba(pair.model, pair.data, pin_q[:, i], pin_v[:, i], pin_tau[:, i])
            pin.rnea(pair.model, pair.data, pin_q[:, i], pin_v[:, i], a)

    singles = range(min(batch, 256))
    states = [(q[i].copy(), v[i].copy(), tau[i].copy()) for i in singles]
    pin_states = [(pin_q[:, i].copy(), pin_v[:, i].copy(), pin_tau[:, i].copy()) for i in singles]
    jobs: dict[str, tuple[Callable[[], Any], int]] = {
        "batch": (lambda: robot.forward_dynamics(q, v, tau, threads=1), batch),
        "pin batch": (lambda: pin.abaInParallel(1, pool, pin_q, pin_v, pin_tau, out), batch),
        "reactions": (lambda: robot.reactions(q, v, tau, part="total", joints=moving, threads=1), batch),
        "pin reactions": (pin_reactions, len(range(0, batch, 16))),
        "single": (lambda: [robot.forward_dynamics(*state) for state in states], len(states)),
        "pin single": (lambda: [pin.aba(pair.model, pair.data, *state) for state in pin_states], len(states)),
    }

    # Results before times.
    few = slice(0, CHECKED)
    exact = robot.forward_dynamics(q[few], v[few], tau[few], backend="mpmath")
    wrenches = robot.reactions(q[few], v[few], tau[few], part="total", joints=moving, backend="mpmath").array
    errors = {
        "batch": _error(jobs["batch"][0]()[few], exact),
        "pin batch": _error(np.stack([pair.forward_dynamics(*s) for s in zip(q[few], v[few], tau[few], strict=True)]), exact),
        "reactions": _error(jobs["reactions"][0]().array[few], wrenches),
        "single": _error(np.stack([robot.forward_dynamics(*s) for s in states[few]]), exact),
    }
    theirs = []
    for state in zip(q[few], v[few], tau[few], strict=True):
        found = pair.joint_wrenches(state[0], state[1], pair.forward_dynamics(*state))
        theirs.append(np.stack([found[name] for name in moving]))
    errors["pin reactions"], errors["pin single"] = _error(np.stack(theirs), wrenches), errors["pin batch"]

    seconds = _medians(jobs, rounds)
    names = {
        "batch": f"forward dynamics, batch of {batch}",
        "reactions": "and all moving joints' wrenches",
        "single": "forward dynamics, one call",
    }
    rows = [Row(name, seconds[key], seconds[f"pin {key}"], errors[key], errors[f"pin {key}"]) for key, name in names.items()]
    flops = robot._on_earth.evaluator.kernel(ForwardDynamics("auto")).program.operations
    return Result(rows, robot._on_earth.evaluator.operations, first_call, flops / seconds["batch"] / 1e9)


def _medians(jobs: dict[str, tuple[Callable[[], Any], int]], rounds: int) -> dict[str, float]:
    """Median seconds per state of each job; all of them in turn in every round, each warmed up by a run that does not count."""
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, (job, _) in jobs.items():
            job()
            started = time.perf_counter()
            job()
            times[name].append(time.perf_counter() - started)
    return {name: float(np.median(t)) / jobs[name][1] for name, t in times.items()}


def _error(found: Array, exact: Array) -> float:
    """The largest error of any state, relative to the largest entry of that state's result."""
    exact = exact.reshape(len(exact), -1)
    errors = abs(found.reshape(len(exact), -1) - exact).max(-1) / abs(exact).max(-1)
    return float(errors.max())
