"""Published results, to their own digits."""

from pathlib import Path

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import robodyn as rd

ROBOTS = Path(__file__).parents[2] / "robots"


def test_simple_pendulum_A01():
    """IFToMM benchmark A01: 1 kg, 1 m, released horizontal; the position at 10 s to its twelve digits, and the rod's tension."""
    robot = rd.load(ROBOTS / "pendulum.urdf")
    trajectory = rd.simulate(robot, t_end=10.0, q0=[-np.pi / 2], rtol=1e-13)
    mass = (trajectory.link_poses()[:, -1] @ [0.0, 0.0, -1.0, 1.0])[:, [0, 2]]
    assert np.round(mass[-1], 12).tolist() == pytest.approx([0.275087462576, -0.961419205099], abs=1.0e-12)

    # Tension of the rod, 3 m g cos θ for the release from horizontal: a wrench the simulation never computes on its way.
    theta = trajectory.q[:, 0]
    force = trajectory.reactions(frame="world")[robot.joint_names[0]][:, 3:]
    towards_hinge = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], axis=-1)
    tension = (force * towards_hinge).sum(-1)
    assert np.allclose(tension, 3 * 9.81 * np.cos(theta), rtol=0, atol=1e-10)
    assert np.allclose(force - tension[:, None] * towards_hinge, 0, atol=1e-10)


def test_simple_pendulum_against_elliptic_functions():
    """sin(θ/2) = k sn(K(k) − ω t, k), k = sin(θ₀/2), at every output time of the benchmark's ten seconds."""
    trajectory = rd.simulate(rd.load(ROBOTS / "pendulum.urdf"), t_end=10.0, q0=[-np.pi / 2], rtol=1e-13)
    sn, *_ = ellipj(ellipk(0.5) - np.sqrt(9.81) * trajectory.t, 0.5)
    assert np.allclose(trajectory.q[:, 0], -2 * np.arcsin(np.sqrt(0.5) * sn), rtol=0, atol=1e-11)


def test_chaotic_babyboot():
    """Drake's benchmark to the digits that double precision can reach, and the file's own 20-digit reference.

    Errors grow by about 1e3 to 1e4 over the ten seconds, so rtol 1e-13 leaves about 1e-9 rad. Drake's own seventh digit of qB' is off
    by 7e-7: its figures come from an integration in double precision.
    """
    robot = rd.load(ROBOTS / "double_pendulum.urdf")
    trajectory = rd.simulate(robot, t_end=10.0, q0=np.radians([90.0, 1.0]), rtol=1e-13, atol=1e-14)
    q, v = np.degrees(trajectory.q[-1]), trajectory.v[-1]
    assert abs(q - [-61.3129833, -929.477897]) == pytest.approx(0, abs=2e-6)
    assert abs(v - [-6.744008, -2.779569]) == pytest.approx(0, abs=2e-6)
    assert abs(q - [-61.31298351750168553, -929.47789813700101347]) == pytest.approx(0, abs=1e-5)
    assert abs(v - [-6.74400807537376978, -2.77956967231066018]) == pytest.approx(0, abs=3e-6)
    assert trajectory.energy().drift < 1e-12


def test_uniform_rod_released_horizontal():
    """Closed forms: α = 3g/2l at release, hinge force mg/4 up there; 5mg/2 up at the bottom, with no horizontal part."""
    rod = rd.load(_rod_urdf(mass=2.0, length=0.8))
    g = 9.81
    assert rod.forward_dynamics([-np.pi / 2], [0.0]) == pytest.approx([3 * g / (2 * 0.8)])
    force = rod.reactions([-np.pi / 2], [0.0], frame="world")["hinge"][3:]
    assert force == pytest.approx([0, 0, 2.0 * g / 4], abs=1e-14)
    force = rod.reactions([0.0], [np.sqrt(3 * g / 0.8)], frame="world")["hinge"][3:]
    assert force == pytest.approx([0, 0, 2.5 * 2.0 * g], abs=1e-13)


def test_spinning_top_precesses_steadily():
    """Steady precession of a heavy symmetric top, upright angle 60°: A Ω² cosθ − C n Ω + m g l = 0 holds exactly for a free point."""
    m, l, A, C, g, theta, n = 0.5, 0.1, 0.006, 0.001, 9.81, np.pi / 3, 300.0
    omega = np.roots([A * np.cos(theta), -C * n, m * g * l]).min()  # the slow precession
    urdf = f"""<robot name="top"><link name="base"/><link name="top"><inertial><origin xyz="0 0 {l}"/><mass value="{m}"/>
      <inertia ixx="{A - m * l**2}" iyy="{A - m * l**2}" izz="{C}" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="point" type="spherical"><parent link="base"/><child link="top"/></joint></robot>"""
    top = rd.load(_text(urdf))
    q0 = [np.cos(theta / 2), 0.0, np.sin(theta / 2), 0.0]  # the axis leans towards x
    # Spin n is the whole angular velocity along the axis; Ω is about the vertical, resolved in the body.
    v0 = [-omega * np.sin(theta), 0.0, n]
    t_end = 2 * np.pi / omega
    trajectory = rd.simulate(top, t_end=t_end, q0=q0, v0=v0, rtol=1e-11)
    axis = trajectory.link_poses()[:, -1, :3, 2]
    expected = np.stack(
        [np.sin(theta) * np.cos(omega * trajectory.t), np.sin(theta) * np.sin(omega * trajectory.t), 0 * trajectory.t + np.cos(theta)], -1
    )
    assert np.allclose(axis, expected, rtol=0, atol=1e-7)
    assert np.allclose(np.linalg.norm(trajectory.q, axis=-1), 1, rtol=0, atol=4e-16)


def _text(urdf: str):
    import io

    return io.StringIO(urdf)


def _rod_urdf(mass: float, length: float):
    I = mass * length**2 / 12
    return _text(f"""<robot name="rod"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 {-length / 2}"/><mass value="{mass}"/>
      <inertia ixx="{I}" iyy="{I}" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>""")
