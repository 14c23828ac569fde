"""`simulate_many`: N trajectories of one scene at a time, in SIMD lanes and threads."""

import os
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import inputs
from ..arithmetic import Array
from ..engine.compile import lanes
from ..engine.integrate import DONE
from ..equations import FORMALISMS, SADDLES
from ..errors import InputError, RobodynError, SimulationError
from ..model import Mechanism
from ..questions import Evolution, Result
from ..scene import Scene
from . import native
from .methods import METHODS
from .run import output_times
from .trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Trajectories:
    """N trajectories at the same times: t (T,) [s], q (N, T, nq), v (N, T, nv), work of the loads (N, T) [J]. `[i]` is a Trajectory."""

    scene: Scene
    t: Array
    q: Array
    v: Array
    work: Array
    stats: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, i: int) -> Trajectory:
        got = self.scene.evaluator.ask(Result(self.stats["formalism"]), t=self.t, q=self.q[i], v=self.v[i], tau=None)
        return Trajectory(self.scene, self.t, self.q[i], self.v[i], got["vdot"], got["u"], self.work[i], self.stats)


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

    method: "rk4" or "semi_implicit_euler", steps of at most dt [s]. Results at fps frames per second, or at `times`; fps=None: the end.
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
    names = [name for name, integrator in METHODS.items() if integrator.tableau and not integrator.adaptive]
    inputs.choice("method", method, names)
    inputs.choice("formalism", formalism, [f for f in FORMALISMS if f not in SADDLES])
    t0, t_end, dt = (inputs.number(k, x) for k, x in (("t0", t0), ("t_end", t_end), ("dt", dt)))
    if not t_end > t0 or dt <= 0:
        raise InputError(f"t_end={t_end} must be later than t0={t0}, and dt={dt} positive")
    wanted = np.array([t_end]) if fps is None and times is None else output_times(t0, t_end, fps, times)
    assert wanted is not None

    states = inputs.checked(scene.robot, {"q0": scene.robot.neutral() if q0 is None else q0, "v0": v0})
    q, v = (np.atleast_2d(x) for x in states.values())
    if q.ndim != 2:
        raise InputError(f"q0 and v0 have the leading dimensions {q.shape[:-1]}: give (N, nq) and (N, nv)")
    inputs.unit_quaternions(scene.equations().side_conditions(q))
    x0 = np.hstack([scene.equations().project(q), v, np.zeros((len(q), 1))])

    width = lanes()
    advance = native.compiled(scene.evaluator, method, formalism, width)
    settings = {"dt": dt, "rtol": 0.0, "atol": 0.0}
    found = np.empty((len(q), len(wanted), x0.shape[1]))
    started = time.perf_counter()

    def block(first: int) -> None:
        """One vector of trajectories; beyond the last state, the last again."""
        rows = np.minimum(np.arange(first, first + width), len(q) - 1)
        run = native.Run(advance, x0[rows].T, t0, wanted, settings)
        run.head_for(t_end)
        while (status := run.slice()) != DONE:
            if status > 1:
                bad = next(
                    (int(row) for row, x in zip(rows, run.x.T, strict=True) if not _can_move(scene, formalism, run.t, x)), int(rows[0])
                )
                raise SimulationError(
                    f"after t={run.t:.9g} s trajectory {bad} stopped being finite, or one of its joints showed no inertia: reduce dt, "
                    f"or look at q0[{bad}] with `simulate`"
                )
        found[rows] = run.results.transpose(2, 0, 1)

    with ThreadPoolExecutor(min(threads or os.cpu_count() or 1, -(-len(q) // width) or 1)) as pool:
        try:
            for _ in pool.map(block, range(0, len(q), width)):
                pass
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    nq, nv = scene.robot.nq, scene.robot.nv
    stats = {"method": method, "formalism": formalism, "dt": dt, "wall_time": time.perf_counter() - started, "completed": True}
    return Trajectories(scene, wanted, found[..., :nq], found[..., nq : nq + nv], found[..., nq + nv], stats)


def _can_move(scene: Scene, formalism: str, t: float, x: Array) -> bool:
    """Whether a state has accelerations."""
    nq, nv = scene.robot.nq, scene.robot.nv
    try:
        scene.evaluator.ask(Evolution(formalism), "numpy", t=t, q=x[:nq], v=x[nq : nq + nv], tau=None)
    except RobodynError:
        return False
    return True
