"""Chains of n revolute joints: time per joint of one forward_dynamics(q, v, tau), and the memory that the process needed.

Each chain has a process of its own, so that its memory is its own. Pinocchio stands beside short chains; it needs more than 24 GB for
1000 joints, for the derivatives that its data has room for. Errors are against 50 digits.
"""

import contextlib
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from ..arithmetic import Array
from ..errors import RobodynError
from ..random import random_robot
from ..robot import Robot
from ..system import cache
from .accuracy import condition, error
from .timing import Timing, fresh, interleaved

COUNTS = (100, 1000, 10000)
PINOCCHIO_UP_TO = 200
CONDITION_UP_TO = 300  # joints: κ costs n³


def chains(counts: Sequence[int], rounds: int) -> Iterator[tuple[int, dict | str]]:
    """n and what `measure` found; or why nothing was."""
    for n in counts:
        with tempfile.TemporaryDirectory() as folder:  # of compiled kernels: empty for the first call, filled for the second
            run = partial(fresh, **{cache.VARIABLE: folder})
            try:
                found = run(f"from robodyn.report.chains import measure; measure({n}, {rounds})")
                yield n, found | {"cached": run(f"from robodyn.report.chains import asked; print(asked({n})[2])")}
            except RobodynError as problem:
                yield n, str(problem)


def asked(n: int) -> tuple[Robot, tuple[Array, Array, Array], float]:
    """A chain of n joints, a state of it, and the seconds of the first call."""
    rng = np.random.default_rng(n)
    robot = random_robot(rng, n, branching=0.0, joint_types=("revolute",))
    state = (*robot.random_state(rng), rng.uniform(-5.0, 5.0, n))
    started = time.perf_counter()
    robot.forward_dynamics(*state)
    return robot, state, time.perf_counter() - started


def measure(n: int, rounds: int) -> None:
    """Measure one chain in this process, and print what was found as JSON."""
    robot, (q, v, tau), seconds = asked(n)
    found: dict[str, object] = {"first_call": seconds, "memory": _most_memory()}
    calls = max(1, 2000 // n)  # several milliseconds

    def ours() -> None:
        for _ in range(calls):
            robot.forward_dynamics(q, v, tau)

    jobs, answers = [ours], {"error": robot.forward_dynamics(q, v, tau)}
    if n <= PINOCCHIO_UP_TO:
        try:
            from .peers.pinocchio import NAME, chain_model, pin
        except ImportError:
            pass
        else:
            model = chain_model(robot)
            data = model.createData()

            def theirs() -> None:
                for _ in range(calls):
                    pin.aba(model, data, q, v, tau)

            jobs.append(theirs)
            answers["peer_error"] = pin.aba(model, data, q, v, tau).copy()
            found["peer"] = f"{NAME} aba"
    exact = robot.forward_dynamics(q, v, tau, backend="mpmath", formalism="recursive")
    found |= {name: error(answer[None], exact[None]) for name, answer in answers.items()}
    if n <= CONDITION_UP_TO:
        found["condition"] = condition(robot, q, exact)
    for name, times in zip(("ours", "theirs"), interleaved(jobs, rounds), strict=False):
        found[name] = vars(Timing.of(times, calls * n))
    print(json.dumps(found))


def _most_memory() -> int | None:
    """The largest memory [bytes] that this process has had resident; None where the system does not tell."""
    # Linux's ru_maxrss is at least what the parent had when it started this process: here its own peak is asked for.
    with contextlib.suppress(OSError), open("/proc/self/status") as file:
        return next((int(line.split()[1]) * 1024 for line in file if line.startswith("VmHWM:")), None)
    try:
        import resource
    except ImportError:  # Windows
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
