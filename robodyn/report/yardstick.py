"""A measuring stick from outside: a script that prints how fast traced dynamics alone runs on this machine, held beside robodyn.

The script is given a URDF file and prints lines such as `…, batch in 8 lanes, per state   11.0 ns` and
`…, one chained evaluation, scalar   80.1 ns`, one per route; the fastest route counts.
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import numpy as np

from ..errors import InputError
from .subject import Subject
from .timing import Timing, interleaved
from .trajectories import steps_alone

RUNS = 3  # of the script, with robodyn's own measurements between them
WANTED = {"batch": r"batch in \d+ lanes.*?([\d.]+) ns", "chained": r"chained evaluation.*?([\d.]+) ns"}
Row = tuple[str, str, Timing, Timing, str]  # kind, work, ours, the script's, remark


def yardstick(subject: Subject, script: str) -> Iterator[Row]:
    """The batch beside the script's batch; a step of RK4, four evaluations, beside one chained evaluation of the script's."""
    robot, (q, v, tau), n, count = subject.robot, subject.states, len(subject.states[0]), 5000
    vdot = np.empty(v.shape)
    jobs = {"batch": (lambda: robot.forward_dynamics(q, v, tau, threads=1, out=vdot), n), "chained": (steps_alone(subject, count), count)}
    found, theirs, ratios = ({name: [] for name in jobs} for _ in range(3))
    for _ in range(min(RUNS, subject.settings.rounds)):
        text = _printed(script, subject.path)
        for name, (job, units) in jobs.items():
            theirs[name].append(min(float(x) for x in re.findall(WANTED[name], text)) * 1e-9)
            times = [t / units for t in interleaved([job], subject.settings.rounds)[0]]
            found[name] += times
            ratios[name].append(median(times) / theirs[name][-1])
    for name, work in (("batch", f"batch of {n}, beside the yardstick's"), ("chained", "an RK4 step, beside its chained evaluation")):
        ours, stick = Timing.of(found[name]), Timing.of(theirs[name])
        yield "yardstick", work, ours, stick, f"{median(ratios[name]):.2f} × the yardstick's time, the median of neighbours"


def _printed(script: str, path) -> str:
    done = subprocess.run([sys.executable, script, str(path)], capture_output=True, text=True, check=False)
    if done.returncode or not all(re.search(pattern, done.stdout) for pattern in WANTED.values()):
        last = (done.stderr.strip().splitlines() or ["it printed no figures"])[-1]
        raise InputError(f"--yardstick {Path(script).name} {path}: {last}")
    return done.stdout
