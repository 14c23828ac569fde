"""`simulate`: from a scene and its initial state to a trajectory."""

import time
import warnings
from collections.abc import Sequence
from typing import Any

from ..arithmetic import Array
from ..checks import inputs
from ..dynamics.equations import FORMALISMS
from ..dynamics.questions import Result
from ..errors import InputError, ModelError, RobodynWarning, SimulationError
from ..evaluation.evaluator import BACKENDS, DEFAULT
from ..model import Mechanism
from ..scene import Scene
from .integration import InNativeCode, InPython, advice
from .integrators import METHODS
from .progress import Progress, patient, reporter
from .times import output_times, refuse_empty
from .trajectory import Trajectory


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
    x0 = scene.evaluator.start(state["q0"], state["v0"])
    if backend == "native":
        scene.evaluator.unchanged.confirm()
    in_native_code = backend == "native" and METHODS[method].native and scene.evaluator.routes.compiles_steps(formalism)
    problem = scene, t0, t_end, x0, wanted, method, formalism, {"rtol": rtol, "atol": atol, "dt": dt}
    integration = InNativeCode(*problem) if in_native_code else InPython(*problem, backend)
    with reporter(progress, "compiling" if in_native_code else "simulating") as show:
        if not integration.starts():  # NumPy's formalism says why, if it does not
            scene.evaluator.ask(Result(formalism), "numpy", t=t0, q=state["q0"], v=state["v0"], tau=None)
        started, failure, report = time.perf_counter(), None, patient(show, t0, t_end)
        try:
            integration.run(report)
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
    trajectory = _finished(scene, t, x, integration.sampling.at(t), formalism, backend, stats)
    if failure is None and len(trajectory.t) < len(t):
        failure = SimulationError(f"after t={trajectory.t[-1]:.6g} s the states mean nothing: the integration is unstable. Reduce dt")
    if failure is not None:
        failure.trajectory = trajectory  # type: ignore[assignment]
        raise failure
    return trajectory


def _finished(scene: Scene, t: Array, x: Array, tau: Array | None, formalism: str, backend: str, stats: dict[str, Any]) -> Trajectory:
    """The trajectory of times (n,), states (n, nx) and what controllers held (n, nv): without its end where that is no state to trust."""
    try:
        return Trajectory.of(scene, t, scene.evaluator.state_vector.split(x), tau, formalism, backend, stats)
    except ModelError:
        # The last states may be what the integration failed at: keep what comes before them.
        if len(t) <= 1:
            raise
        kept = max(1, len(t) * 9 // 10)
        held = None if tau is None else tau[:kept]
        return _finished(scene, t[:kept], x[:kept], held, formalism, backend, stats | {"completed": False})
