"""Write a page that shows a robot, or a saved run, in any browser, with no server and no network."""

import argparse
import webbrowser
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..simulation import Trajectory
from ..view import write_html
from .common import load_robot, loading_arguments


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("robot", metavar="ROBOT|RUN.npz", help="a URDF file, or what `robodyn simulate --npz` wrote")
    loading_arguments(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="the page (default: the input's name with .html, in this folder)")
    parser.add_argument("--open", action="store_true", help="open the page in the browser")


def run(options: argparse.Namespace) -> int:
    source = Path(options.robot)
    output = Path(options.output or f"{source.stem}.html")
    if _is_run(source):
        if options.lock or options.floating_base or options.package_dir:
            raise InputError(f"{source} is a saved run: --lock, --floating-base and --package-dir belong to URDF files")
        Trajectory.load(source).to_html(output)
    else:
        robot = load_robot(options)
        write_html(output, robot, times=np.zeros(1), poses=robot.link_poses(robot.neutral())[None])
    print(f"wrote {output}")
    if options.open:
        webbrowser.open(output.resolve().as_uri())
    return 0


def _is_run(path: Path) -> bool:
    """Whether a file is a zip archive, as every .npz is, whatever its name."""
    try:
        with open(path, "rb") as file:
            return file.read(2) == b"PK"
    except OSError:
        return path.suffix == ".npz"
