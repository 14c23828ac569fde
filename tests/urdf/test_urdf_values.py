"""What the tags become: numbers to the last bit, URDF's defaults, and the checks that only warn."""

import warnings

import numpy as np
import pytest

from robodyn import RobodynWarning
from robodyn.arithmetic.vectors import mirrored
from robodyn.joints import JOINT_TYPES, Continuous, Fixed, Free, Revolute
from robodyn.joints.base import AxisJoint
from robodyn.model import Box, Cylinder, Limits, Mesh, Sphere

EPS = np.finfo(float).eps


def text(*numbers):
    return " ".join(map(repr, map(float, np.ravel(numbers))))


def exact(*numbers):
    return np.array(numbers, dtype=np.longdouble)


def rpy_matrix(roll, pitch, yaw):
    """By hand, in extended precision: the rotation that URDF means."""
    angles = exact(roll, pitch, yaw)
    (a, b, c), (x, y, z) = np.cos(angles), np.sin(angles)
    return np.array([[c * b, c * y * x - z * a, c * y * a + z * x], [z * b, z * y * x + c * a, z * y * a - c * x], [-y, b * x, b * a]])


# --- anything written is read back ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_random_robots_are_read_to_the_last_bit(load, seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 30))
    names = [f"link {i} <&\"'ß>" for i in range(n)]
    parents = [int(rng.integers(0, i)) for i in range(1, n)]
    values = [
        {
            "mass": rng.exponential(),
            "centre": rng.normal(size=3),
            "xyz": rng.normal(size=3) * 10.0 ** rng.integers(-8, 8),
            "rpy": rng.uniform(-4, 4, 3),
            "axis": rng.normal(size=3),
            "kind": str(rng.choice(list(JOINT_TYPES))),
            "damping": rng.exponential(),
            "friction": rng.exponential(),
            "limits": [-rng.exponential(), rng.exponential(), rng.exponential(), rng.exponential()],
            "square": rng.normal(size=(3, 3)),
        }
        for _ in range(n)
    ]

    def escaped(name):
        return name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")

    parts = []
    for name, v in zip(names, values, strict=True):
        spread = v["square"] @ v["square"].T
        v["tensor"] = T = mirrored(np.trace(spread) * np.eye(3) - spread)  # as of real matter
        moments = " ".join(f'i{"xyz"[i]}{"xyz"[j]}="{float(T[i, j])!r}"' for i in range(3) for j in range(i, 3))
        parts.append(
            f'<link name="{escaped(name)}"><inertial><origin xyz="{text(v["centre"])}"/>'
            f'<mass value="{float(v["mass"])!r}"/><inertia {moments}/></inertial></link>'
        )
    for i, parent in enumerate(parents, start=1):
        v = values[i]
        lower, upper, velocity, effort = map(float, v["limits"])
        parts.append(
            f'<joint name="joint {i}" type="{v["kind"]}"><parent link="{escaped(names[parent])}"/><child link="{escaped(names[i])}"/>'
            f'<origin xyz="{text(v["xyz"])}" rpy="{text(v["rpy"])}"/><axis xyz="{text(v["axis"])}"/>'
            f'<limit lower="{lower!r}" upper="{upper!r}" velocity="{velocity!r}" effort="{effort!r}"/>'
            f'<dynamics damping="{float(v["damping"])!r}" friction="{float(v["friction"])!r}"/></joint>'
        )
    rng.shuffle(parts)
    mechanism = load(f'<robot name="r">{"".join(parts)}</robot>')

    assert sorted(mechanism.link_names) == sorted(names)
    for link, joint in zip(mechanism.links, mechanism.joints, strict=True):
        i = names.index(link.name)
        v = values[i]
        assert link.inertia.mass == v["mass"]
        assert np.array_equal(link.inertia.moment, v["mass"] * v["centre"])
        share = v["mass"] * (v["centre"] @ v["centre"])
        assert np.abs(link.inertia.about_own_centre - v["tensor"]).max() <= 8 * EPS * (np.trace(v["tensor"]) + share)
        if i == 0:
            assert joint.parent == -1
            continue
        assert joint.name == f"joint {i}"
        assert mechanism.link_names[joint.parent] == names[parents[i - 1]]
        assert type(joint.type) is JOINT_TYPES[v["kind"]]
        assert np.array_equal(joint.translation, v["xyz"])
        assert np.abs(joint.rotation - rpy_matrix(*v["rpy"])).max() <= 4 * EPS
        assert np.abs(joint.rotation.T @ joint.rotation - np.eye(3)).max() <= 4 * EPS
        if isinstance(joint.type, AxisJoint):
            assert np.abs(joint.type.axis - v["axis"] / np.linalg.norm(v["axis"])).max() <= 2 * EPS
        moves, bounded = joint.type.nv > 0, joint.type.bounded
        lower, upper, velocity, effort = v["limits"]
        assert joint.limits == Limits(
            *((lower, upper) if bounded else (-np.inf, np.inf)), *((velocity, effort) if moves else (np.inf, np.inf))
        )
        assert (joint.damping, joint.friction) == ((v["damping"], v["friction"]) if moves else (0.0, 0.0))


