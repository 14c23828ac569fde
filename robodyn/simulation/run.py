"""`simulate`: from a scene and its initial state to a trajectory. State x = (β, η, w), ẋ = Ψ(x, t); w is the work of the loads."""

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from ..arithmetic import Array
from ..checks import inputs
from ..dynamics.equations import FORMALISMS
from ..dynamics.questions import Evolution, Result
from ..engine.emit.integrate import DONE, NOT_FINITE, STEP_TOO_SMALL
from ..errors import InputError, ModelError, RobodynWarning, SimulationError
from ..evaluation.evaluator import BACKENDS, DEFAULT
from ..model import Mechanism
from ..scene import Scene
from ..system.processes import cached_property
from . import native
from .methods import METHODS
from .sampling import Sampling
from .scipy_steps import too_small
from .step import Step, refuse_empty, resolution
from .trajectory import Trajectory

FEW = 20  # steps in Python that are to meet what stopped native code within one of its own
SOON = (10.0, 600.0)  # [s]: after that time, whoever has to wait for longer than that hears of it
MOST_FRAMES = 1e8  # results of one trajectory: beyond this memory runs out first

Progress = Callable[[float], None]  # called with the simulated share of the time span, 0…1


def simulate(
    scene: Scene | Mechanism,
    *,
    t_end: float,
    q0: object = None,
    v0: object = None,
    t0: float = 0.0,
    method: str = "dop853",
    rtol: float = 1e-9,
    atol: float | None = None,
    dt: float = 1e-3,
    fps: float | None = 60.0,
    times: Sequence[float] | Array | None = None,
    formalism: str = "auto",
    backend: str = DEFAULT,
    progress: bool | Progress = False,
) -> Trajectory:
    """Integrate a scene from t0 to t_end [s].

    scene: a Scene, or a robot for the scene that its file declares. q0 (nq,), v0 (nv,): initial state; neutral and at rest if not given.
    method: adaptive "dop853" (order 8), "rk45" (order 5), and for stiff scenes "radau", "bdf", "lsoda" (SciPy's): error per step within
    atol + rtol |x|, atol = rtol if not given; or equal steps of at most dt [s]: "rk4", "semi_implicit_euler". Results at fps frames per
    second, or at `times` (n,) [s] within [t0, t_end], or with fps=None at every step; t_end is always the last.
    A step ends wherever a `Sampled` controller is asked; `a` and `u` are those under the forces it held.
    backend: "native" (the step loop is compiled) or "numpy". progress: True for a bar on the terminal, or a function of the share done.

    Ctrl-C returns what has been computed, with a warning; `trajectory.completed` is then False, unless all was there.
    Raises InputError for bad arguments; SimulationError where the integration cannot go on, with what has been computed as its
    attribute `trajectory`; ModelError where the motion is undetermined from the start.
    """
    scene = scene if isinstance(scene, Scene) else Scene(scene)
    method = inputs.method(method, tuple(METHODS))
    inputs.choice("formalism", formalism, FORMALISMS)
    inputs.choice("backend", backend, BACKENDS[:2])
    t0, t_end, rtol, dt = (inputs.number(k, x) for k, x in (("t0", t0), ("t_end", t_end), ("rtol", rtol), ("dt", dt)))
    atol = rtol if atol is None else inputs.number("atol", atol)
    refuse_empty(t0, t_end)
    if min(rtol, atol, dt) <= 0 or rtol < 1e-13:
        raise InputError(f"rtol={rtol:g}, atol={atol:g} and dt={dt:g} must be positive, rtol at least 1e-13: float64 resolves no more")
    if not isinstance(progress, bool) and not callable(progress):
        raise InputError(f"progress={progress!r} must be True, False, or a function of the share done")
    wanted = output_times(t0, t_end, fps, times)

    # The initial state, and whether it can move at all.
    state = inputs.checked(scene.robot, {"q0": scene.robot.neutral() if q0 is None else q0, "v0": v0})
    if state["q0"].ndim != 1:
        raise InputError(f"q0 and v0 have the leading dimensions {state['q0'].shape[:-1]}: give one state, (nq,) and (nv,)")
    inputs.unit_quaternions("q0", scene.equations().side_conditions(state["q0"]))
    x0 = np.concatenate([scene.equations().project(state["q0"]), state["v0"], [0.0]])
    if backend == "native":
        scene.evaluator.unchanged.confirm()
    in_native_code = backend == "native" and METHODS[method].tableau is not None and scene.evaluator.routes.compiles_steps(formalism)
    integration = Integration(scene, t0, t_end, x0, wanted, method, formalism, {"rtol": rtol, "atol": atol, "dt": dt})
    with _reporter(progress, "compiling" if in_native_code else "simulating") as show:
        if not (in_native_code and integration.starts_natively()):
            scene.evaluator.ask(Result(formalism), "numpy", t=t0, q=state["q0"], v=state["v0"], tau=None)
        started, failure, report = time.perf_counter(), None, _patience(show, t0, t_end)
        try:
            integration.run_natively(report) if in_native_code else integration.run_in_python(backend, report)
        except KeyboardInterrupt:
            reached = f"t={integration.reached:.6g} s of {t_end:g} s"
            ends = "is complete" if integration.completed else "ends with its last state before"
            warnings.warn(f"interrupted at {reached}: the trajectory {ends}", RobodynWarning, stacklevel=2)
        except SimulationError as error:
            failure = error
        except ModelError as error:
            failure = SimulationError(f"at t={integration.reached:.9g} s: {error}{advice(method, dt)}")

    stats = {
        "method": method,
        "formalism": formalism,
        "backend": backend,
        **({"rtol": rtol, "atol": atol} if METHODS[method].adaptive else {"dt": dt}),
        **integration.counts,
        "wall_time": time.perf_counter() - started,
        "completed": integration.completed,
    }
    t, x = integration.results
    trajectory = _finished(scene, t, x, integration.sampling, formalism, backend, stats)
    if failure is None and len(trajectory.t) < len(t):
        failure = SimulationError(f"after t={trajectory.t[-1]:.6g} s the states mean nothing: the integration is unstable. Reduce dt")
    if failure is not None:
        failure.trajectory = trajectory  # type: ignore[assignment]
        raise failure
    return trajectory


