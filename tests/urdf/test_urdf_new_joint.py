"""A joint type from outside the package: its class and a word in JOINT_TYPES are all that it takes, from the URDF to a saved run."""

import io
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

import robodyn as rd
from robodyn.arithmetic import cos, sin
from robodyn.arithmetic.vectors import rotation
from robodyn.joints import JOINT_TYPES, Attribute, AxisJoint


@dataclass(frozen=True, eq=False)
class Helical(AxisJoint):
    """A screw: β the angle [rad], pitch the displacement along the axis [m/rad]."""

    kind = "helical"
    coordinates = (("", "rad"),)
    velocities = (("", "rad/s"),)
    attributes = {**AxisJoint.attributes, "pitch": Attribute("pitch", "screw")}

    pitch: float = 0.1

    def pose(self, q):
        return rotation(self.axis, cos(q[..., 0]), sin(q[..., 0])), self.pitch * q * self.axis

    def motion(self, q):
        return np.concatenate([self.axis, self.pitch * self.axis])[:, None]

    def actuation(self, q):
        return np.concatenate([self.axis, np.zeros(3)])[:, None]


LINK = '<link name="{0}"><inertial><mass value="2"/><inertia ixx="0.3" iyy="0.3" izz="0.5"/></inertial></link>'
JOINT = '<joint name="screw_{1}" type="helical">\n<parent link="{0}"/><child link="{1}"/><axis xyz="0 0 1"/>\n<screw pitch="{2}"/></joint>'


def screws(n=1, pitch="0.25"):
    names = [f"link_{i}" for i in range(n + 1)]
    joints = [JOINT.format(a, b, pitch) for a, b in pairwise(names)]
    return rd.load(io.StringIO(f'<robot name="screws">{"".join(map(LINK.format, names))}{"".join(joints)}</robot>'))


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    monkeypatch.setitem(JOINT_TYPES, "helical", Helical)


def test_the_file_is_read_and_its_ledger_knows_the_pitch():
    robot = screws()
    assert robot.joints[1].type.pitch == 0.25
    assert any(path == "joint/screw" and "[pitch]" in reason for path, verdict, reason in robot.ledger if verdict == "honoured")


@pytest.mark.parametrize("backend", ["native", "numpy", "mpmath"])
def test_it_falls_as_a_screw_does(backend):
    """(Θ + m p²) η̇ = τ − m g p."""
    tau = 0.7
    found = screws().forward_dynamics(np.array([0.4]), np.array([1.1]), np.array([tau]), backend=backend)
    assert abs(float(found[0]) - (tau - 2 * 9.81 * 0.25) / (0.5 + 2 * 0.25**2)) < 1e-14


def test_a_loop_of_many():
    """Natively as by NumPy; in a row about one axis, each moves all that follow: the last joint feels its own link alone."""
    robot = screws(60)
    assert robot.alone.evaluator.routes.loops
    q, v = robot.random_state(np.random.default_rng(0))
    a = np.random.default_rng(1).normal(size=robot.nv)
    tau = robot.inverse_dynamics(q, v, a)
    assert np.allclose(tau, robot.inverse_dynamics(q, v, a, backend="numpy"), rtol=1e-12, atol=1e-12)
    assert abs(tau[-1] - (0.5 * a.sum() + 2 * 0.25 * (0.25 * a.sum() + 9.81))) < 1e-11


def test_a_run_is_saved_and_loaded(tmp_path):
    run = rd.simulate(rd.Scene(screws()), t_end=0.1)
    run.save(tmp_path / "run.npz")
    assert rd.Trajectory.load(tmp_path / "run.npz").scene.robot.joints[1].type.pitch == 0.25


def test_a_wrong_pitch_is_refused_by_its_line():
    with pytest.raises(rd.UrdfError, match=r":3: <screw> in <joint name='screw_link_1'> pitch='steep'"):
        screws(pitch="steep")


def test_info_shows_it(tmp_path, capsys):
    from robodyn.cli import main

    file = tmp_path / "screw.urdf"
    file.write_text(f'<robot name="screws">{LINK.format("a")}{LINK.format("b")}{JOINT.format("a", "b", "0.25")}</robot>', encoding="utf-8")
    assert main(["info", str(file)]) == 0
    assert "helical" in capsys.readouterr().out