# --- poses and axes -----------------------------------------------------------------------------------------------------


def test_right_angles_leave_no_dust(load, arm):
    joint = load(arm(joint='<origin rpy="1.5707963267948966 0 -3.141592653589793"/>')).joints[1]
    assert set(np.abs(joint.rotation).ravel()) == {0.0, 1.0}
    assert not np.signbit(joint.rotation[joint.rotation == 0]).any()


def test_what_is_absent_has_urdf_s_default(load, arm):
    joint = load(arm()).joints[1]
    assert np.array_equal(joint.type.axis, [1, 0, 0])
    assert np.array_equal(joint.rotation, np.eye(3))
    assert not joint.translation.any()
    assert (joint.damping, joint.friction, joint.limits, joint.mimic) == (0.0, 0.0, Limits(), None)


@pytest.mark.parametrize("scale", [1e-8, 1.0, 3.0, 1e8])
def test_axes_are_brought_to_length_one(load, arm, scale):
    axis = load(arm(joint=f'<axis xyz="{text(0.0, 3.0 * scale, -4.0 * scale)}"/>')).joints[1].type.axis
    assert np.abs(axis - [0.0, 0.6, -0.8]).max() <= 2 * EPS


def test_dust_beside_an_axis_is_removed(load, arm):
    axis = load(arm(joint='<axis xyz="6.123e-17 -2 0"/>')).joints[1].type.axis
    assert np.array_equal(axis, [0, -1, 0])


@pytest.mark.parametrize("kind", JOINT_TYPES)
def test_every_joint_type_has_its_word(load, arm, kind):
    joint = load(arm(kind=kind)).joints[1]
    assert type(joint.type) is JOINT_TYPES[kind]


def test_the_root_is_fixed_or_free(load, arm):
    assert type(load(arm()).joints[0].type) is Fixed
    mechanism = load(arm(), floating_base=True)
    assert type(mechanism.joints[0].type) is Free
    assert (mechanism.nq, mechanism.nv, mechanism.joint_names) == (8, 7, ("ground", "elbow"))


# --- limits and dynamics --------------------------------------------------------------------------------------------------


def test_limits_without_bounds_are_none_and_noted(load, arm, row):
    for joint in ("", '<limit effort="0" velocity="0"/>'):
        mechanism = load(arm(joint=joint))
        assert (mechanism.joints[1].limits.lower, mechanism.joints[1].limits.upper) == (-np.inf, np.inf)
        assert "no lower and upper limit given: none assumed (joint 'elbow')" in row(mechanism, "joint/limit")
    assert (mechanism.joints[1].limits.effort, mechanism.joints[1].limits.velocity) == (0.0, 0.0)


def test_one_missing_bound_is_zero(load, arm):
    assert load(arm(joint='<limit upper="2"/>')).joints[1].limits == Limits(0.0, 2.0)


def test_a_limit_may_be_infinite(load, arm):
    limits = load(arm(joint='<limit lower="-inf" upper="Infinity" effort="1.8e308" velocity="inf"/>')).joints[1].limits
    assert limits == Limits()
    largest = float(np.finfo(float).max)  # how some exporters write "no limit"
    assert load(arm(joint=f'<limit lower="{-largest!r}" upper="{largest!r}"/>')).joints[1].limits == Limits(-largest, largest)


def test_bounds_of_a_continuous_joint_are_ignored(load, arm, row):
    mechanism = load(arm(kind="continuous", joint='<limit lower="1" upper="-1" effort="3" velocity="2"/>'))
    assert type(mechanism.joints[1].type) is Continuous
    assert mechanism.joints[1].limits == Limits(velocity=2.0, effort=3.0)
    assert "ignored: a continuous joint has no bounds" in row(mechanism, "joint/limit@lower")


