"""What only a new process can show: the first call, with an empty cache on disk and a filled one; the import."""

import json
import tempfile
from collections.abc import Iterator

from ..system import cache
from .subject import Subject
from .timing import Timing, fresh

FIRST = """
import json, sys, time
import numpy as np
import robodyn as rd
robot = rd.load(sys.argv[1], **json.loads(sys.argv[2]))
rng = np.random.default_rng(0)
q, v = robot.random_state(rng)
tau = rng.uniform(-5.0, 5.0, robot.nv)
started = time.perf_counter()
robot.forward_dynamics(q, v, tau)
print(json.dumps(time.perf_counter() - started))
"""
IMPORT = "import time; started = time.perf_counter(); import robodyn; print(time.perf_counter() - started)"
PROCESSES = 5  # of each kind, at most
Row = tuple[str, str, Timing]  # kind, work, time


def first_call(subject: Subject) -> Iterator[Row]:
    """From a loaded robot to its first answer: import of LLVM, tracing by each route (cached: by the cheapest), compiling or loading."""
    options, times = json.dumps({name: x for name, x in subject.options.items() if x}), {"nothing cached": [], "cached": []}
    for _ in range(min(PROCESSES, subject.settings.rounds)):
        with tempfile.TemporaryDirectory() as folder:
            for found in times.values():
                found.append(fresh(FIRST, subject.path, options, **{cache.VARIABLE: folder}))
    yield from (("first", f"first call, {name}", Timing.of(found)) for name, found in times.items())


def importing(subject: Subject) -> Iterator[Row]:
    """`import robodyn`, the files of Python and NumPy warm."""
    fresh(IMPORT)
    yield "import", "import robodyn", Timing.of([fresh(IMPORT) for _ in range(min(PROCESSES, subject.settings.rounds))])
