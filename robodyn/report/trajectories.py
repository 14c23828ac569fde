"""Trajectories: equal steps beside MuJoCo's, adaptive ones beside SciPy's around pin.aba, crowds beside mujoco.rollout.

Errors are those of the state (q, v) at one time, the largest entry in rad, m, rad/s, m/s. They are measured against a reference that is
computed twice, by robodyn's dop853 on its own dynamics and by SciPy's DOP853 on Pinocchio's, both with a tolerance of 1e-13. A falling arm
can be chaotic; then no two computations agree for long and errors mean nothing. So both references are compared at growing times, and
errors are taken at the last time at which the two agree to AGREEMENT; times are always those of the whole span.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ..arithmetic import Array
from ..engine.emit.integrate import DONE
from ..errors import ModelError
from ..simulation import Trajectory, native, simulate, simulate_many
from ..simulation.times import step_count
from .accuracy import error
from .subject import Contest, Subject
from .timing import Job

AGREEMENT = 1e-9  # relative to the largest entry of the state, or to 1
SHARES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # of the time span, at which the references are compared
SAME = 1e-10  # MuJoCo's accelerations may differ by this, relative to the largest: its inertias are diagonalised to about 1e-12
RTOL = 1e-9


@dataclass(frozen=True, eq=False)
class Reference:
    """The state (2 nv,) at a time [s] at which two independent computations agree, and how far."""

    t: float
    state: Array
    agreement: float

    def error(self, state: Array) -> float:
        """The largest entry of the error of a state (2 nv,)."""
        return float(abs(state - self.state).max())

    def __str__(self) -> str:
        return f"errors at {self.t:g} s, where two references agree to {self.agreement:.0e}"


def rk4(subject: Subject) -> Iterator[Contest]:
    """One trajectory from rest, RK4 with the same equal steps, the end alone asked for: `simulate` beside MuJoCo stepping in C."""
    settings, (q, v) = subject.settings, _start(subject)

    def ours(t_end: float = settings.t_end) -> Trajectory:
        return simulate(subject.scene, t_end=t_end, q0=q, v0=v, method="rk4", dt=settings.dt, times=[t_end])

    work = f"{settings.t_end:g} s at {1 / settings.dt:g} Hz, RK4"
    if isinstance(twin := _same(subject), str):
        yield Contest("rk4", work, ours, 1, note=twin)
        return
    reference, name = _reference(subject), _mujoco_name()
    errors: dict[str, Any] = {"note": reference}
    if not isinstance(reference, str):
        there = twin.run(q, v, step_count(0.0, reference.t, settings.dt))
        errors = {"error": reference.error(_end(ours(reference.t))), "peer_error": reference.error(there), "note": str(reference)}
    steps = step_count(0.0, settings.t_end, settings.dt)
    yield Contest("rk4", work, ours, 1, peer=f"{name} mj_step(nstep={steps})", theirs=lambda: twin.run(q, v, steps), **errors)


def dop853(subject: Subject) -> Iterator[Contest]:
    """The same trajectory at the same tolerance with 60 states kept per second, beside SciPy's DOP853 around pin.aba."""
    from scipy.integrate import solve_ivp

    settings, (q, v) = subject.settings, _start(subject)

    def ours(t_end: float = settings.t_end) -> Trajectory:
        return simulate(subject.scene, t_end=t_end, q0=q, v0=v, method="dop853", rtol=RTOL, fps=60)

    work = f"{settings.t_end:g} s, dop853, rtol {RTOL:g}"
    reference = _reference(subject)
    if isinstance(pair := subject.pinocchio, str) or isinstance(reference, str):
        yield Contest("dop853", work, ours, 1, note=pair if isinstance(pair, str) else str(reference))
        return
    rate, x0 = pair.rate(), np.concatenate([q, v])

    def theirs(t_end: float = settings.t_end) -> Array:
        times = np.append(np.arange(0, t_end, 1 / 60), t_end)
        return solve_ivp(rate, (0.0, t_end), x0, method="DOP853", rtol=RTOL, atol=RTOL, t_eval=times).y[:, -1]

    errors = {"error": reference.error(_end(ours(reference.t))), "peer_error": reference.error(theirs(reference.t))}
    around = "pin.crba and rnea" if pair.has_mimic else "pin.aba"
    around += "" if pair.is_identity else ", with maps in Python"
    yield Contest("dop853", work, ours, 1, peer=f"SciPy DOP853 around {around}", theirs=theirs, note=str(reference), **errors)