def test_what_a_fixed_joint_cannot_have_is_ignored(load, arm, row):
    inside = '<axis xyz="0 0 0"/><limit lower="1" upper="0"/><dynamics damping="1" friction="1"/>'
    mechanism = load(arm(kind="fixed", joint=inside))
    joint = mechanism.joints[1]
    assert (joint.damping, joint.friction, joint.limits) == (0.0, 0.0, Limits())
    assert "a fixed joint has no axis" in row(mechanism, "joint/axis")
    assert "does not move" in row(mechanism, "joint/limit")
    assert "does not move" in row(mechanism, "joint/dynamics")


# --- inertia ----------------------------------------------------------------------------------------------------------------


def inertial(mass, moments, origin=""):
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    inertia = " ".join(f'{name}="{moment!r}"' for name, moment in zip(names, moments, strict=False))
    return f'<inertial>{origin}<mass value="{mass!r}"/><inertia {inertia}/></inertial>'


def test_the_inertial_frame_may_be_turned_and_shifted(load, arm):
    origin = '<origin xyz="0.1 -0.2 0.3" rpy="0.3 0.4 0.5"/>'
    inertia = load(arm(link=inertial(2.0, (0.3, 0.4, 0.5, 0.01, 0.02, -0.03), origin))).links[1].inertia
    R, c = rpy_matrix(0.3, 0.4, 0.5), exact(0.1, -0.2, 0.3)
    T = exact([0.3, 0.01, 0.02], [0.01, 0.4, -0.03], [0.02, -0.03, 0.5])
    about_origin = R @ T @ R.T + 2 * (c @ c * np.eye(3) - np.outer(c, c))
    assert np.abs(inertia.tensor - about_origin).max() <= 8 * EPS * np.trace(about_origin)
    assert np.array_equal(inertia.tensor, inertia.tensor.T)


def test_a_link_without_inertial_has_no_mass(load, arm):
    assert load(arm()).links[1].inertia.is_zero


@pytest.mark.parametrize(
    ("mass", "moments", "note"),
    [
        (1.0, (0.0, 0.0, 0.0), ""),  # a point mass
        (1.0, (1.0, 1.0, 2.0), ""),  # a plate
        (1.0, (0.0, 1.0, 1.0), ""),  # a rod
        (1.0, (0.1111, 0.2222, 0.3334), ""),  # a plate, rounded to four digits
        (1.0, (1.0, 1.0, 1.0, 1.0, 1.0, 1.0), "no rigid body has it"),  # semidefinite: moments 0, 0, 3
        (0.0, (1.0, 1.0, 1.0), "used although the link has no mass"),
        (0.0, (0.0, 0.0, 0.0), ""),
    ],
)
def test_what_an_inertia_may_be(load, arm, row, mass, moments, note):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mechanism = load(arm(link=inertial(mass, moments)))
    assert np.array_equal(np.diag(mechanism.links[1].inertia.tensor), moments[:3])
    assert note in row(mechanism, "link/inertial/inertia")
    assert "ignored" not in row(mechanism, "link/inertial/inertia")
    assert bool(note) == ("although" in row(mechanism, "link/inertial/inertia"))


def test_impossible_moments_are_used_and_a_warning(load, arm):
    with pytest.warns(RobodynWarning, match=r"robot\.urdf: link/inertial/inertia used although no rigid body has it.*'upper' line 3"):
        mechanism = load(arm(link=inertial(1.0, (1.0, 1.0, 3.0))))
    assert np.array_equal(mechanism.links[1].inertia.tensor, np.diag([1.0, 1.0, 3.0]))


def test_rounding_is_measured_against_the_whole_inertia(load, arm):
    """A tensor that is zero up to the rounding of a shift (as iCub's file has it) belongs to a point mass."""
    origin = '<origin xyz="0 0 0.1"/>'
    assert load(arm(link=inertial(1.0, (-1e-19, -1e-19, 0.0), origin))).links[1].inertia.mass == 1.0


# --- looks ----------------------------------------------------------------------------------------------------------------------


