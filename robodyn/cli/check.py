"""Check a URDF: print every problem, and what became of every tag.

Exit code 0 where the robot can be simulated, 1 where it cannot.
"""

import argparse
import warnings

import numpy as np

from ..errors import RobodynWarning
from .common import load_robot, print_table, robot_arguments


def arguments(parser: argparse.ArgumentParser) -> None:
    robot_arguments(parser)


def run(options: argparse.Namespace) -> int:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RobodynWarning)
        robot = load_robot(options)
    if robot.ledger:
        print_table(("element", "what became of it", "why"), robot.ledger, left=3)
        print()
    for warning in caught:
        print(f"warning: {warning.message}")

    # Is the motion determined? Asked of the equations themselves, at states that nobody chose.
    rng = np.random.default_rng(0)
    q, v = (np.array(x) for x in zip(*(robot.random_state(rng) for _ in range(3)), strict=True))
    robot.forward_dynamics(q, v)
    print(
        f"{robot.name}: no error, {len(caught)} warning{'s' * (len(caught) != 1)}; nq={robot.nq}, nv={robot.nv}, its motion is determined"
    )
    return 0
