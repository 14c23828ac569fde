"""Two ways to control a robot: a law that is compiled into the equations, and a digital controller.

python examples/04_control.py
"""

from pathlib import Path

import numpy as np

import robodyn as rd

ROBOTS = Path(__file__).parents[1] / "robots"

robot = rd.load(ROBOTS / "ur5e.urdf")
start, target = np.array([0.0, -1.2, 1.5, 0.0, 0.5, 0.0]), np.array([0.6, -1.0, 1.2, 0.3, 0.8, 0.4])
stiffness, damping = np.array([600, 900, 500, 60, 60, 1]), np.array([80, 120, 60, 4, 4, 0.02])


# Written with NumPy functions, a law of time and state is traced into the compiled equations: it acts at every instant.
def spring(t, q, v):
    wanted = start + np.tanh(2.0 * t) * (target - start)  # reaches out gently
    return stiffness * (wanted - q) - damping * v


continuous = rd.simulate(rd.Scene(robot, loads=[rd.ControlLaw(spring)]), t_end=2.0, q0=start)
print("continuous spring and damper: error at the end [rad]:", abs(continuous.q[-1] - target).max().round(4))


# A controller that remembers and branches runs as it does on the robot: asked once per period, its torques held in between.
class PID:
    """Proportional, integral and derivative, with limited torques."""

    limits = np.array([150, 150, 150, 28, 28, 28])

    def __init__(self, period):
        self.period, self.integral = period, np.zeros(robot.nv)

    def __call__(self, t, q, v):
        error = start + min(t / 0.8, 1.0) * (target - start) - q
        tau = stiffness * error + self.integral - damping * v
        for i in range(robot.nv):
            if abs(tau[i]) > self.limits[i]:
                tau[i] = np.sign(tau[i]) * self.limits[i]
            else:  # no winding up while the motor is at its limit
                self.integral[i] += self.period * 3 * stiffness[i] * error[i]
        return tau


period = 1e-3
digital = rd.simulate(rd.Scene(robot, loads=[rd.Sampled(PID(period), period)]), t_end=2.0, q0=start)
print("PID, asked 1000 times a second: error at the end [rad]:", abs(digital.q[-1] - target).max().round(4))

# The trajectory knows what was held: torques, reactions, and the work that the motors did.
print("largest torque of each joint [N m]:", abs(digital.u).max(axis=0).round(1))
print(f"force that the elbow carries, at most: {np.linalg.norm(digital.reactions()['elbow_joint'][:, 3:], axis=1).max():.1f} N")
print(f"work of the motors: {digital.work[-1]:.2f} J, energy drift {digital.energy().drift:.1e} J")
