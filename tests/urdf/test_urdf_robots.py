"""Real robots, beside Pinocchio: the same freedoms, placements, axes and inertias."""

import sysconfig
import warnings
from pathlib import Path

import numpy as np
import pytest

from robodyn import UrdfError
from robodyn.model import Mesh, lump
from robodyn.urdf import read

pin = pytest.importorskip("pinocchio")

ROBOTS = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"
FILES = sorted(path.relative_to(ROBOTS).as_posix() for path in ROBOTS.rglob("*.urdf"))
if not FILES:
    pytest.skip("example-robot-data is not installed", allow_module_level=True)

# What cannot be read, and why.
BROKEN = {
    "alex_description/urdf/alex_psyonic_hands.urdf": r"1037: <mimic> in <joint name='Left_index_q2'> follows joint='index_q1', which",
    "ur_description/urdf/ur3.urdf": r"6: <robot> has no link",
}
PACKAGE = "package://example-robot-data/robots/"
SOUND = [name for name in FILES if name not in BROKEN]
TOLERANCE = 1e-12  # relative to the largest number of the kind: Pinocchio goes by quaternions, some 1000 roundings of eps


@pytest.mark.parametrize("name", sorted(set(BROKEN) & set(FILES)))
def test_what_is_broken_is_named(name):
    with pytest.raises(UrdfError, match=BROKEN[name]):
        read(ROBOTS / name)


def test_a_negative_moment_warns_and_is_refused_only_where_it_moves():
    """TIAGo's antennas have one but are lumped into its base; a body of Romeo's moves with one."""
    import robodyn as rd

    with pytest.warns(rd.RobodynWarning, match="negative principal moment"):
        tiago = rd.load(ROBOTS / "tiago_description/robots/tiago.urdf")
    assert np.isfinite(tiago.forward_dynamics(tiago.neutral(), np.zeros(tiago.nv))).all()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rd.RobodynWarning)
        romeo = rd.load(ROBOTS / "romeo_description/urdf/romeo_laas_small.urdf", floating_base=True)
    assert np.isfinite(romeo.link_poses(romeo.neutral())).all()
    with pytest.raises(rd.ModelError, match=r"body of link 'base_link' has the principal moments of inertia -0\.021"):
        romeo.forward_dynamics(romeo.neutral(), np.zeros(romeo.nv))


@pytest.mark.filterwarnings("ignore::robodyn.RobodynWarning")
@pytest.mark.parametrize("floating", [False, True], ids=["fixed", "floating"])
@pytest.mark.parametrize("name", SOUND)
def test_pinocchio_reads_the_same_robot(name, floating):
    mechanism = read(ROBOTS / name, floating_base=floating)
    model = pin.buildModelFromUrdf(str(ROBOTS / name), *([pin.JointModelFreeFlyer()] if floating else []))
    assert mechanism.nu == model.nv  # Pinocchio gives a mimic joint a coordinate of its own
    assert len(mechanism.links) == sum(frame.type == pin.FrameType.BODY for frame in model.frames)

    tree = lump(mechanism)
    bodies = {mechanism.joints[body.link].name.replace("ground", "root_joint"): body for body in tree.bodies}
    assert set(bodies) == set(model.names[1:])
    scale = max([1.0, *(np.abs(placement.translation).max() for placement in model.jointPlacements)])
    for joint, body in bodies.items():
        i = model.getJointId(joint)
        parent = tree.bodies[body.parent].link if body.parent >= 0 else None
        assert model.names[model.parents[i]].replace("root_joint", "ground") == (
            "universe" if parent is None else mechanism.joints[parent].name
        )
        assert np.abs(body.rotation - model.jointPlacements[i].rotation).max() <= TOLERANCE
        assert np.abs(body.translation - model.jointPlacements[i].translation).max() <= TOLERANCE * scale

        # The motion subspace; Pinocchio puts the linear part first, in the velocities of a free joint too.
        S = np.roll(model.joints[i].createData().S.reshape(6, -1), 3, axis=0)
        S = np.roll(S, 3, axis=1) if body.joint.nv == 6 else S
        assert np.abs(S - body.joint.motion(body.joint.neutral())).max() <= TOLERANCE

        theirs, ours = model.inertias[i], body.inertia
        assert abs(ours.mass - theirs.mass) <= TOLERANCE * theirs.mass
        about = theirs.inertia - theirs.mass * pin.skew(theirs.lever) @ pin.skew(theirs.lever)
        assert np.abs(ours.moment - theirs.mass * theirs.lever).max() <= TOLERANCE * theirs.mass * scale
        assert np.abs(ours.tensor - about).max() <= TOLERANCE * max(np.abs(about).max(), theirs.mass * scale**2)

    masses = sum(link.inertia.mass for link in mechanism.links)
    assert abs(masses - sum(inertia.mass for inertia in model.inertias)) <= TOLERANCE * masses


@pytest.mark.filterwarnings("ignore::robodyn.RobodynWarning")
@pytest.mark.parametrize("name", SOUND)
def test_pinocchio_puts_the_links_where_we_do(name):
    mechanism = read(ROBOTS / name)
    model = pin.buildModelFromUrdf(str(ROBOTS / name))
    tree = lump(mechanism)
    for i, link in enumerate(mechanism.links):
        frame = model.frames[model.getFrameId(link.name, pin.FrameType.BODY)]
        body = tree.bodies[tree.link_body[i]].link if tree.link_body[i] >= 0 else None
        assert model.names[frame.parentJoint] == ("universe" if body is None else mechanism.joints[body].name)
        assert np.abs(tree.link_rotation[i] - frame.placement.rotation).max() <= TOLERANCE
        assert np.abs(tree.link_translation[i] - frame.placement.translation).max() <= TOLERANCE


@pytest.mark.filterwarnings("ignore::robodyn.RobodynWarning")
@pytest.mark.parametrize("name", SOUND)
def test_pinocchio_reads_the_same_limits_and_forces(name):
    mechanism = read(ROBOTS / name)
    model = pin.buildModelFromUrdf(str(ROBOTS / name))
    for joint in mechanism.joints:
        if joint.type.nv != 1:
            continue
        i = model.joints[model.getJointId(joint.name)]
        assert (model.damping[i.idx_v], model.friction[i.idx_v]) == (joint.damping, joint.friction)
        if joint.type.bounded and "no lower and upper limit" not in str(mechanism.ledger):
            assert (model.lowerPositionLimit[i.idx_q], model.upperPositionLimit[i.idx_q]) == (joint.limits.lower, joint.limits.upper)
            assert (model.velocityLimit[i.idx_v], model.effortLimit[i.idx_v]) == (joint.limits.velocity, joint.limits.effort)


@pytest.mark.parametrize("name", SOUND)
def test_meshes_that_are_there_are_found(name):
    """Those of the package example-robot-data, which lies above its robots."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mechanism = read(ROBOTS / name)
    shapes = [visual.geometry for link in mechanism.links for visual in link.visuals]
    for mesh in shapes:
        if isinstance(mesh, Mesh) and mesh.filename.startswith(PACKAGE):
            assert (mesh.path is not None) == (ROBOTS / mesh.filename.removeprefix(PACKAGE)).is_file()
