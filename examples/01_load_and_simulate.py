"""Load a URDF, ask it a few questions, let it fall.

python examples/01_load_and_simulate.py
"""

from pathlib import Path

import numpy as np

import robodyn as rd

ROBOTS = Path(__file__).parents[1] / "robots"

# A robot is immutable. q and v follow the order of robot.joint_names.
robot = rd.load(ROBOTS / "ur5e.urdf")
print(robot)
print("joints:", ", ".join(robot.joint_names))

# Rigid bodies and gravity alone: one state, or any number in leading dimensions.
q, v = robot.random_state(np.random.default_rng(0))
tau = np.zeros(robot.nv)
a = robot.forward_dynamics(q, v, tau)
print("accelerations [rad/s²]:", a.round(3))
print("torques that would hold it still [N m]:", robot.inverse_dynamics(q, 0 * v, 0 * v).round(3))
print("condition of the mass matrix:", np.linalg.cond(robot.mass_matrix(q)).round(1))

# A scene adds what the file declares, here damping in the joints, and loads of your own.
scene = rd.Scene(robot, loads=[rd.JointSpring({"elbow_joint": 40.0})])
trajectory = rd.simulate(scene, t_end=0.5, q0=robot.neutral(), rtol=1e-8)
print(trajectory)
print("final position [rad]:", trajectory.q[-1].round(4))
print(f"energy drift: {trajectory.energy().drift:.1e} J")

# The same states by all four routes of the formalism.
for formalism in ("recursive", "nonrecursive", "saddle_joint", "saddle_body"):
    difference = robot.forward_dynamics(q, v, tau, formalism=formalism) - a
    print(f"{formalism:>13}: differs by {abs(difference).max():.1e}")