@dataclass(eq=False)
class Integration:
    """An integration under way: what was found, and how far it got."""

    scene: Scene
    t0: float
    t_end: float
    x0: Array
    wanted: Array | None  # times of the results; None: every step
    method: str
    formalism: str
    settings: dict[str, float]  # rtol, atol, dt

    def __post_init__(self) -> None:
        self.sampling = Sampling(self.scene, self.t0, self.t_end)
        self.x = self.x0
        # What Ctrl-C may come in between of is one list or one number: nothing has to fit another.
        self._kept: list[tuple[Array, Array]] = []  # times (k,) and states (k, nx)
        if self.wanted is None or self.wanted[0] == self.t0:
            self.keep(self.t0, self.x0)
        self._t, self._counts = self.t0, {"steps": 0, "rejected": 0, "evaluations": 0}
        self._natively = False

    @property
    def results(self) -> tuple[Array, Array]:
        """Times (n,) and states (n, nx), as far as they go."""
        if self._natively and self.wanted is not None:
            states = self.native_run.results[:, :, 0]
            return self.wanted[: len(states)].copy(), states.copy()
        self._take_over()
        times, states = zip(*self._kept, strict=True) if self._kept else ((), ())
        return np.concatenate([np.zeros(0), *times]), np.concatenate([np.zeros((0, len(self.x0))), *states])

    @property
    def reached(self) -> float:
        """The time [s] that the integration has come to."""
        return self.native_run.t if self._natively else self._t

    @property
    def completed(self) -> bool:
        """Whether there is the last result, which is that at t_end."""
        if self._natively and self.wanted is not None:
            return len(self.native_run.results) == len(self.wanted)
        self._take_over()
        return bool(self._kept) and bool(self._kept[-1][0][-1] == self.t_end)

    @property
    def counts(self) -> dict[str, int]:
        """Steps, rejected steps, evaluations."""
        return self.native_run.counts if self._natively else self._counts

    @cached_property
    def native_run(self) -> native.Run:
        """The compiled step loop, at the start."""
        advance = native.compiled(self.scene.evaluator, self.method, self.formalism, lanes=1, held=bool(self.sampling))
        return native.Run(advance, self.x0[:, None], self.t0, self.wanted, self.settings)

    def starts_natively(self) -> bool:
        """Whether native code finds an ẋ to be trusted at the start."""
        try:
            return self.native_run.starts()
        except ZeroDivisionError:  # a pivot is zero whatever the state
            return False

    def keep(self, t: float, x: Array) -> None:
        """One result more."""
        self._kept.append((np.array([t]), x[None]))

    def _take_over(self) -> None:
        """Every step that native code has made since the last time; none twice where Ctrl-C came in between."""
        if self._natively and self.wanted is None:
            t, x = self.native_run.recorded
            new = t > self._kept[-1][0][-1]
            if new.any():
                self._kept.append((t[new], x[new, :, 0]))
            self.native_run.taken()

    def rhs(self, t: float, x: Array, backend: str) -> Array:
        """ẋ (nx,)."""
        self._counts["evaluations"] += 1
        q, v = self.coordinates(x)
        try:
            got = self.scene.evaluator.ask(Evolution(self.formalism), backend, t=t, q=q, v=v, tau=self.sampling.held)
        except ModelError:
            raise
        except Exception as error:
            if backend == "native":  # what cannot be compiled is no matter of the time
                raise
            raise SimulationError(f"a load failed at t={t:.9g} s: {type(error).__name__}: {error}") from error
        return np.concatenate([got["qdot"], got["vdot"], got["power"].reshape(1)])

    def spans(self) -> Iterator[tuple[float, float]]:
        """Start and end of each span of time that is integrated without a break."""
        return self.sampling.spans(lambda: self.coordinates(self.x))

    def coordinates(self, x: Array) -> tuple[Array, Array]:
        """q (nq,) and v (nv,) of a state."""
        nq, nv = self.scene.robot.nq, self.scene.robot.nv
        return x[:nq], x[nq : nq + nv]

    def project(self, x: Array) -> Array:
        """x with its Euler parameters at unit length."""
        nq = self.scene.robot.nq
        return np.concatenate([self.scene.equations().project(x[:nq]), x[nq:]])

    def share(self) -> float:
        """How much of the span is done."""
        return (self.reached - self.t0) / (self.t_end - self.t0)

    def steps(self, start: float, end: float, backend: str, first_step: float | None = None) -> Iterator[Step]:
        """Steps in Python from the state reached, over a span of time without a break."""
        integrator, h = METHODS[self.method], (end - start) / native.step_count(start, end, self.settings["dt"])

        def f(t: float, x: Array) -> Array:
            dx = self.rhs(t, x, backend)
            if integrator.semi_implicit:
                (q, v), (qdot, vdot) = self.coordinates(x), self.coordinates(dx)
                qdot[:] = self.scene.equations().rate(q, v + h * vdot)
            return dx

        return integrator.steps(f, start, self.x, end, self.project, first_step=first_step, **self.settings)

    def run_in_python(self, backend: str, report: Progress) -> None:
        """Steps in Python, on a right-hand side of either backend."""
        wanted = self.wanted
        first_step = None
        for start, end in self.spans():
            for step in self.steps(start, end, backend, first_step):
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

    def run_natively(self, report: Progress) -> None:
        """Steps in native code, a slice of time between two looks at the keyboard."""
        run = self.native_run
        self._natively, self.x = True, run.x[:, 0]
        for _, end in self.spans():
            run.head_for(end, held=self.sampling.held)
            status = None
            while status != DONE:
                status = run.slice()
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
        if status == STEP_TOO_SMALL:
            return too_small(run.t)
        return (
            f"after t={run.t:.9g} s the state stopped being finite, or a joint showed no inertia within the next step: "
            "reduce dt, or look for loads that grow without bound"
        )


