"""The step loop in native code: what `simulate` and `simulate_many` drive, a budget of steps at a time."""

import ctypes
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arithmetic import Array
from ..engine import integrate
from ..engine.kernel import load
from ..evaluate import Evaluator
from .methods import METHODS
from .step import step_count

SLICE = 0.05  # seconds of native code between two looks at the keyboard


@dataclass(frozen=True, eq=False)
class Advance:
    """A compiled integrator for one scene: nx numbers per state, `lanes` states side by side."""

    function: Callable[..., int]
    room: int
    nx: int
    lanes: int
    adaptive: bool


def compiled(evaluator: Evaluator, method: str, formalism: str, lanes: int) -> Advance:
    """The integrator of a scene; compiled when first asked for, then from the cache on disk."""
    integrator = METHODS[method]
    assert integrator.tableau is not None
    tableau = integrator.tableau()
    rhs = evaluator.evolution(formalism, semi_implicit=integrator.semi_implicit)
    project = evaluator.projection()
    loaded = load(integrate.module(tableau, rhs, project, lanes), integrate.tables(rhs, project))
    function = loaded.function("advance", *[ctypes.c_void_p] * 4, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)
    function.owner = loaded  # the code lives as long as the function
    return Advance(function, integrate.room(tableau, rhs, project), rhs.inputs["x"], lanes, integrator.adaptive)


class Run:
    """One integration, from x0 (nx, lanes) at t0 to t_end, with results at `times`."""

    def __init__(self, advance: Advance, x0: Array, t0: float, t_end: float, times: Array, settings: dict[str, float]) -> None:
        self._advance, self._times = advance, np.ascontiguousarray(times, dtype=float)
        n = step_count(t0, t_end, settings["dt"])
        h = settings["first_step"] if advance.adaptive else (t_end - t0) / n
        values = {"t": t0, "h": h, "t0": t0, "t_end": t_end, "count": n, "rtol": settings["rtol"], "atol": settings["atol"]}
        self._header = np.array([values.get(name, 0.0) for name in integrate.HEADER])
        self._x = _aligned((advance.nx, advance.lanes))
        self._x[:] = x0
        self._k = _aligned((advance.room, advance.lanes))
        self._out = _aligned((len(times), advance.nx, advance.lanes))
        self._budget = 64
        # Outputs at the start are the start.
        while self._number("next") < len(times) and times[int(self._number("next"))] <= t0:
            self._out[int(self._number("next"))] = self._x
            self._header[integrate.HEADER.index("next")] += 1

    def _number(self, name: str) -> float:
        return float(self._header[integrate.HEADER.index(name)])

    def slice(self) -> int:
        """Some steps more, for about SLICE seconds; what `advance` returned."""
        started = time.perf_counter()
        pointers = [x.ctypes.data for x in (self._header, self._x, self._k, self._times)]
        status = self._advance.function(*pointers, len(self._times), self._out.ctypes.data, self._budget)
        took = time.perf_counter() - started
        self._budget = int(np.clip(self._budget * SLICE / max(took, 1e-6), 1, 4 * self._budget))
        return status

    def step(self) -> int:
        """One attempt at a step."""
        self._budget = 1
        return self.slice()

    @property
    def t(self) -> float:
        """The time reached [s]."""
        return self._number("t")

    @property
    def x(self) -> Array:
        """The state reached (nx, lanes)."""
        return self._x

    @property
    def results(self) -> Array:
        """States (k, nx, lanes) at the times that were reached."""
        return self._out[: int(self._number("next"))]

    @property
    def counts(self) -> dict[str, int]:
        """Steps, rejected steps, evaluations."""
        return {name: int(self._number(name)) for name in ("steps", "rejected", "evaluations")}


def _aligned(shape: tuple[int, ...]) -> Array:
    """Zeros that start on a cache line: the compiled loads are aligned to a whole vector."""
    size = int(np.prod(shape))
    raw = np.zeros(size + 8)
    start = (-raw.ctypes.data // 8) % 8
    return raw[start : start + size].reshape(shape)
