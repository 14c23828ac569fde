"""`simulate_many`: N trajectories of one scene at a time, in SIMD lanes and threads."""

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from ..arithmetic import Array
from ..checks import inputs
from ..dynamics.equations import FORMALISMS, SADDLES
from ..dynamics.questions import Evolution
from ..dynamics.state_vector import Parts
from ..engine.run.compile import lanes
from ..errors import InputError, ModelError, SimulationError
from ..evaluation.evaluator import DEFAULT
from ..model import Mechanism
from ..scene import Scene
from ..system.processes import cores, together
from . import native
from .integrators import METHODS
from .quantities import QUANTITIES, described
from .single import simulate
from .times import MOST_RESULTS, output_times, refuse_empty, step_count, step_times
from .trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Trajectories:
    __doc__ = f"""N trajectories of one scene at the same times; `[i]` is a `Trajectory`, `len` is N.

    {described((QUANTITIES[name] for name in ("t", "q", "v", "z", "work")), "N")}
    stats: method, formalism, dt [s], wall_time [s], completed.
    """

    scene: Scene
    t: Array
    q: Array
    v: Array
    z: Array
    work: Array
    stats: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, i: int) -> Trajectory:
        states = Parts(self.q[i], self.v[i], self.z[i], self.work[i])
        return Trajectory.of(self.scene, self.t, states, None, self.stats["formalism"], DEFAULT, self.stats)


def simulate_many(
    scene: Scene | Mechanism,
    *,
    t_end: float,
    q0: object = None,
    v0: object = None,
    t0: float = 0.0,
    method: str = "rk4",
    dt: float = 1e-3,
    fps: float | None = 60.0,
    times: Sequence[float] | Array | None = None,
    formalism: str = "auto",
    threads: int | None = None,
) -> Trajectories:
    """Integrate N initial states q0 (N, nq), v0 (N, nv) (either may be one state for all) from t0 to t_end [s] with equal steps.

    method: "rk4" or "semi_implicit_euler", steps of at most dt [s]. Results at fps frames per second, or at `times` (T,)
    [s] within [t0, t_end], or with fps=None at every step; t_end is always the last, and with times=[t_end] the only one.
    Each result has the same bits as `simulate` gives for that state alone. Ctrl-C stops between slices of work and raises.
    Raises InputError for bad arguments and for a scene with a `Sampled` law, SimulationError naming the trajectory that cannot go on.
    """
    scene = scene if isinstance(scene, Scene) else Scene(scene)
    if scene.sampled:
        raise InputError(
            "simulate_many cannot share a Sampled law among trajectories: it may remember. Give each a law of its own: "
            "[rd.simulate(rd.Scene(robot, loads=[rd.Sampled(new_law(), dt)]), q0=q, t_end=…) for q in q0]; "
            "or write it as a rd.ControlLaw"
        )
    names = [name for name, integrator in METHODS.items() if integrator.native and not integrator.adaptive]
    method = inputs.method(method, names)
    inputs.choice("formalism", formalism, [f for f in FORMALISMS if f not in SADDLES])
    t0, t_end, dt = (inputs.number(k, x) for k, x in (("t0", t0), ("t_end", t_end), ("dt", dt)))
    refuse_empty(t0, t_end)
    if dt <= 0:
        raise InputError(f"dt={dt:g} must be positive")
    wanted = output_times(t0, t_end, fps, times)
    if wanted is None:
        if not (n := step_count(t0, t_end, dt)) < MOST_RESULTS:
            raise InputError(f"{n:.3g} steps are too many to keep: give fps or the times you need, such as times=[t_end]")
        wanted = step_times(t0, t_end, dt)

    inputs.thread_count(threads)
    states = inputs.checked(scene.robot, {"q0": scene.robot.neutral() if q0 is None else q0, "v0": v0})
    q, v = (np.atleast_2d(x) for x in states.values())
    if q.ndim != 2:
        raise InputError(f"q0 and v0 have the leading dimensions {q.shape[:-1]}: give (N, nq) and (N, nv)")
    inputs.unit_quaternions("q0", scene.equations().side_conditions(q))
    alone = partial(_alone, scene, q, v, times=wanted, t0=t0, t_end=t_end, method=method, dt=dt, formalism=formalism)
    if DEFAULT != "native" or not scene.evaluator.routes.compiles_steps(formalism):
        started = time.perf_counter()
        found = np.array([alone(row) for row in range(len(q))]).reshape(len(q), len(wanted), scene.evaluator.state_vector.size)
        return _trajectories(scene, wanted, found, method, formalism, dt, started)
    x0 = scene.evaluator.start(q, v)

    scene.evaluator.unchanged.confirm()

    # Blocks of lanes; beyond the last state, the last again.
    width = lanes()
    try:
        advance = native.compiled(scene.evaluator, method, formalism, width)
    except ZeroDivisionError:  # a pivot is zero whatever the state: NumPy's formalism says which
        scene.evaluator.ask(Evolution(formalism), "numpy", t=t0, q=q[:1], v=v[:1], tau=None)
        raise
    rows = np.minimum(np.arange(-(-len(x0) // width) * width), len(x0) - 1).reshape(-1, width)
    started, stop = time.perf_counter(), threading.Event()
    crowd = native.Crowd(advance, x0[rows].transpose(0, 2, 1), t0, t_end, wanted, dt)
    workers = max(1, min(threads or cores(), len(rows)))
    failed = together(lambda _: crowd.run(workers, lambda: not stop.is_set()), workers, stop.set)
    for block in sorted(block for block in failed if block is not None):
        for row in rows[block]:  # has the same bits alone: one of them fails again, and says why
            alone(int(row))
        raise SimulationError(f"trajectories {rows[block][0]} to {rows[block][-1]} cannot go on side by side: reduce dt={dt:g}")
    found = crowd.results.transpose(0, 3, 1, 2).reshape(-1, len(wanted), x0.shape[1])[: len(x0)]
    return _trajectories(scene, wanted, found, method, formalism, dt, started)


def _trajectories(scene: Scene, t: Array, x: Array, method: str, formalism: str, dt: float, started: float) -> Trajectories:
    stats = {"method": method, "formalism": formalism, "dt": dt, "wall_time": time.perf_counter() - started, "completed": True}
    return Trajectories(scene, t, *scene.evaluator.state_vector.split(x), stats)


def _alone(scene: Scene, q: Array, v: Array, row: int, **options: Any) -> Array:
    """The states (T, nx) of one trajectory, by `simulate`; what it fails at is an error that names the row."""
    try:
        run = simulate(scene, q0=q[row], v0=v[row], **options)
    except (ModelError, SimulationError) as error:
        raise SimulationError(f"trajectory {row}: {error}; look at q0[{row}] with `simulate`") from error
    if not run.completed:  # `simulate` takes Ctrl-C for the wish to see what there is
        raise KeyboardInterrupt
    return scene.evaluator.state_vector.join(run.q, run.v, run.z, run.work)
