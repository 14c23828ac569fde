"""Times of a simulation: which can be told apart, how a span is cut into equal steps, and at which results are kept."""

import math
from collections.abc import Sequence

import numpy as np

from ..arithmetic import EPS, Array
from ..checks import inputs
from ..errors import InputError

MOST_RESULTS = 1e8  # of one trajectory: beyond this memory runs out first


def resolution(t0: float, t_end: float) -> float:
    """Times closer than this [s] are one: sums such as t0 + k dt, and the user's own, are a few roundings off."""
    return 32 * EPS * max(abs(t0), abs(t_end))


def refuse_empty(t0: float, t_end: float) -> None:
    """InputError where a span of time [s] ends no later than it starts, or times within it are all one."""
    if not t_end > t0:
        raise InputError(f"t_end={t_end} must be later than t0={t0}")
    if t_end - t0 <= (same := resolution(t0, t_end)):
        raise InputError(f"t0={t0} and t_end={t_end} are closer than {same:.3g} s, which is too close to tell times apart: start from t0=0")


def step_count(t0: float, t_end: float, dt: float) -> int:
    """How many equal steps of at most dt [s] the time span takes; a span that dt divides up to rounding takes no extra one."""
    return max(1, math.ceil((t_end - t0 - resolution(t0, t_end)) / dt * (1 - 1e-12)))


def step_times(t0: float, t_end: float, dt: float) -> Array:
    """t0 and the end of every step [s], to the bit as native code has them: t0 + k h rounded once, and t_end."""
    n = step_count(t0, t_end, dt)
    (a, c), (b, d) = t0.as_integer_ratio(), ((t_end - t0) / n).as_integer_ratio()
    whole = max(c, d)  # both are powers of two; a quotient of integers is rounded once
    a, b = a * (whole // c), b * (whole // d)
    return np.array([(a + k * b) / whole for k in range(n)] + [t_end])


def output_times(t0: float, t_end: float, fps: float | None, times: Sequence[float] | Array | None) -> Array | None:
    """Ascending times (n,) [s] with t_end as the last; None: every step.

    InputError where `times` do not ascend within [t0, t_end], fps is not positive, or the results are too many to keep.
    """
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
    if not (t_end - t0) * fps < MOST_RESULTS:
        raise InputError(f"{(t_end - t0) * fps:.3g} results are too many to keep: reduce fps={fps:g}, or give the times you need")
    frames = np.arange(int(np.ceil((t_end - t0) * fps * (1 - 1e-12)))) / fps + t0
    return np.append(frames[frames < t_end - resolution(t0, t_end)], t_end)
