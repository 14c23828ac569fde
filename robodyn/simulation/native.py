"""The step loop in native code: what `simulate` and `simulate_many` drive, a budget of steps at a time."""

import ctypes
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arithmetic import Array
from ..engine.emit import integrate
from ..engine.run.kernel import load
from ..evaluation.evaluator import Evaluator
from ..system.processes import lock
from .integrators import METHODS
from .times import step_count

_PLACE = {name: i for i, name in enumerate(integrate.HEADER)}
_compiling = lock()  # LLVM works for one thread at a time anyway
SLICE = 0.05  # seconds of native code between two looks at the keyboard
RECORD = (1024, 10**5)  # steps, and numbers, up to which every step is kept before Python takes them over
MOST_STEPS = 10**9  # in a slice


@dataclass(frozen=True, eq=False)
class Advance:
    """A compiled integrator for one scene: nx numbers per state, `lanes` states side by side, each under nheld held forces."""

    function: Callable[..., int]
    each: Callable[..., int]
    room: int
    nx: int
    nheld: int
    lanes: int
    adaptive: bool


def compiled(evaluator: Evaluator, method: str, formalism: str, lanes: int, *, held: bool = False) -> Advance:
    """The integrator of a scene, under held joint forces or not; compiled when first asked for, then from the cache on disk."""
    integrator, key = METHODS[method], (method, formalism, lanes, held)
    if key in evaluator.integrators.compiled:
        return evaluator.integrators.compiled[key]
    with _compiling:
        if key in evaluator.integrators.compiled:  # by another thread, meanwhile
            return evaluator.integrators.compiled[key]
        tableau = integrator.tableau()
        rhs = evaluator.integrators.evolution(formalism, semi_implicit=integrator.semi_implicit, held=held)
        project = evaluator.integrators.projection()
        loaded = load(integrate.module(tableau, rhs, project, lanes), integrate.tables(rhs, project))
        types = (*[ctypes.c_void_p] * 5, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)
        function, each = loaded.function("advance", *types), loaded.function("advance_each", *types, ctypes.c_int64)
        function.owner = each.owner = loaded  # the code lives as long as the functions
        room = integrate.room(tableau, rhs, project)
        nx, nheld = rhs.inputs["x"], rhs.inputs.get("held", 0)
        evaluator.integrators.compiled[key] = found = Advance(function, each, room, nx, nheld, lanes, integrator.adaptive)
        return found