def crowd(subject: Subject) -> Iterator[Contest]:
    """Many trajectories from rest, RK4, with the same threads: `simulate_many`, the ends alone, beside mujoco.rollout."""
    settings, n, (q, v) = subject.settings, subject.settings.crowd, _starts(subject)
    t_end = settings.crowd_steps * settings.dt

    def ours() -> Any:
        return simulate_many(subject.scene, q0=q, v0=v, t_end=t_end, dt=settings.dt, times=[t_end], threads=settings.threads)

    work = f"{n} trajectories of {settings.crowd_steps} steps, RK4, {settings.threads} threads"
    if isinstance(twin := _same(subject), str):
        yield Contest("crowd", work, ours, n, note=twin)
        return
    # Errors of the first few, each against an adaptive integration that is a million times as accurate as the steps.
    found, theirs, few = ours(), twin.crowd(q, v, settings.crowd_steps, settings.threads), range(min(settings.checked, n))
    there = theirs()
    exact = [_end(simulate(subject.scene, t_end=t_end, q0=q[i], v0=v[i], rtol=1e-13, times=[t_end])) for i in few]
    errors = [
        max(float(abs(x - y).max()) for x, y in zip(states, exact, strict=False))
        for states in (np.hstack([found.q[:, -1], found.v[:, -1]]), there)
    ]
    peer = {"peer": f"{_mujoco_name()} rollout", "theirs": theirs, "peer_units": n, "error": errors[0], "peer_error": errors[1]}
    yield Contest("crowd", work, ours, n, note="MuJoCo records every step, robodyn the last", **peer)


def steps_alone(subject: Subject, count: int = 5000) -> Job:
    """RK4 steps of dt in native code and nothing around them: no tracing, no results but the end."""
    q, v = _start(subject)
    advance = native.compiled(subject.scene.evaluator, "rk4", "auto", lanes=1)
    x0, t_end = subject.scene.evaluator.start(q, v)[:, None], count * subject.settings.dt

    def run() -> None:
        integration = native.Run(advance, x0, 0.0, np.array([t_end]), {"dt": subject.settings.dt, "rtol": 0.0, "atol": 0.0})
        integration.head_for(t_end)
        while (status := integration.slice()) != DONE:
            if status > 1:
                raise ModelError(f"the state stopped being finite at t={integration.t:g} s")

    return run


def _start(subject: Subject) -> tuple[Array, Array]:
    """At rest in the first of the random positions."""
    return subject.states[0][0], np.zeros(subject.robot.nv)


def _starts(subject: Subject) -> tuple[Array, Array]:
    q = np.resize(subject.states[0], (subject.settings.crowd, subject.robot.nq))
    return q, np.zeros((len(q), subject.robot.nv))


def _end(trajectory: Trajectory) -> Array:
    return np.concatenate([trajectory.q[-1], trajectory.v[-1]])


def _same(subject: Subject) -> Any:
    """MuJoCo's twin, once its accelerations are known to be ours; or why there is none."""
    if isinstance(twin := subject.mujoco, str):
        return twin
    found = np.stack([twin.forward_dynamics(*state) for state in zip(*subject.few, strict=True)])
    if (differs := error(found, subject.exact)) > SAME:
        return f"MuJoCo's accelerations differ from 50 digits by {differs:.1e}: it does not have the same robot"
    return twin


def _mujoco_name() -> str:
    from .peers.mujoco import NAME

    return NAME


@lru_cache(maxsize=1)
def _reference(subject: Subject) -> Reference | str:
    """The reference of the one trajectory, or why there is none."""
    from scipy.integrate import solve_ivp

    if isinstance(pair := subject.pinocchio, str):
        return f"no independent reference: {pair}"
    try:
        rate: Callable[..., Any] = pair.rate()
    except ModelError as error:
        return str(error)
    q, v = _start(subject)
    t, x, found = 0.0, np.concatenate([q, v]), None
    for share in SHARES:
        t_next = share * subject.settings.t_end
        x = solve_ivp(rate, (t, t_next), x, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
        mine = _end(simulate(subject.scene, t_end=t_next, q0=q, v0=v, rtol=1e-13, times=[t_next]))
        agreement = float(abs(mine - x).max())
        if agreement > AGREEMENT * max(1.0, abs(x).max()):
            break
        t, found = t_next, Reference(t_next, mine, agreement)
    return found or "no reference: two computations to 1e-13 do not agree"
