"""A column of a CSV table takes one entry in the table of quantities: one that is added here, from outside the package."""

import csv
from pathlib import Path

import numpy as np

import robodyn as rd
from robodyn.simulation.quantities import QUANTITIES, Quantity

ROBOTS = Path(__file__).parents[2] / "robots"


def test_a_column_takes_one_entry(tmp_path, monkeypatch):
    power = Quantity(
        name="power",
        shape=("nv",),
        unit="W",
        meaning="what damping does in the joints",
        found=lambda trajectory: trajectory.u * trajectory.v,
        csv="powers",
        labels=lambda scene: [(f"P.{name}", "W") for name in scene.robot.joint_names],
    )
    monkeypatch.setitem(QUANTITIES, power.name, power)
    robot = rd.load(ROBOTS / "pendulum.urdf")
    scene = rd.Scene(robot, loads=[rd.JointDamping({"hinge": 0.3})])
    trajectory = rd.simulate(scene, t_end=0.1, v0=[1.0])
    trajectory.to_csv(tmp_path)
    with open(tmp_path / "powers.csv", newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert header == ["t [s]", *(f"P.{name} [W]" for name in robot.joint_names)]
    assert np.array_equal(np.array(rows, dtype=float), np.column_stack([trajectory.t, trajectory.u * trajectory.v]))
    assert (trajectory.u * trajectory.v < 0).any()


def test_a_file_of_before_z_is_read(tmp_path):
    """Where no load has a state of its own, the file is what it was: without z."""
    trajectory = rd.simulate(rd.load(ROBOTS / "pendulum.urdf"), t_end=0.05)
    trajectory.save(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as file:
        assert "z" not in file
    assert rd.Trajectory.load(tmp_path / "run.npz").z.shape == (len(trajectory.t), 0)
