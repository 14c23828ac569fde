"""When a scene's sampled controllers are asked, and what they hold in between."""

from array import array
from collections.abc import Callable, Iterator

import numpy as np

from ..arithmetic import Array
from ..errors import InputError, SimulationError
from ..scene import Scene
from .times import resolution


class Sampling:
    """The `Sampled` loads of a scene from t0 to t_end [s]: controller c is asked at t0 + k dt_c before t_end.

    Instants that differ by rounding are one: 3 · 0.1 s and 1 · 0.3 s. InputError for a period that float64 does not resolve in the span.
    """

    def __init__(self, scene: Scene, t0: float, t_end: float) -> None:
        self._robot, self._loads, self._t0, self._t_end = scene.robot, scene.sampled, t0, t_end
        self._rounding = resolution(t0, t_end)
        for load in self._loads:
            if not load.dt > 4 * self._rounding:
                raise InputError(
                    f"Sampled(…, dt={load.dt:g}): float64 does not tell instants so close apart between t={t0:g} and {t_end:g} s"
                )
        self._each = [np.zeros(scene.robot.nv) for _ in self._loads]
        self.held: Array | None = np.zeros(scene.robot.nv) if self._loads else None  # (nv,): what acts now
        self._times, self._values = array("d"), array("d")  # instants, and what has been held since each

    def __bool__(self) -> bool:
        return bool(self._loads)

    def spans(self, state: Callable[[], tuple[Array, Array]]) -> Iterator[tuple[float, float]]:
        """Start and end of each span of time without a sample; whoever is due is asked at its start, of q (nq,) and v (nv,) then.

        Raises SimulationError where a law fails; the law's own exception is its cause.
        """
        t, counts = self._t0, [0] * len(self._loads)
        while t < self._t_end:
            following = self._t_end
            for i, load in enumerate(self._loads):
                if self._t0 + counts[i] * load.dt <= t + self._rounding:
                    self._each[i] = self._ask(i, t, *state())
                    counts[i] += 1
                following = min(following, self._t0 + counts[i] * load.dt)
            if self._loads:
                self.held = sum(self._each[1:], self._each[0])
                self._values.frombytes(self.held.tobytes())  # before its instant: Ctrl-C may come in between
                self._times.append(t)
            # No sample at t_end: a simulation that goes on from there begins with it.
            following = following if following < self._t_end - self._rounding else self._t_end
            yield t, following
            t = following

    def _ask(self, i: int, t: float, q: Array, v: Array) -> Array:
        try:
            return self._loads[i].forces(self._robot, t, q, v)
        except InputError as error:
            raise SimulationError(str(error)) from error
        except Exception as error:
            raise SimulationError(f"the sampled control law raised {type(error).__name__} at t={t:.9g} s: {error}") from error

    def at(self, times: Array) -> Array | None:
        """What was held (n, nv) at times (n,) that were reached; at an instant, what was answered there. None: nothing is sampled.

        Where Ctrl-C came before the answer, what was held until then.
        """
        if not self._loads:
            return None
        if not len(self._times):
            return np.zeros((len(times), self._robot.nv))
        rows = np.searchsorted(np.array(self._times), times + self._rounding, side="right") - 1
        return np.array(self._values).reshape(-1, self._robot.nv)[rows]
