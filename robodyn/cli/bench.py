"""Measure speed against error on robots of your own, beside Pinocchio, MuJoCo and SciPy in the same run.

Each time is the median of several rounds in which the contenders take turns after a warm-up, with the quartiles behind it. Results are
compared before any time is taken: with 50 digits (relative to the largest entry), trajectories with a reference computed twice. All
runs on one thread, save the many trajectories; compilation stands on rows of its own. Ctrl-C prints what there is.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.control import Control
from rich.segment import ControlType

from ..errors import InputError
from ..report import KINDS, Row, Settings, Subject, Timing, chain_rows, facts, machine, rows
from ..report.chains import COUNTS
from ..system.files import atomic_write, writable
from .common import assignments, loading_arguments, print_table

HEADINGS = ("work", "peer", "robodyn (quartiles)", "peer (quartiles)", "times faster", "error", "peer's error", "remark")


def arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("robots", metavar="ROBOT", nargs="*", help="URDF files")
    loading_arguments(parser)
    parser.add_argument(
        "--only", metavar="KIND,…", type=_kinds, action="extend", help=f"of {', '.join(KINDS)} (default all of them), repeatable"
    )
    parser.add_argument("--batch", type=int, metavar="N", help=f"states in a batch (default {Settings.batch})")
    parser.add_argument("--rounds", type=int, metavar="N", help=f"rounds of measuring (default {Settings.rounds})")
    parser.add_argument("--threads", type=int, metavar="N", help="threads of the many trajectories, on both sides (default all cores)")
    parser.add_argument(
        "--chains", type=int, metavar="N", nargs="*", help=f"also chains of N joints (default {' '.join(map(str, COUNTS))}); needs no ROBOT"
    )
    parser.add_argument("--yardstick", metavar="SCRIPT", help="also run a script that measures bare dynamics, in turn with robodyn")
    parser.add_argument("--json", metavar="FILE", help="write everything that was measured, in SI units")
    parser.add_argument(
        "--quick", action="store_true", help="a run of seconds that shows whether everything works; its figures mean nothing"
    )


def _kinds(text: str) -> list[str]:
    found = text.split(",")
    if unknown := [name for name in found if name not in KINDS]:
        raise argparse.ArgumentTypeError(f"there is no {unknown[0]!r}: choose from {', '.join(KINDS)}")
    return found


def run(options: argparse.Namespace) -> int:
    """Measure and print."""
    counts = list(COUNTS) if options.chains == [] else options.chains or []
    given = {name: x for name in ("batch", "rounds", "threads") if (x := getattr(options, name)) is not None}
    if bad := [f"--{name} {x}" for name, x in given.items() if x < 1] + [f"--chains {n}" for n in counts if n < 1]:
        raise InputError(f"{', '.join(bad)}: must be at least 1")
    if not options.robots and not counts:
        raise InputError("nothing to measure: give URDF files, or --chains")
    if options.yardstick and not Path(options.yardstick).is_file():
        raise InputError(f"--yardstick {options.yardstick}: there is no such file")
    if options.json:
        writable(options.json)
    settings = replace(Settings.quick() if options.quick else Settings(), **given)
    loading = {
        "floating_base": options.floating_base,
        "package_dirs": options.package_dir,
        "locked": assignments("--lock", options.lock),
    }
    progress, results = _Progress(), []
    try:
        for file in options.robots:
            subject = Subject(file, settings, loading)
            about = facts(subject)
            routes = ", ".join(f"{route} {n}" for route, n in about["operations"].items())
            if "unreduced" in about:
                loss = f"errors times {about['reduction_error']:.2g}"
                routes += f" (base inertial parameters: {about['unreduced']} without, {about['reduced']} with, {loss})"
            title = f"{about['name']}: {about['nv']} degrees of freedom, κ up to {about['condition']:.0e}; operations: {routes}"
            found = rows(subject, options.only or list(KINDS), script=options.yardstick, tick=progress.show)
            results.append({"file": file, **about, "rows": []})
            _print(title, found, progress, results[-1]["rows"])
        if counts:
            found = chain_rows(counts, settings, progress.show)
            results.append({"name": "chains", "rows": []})
            _print("chains of revolute joints", found, progress, results[-1]["rows"])
    finally:
        if options.json:
            record = {"machine": machine(), "settings": vars(settings), "robots": results}
            atomic_write(options.json, json.dumps(record, indent=1) + "\n")
    return 0


def _print(title: str, rows: Iterator[Row], progress: "_Progress", records: list[dict[str, Any]]) -> None:
    """Measure and print the rows, those there are where the user interrupts, and keep records of them."""
    found: list[Row] = []
    try:
        found.extend(rows)
    finally:
        progress.show("")
        print(f"\n{title}\n")
        print_table(HEADINGS, (_cells(row) for row in found), left=2)
        records += [row.record() for row in found]


def _cells(row: Row) -> tuple[str, ...]:
    def timing(x: Timing | None) -> str:
        return "" if x is None else str(x)

    def size(x: float | None, how: str) -> str:
        return "" if x is None else format(x, how)

    errors = size(row.error, ".0e"), size(row.peer_error, ".0e")
    return row.work, row.peer, timing(row.ours), timing(row.theirs), size(row.ratio, ".3g"), *errors, row.note


class _Progress:
    """One line on standard error, redrawn between rounds only: nothing runs beside what is timed."""

    def __init__(self) -> None:
        self._console = Console(stderr=True) if sys.stderr is not None else None

    def show(self, text: str) -> None:
        """Say what is being done, or nothing; nobody is told where nobody is looking."""
        if self._console and self._console.is_terminal:
            self._console.control(Control((ControlType.CARRIAGE_RETURN,), (ControlType.ERASE_IN_LINE, 2)))
            self._console.print(text, end="", markup=False, highlight=False, no_wrap=True, overflow="ellipsis")
