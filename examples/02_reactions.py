"""What each bearing, flange and mounting plate feels.

    python examples/02_reactions.py

A reaction is the wrench on the child link, from its parent, about the joint's origin, resolved in the child link's frame:
the moment [N m] first, then the force [N].
"""

from pathlib import Path

import numpy as np

import robodyn as rd

ROBOTS = Path(__file__).parents[1] / "robots"
robot = rd.load(ROBOTS / "ur5e.urdf")
q, v = np.array([0.0, -0.6, 1.0, 0.2, 0.5, 0.0]), np.zeros(6)

# Held still with a tool that pushes: every joint of the file has a reaction, fixed ones and the joint to ground included.
scene = rd.Scene(robot, loads=[rd.LinkWrench("tool0", force=(0, 0, 100.0))])
holding = scene.inverse_dynamics(q, v, np.zeros(6))
reactions = scene.reactions(q, v, holding)
for name, wrench in reactions.items():
    print(f"{name:>20}  M {np.array2string(wrench[:3], precision=2, suppress_small=True):>26}  F {wrench[3:].round(2)}")

# The whole wrench contains the actuator's torque; the constraint's part does no work along the free axis.
axis = robot.joints[robot.joint_index("elbow_joint")].type.axis
total = scene.reactions(q, v, holding, part="total", joints=["elbow_joint"])["elbow_joint"]
print("\nelbow, moment about its axis [N m]: total", (total[:3] @ axis).round(3), "= actuator", holding[2].round(3))
print("elbow, constraint part about its axis:", reactions["elbow_joint"][:3] @ axis)

# In the world's frame the ground carries the weight less the push.
weight = 9.81 * sum(link.inertia.mass for link in robot.links)
ground = scene.reactions(q, v, holding, frame="world", joints=["ground"])["ground"]
print("ground [N]:", ground[3:].round(3), " weight − push:", round(weight - 100, 3))

# Over a motion: where and when is the worst load?
trajectory = rd.simulate(robot, t_end=0.6, rtol=1e-7)
forces = {name: np.linalg.norm(f[:, 3:], axis=-1) for name, f in trajectory.reactions().items()}
worst = max(forces, key=lambda name: forces[name].max())
print(f"falling: {worst} carries {forces[worst].max():.0f} N at {trajectory.t[forces[worst].argmax()]:.3f} s")