class Run:
    """An integration from x0 (nx, lanes) at t0, with results at `times`: `head_for` an end, then `slice` until it is reached.

    Without times, with the end of every step as a result: `taken` from time to time, for there is room for some of them only.
    """

    def __init__(self, advance: Advance, x0: Array, t0: float, times: Array | None, settings: dict[str, float]) -> None:
        nx, lanes, self._advance, self._dt = advance.nx, advance.lanes, advance, settings["dt"]
        most, numbers = RECORD
        self._times = np.zeros(max(1, min(most, numbers // nx))) if times is None else np.ascontiguousarray(times, dtype=float)
        n = len(self._times)
        # One allocation: a short run takes about as long as a few of them.
        shapes = {
            "header": (len(_PLACE),),
            "x": (nx, lanes),
            "k": (advance.room, lanes),
            "held": (advance.nheld, lanes),
            "out": (n, nx, lanes),
        }
        places, end = {}, 0
        for name, shape in shapes.items():
            places[name], end = end, end + -(-math.prod(shape) // 8) * 8
        memory = _aligned((end,))
        views = {name: memory[places[name] : places[name] + math.prod(shape)].reshape(shape) for name, shape in shapes.items()}
        header, self._x, _, self._held, self._out = views.values()
        self._header: Any = header.data  # looked at in every sample: a memoryview is faster than an array
        reached = 0 if times is None else int(np.count_nonzero(self._times <= t0))  # outputs at the start are the start
        header[:] = _header(t=t0, t0=t0, t_end=t0, rtol=settings["rtol"], atol=settings["atol"], next=reached)
        self._x[:] = self._out[:reached] = x0
        self._budget, self._steps = 64, 0
        address = memory.ctypes.data
        pointers = [address + 8 * places[name] for name in shapes]
        self._arguments = (*pointers[:4], self._times.ctypes.data, -n if times is None else n, pointers[4])

    def _number(self, name: str) -> float:
        return self._header[_PLACE[name]]

    def _put(self, name: str, value: float) -> None:
        self._header[_PLACE[name]] = value

    def starts(self) -> bool:
        """Whether there is an ẋ to be trusted at the start, under no held forces; not counted, before the first `head_for`."""
        status = self._advance.function(*self._arguments, 0)
        self._put("evaluations", 0.0)
        return status != integrate.NOT_FINITE

    def head_for(self, t_end: float, *, held: Array | None = None) -> None:
        """Go on from the time reached to t_end, under held forces (nheld,); an adaptive method with the step that it had."""
        if held is not None:
            self._held[:] = held[:, None]
        t = self._number("t")
        self._put("t0", t)
        self._put("t_end", t_end)
        self._put("started", 0.0)  # the derivative jumps with the held forces
        self._steps += int(self._number("steps"))
        self._put("steps", 0.0)
        if not self._advance.adaptive:
            n = step_count(t, t_end, self._dt)
            self._put("count", n)
            self._put("h", (t_end - t) / n)

    def slice(self) -> int:
        """Some steps more, for about SLICE seconds; what `advance` returned."""
        started = time.perf_counter()
        status = self._advance.function(*self._arguments, self._budget)
        if status == integrate.PAUSED:
            took = time.perf_counter() - started
            self._budget = int(np.clip(self._budget * SLICE / max(took, 1e-6), 1, min(4 * self._budget, MOST_STEPS)))
        return status

    @property
    def t(self) -> float:
        """The time reached [s]."""
        return self._number("t")

    @property
    def h(self) -> float:
        """The step that is due [s]."""
        return self._number("h")

    @property
    def x(self) -> Array:
        """The state reached (nx, lanes)."""
        return self._x

    @property
    def results(self) -> Array:
        """States (k, nx, lanes) at the times that were reached."""
        return self._out[: int(self._number("next"))]

    @property
    def recorded(self) -> tuple[Array, Array]:
        """Without times: the ends of steps (k,) and the states (k, nx, lanes) there since the last `taken`."""
        return self._times[: len(self.results)], self.results

    def taken(self) -> None:
        """What was recorded makes room."""
        self._put("next", 0.0)

    @property
    def counts(self) -> dict[str, int]:
        """Steps, rejected steps, evaluations."""
        counts = {name: int(self._number(name)) for name in ("steps", "rejected", "evaluations")}
        return counts | {"steps": self._steps + counts["steps"]}


class Crowd:
    """Integrations from x0 (n, nx, lanes) at t0 to t_end with equal steps, block after block, with results at `times`."""

    def __init__(self, advance: Advance, x0: Array, t0: float, t_end: float, times: Array, dt: float) -> None:
        self._advance, self._times, steps = advance, np.ascontiguousarray(times, dtype=float), step_count(t0, t_end, dt)
        reached = int(np.count_nonzero(self._times <= t0))
        header = _header(t=t0, t0=t0, t_end=t_end, h=(t_end - t0) / steps, count=steps, next=reached)
        self._headers = np.tile(header, (len(x0), 1))
        self.x = _aligned(x0.shape)
        self.x[:] = x0
        self.results = _aligned((len(x0), len(times), *x0.shape[1:]))
        self.results[:, :reached] = x0[:, None]
        self._taken, self._lock = 0, threading.Lock()

    def _take(self, count: int, workers: int) -> tuple[int, int]:
        """The next blocks, first to last: `count`, or fewer, that all workers come to the end together."""
        with self._lock:
            first = self._taken
            left = len(self.x) - first
            self._taken = first + min(count, -(-left // (2 * workers - 1)))
            return first, self._taken

    def run(self, workers: int, proceed: Callable[[], bool]) -> int | None:
        """One of `workers` threads that share the blocks, while `proceed` agrees, asked every SLICE seconds; a block that cannot go on.

        Where there are several of those, the first of all is among the answers: blocks are taken in order, and what is taken is finished.
        """
        k, held = (_aligned((n, self._advance.lanes)) for n in (self._advance.room, self._advance.nheld))
        budget, count = 64, 1
        first = last = 0
        while proceed():
            if first == last:
                first, last = self._take(count, workers)
                if first == last:
                    break
            started = time.perf_counter()
            arrays = (self._headers[first:], self.x[first:], k, held, self._times)
            pointers = [a.ctypes.data for a in arrays]
            out = self.results[first:].ctypes.data
            done, status = divmod(self._advance.each(*pointers, len(self._times), out, budget, last - first), integrate.STATUSES)
            first += done
            if status not in (integrate.DONE, integrate.PAUSED):
                with self._lock:
                    self._taken = len(self.x)  # nobody begins another
                return first
            share = SLICE / max(time.perf_counter() - started, 1e-6)
            if status == integrate.PAUSED:
                budget = int(np.clip(budget * share, 1, 4 * budget))
            else:
                count = int(np.clip(done * share, 1, 16 * count))
        return None


def _header(**values: float) -> list[float]:
    """The numbers that the compiled loop starts from, zero where none is given."""
    return [values.get(name, 0.0) for name in integrate.HEADER]


def _aligned(shape: tuple[int, ...]) -> Array:
    """Zeros that start on a cache line: the compiled loads are aligned to a whole vector."""
    size = math.prod(shape)
    raw = np.zeros(size + 8)
    start = (-raw.ctypes.data // 8) % 8
    return raw[start : start + size].reshape(shape)