def advice(method: str, dt: float) -> str:
    """What else may help where equal steps came to a state that has no derivative."""
    return "" if METHODS[method].adaptive else f". If the motion itself is smooth, dt={dt:g} s is too large, or method='radau' is needed"


def _finished(scene: Scene, t: Array, x: Array, sampling: Sampling, formalism: str, backend: str, stats: dict[str, Any]) -> Trajectory:
    """The trajectory of times (n,) and states (n, nx), with accelerations and joint forces evaluated at them."""
    nq, nv = scene.robot.nq, scene.robot.nv
    q, v, work = x[:, :nq], x[:, nq : nq + nv], x[:, nq + nv]
    try:
        got = scene.evaluator.ask(Result(formalism), backend, t=t, q=q, v=v, tau=sampling.at(t))
    except ModelError:
        # The last states may be what the integration failed at: keep what comes before them.
        if len(t) <= 1:
            raise
        kept = max(1, len(t) * 9 // 10)
        return _finished(scene, t[:kept], x[:kept], sampling, formalism, backend, stats | {"completed": False})
    return Trajectory(scene=scene, t=t, q=q, v=v, a=got["vdot"], u=got["u"], work=work, stats=stats)


def output_times(t0: float, t_end: float, fps: float | None, times: Sequence[float] | Array | None) -> Array | None:
    """Ascending times with t_end as the last; None: every step."""
    if times is not None:
        t, same = np.array(inputs.array("times", times, np.size(times), "one entry per time")), resolution(t0, t_end)
        t[abs(t - t0) <= same], t[abs(t - t_end) <= same] = t0, t_end  # 3 · 0.1 is 0.3
        if t.ndim != 1 or not len(t) or (np.diff(t) <= 0).any() or t[0] < t0 or t[-1] > t_end:
            raise InputError(f"times must ascend within [{t0:g}, {t_end:g}]")
        return t if t[-1] == t_end else np.append(t, t_end)
    if fps is None:
        return None
    if not inputs.number("fps", fps) > 0:
        raise InputError(f"fps={fps} must be positive, or None for every step")
    if not (t_end - t0) * fps < MOST_FRAMES:
        raise InputError(f"{(t_end - t0) * fps:.3g} results are too many to keep: reduce fps={fps:g}, or give the times you need")
    frames = np.arange(int(np.ceil((t_end - t0) * fps * (1 - 1e-12)))) / fps + t0
    return np.append(frames[frames < t_end - resolution(t0, t_end)], t_end)


def _patience(report: Progress, t0: float, t_end: float) -> Progress:
    """The report, which warns once where the rest will take very long: few expect that of a motion that grows without bound."""
    started, warned = time.perf_counter(), False

    def watched(share: float) -> None:
        nonlocal warned
        report(share)
        if not warned and (took := time.perf_counter() - started) > SOON[0] and took * (1 - share) > SOON[1] * share:
            warned = True
            rest = f"{took * (1 - share) / share / 3600:.3g} hours" if share > 0 else "for ever"
            warnings.warn(
                f"after {took:.0f} s the simulation is at t={t0 + share * (t_end - t0):.6g} s of {t_end:g} s and would take {rest} at this "
                "rate: the motion is very fast, or grows without bound, as under a controller that is asked too seldom. "
                "Ctrl-C returns what there is",
                RobodynWarning,
                stacklevel=4,
            )

    return watched


@contextmanager
def _reporter(progress: bool | Progress, first: str) -> Iterator[Progress]:
    """A function that is told the share done; a bar on standard error for True, which says what is done until the first share."""
    if callable(progress):
        yield progress
        return
    if not progress:
        yield lambda share: None
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True) as bar:
        task, shown = bar.add_task(first, total=1.0), -1.0

        def show(share: float) -> None:
            nonlocal shown
            if shown < 0:
                bar.update(task, description="simulating")
            if share >= min(1.0, shown + 0.001):  # thousands of samples need no thousands of pictures
                bar.update(task, completed=share)
                shown = share

        yield show
