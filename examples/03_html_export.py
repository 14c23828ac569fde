"""Simulate and write a page that shows the motion in any browser, with no server and no network: mail it.

python examples/03_html_export.py [FILE.html]
"""

import sys
from pathlib import Path

import robodyn as rd

ROBOTS = Path(__file__).parents[1] / "robots"
page = sys.argv[1] if len(sys.argv) > 1 else "double_pendulum.html"

robot = rd.load(ROBOTS / "double_pendulum.urdf")
trajectory = rd.simulate(robot, t_end=3.0, q0=[1.57, 0.02])
trajectory.to_html(page)
print("wrote", page)
