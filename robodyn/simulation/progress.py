"""What is shown of a simulation under way: a bar or a callback, and a warning to whoever would wait for hours."""

import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..errors import RobodynWarning

SOON = (10.0, 600.0)  # [s]: after that time, whoever has to wait for longer than that hears of it

Progress = Callable[[float], None]  # called with the simulated share of the time span, 0…1


def patient(report: Progress, t0: float, t_end: float) -> Progress:
    """The report, which warns once where the rest will take very long: few expect that of a motion that grows without bound.

    The warning names the line that called `simulate`, three calls above.
    """
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
def reporter(progress: bool | Progress, first: str) -> Iterator[Progress]:
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
