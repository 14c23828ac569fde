"""What the subcommands share: the options that load a robot, `joint=value` arguments, tables."""

import argparse
import sys
from collections.abc import Iterable, Sequence

from ..errors import InputError
from ..robot import Robot, load


def robot_arguments(parser: argparse.ArgumentParser) -> None:
    """The robot's file and how to load it."""
    parser.add_argument("robot", metavar="ROBOT", help="a URDF file")
    loading_arguments(parser)


def loading_arguments(parser: argparse.ArgumentParser) -> None:
    """How to load a robot."""
    parser.add_argument("--floating-base", action="store_true", help="let the root link move freely: the joint `ground` becomes free")
    parser.add_argument(
        "--lock", metavar="JOINT=VALUE", action="append", default=[], help="freeze a joint at a value [rad or m]; repeatable"
    )
    parser.add_argument("--package-dir", metavar="DIR", action="append", default=[], help="where package:// meshes are found; repeatable")


def load_robot(options: argparse.Namespace) -> Robot:
    """The robot that the options name."""
    locked = assignments("--lock", options.lock)
    return load(options.robot, floating_base=options.floating_base, package_dirs=options.package_dir, locked=locked)


def assignments(option: str, texts: Iterable[str]) -> dict[str, float]:
    """`name=number` arguments as a dictionary; InputError where one is not of this form."""
    found = {}
    for text in texts:
        name, _, value = text.rpartition("=")
        try:
            found[name] = float(value)
        except ValueError:
            name = ""
        if not name:
            raise InputError(f"{option} {text!r} is not of the form NAME=NUMBER, such as elbow_joint=1.57")
    return found


def print_table(headings: Sequence[str], rows: Iterable[Sequence[object]], *, left: int = 1) -> None:
    """A table on standard output; the first `left` columns are text, the others are aligned right."""
    if sys.stdout is None:  # a daemon's
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    for i, heading in enumerate(headings):
        table.add_column(heading, justify="left" if i < left else "right", overflow="fold")
    for row in rows:
        table.add_row(*(Text(str(cell)) for cell in row))

    class Output(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError  # `main` knows what to do; Rich would exit with 1

    # A pipe or a file is as wide as the table needs, whatever COLUMNS says.
    console = Output(highlight=False, markup=False)
    if not sys.stdout.isatty():
        needed = table.__rich_measure__(console, console.options.update(width=10_000)).maximum
        console = Output(highlight=False, markup=False, width=needed)
    console.print(table)


def number(x: float, digits: int = 4) -> str:
    """A number for a table."""
    return f"{x:.{digits}g}"
