"""`simulate`: from a scene and its initial state to a trajectory. State x = (β, η, w), ẋ = Ψ(x, t); w is the work of the loads."""

import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import contextmanager

import numpy as np

from .. import inputs
from ..arithmetic import Array
from ..errors import InputError, ModelError, RobodynWarning, SimulationError
from ..model import Mechanism
from ..scene import Scene
from .dop853 import dop853
from .rk4 import rk4
from .trajectory import Trajectory

METHODS = {"dop853": dop853, "rk4": rk4}

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
    progress: bool | Progress = False,
) -> Trajectory:
    """Integrate a scene from t0 to t_end [s].

    scene: a Scene, or a robot for the scene that its file declares. q0 (nq,), v0 (nv,): initial state; neutral and at rest if not given.
    method: "dop853" (adaptive, order 8: error per step within atol + rtol |x|; atol = rtol if not given) or "rk4" (equal steps of at
    most dt [s]). Results at fps frames per second, or at `times` (n,) [s] within [t0, t_end], or with fps=None at every step; t_end is
    always the last. progress: True for a bar on the terminal, or a function of the share done.

    Ctrl-C returns what has been computed, with a warning; `trajectory.completed` is then False.
    Raises InputError for bad arguments; SimulationError where the integration cannot go on, with what has been computed as its
    attribute `trajectory`; ModelError where the motion is undetermined.
    """
    scene = scene if isinstance(scene, Scene) else Scene(scene)
    inputs.choice("method", method, tuple(METHODS))
    inputs.choice("formalism", formalism, ("auto", "recursive", "nonrecursive", "saddle_joint", "saddle_body"))
    t0, t_end, rtol, dt = (_number(k, x) for k, x in (("t0", t0), ("t_end", t_end), ("rtol", rtol), ("dt", dt)))
    atol = rtol if atol is None else _number("atol", atol)
    if not t_end > t0:
        raise InputError(f"t_end={t_end} must be later than t0={t0}")
    if min(rtol, atol, dt) <= 0 or rtol < 1e-13:
        raise InputError(f"rtol={rtol:g}, atol={atol:g} and dt={dt:g} must be positive, rtol at least 1e-13: float64 resolves no more")
    wanted = _output_times(t0, t_end, fps, times)

    # The initial state, checked once; every evaluation after it skips the door.
    q, v = scene._door("numpy", q=scene.robot.neutral() if q0 is None else q0, v=v0)
    if q.ndim != 1:
        raise InputError(f"q0 and v0 have the leading dimensions {q.shape[:-1]}: give one state, (nq,) and (nv,)")
    nq, nv = scene.robot.nq, scene.robot.nv
    equations, tau = scene.equations(), np.zeros(nv)
    evaluations = 0

    def rhs(t: float, x: Array) -> Array:
        nonlocal evaluations
        evaluations += 1
        q, v = x[:nq], x[nq : nq + nv]
        acts, vdot = scene._forward(q, v, tau, t, formalism, "numpy")
        return np.concatenate([equations.rate(q, v), vdot, [acts.power]])

    def project(x: Array) -> Array:
        return np.concatenate([equations.project(x[:nq]), x[nq:]])

    # The steps, with what lies at the wanted times.
    x0 = np.concatenate([equations.project(q), v, [0.0]])
    found = [(t0, x0)] if wanted is None or wanted[0] == t0 else []
    steps, reached, failure = 0, t0, None
    started = time.perf_counter()
    with _reporter(progress) as report:
        try:
            for step in METHODS[method](rhs, t0, x0, t_end, project, rtol=rtol, atol=atol, dt=dt):
                steps, reached = steps + 1, step.t
                if wanted is None:
                    found.append((step.t, step.x))
                else:
                    inside = wanted[(wanted > step.t_old) & (wanted <= step.t)]
                    for t, x in zip(inside, step.between(inside) if (inside < step.t).any() else [], strict=False):
                        if t < step.t:
                            found.append((float(t), project(x)))
                    if len(inside) and inside[-1] == step.t:
                        found.append((step.t, step.x))
                report((step.t - t0) / (t_end - t0))
        except KeyboardInterrupt:
            warnings.warn(f"interrupted at t={reached:.6g} s of {t_end:g} s: the trajectory ends there", RobodynWarning, stacklevel=2)
        except (SimulationError, ModelError) as error:
            failure = error

    stats = {
        "method": method,
        "formalism": formalism,
        **({"rtol": rtol, "atol": atol} if method == "dop853" else {"dt": dt}),
        "steps": steps,
        "evaluations": evaluations,
        "wall_time": time.perf_counter() - started,
        "completed": reached == t_end,
    }
    trajectory = _finished(scene, found, formalism, stats)
    if failure is not None:
        error = failure if isinstance(failure, SimulationError) else SimulationError(f"at t={reached:.9g} s: {failure}")
        error.trajectory = trajectory  # type: ignore[assignment]
        raise error from failure.__cause__
    return trajectory


def _finished(scene: Scene, found: list[tuple[float, Array]], formalism: str, stats: dict) -> Trajectory:
    """The trajectory of the times and states found, with accelerations and joint forces evaluated at them."""
    nq, nv = scene.robot.nq, scene.robot.nv
    t = np.array([t for t, _ in found])
    x = np.array([x for _, x in found]).reshape(-1, nq + nv + 1)
    q, v, work = x[:, :nq], x[:, nq : nq + nv], x[:, nq + nv]
    acts, a = scene._forward(q, v, np.zeros_like(v), t, formalism, "numpy")
    return Trajectory(scene=scene, t=t, q=q, v=v, a=np.array(a), u=np.array(acts.u), work=work, stats=stats)


def _number(name: str, value: object) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InputError(f"{name}={value!r} must be a number") from None
    if not np.isfinite(number):
        raise InputError(f"{name}={number} must be finite")
    return number


def _output_times(t0: float, t_end: float, fps: float | None, times: Sequence[float] | Array | None) -> Array | None:
    """Ascending times with t_end as the last; None: every step."""
    if times is not None:
        t = inputs.array("times", times, np.size(times), "one entry per time")
        if t.ndim != 1 or not len(t) or (np.diff(t) <= 0).any() or t[0] < t0 or t[-1] > t_end:
            raise InputError(f"times must ascend within [{t0:g}, {t_end:g}]")
        return t if t[-1] == t_end else np.append(t, t_end)
    if fps is None:
        return None
    if not _number("fps", fps) > 0:
        raise InputError(f"fps={fps} must be positive, or None for every step")
    frames = np.arange(int(np.ceil((t_end - t0) * fps * (1 - 1e-12)))) / fps + t0
    return np.append(frames, t_end)


@contextmanager
def _reporter(progress: bool | Progress):
    """A function that is told the share done; a bar on standard error for True."""
    if not isinstance(progress, bool):
        yield progress
        return
    if not progress:
        yield lambda share: None
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("simulating", total=1.0)
        yield lambda share: bar.update(task, completed=share)
