"""The `robodyn` command: one file per subcommand. Exit codes: 0 done, 1 an error of the input, 2 wrong usage, 130 interrupted."""

import argparse
import io
import os
import sys
import warnings
from collections.abc import Sequence

from .. import __version__
from ..errors import RobodynError, RobodynWarning
from . import bench, cache, check, info, simulate, view

COMMANDS = {"info": info, "check": check, "simulate": simulate, "view": view, "bench": bench, "cache": cache}

EPILOG = """examples:
  robodyn info robots/ur5e.urdf
  robodyn check my_robot.urdf
  robodyn simulate robots/ur5e.urdf --t-end 5 --html run.html
  robodyn simulate robots/quadruped.urdf --floating-base --q0 ground.z=0.6 --t-end 1 --npz run.npz
  robodyn view run.npz --open
Units are SI and radians. `robodyn COMMAND --help` explains each command."""


def parser() -> argparse.ArgumentParser:
    """The command line and its help."""
    root = argparse.ArgumentParser(
        prog="robodyn",
        description="Load a URDF, simulate it, and know what force every joint carries.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    root.add_argument("--version", action="version", version=f"robodyn {__version__}")
    commands = root.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, module in COMMANDS.items():
        summary = (module.__doc__ or "").strip()
        command = commands.add_parser(
            name, help=summary.split("\n")[0], description=summary, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        module.arguments(command)
    return root


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal or pipe that lacks a character shows another, and no traceback
            stream.reconfigure(errors="replace")
    options = parser().parse_args(argv)
    warnings.simplefilter("always", RobodynWarning)
    warnings.showwarning = _show_warning
    try:
        code = COMMANDS[options.command].run(options)
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except RobodynError as error:
        return _failed(1, f"error: {error}")
    except BrokenPipeError:  # `robodyn info … | head`: nobody reads on
        _no_more_output()
        return 0
    except OSError as error:  # standard output on a full disk
        _no_more_output()
        return _failed(1, f"error: {error}")
    except KeyboardInterrupt:
        return _failed(130, "interrupted")


def _failed(code: int, message: str) -> int:
    print(f"robodyn: {message}", file=sys.stderr)
    return code


def _no_more_output() -> None:
    """Let the interpreter's last flush go nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _show_warning(message, category, filename, lineno, file=None, line=None) -> None:
    print(f"robodyn: {'warning: ' if issubclass(category, RobodynWarning) else ''}{message}", file=sys.stderr)
