"""Simulate a robot, print what happened, and write the motion to files.

The robot moves under gravity, with the damping and friction that its file declares, from the initial state that --q0 and
--v0 give (zero where they do not). Reactions are the constraint wrench on each joint's child link, about the joint's origin.
"""

import argparse

import numpy as np

from ..arithmetic import Array
from ..errors import InputError, SimulationError
from ..evaluation.asking import EARTH
from ..scene import Scene
from ..simulation import METHODS, Trajectory, simulate
from ..system.files import make_folder, writable
from .common import assignments, load_robot, number, print_table, robot_arguments


def arguments(parser: argparse.ArgumentParser) -> None:
    robot_arguments(parser)
    motion = parser.add_argument_group("motion")
    motion.add_argument("--t-end", type=float, required=True, metavar="SECONDS", help="simulated time")
    motion.add_argument(
        "--q0",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="initial coordinate [rad or m]; repeatable; ground.z, shoulder.qw where a joint has several",
    )
    motion.add_argument("--v0", metavar="NAME=VALUE", action="append", default=[], help="initial velocity [rad/s or m/s]; repeatable")
    motion.add_argument("--gravity", type=float, nargs=3, default=EARTH, metavar=("X", "Y", "Z"), help="[m/s²], 0 0 -9.81 if not given")
    motion.add_argument("--method", choices=tuple(METHODS), default="dop853", help="dop853: adaptive, order 8 (default); rk4: equal steps")
    motion.add_argument("--rtol", type=float, default=1e-9, help="tolerance of dop853, absolute and relative (default 1e-9)")
    motion.add_argument("--dt", type=float, default=1e-3, metavar="SECONDS", help="step of rk4 (default 0.001)")
    motion.add_argument("--fps", type=float, default=60.0, help="states kept per second (default 60)")
    output = parser.add_argument_group("output")
    output.add_argument("--html", metavar="FILE", help="a page that shows the motion in any browser, with no server and no network")
    output.add_argument("--npz", metavar="FILE", help="everything, for `robodyn view FILE` and robodyn.Trajectory.load")
    output.add_argument("--csv", metavar="FOLDER", help="states.csv, reactions.csv, energy.csv")
    output.add_argument("--quiet", action="store_true", help="no progress bar")


def run(options: argparse.Namespace) -> int:
    for path in (options.html, options.npz):
        if path is not None:
            writable(path)  # an hour of computing must not end in a folder that was never there
    if options.csv is not None:
        make_folder(options.csv)
    robot = load_robot(options)
    q_names, v_names = robot.coordinate_names()
    q0 = _filled("--q0", options.q0, [name for name, _ in q_names], robot.neutral())
    v0 = _filled("--v0", options.v0, [name for name, _ in v_names], np.zeros(robot.nv))
    settings = {name: getattr(options, name) for name in ("t_end", "method", "rtol", "dt", "fps")}
    try:
        trajectory = simulate(Scene(robot, gravity=options.gravity), q0=q0, v0=v0, progress=not options.quiet, **settings)
    except SimulationError as error:
        if (partial := getattr(error, "trajectory", None)) is not None and len(partial.t) > 1:
            print(*_write(partial, options), sep="\n")
        raise
    written = _write(trajectory, options)  # first: whoever reads the report may leave early
    _report(trajectory)
    print(*written, sep="\n", end="\n" if written else "")
    return 0 if trajectory.completed else 130


def _filled(option: str, texts: list[str], names: list[str], values: Array) -> Array:
    for name, value in assignments(option, texts).items():
        if name not in names:
            raise InputError(f"{option} {name}={value:g}: there is no coordinate of that name; there are {', '.join(names)}")
        values[names.index(name)] = value
    return values


def _report(trajectory: Trajectory) -> None:
    """What happened, in a few lines."""
    robot, stats, energy = trajectory.scene.robot, trajectory.stats, trajectory.energy()
    how = f"{stats['method']}, rtol {stats['rtol']:g}" if "rtol" in stats else f"{stats['method']}, dt {stats['dt']:g} s"
    print(f"{robot.name}: {trajectory.t[0]:g} to {trajectory.t[-1]:g} s by {how}")
    print(f"  {stats['steps']} steps, {stats['evaluations']} evaluations, {stats['wall_time']:.3g} s of wall time")
    largest = float(energy.kinetic.max())
    share = f", {energy.drift / largest:.1e} of the largest kinetic energy {largest:.4g} J" if largest > 0 else ""
    print(f"  energy drift {energy.drift:.1e} J{share}; the loads took out {0.0 - energy.work[-1]:.4g} J")
    reactions = trajectory.reactions()
    rows = []
    for name in reactions.joint_names:
        row: list[object] = [name]
        for part in (slice(3, 6), slice(0, 3)):
            size = np.linalg.norm(reactions[name][:, part], axis=-1)
            row += [number(size.max()), f"{trajectory.t[size.argmax()]:.3f}"]
        rows.append(row)
    print(f"  drift and the largest reactions below are those of the {len(trajectory.t)} states kept; --fps keeps more\n")
    print_table(("largest reaction at joint", "force [N]", "at [s]", "moment [N m]", "at [s]"), rows)


def _write(trajectory: Trajectory, options: argparse.Namespace) -> list[str]:
    """Write what was asked for; a line about each."""
    written = []
    for name, write in (("html", trajectory.to_html), ("npz", trajectory.save), ("csv", trajectory.to_csv)):
        if (path := getattr(options, name)) is not None:
            write(path)
            written.append(f"wrote {path}")
    return written
