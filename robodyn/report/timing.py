"""Measuring time: contenders take turns in every round, medians are reported and quartiles show the spread."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RobodynError

Job = Callable[[], Any]
SHORT = 0.1  # [s]: a job of less is run once, unmeasured, before each measurement, so that its data is in the cache as in a user's loop
MOST_RUNS = 1000  # of a job in a round
PATIENCE = 20.0  # [s] of measuring slow jobs, after which the rounds are as few as FEWEST
FEWEST = 3


@dataclass(frozen=True)
class Timing:
    """Seconds per unit of work: the median of the rounds and its quartiles."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, seconds: Sequence[float], units: float = 1.0) -> "Timing":
        """From the times of several rounds, `units` of work in each."""
        low, median, high = np.percentile(np.asarray(seconds) / units, (25, 50, 75))
        return cls(float(median), float(low), float(high))

    def __str__(self) -> str:
        scale, unit = next((s, u) for s, u in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns")) if self.median >= s or u == "ns")
        return f"{self.median / scale:.3g} ({self.low / scale:.3g}…{self.high / scale:.3g}) {unit}"


def interleaved(jobs: Sequence[Job], rounds: int, tick: Callable[[int], None] = lambda _: None) -> list[list[float]]:
    """Seconds that a run of each job took in each round; who goes first changes from round to round. First runs do not count.

    In a round, each is run as many times as take about as long as the slowest: whatever else the machine does is then in the way of all,
    while a short job alone would slip through between. Jobs that take seconds get fewer rounds, see PATIENCE. tick: called with the
    number of the round, outside of what is timed.
    """
    took = [first if (first := _timed(job)) >= SHORT else min(first, _timed(job)) for job in jobs]
    runs = [min(MOST_RUNS, max(1, round(max(took) / max(t, 1e-9)))) for t in took]
    times: list[list[float]] = [[] for _ in jobs]
    for i in range(rounds):
        if i >= FEWEST and sum(n * sum(t) for n, t in zip(runs, times, strict=True)) > PATIENCE * len(jobs):
            break
        tick(i)
        for j in range(len(jobs)) if i % 2 == 0 else reversed(range(len(jobs))):
            if took[j] < SHORT:
                jobs[j]()
            times[j].append(_timed(jobs[j], runs[j]))
    return times


def _timed(job: Job, runs: int = 1) -> float:
    started = time.perf_counter()
    for _ in range(runs):
        job()
    return (time.perf_counter() - started) / runs


def fresh(code: str, *arguments: object, **environment: str) -> Any:
    """What `code` prints last, as JSON, when a new Python process runs it; RobodynError with its last line of error where it fails.

    The process imports this very robodyn, wherever it lies.
    """
    command = [sys.executable, "-W", "ignore", "-c", code, *map(str, arguments)]
    path = os.pathsep.join([str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])])
    settings = {**os.environ, "PYTHONPATH": path, **environment}
    done = subprocess.run(command, capture_output=True, text=True, env=settings, check=False)
    if done.returncode:
        raise RobodynError((done.stderr.strip().splitlines() or [f"a process of the benchmark ended with {done.returncode}"])[-1])
    return json.loads(done.stdout.strip().splitlines()[-1])
