"""Robots of the package example-robot-data."""

import sysconfig
import warnings
from pathlib import Path

import robodyn as rd
from robodyn.report.peers.pinocchio import Pair

DATA = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"

ROBOTS = {
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "talos_reduced": "talos_data/robots/talos_reduced.urdf",
    "talos_full": "talos_data/robots/talos_full_v2.urdf",
    "solo12": "solo_description/robots/solo12.urdf",
    "hyq": "hyq_description/robots/hyq_no_sensors.urdf",
    "anymal_c": "anymal_c_simple_description/urdf/anymal.urdf",
    "anymal_b": "anymal_b_simple_description/robots/anymal.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "romeo": "romeo_description/urdf/romeo_small.urdf",
    "tiago": "tiago_description/robots/tiago.urdf",
    "icub": "icub_description/robots/icub_reduced.urdf",
    "allegro_hand": "allegro_hand_description/urdf/allegro_right_hand.urdf",
    "z1": "z1_description/urdf/z1.urdf",
    "bolt": "bolt_description/robots/bolt.urdf",
    "go1": "go1_description/urdf/go1.urdf",
}


def load(name: str, *, floating_base: bool = False) -> rd.Robot:
    """A robot. What real files contain is reported by warnings, and tested elsewhere."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rd.RobodynWarning)
        return rd.load(DATA / ROBOTS[name], floating_base=floating_base)


def pair(name: str, *, floating_base: bool) -> Pair:
    """A robot in both libraries."""
    return Pair(load(name, floating_base=floating_base), DATA / ROBOTS[name])
