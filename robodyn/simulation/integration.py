"""An integration under way, in native code or in Python: what it has found, and how far it got.

Ctrl-C may come at any line, and what there is by then is a trajectory. So each result, a time with its state, is made known by one
assignment or one call: a list that grows by pairs of both, or the counter in native code's header that says how many rows are filled.
`results`, `reached` and `completed` are read from there alone. No second variable has to fit it.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from ..arithmetic import Array
from ..dynamics.questions import Evolution
from ..engine.emit.integrate import DONE, NOT_FINITE, STEP_TOO_SMALL
from ..errors import ModelError, SimulationError
from ..scene import Scene
from ..system.processes import cached_property
from . import native
from .integrators import METHODS, Outcome, Step
from .progress import Progress
from .sampling import Sampling
from .times import resolution, step_count

FEW = 20  # steps in Python that are to meet what stopped native code within one of its own


@dataclass(eq=False)
class Integration(ABC):
    """What both kinds share: the problem, when its controllers are asked, and steps in Python."""

    scene: Scene
    t0: float
    t_end: float
    x0: Array  # (nx,)
    wanted: Array | None  # times of the results; None: every step
    method: str
    formalism: str
    settings: dict[str, float]  # rtol, atol, dt

    def __post_init__(self) -> None:
        self.sampling = Sampling(self.scene, self.t0, self.t_end)
        self.layout, self.x = self.scene.evaluator.state_vector, self.x0
        self._kept: list[tuple[Array, Array]] = []  # times (k,) and states (k, nx)
        if self.wanted is None or self.wanted[0] == self.t0:
            self.keep(self.t0, self.x0)
        self._counts = {"steps": 0, "rejected": 0, "evaluations": 0}

    @abstractmethod
    def starts(self) -> bool:
        """Whether it is known that there is an ẋ to be trusted at the start."""

    @abstractmethod
    def run(self, report: Progress) -> None:
        """Integrate to t_end; report is told the share done. SimulationError or ModelError where it cannot go on."""

    @property
    def results(self) -> tuple[Array, Array]:
        """Times (n,) and states (n, nx), as far as they go."""
        times, states = zip(*self._kept, strict=True) if self._kept else ((), ())
        return np.concatenate([np.zeros(0), *times]), np.concatenate([np.zeros((0, len(self.x0))), *states])

    @property
    @abstractmethod
    def reached(self) -> float:
        """The time [s] that the integration has come to."""

    @property
    def completed(self) -> bool:
        """Whether there is the last result, which is that at t_end."""
        return bool(self._kept) and bool(self._kept[-1][0][-1] == self.t_end)

    @property
    def counts(self) -> dict[str, int]:
        """Steps, rejected steps, evaluations."""
        return self._counts

    def keep(self, t: float, x: Array) -> None:
        """One result more."""
        self._kept.append((np.array([t]), x[None]))

    def share(self) -> float:
        """How much of the span is done."""
        return (self.reached - self.t0) / (self.t_end - self.t0)

    def spans(self) -> Iterator[tuple[float, float]]:
        """Start and end of each span of time that is integrated without a break."""
        return self.sampling.spans(lambda: self.layout.split(self.x)[:2])

    # --- steps in Python ---

    def rhs(self, t: float, x: Array, backend: str) -> Array:
        """ẋ (nx,). SimulationError where a load fails."""
        self._counts["evaluations"] += 1
        now = self.layout.split(x)
        question, state = Evolution(self.formalism), {"q": now.q, "v": now.v, "tau": self.sampling.held, "z": now.z}
        try:
            got = self.scene.evaluator.ask(question, backend, t=t, **state)
        except ModelError:
            raise
        except Exception as error:
            if backend == "native":  # what cannot be compiled is no matter of the time
                raise
            raise SimulationError(f"a load failed at t={t:.9g} s: {type(error).__name__}: {error}") from error
        return self.layout.join(got["qdot"], got["vdot"], got.get("zdot", now.z), got["power"])

    def project(self, x: Array) -> Array:
        """x (nx,) with its Euler parameters at unit length."""
        q, *rest = self.layout.split(x)
        return self.layout.join(self.scene.equations().project(q), *rest)

    def steps(self, start: float, end: float, backend: str, first_step: float | None = None) -> Iterator[Step]:
        """Steps from the state reached, over a span of time [s] without a break. SimulationError where one fails."""
        integrator, h = METHODS[self.method], (end - start) / step_count(start, end, self.settings["dt"])

        def f(t: float, x: Array) -> Array:
            dx = self.rhs(t, x, backend)
            if integrator.semi_implicit:
                now, rate = self.layout.split(x), self.layout.split(dx)
                rate.q[:] = self.scene.equations().rate(now.q, now.v + h * rate.v)
            return dx

        return integrator.steps(f, start, self.x, end, self.project, first_step=first_step, **self.settings)


@dataclass(eq=False)
class InPython(Integration):
    """Steps in Python, on a right-hand side of either backend. All results are in one list."""

    backend: str

    def __post_init__(self) -> None:
        super().__post_init__()
        self._t = self.t0

    def starts(self) -> bool:
        return False

    @property
    def reached(self) -> float:
        return self._t

    def run(self, report: Progress) -> None:
        wanted = self.wanted
        first_step = None
        for start, end in self.spans():
            for step in self.steps(start, end, self.backend, first_step):
                self._counts["steps"] += 1
                if wanted is None:
                    self.keep(step.t, step.x)
                else:
                    inside = wanted[(wanted > step.t_old) & (wanted < step.t)]
                    for t, x in zip(inside, step.between(inside), strict=True) if len(inside) else ():
                        self.keep(float(t), self.project(x))
                    if step.t in wanted:
                        self.keep(step.t, step.x)
                self.x, first_step, self._t = step.x, step.h, step.t
                report(self.share())


@dataclass(eq=False)
class InNativeCode(Integration):
    """Steps in native code, a slice of time between two looks at the keyboard.

    Results at times that are wanted are read where native code puts them. Of every step there is no end: the list takes them over.
    """

    @cached_property
    def native_run(self) -> native.Run:
        """The compiled step loop, at the start."""
        advance = native.compiled(self.scene.evaluator, self.method, self.formalism, lanes=1, held=bool(self.sampling))
        return native.Run(advance, self.x0[:, None], self.t0, self.wanted, self.settings)

    def starts(self) -> bool:
        try:
            return self.native_run.starts()
        except ZeroDivisionError:  # a pivot is zero whatever the state
            return False

    @property
    def results(self) -> tuple[Array, Array]:
        if self.wanted is None:
            self._take_over()
            return super().results
        states = self.native_run.results[:, :, 0]
        return self.wanted[: len(states)].copy(), states.copy()

    @property
    def reached(self) -> float:
        return self.native_run.t

    @property
    def completed(self) -> bool:
        if self.wanted is None:
            self._take_over()
            return super().completed
        return len(self.native_run.results) == len(self.wanted)

    @property
    def counts(self) -> dict[str, int]:
        return self.native_run.counts

    def _take_over(self) -> None:
        """Every step that native code has made since the last time; none twice where Ctrl-C came in between."""
        t, x = self.native_run.recorded
        new = t > self._kept[-1][0][-1]
        if new.any():
            self._kept.append((t[new], x[new, :, 0]))
        self.native_run.taken()

    def run(self, report: Progress) -> None:
        """As in Python; SimulationError where native code cannot go on, with the cause that NumPy's formalism finds."""
        run = self.native_run
        self.x = run.x[:, 0]
        for _, end in self.spans():
            run.head_for(end, held=self.sampling.held)
            status = None
            while status != DONE:
                status = run.slice()
                if self.wanted is None:
                    self._take_over()
                report(self.share())
                if status in (STEP_TOO_SMALL, NOT_FINITE):
                    raise SimulationError(self._cause(run, end, status))

    def _cause(self, run: native.Run, end: float, status: int) -> str:
        """Why native code cannot go on, with the joint or the load where NumPy's formalism can name it."""
        h = run.h if status == NOT_FINITE else 0.0
        end = min(run.t + max(h, resolution(run.t, end)), end)
        try:
            with np.errstate(all="ignore"):
                for _ in islice(self.steps(run.t, end, "numpy", h or None), FEW):  # where a stage of the step fails, so does this one
                    pass
        except ModelError as error:
            where = f"at t={run.t:.9g} s" if h else f"the step size went to zero at t={run.t:.9g} s"
            return f"{where}: {error}{advice(self.method, self.settings['dt'])}"
        return (Outcome.NOT_FINITE if status == NOT_FINITE else Outcome.STEP_TOO_SMALL).told(run.t)


def advice(method: str, dt: float) -> str:
    """What else may help where equal steps of dt [s] came to a state that has no derivative."""
    return "" if METHODS[method].adaptive else f". If the motion itself is smooth, dt={dt:g} s is too large, or method='radau' is needed"
