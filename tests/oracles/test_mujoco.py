"""MuJoCo's twin of a robot against 50 digits, and its RK4 against ours, step for step."""

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the oracle needs mujoco: pip install '.[test]'")
pytest.importorskip("pinocchio", reason="the robots come with pin and example-robot-data: pip install '.[test]'")

import real_robots
from tools import EPS, condition, error

import robodyn as rd
from robodyn.evaluation.asking import EARTH
from robodyn.report.peers.mujoco import Twin

# Both sides round some dozens of times per joint of a path; κ carries it into accelerations. MuJoCo diagonalises inertias by Jacobi
# rotations until what is left is below 1e-12 of them.
C, DIAGONALISED = 100, 1e-12


@pytest.mark.parametrize("name", ["ur5", "talos_reduced", "tiago", "z1", "hyq"])
def test_accelerations(name):
    robot = real_robots.load(name)
    twin, rng = Twin(robot, 1e-3, EARTH), np.random.default_rng(5)
    assert twin.model.nbody == 1 + len(robot.owners)  # links on fixed joints are lumped for MuJoCo too
    for _ in range(3):
        q, v = robot.random_state(rng)
        tau = rng.normal(size=robot.nv)
        exact = robot.forward_dynamics(q, v, tau, backend="mpmath")
        assert error(twin.forward_dynamics(q, v, tau), exact) < condition(robot, q) * (C * EPS + DIAGONALISED)


def test_a_hundred_steps_of_rk4():
    """The same method from the same state: what differs are roundings, a hundred steps of about a dozen each."""
    robot = real_robots.load("ur5")
    rng = np.random.default_rng(6)
    q, v = robot.random_state(rng)
    twin, scene = Twin(robot, 1e-3, EARTH), rd.Scene(robot, declared=False)
    ours = rd.simulate(scene, t_end=0.1, q0=q, v0=v, method="rk4", dt=1e-3, times=[0.1])
    expected = np.concatenate([ours.q[-1], ours.v[-1]])
    tolerance = 100 * (C * EPS + DIAGONALISED) * abs(expected).max()
    assert abs(twin.run(q, v, 100) - expected).max() < tolerance
    crowd = twin.crowd(np.stack([q, q + 0.1]), np.stack([v, v]), 100, threads=2)()
    assert abs(crowd[0] - expected).max() < tolerance
    assert abs(crowd[1] - expected).max() > 1e-3


def test_what_mujoco_cannot_be_given_is_refused():
    with pytest.raises(rd.ModelError, match=r"soft constraint: lock the leader"):
        Twin(real_robots.load("panda"), 1e-3, EARTH)
    with pytest.raises(rd.ModelError, match="ground"):
        Twin(real_robots.load("solo12", floating_base=True), 1e-3, EARTH)
