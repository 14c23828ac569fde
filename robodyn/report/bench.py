"""The benchmark: kinds of work, each prepared, compared with 50 digits or a reference, and only then timed."""

import platform
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ..arithmetic import mpmath
from ..errors import InputError, MissingPackageError, RobodynError
from ..evaluation.base_parameters import rounding
from . import chains as long_chains, dynamics, processes, trajectories
from .accuracy import condition
from .subject import Contest, Settings, Subject
from .timing import Timing, interleaved
from .yardstick import yardstick

KINDS: dict[str, Callable[[Subject], Iterator[Any]]] = {
    "batch": dynamics.batch,
    "reactions": dynamics.reactions,
    "call": dynamics.call,
    "rk4": trajectories.rk4,
    "dop853": trajectories.dop853,
    "crowd": trajectories.crowd,
    "first": processes.first_call,
    "import": processes.importing,
    "peak": dynamics.peak,
}
Tick = Callable[[str], None]  # called with what is being done, outside of what is timed


@dataclass(frozen=True)
class Row:
    """What was measured: seconds per unit of work, and errors."""

    kind: str
    work: str
    ours: Timing | None = None
    peer: str = ""
    theirs: Timing | None = None
    error: float | None = None
    peer_error: float | None = None
    note: str = ""

    @property
    def ratio(self) -> float | None:
        """How many times robodyn's time the peer takes."""
        return self.theirs.median / self.ours.median if self.ours and self.theirs else None

    def record(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "ratio": self.ratio}


def rows(subject: Subject, kinds: Sequence[str] = tuple(KINDS), *, script: str | None = None, tick: Tick = lambda _: None) -> Iterator[Row]:
    """The rows of one robot, each as soon as it is measured. script: the yardstick's. InputError for an unknown kind."""
    if unknown := set(kinds) - set(KINDS):
        raise InputError(f"there is no kind of work named {', '.join(sorted(unknown))}; there are {', '.join(KINDS)}")
    _needs_digits()
    for kind in kinds:
        tick(f"{subject.robot.name}: {kind}, preparing and comparing results")
        for found in KINDS[kind](subject):
            yield _timed(found, subject, tick) if isinstance(found, Contest) else Row(*found)
    if script is not None:
        tick(f"{subject.robot.name}: yardstick")
        try:
            for kind, work, ours, theirs, note in yardstick(subject, script):
                yield Row(kind, work, ours, "yardstick", theirs, note=note)
        except RobodynError as error:  # it does not know every joint
            yield Row("yardstick", "beside the yardstick", note=str(error))


def _timed(contest: Contest, subject: Subject, tick: Tick) -> Row:
    """The contenders, taking turns."""
    jobs = [contest.ours] if contest.theirs is None else [contest.ours, contest.theirs]
    rounds = subject.settings.rounds
    times = interleaved(jobs, rounds, lambda i: tick(f"{subject.robot.name}: {contest.kind}, round {i + 1} of {rounds}"))
    both = [Timing.of(t, units) for t, units in zip(times, (contest.units, contest.peer_units), strict=False)]
    theirs = both[1] if len(both) > 1 else None
    return Row(contest.kind, contest.work, both[0], contest.peer, theirs, contest.error, contest.peer_error, contest.note)


def _needs_digits() -> None:
    """MissingPackageError where the extra is not installed: without the peers a benchmark says something, without errors it does not."""
    try:
        mpmath()
    except MissingPackageError as error:
        raise MissingPackageError("the benchmark measures errors in 50 digits, and needs mpmath: pip install 'robodyn[bench]'") from error


def chain_rows(counts: Sequence[int], settings: Settings, tick: Tick = lambda _: None) -> Iterator[Row]:
    """A row per chain of n joints, seconds per joint; its remark has the memory and the first call."""
    _needs_digits()
    for n in counts:
        tick(f"chain of {n} joints")
        for _, found in long_chains.chains([n], settings.rounds):
            work = f"chain of {n} joints, per joint"
            if isinstance(found, str):
                yield Row("chain", work, note=found)
                continue
            memory = f"{found['memory'] / 2**20:.0f} MB, " if found["memory"] else ""
            first = f"first call {found['first_call']:.2f} s, cached {found['cached']:.2f} s"
            note = f"{memory}{first}" + (f", κ {found['condition']:.0e}" if "condition" in found else "")
            theirs = Timing(**found["theirs"]) if "theirs" in found else None
            measured = Timing(**found["ours"]), found.get("peer", ""), theirs, found["error"], found.get("peer_error")
            yield Row("chain", work, *measured, note)


def facts(subject: Subject) -> dict[str, Any]:
    """What belongs above a robot's rows: size, operations per route, the condition of the checked states.

    Of "nonrecursive" also those with base inertial parameters and without, whichever it takes, and the loss of digits that decided it:
    what they make of the error of forward dynamics.
    """
    _needs_digits()
    q = subject.few[0]
    kappa = max(condition(subject.robot, x, a) for x, a in zip(q, subject.exact, strict=True))
    routes = subject.scene.evaluator.routes
    found = {"name": subject.robot.name, "nv": subject.robot.nv, "condition": kappa, "operations": routes.operations}
    if (plain := routes.operations_with(reduce=False)) is not None:
        error, reduced = rounding(subject.robot)
        found |= {"unreduced": plain, "reduced": routes.operations_with(reduce=True)}
        found["reduction_error"] = reduced / error if error else 1.0
    return found


def machine() -> dict[str, Any]:
    """Where this was measured."""
    from ..engine.run.compile import cpu, lanes

    return {"cpu": cpu()[0], "lanes": lanes(), "system": platform.platform(), "python": platform.python_version()}
