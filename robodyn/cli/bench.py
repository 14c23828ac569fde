"""Measure speed against error on robots of your own, beside Pinocchio in the same run.

Each figure is the median of several rounds in which all contenders take turns, after a warm-up; compilation is not in it and stands
on a line of its own. Errors are measured against 50-digit arithmetic, relative to the largest entry of a state's result.
"""

import argparse

from ..report import measure
from ..robot import load
from .common import loading_arguments, print_table


def arguments(parser: argparse.ArgumentParser) -> None:
    """The command's options."""
    parser.add_argument("robots", metavar="ROBOT", nargs="+", help="URDF files")
    loading_arguments(parser)
    parser.add_argument("--batch", type=int, default=4096, help="states in a batch (default 4096)")
    parser.add_argument("--rounds", type=int, default=9, help="rounds of measuring (default 9)")


def run(options: argparse.Namespace) -> int:
    """Measure and print."""
    for file in options.robots:
        robot = load(file, floating_base=options.floating_base, package_dirs=options.package_dir)
        result = measure(robot, file, batch=options.batch, rounds=options.rounds)
        operations = ", ".join(f"{route} {n}" for route, n in result.operations.items())
        print(f"\n{robot.name}, {robot.nv} degrees of freedom; operations of forward dynamics: {operations}")
        print(f"first call {result.first_call:.2f} s; batch kernel {result.rate:.1f} Gflop/s")
        headings = ("one thread", "robodyn [µs]", "Pinocchio [µs]", "times faster", "robodyn's error", "Pinocchio's error")
        print_table(headings, (row.cells() for row in result.rows))
    return 0
