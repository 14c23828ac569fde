"""Names → a tree, depth first in the order of the file."""

import subprocess
import sys
from itertools import pairwise

import numpy as np


def tree(names, *edges):
    links = "".join(f'<link name="{name}"/>' for name in names)
    joints = "".join(f'<joint name="{p}{c}" type="revolute"><parent link="{p}"/><child link="{c}"/></joint>' for p, c in edges)
    return f'<robot name="r">{links}{joints}</robot>'


def test_joints_come_depth_first_in_the_order_of_the_file(load):
    mechanism = load(tree("fedcba", "ce", "ac", "ab", "cd", "bf"))
    assert mechanism.all_joint_names == ("ground", "ac", "ce", "cd", "ab", "bf")
    assert mechanism.link_names == ("a", "c", "e", "d", "b", "f")
    assert [joint.parent for joint in mechanism.joints] == [-1, 0, 1, 1, 0, 4]


def test_one_link_is_a_robot(load):
    mechanism = load('<robot name="r"><link name="a"/></robot>')
    assert (mechanism.name, mechanism.nv, mechanism.all_joint_names) == ("r", 0, ("ground",))


def test_links_and_joints_may_share_a_name(load):
    joint = '<joint name="a" type="floating"><parent link="a"/><child link="b"/></joint>'
    mechanism = load(f'<robot name="r"><link name="a"/><link name="b"/>{joint}</robot>')
    assert (mechanism.nq, mechanism.nv) == (7, 6)


def test_a_chain_may_be_longer_than_the_stack(load):
    n = 5000
    names = [f"link{i}" for i in range(n + 1)]
    mechanism = load(tree(names, *pairwise(names)))
    assert mechanism.link_names == tuple(names)
    assert np.array_equal([joint.parent for joint in mechanism.joints], np.arange(-1, n))


def test_heavy_packages_are_imported_when_a_file_is_read():
    code = "import sys, robodyn.urdf; print(sorted({'yourdfpy', 'lxml', 'trimesh'} & {name.split('.')[0] for name in sys.modules}))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
