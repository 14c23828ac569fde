"""Show what a URDF describes: links, joints, masses, the order of the coordinates."""

import argparse

import numpy as np

from ..joints.base import AxisJoint
from ..model import Joint
from ..robot import Robot
from .common import load_robot, number, print_table, robot_arguments


def arguments(parser: argparse.ArgumentParser) -> None:
    robot_arguments(parser)


def run(options: argparse.Namespace) -> int:
    robot = load_robot(options)
    mass = sum(link.inertia.mass for link in robot.links)
    print(f"{robot.name}: {len(robot.links)} links, {len(robot.joints)} joints, nq={robot.nq}, nv={robot.nv}, mass {mass:.6g} kg\n")
    headings = ("joint", "type", "parent", "child", "axis", "q", "v", "lower", "upper", "damping", "friction")
    print_table(headings, (_joint_row(robot, i, joint) for i, joint in enumerate(robot.joints)), left=5)
    print()
    print_table(("link", "mass [kg]", "centre of mass [m]", "principal moments about it [kg m²]"), map(_link_row, robot.links))
    return 0


def _joint_row(robot: Robot, i: int, joint: Joint) -> tuple[object, ...]:
    kind = joint.type.kind
    if joint.mimic:
        kind += f" (mimics {robot.joints[joint.mimic.leader].name} × {joint.mimic.ratio:g} + {joint.mimic.offset:g})"
    parent = robot.links[joint.parent].name if joint.parent >= 0 else "(ground)"
    axis = " ".join(f"{a:g}" for a in np.round(joint.type.axis, 6) + 0.0) if isinstance(joint.type, AxisJoint) else ""
    limits = [number(x) if joint.type.bounded and np.isfinite(x) else "" for x in (joint.limits.lower, joint.limits.upper)]
    where = [_span(s) for s in (robot.q_slices[i], robot.v_slices[i])] if joint.type.nv else ["", ""]
    return joint.name, kind, parent, robot.links[i].name, axis, *where, *limits, number(joint.damping), number(joint.friction)


def _span(s: slice) -> str:
    return str(s.start) if s.stop == s.start + 1 else f"{s.start}…{s.stop - 1}"


def _link_row(link) -> tuple[object, ...]:
    moments = np.linalg.eigvalsh(link.inertia.about_own_centre)
    return link.name, number(link.inertia.mass), *("  ".join(number(x) for x in xs + 0.0) for xs in (link.inertia.centre, moments))