def test_shapes(load, arm):
    xml = "".join(
        f"<visual>{origin}<geometry>{shape}</geometry></visual>"
        for origin, shape in [
            ('<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>', '<box size="1 2 3"/>'),
            ("", '<cylinder radius="1" length="2"/>'),
            ("", '<sphere radius="0"/>'),
            ("", '<mesh filename="a.stl"/>'),
            ("", '<mesh filename="a.stl" scale="0.001"/>'),
            ("", '<mesh filename="a.stl" scale="1 -1 1"/>'),
        ]
    )
    box, cylinder, sphere, *meshes = load(arm(link=xml)).links[1].visuals
    assert isinstance(box.geometry, Box)
    assert box.geometry.size == (1.0, 2.0, 3.0)
    assert np.array_equal(box.translation, [1, 2, 3])
    assert np.array_equal(box.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert isinstance(cylinder.geometry, Cylinder)
    assert (cylinder.geometry.radius, cylinder.geometry.length) == (1.0, 2.0)
    assert isinstance(sphere.geometry, Sphere)
    assert sphere.geometry.radius == 0.0
    assert all(isinstance(mesh.geometry, Mesh) and mesh.geometry.path is None for mesh in meshes)
    assert [mesh.geometry.scale for mesh in meshes] == [(1.0, 1.0, 1.0), (0.001, 0.001, 0.001), (1.0, -1.0, 1.0)]


@pytest.mark.parametrize(
    ("visual", "reason"),
    [
        ("<visual/>", "holds no shape"),
        ("<visual><geometry/></visual>", "holds no shape"),
        ('<visual><geometry><capsule radius="1"/></geometry></visual>', "holds capsule: only box"),
    ],
)
def test_a_visual_that_shows_nothing_is_ignored(load, arm, row, visual, reason):
    mechanism = load(arm(link=visual))
    assert mechanism.links[1].visuals == ()
    assert f"ignored: {reason}" in row(mechanism, "link/visual")


def looks(load, arm, visual, more=""):
    xml = f'<visual><geometry><sphere radius="1"/></geometry>{visual}</visual>'
    mechanism = load(arm(link=xml, more=more))
    return mechanism, mechanism.links[1].visuals[0]


RED, BLUE = '<color rgba="1 0 0 1"/>', '<color rgba="0 0 1 0.5"/>'


def test_colours(load, arm, row):
    _, visual = looks(load, arm, "")
    assert (visual.colour, visual.material, visual.texture) == (None, None, None)
    _, visual = looks(load, arm, f'<material name="">{RED}</material>')
    assert visual.colour == (1.0, 0.0, 0.0, 1.0)
    _, visual = looks(load, arm, '<material name="m"/>', f'<material name="m">{BLUE}</material>')
    assert (visual.colour, visual.material) == ((0.0, 0.0, 1.0, 0.5), "m")
    _, visual = looks(load, arm, f'<material name="m">{RED}</material>', f'<material name="m">{BLUE}</material>')
    assert visual.colour == (1.0, 0.0, 0.0, 1.0)
    mechanism, visual = looks(load, arm, '<material name="m"/>', f'<material name="m">{BLUE}</material><material name="m">{RED}</material>')
    assert visual.colour == (0.0, 0.0, 1.0, 0.5)
    assert "ignored: a name that was given before" in row(mechanism, "material")
    mechanism, visual = looks(load, arm, '<material name="nowhere"/>')
    assert visual.colour is None
    assert "no material is named 'nowhere'" in row(mechanism, "link/visual/material@name")
    mechanism, visual = looks(load, arm, '<material name="m"><color rgba="255 0.5 -1 1"/></material>')
    assert visual.colour == (1.0, 0.5, 0.0, 1.0)
    assert "cut to it" in row(mechanism, "material/color@rgba")


def test_a_colour_of_one_visual_serves_another_by_name(load, arm):
    first = f'<visual><geometry><sphere radius="1"/></geometry><material name="m">{RED}</material></visual>'
    second = '<visual><geometry><sphere radius="1"/></geometry><material name="m"/></visual>'
    assert load(arm(link=second + first)).links[1].visuals[0].colour == (1.0, 0.0, 0.0, 1.0)
    named = f'<material name="m">{BLUE}</material>'  # the robot's own materials come first
    assert load(arm(link=second + first, more=named)).links[1].visuals[0].colour == (0.0, 0.0, 1.0, 0.5)


def test_textures(load, arm, row, tmp_path):
    (tmp_path / "wood.png").touch()
    _, visual = looks(load, arm, '<material name="m"><texture filename="wood.png"/></material>')
    assert visual.texture == str(tmp_path / "wood.png")
    mechanism, visual = looks(load, arm, '<material name="m"><texture filename="iron.png"/></material>')
    assert visual.texture is None
    assert "'iron.png' of link 'upper'" in row(mechanism, "material/texture@filename")
    mechanism, visual = looks(load, arm, '<material name="m"><texture/></material>')
    assert "names no file" in row(mechanism, "link/visual/material/texture")


def test_reading_leaves_arrays_that_cannot_be_changed(load, arm):
    joint = load(arm()).joints[1]
    assert isinstance(joint.type, Revolute)
    assert not any(a.flags.writeable for a in (joint.rotation, joint.translation, joint.type.axis))
