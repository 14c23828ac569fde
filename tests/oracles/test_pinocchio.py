"""Seventeen real robots of example-robot-data, fixed and free base, against Pinocchio."""

import re
import warnings

import numpy as np
import pytest

pin = pytest.importorskip("pinocchio", reason="the oracle needs pin and example-robot-data: pip install '.[test]'")

import real_robots  # noqa: E402
from real_robots import DATA, ROBOTS  # noqa: E402
from tools import EPS, ROUTES, condition, error  # noqa: E402

import robodyn as rd  # noqa: E402
from robodyn.report.peers.pinocchio import swap  # noqa: E402

# Both sides round: paths are up to 12 joints deep (24 roundings of a product of rotations each), Pinocchio's rotations
# come from the file by other formulas than ours (1 ulp of data), and κ carries that into accelerations.
C = 100


@pytest.fixture(
    scope="module",
    params=[(name, base) for name in ROBOTS for base in (False, True)],
    ids=lambda p: f"{p[0]}-{'free' if p[1] else 'fixed'}",
)
def pair(request):
    name, floating = request.param
    return real_robots.pair(name, floating_base=floating)


def states(pair, count=3):
    rng = np.random.default_rng(7)
    for _ in range(count):
        q, v = pair.robot.random_state(rng)
        yield q, v, rng.normal(size=pair.robot.nv), rng.normal(size=pair.robot.nv)


def test_sizes_and_masses(pair):
    assert pair.model.nv == pair.robot.nu
    assert pair.robot.joints[0].name == "ground"
    carried = pair.robot.links if pair.robot.joints[0].type.nv else ()
    if carried:
        assert np.isclose(sum(link.inertia.mass for link in carried), pin.computeTotalMass(pair.model), rtol=C * EPS)


def test_forward_dynamics(pair):
    for q, v, tau, _ in states(pair):
        expected, tolerance = pair.forward_dynamics(q, v, tau), C * condition(pair.robot, q) * EPS
        for route in ROUTES:
            if route == "recursive" and pair.robot.nu > pair.robot.nv:
                with pytest.raises(rd.ModelError, match="mimic"):
                    pair.robot.forward_dynamics(q, v, tau, formalism=route)
                continue
            assert error(pair.robot.forward_dynamics(q, v, tau, formalism=route), expected) < tolerance, route


def test_inverse_dynamics_and_mass_matrix(pair):
    for q, v, _, a in states(pair):
        assert error(pair.robot.inverse_dynamics(q, v, a), pair.inverse_dynamics(q, v, a)) < C * EPS
        assert error(pair.robot.mass_matrix(q), pair.mass_matrix(q)) < C * EPS
        assert error(pair.robot.bias_forces(q, v), pair.inverse_dynamics(q, v, 0 * v)) < C * EPS


def test_link_poses_and_energy(pair):
    for q, v, _, _ in states(pair):
        pin.framesForwardKinematics(pair.model, pair.data, pair.q(q))
        T = pair.robot.link_poses(q)
        for i, name in enumerate(pair.robot.link_names):
            frame = pair.data.oMf[pair.model.getFrameId(name, pin.FrameType.BODY)]
            assert error(T[i], frame.homogeneous) < C * EPS, name
        kinetic = pin.computeKineticEnergy(pair.model, pair.data, pair.q(q), pair.G @ v)
        assert np.isclose(pair.robot.kinetic_energy(q, v), kinetic, rtol=C * EPS)
        potential = pin.computePotentialEnergy(pair.model, pair.data, pair.q(q))
        masses = sum(i.mass for i in pair.model.inertias)
        assert np.isclose(pair.robot.potential_energy(q), potential, rtol=0, atol=C * EPS * masses * 9.81 * 2)


def test_total_joint_wrenches(pair):
    for q, v, tau, _ in states(pair):
        a = pair.forward_dynamics(q, v, tau)
        r = pair.robot.reactions(q, v, tau, part="total")
        expected = pair.joint_wrenches(q, v, a)
        scale = max(abs(f).max() for f in expected.values())
        tolerance = C * condition(pair.robot, q) * EPS * scale
        for name, f in expected.items():
            assert abs(r[name] - f).max() < tolerance, name
        # In the world's frame and the parent link's: the same wrench, turned by Pinocchio's rotations.
        pin.forwardKinematics(pair.model, pair.data, pair.q(q))
        world = pair.robot.reactions(q, v, tau, part="total", frame="world")
        for name, f in expected.items():
            R = pair.data.oMi[pair._pin(name)].rotation
            assert abs(world[name] - np.concatenate([R @ f[:3], R @ f[3:]])).max() < tolerance, name


@pytest.mark.parametrize("name", ["ur5", "panda", "talos_reduced", "solo12", "kinova"])
def test_reactions_of_fixed_joints_and_the_ground(name, tmp_path):
    """Every fixed joint made continuous and held at zero: Pinocchio then has a joint there, and its wrench must be our reaction.

    A root link `bench` is added below the file's root, so that the joint to ground becomes one that Pinocchio can see too.
    """
    text = (DATA / ROBOTS[name]).read_text()
    original = tmp_path / "original.urdf"
    original.write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rd.RobodynWarning)
        robot = rd.load(original)
    opened = re.sub(r"""type\s*=\s*(["'])fixed\1""", 'type="continuous"', text)
    ground = (
        f'<link name="bench"/><joint name="ground" type="continuous"><parent link="bench"/><child link="{robot.link_names[0]}"/></joint>'
    )
    opened = opened.replace("</robot>", ground + "</robot>")
    model = pin.buildModelFromXML(opened)
    data = model.createData()

    rng = np.random.default_rng(3)
    q, v = robot.random_state(rng)
    tau = rng.normal(size=robot.nv)
    a = robot.forward_dynamics(q, v, tau)
    q_pin, v_pin, a_pin = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    for i, joint in enumerate(robot.joints):
        if joint.type.nv:
            there, ratio, offset = (
                model.joints[model.getJointId(joint.name)],
                *((joint.mimic.ratio, joint.mimic.offset) if joint.mimic else (1, 0)),
            )
            angle = ratio * q[robot.q_slices[i]][0] + offset
            q_pin[there.idx_q : there.idx_q + there.nq] = angle if there.nq == 1 else (np.cos(angle), np.sin(angle))
            v_pin[there.idx_v], a_pin[there.idx_v] = ratio * v[robot.v_slices[i]][0], ratio * a[robot.v_slices[i]][0]
    pin.rnea(model, data, q_pin, v_pin, a_pin)

    r = robot.reactions(q, v, tau, part="total")
    fixed = [joint.name for joint in robot.joints if not joint.type.nv]
    assert "ground" in fixed
    assert len(fixed) > 1
    scale = abs(r.array).max()
    for joint in fixed:
        expected = swap(data.f[model.getJointId(joint)].vector)
        assert abs(r[joint] - expected).max() < C * condition(robot, q) * EPS * scale, joint
        assert np.array_equal(r[joint], robot.reactions(q, v, tau)[joint])  # a fixed joint has no free axis to tell the parts apart
