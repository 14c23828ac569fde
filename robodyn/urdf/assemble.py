"""The values of a URDF, as yourdfpy read them → links and joints, depth first, in the order of the file."""

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arithmetic import Array
from ..arithmetic.vectors import frozen, orthonormal, snapped, unit
from ..errors import InputError
from ..joints import JOINT_TYPES, Fixed, Free
from ..model import GROUND, Box, Cylinder, Geometry, Inertia, Joint, Limits, Link, Mechanism, Mesh, Mimic, Sphere, Visual
from .ledger import Ledger

if TYPE_CHECKING:
    from yourdfpy import urdf

Find = Callable[[str], str | None]  # file name in the URDF → file


@dataclass(frozen=True)
class Appearance:
    """What visuals refer to: materials by name, files by name, and the ledger that hears of what is missing."""

    materials: "dict[str, urdf.Material]"
    find: Find
    ledger: Ledger


def assemble(
    robot: "urdf.Robot", constants: Mapping[str, Mapping[str, Any]], find: Find, ledger: Ledger, *, source: str | None, floating_base: bool
) -> Mechanism:
    """The mechanism with every joint free to move: `couple` adds mimics and locks. constants: of each joint's type, by the joint's name."""
    links = {link.name: link for link in robot.links}
    children: dict[str, list[urdf.Joint]] = defaultdict(list)
    for joint in robot.joints:
        children[joint.parent].append(joint)
    root = (links.keys() - {joint.child for joint in robot.joints}).pop()

    # Depth first with a stack of our own: chains may be longer than Python's.
    appearance = Appearance(materials(robot), find, ledger)
    order: list[Link] = [link_of(links[root], appearance)]
    joints = [Joint(GROUND, Free() if floating_base else Fixed(), -1)]
    stack = [(joint, 0) for joint in reversed(children[root])]
    while stack:
        joint, parent = stack.pop()
        stack += [(child, len(order)) for child in reversed(children[joint.child])]
        order.append(link_of(links[joint.child], appearance))
        joints.append(joint_of(joint, constants[joint.name], parent, ledger))
    return Mechanism(robot.name, tuple(order), tuple(joints), source=source)


def pose_of(origin: Array | None) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,). yourdfpy's rotation is within 3e-16 of the one that the file's rpy mean."""
    T = np.eye(4) if origin is None else origin
    return frozen(orthonormal(snapped(T[:3, :3]))), frozen(T[:3, 3])


# --- links ------------------------------------------------------------------------------------------------------------


def link_of(link: "urdf.Link", appearance: Appearance) -> Link:
    """A link with its inertia and its looks."""
    visuals = tuple(visual_of(visual, link.name, appearance) for visual in link.visuals)
    return Link(link.name, inertia_of(link.inertial), visuals)


def inertia_of(inertial: "urdf.Inertial | None") -> Inertia:
    """About the link's origin: the file gives the tensor about the centre of mass, along the axes of its own frame."""
    if inertial is None:
        return Inertia.zero()
    R, centre = pose_of(inertial.origin)
    return Inertia.about_centre(inertial.mass or 0.0, centre, R @ inertial.inertia @ R.T)


def materials(robot: "urdf.Robot") -> "dict[str, urdf.Material]":
    """By name; the first definition counts, those at the top of the file before those in visuals."""
    inline = [visual.material for link in robot.links for visual in link.visuals if visual.material]
    named: dict[str, urdf.Material] = {}
    for material in [*robot.materials, *inline]:
        if material.name and (material.color or material.texture):
            named.setdefault(material.name, material)
    return named


def visual_of(visual: "urdf.Visual", link: str, appearance: Appearance) -> Visual:
    """A visual with the colour and the texture of its own material, or of the one that it names."""
    R, r = pose_of(visual.origin)
    material = visual.material
    name = material.name if material else None
    if material and not (material.color or material.texture):
        material = appearance.materials.get(material.name or "")
        if name and not material:
            appearance.ledger.ignore("link/visual/material@name", f"no material is named {name!r}", f"link {link!r}")
    colour = None
    if material and material.color:
        colour = tuple(np.clip(material.color.rgba, 0.0, 1.0).tolist())
        if colour != tuple(material.color.rgba):
            appearance.ledger.honour("material/color@rgba", "beyond 0…1: cut to it", f"link {link!r}")
    texture = None
    if material and material.texture:
        texture = found("material/texture@filename", material.texture.filename, link, appearance)
    return Visual(geometry_of(visual.geometry, link, appearance), R, r, colour, name, texture)


def geometry_of(geometry: Any, link: str, appearance: Appearance) -> Geometry:
    """The one shape that the check left in yourdfpy's record of four."""
    if geometry.box:
        return Box(tuple(geometry.box.size.tolist()))
    if geometry.cylinder:
        return Cylinder(geometry.cylinder.radius, geometry.cylinder.length)
    if geometry.sphere:
        return Sphere(geometry.sphere.radius)
    name, scale = geometry.mesh.filename, geometry.mesh.scale
    x, y, z = np.broadcast_to(1.0 if scale is None else scale, 3).tolist()
    return Mesh(name, found("link/visual/geometry/mesh@filename", name, link, appearance), (x, y, z))


def found(path: str, filename: str, link: str, appearance: Appearance) -> str | None:
    """The file, or None and a row in the ledger."""
    file = appearance.find(filename)
    if file is None:
        appearance.ledger.ignore(path, "file not found: name its package's folder in package_dirs", f"{filename!r} of link {link!r}")
    return file


# --- joints -----------------------------------------------------------------------------------------------------------


def joint_of(joint: "urdf.Joint", constants: Mapping[str, Any], parent: int, ledger: Ledger) -> Joint:
    """A joint on the link with this number."""
    R, r = pose_of(joint.origin)
    others = {name: value for name, value in constants.items() if name != "axis"}
    type = JOINT_TYPES[joint.type].from_axis(snapped(unit(constants.get("axis", np.eye(3)[0]))), **others)
    dynamics = joint.dynamics
    damping, friction = (float(value or 0.0) for value in (dynamics.damping, dynamics.friction)) if dynamics else (0.0, 0.0)
    return Joint(joint.name, type, parent, R, r, limits_of(joint, ledger), damping, friction)


def limits_of(joint: "urdf.Joint", ledger: Ledger) -> Limits:
    """Declared limits. URDF's default for one missing bound is 0; a joint without any is meant to be unlimited."""
    given = {name: getattr(joint.limit, name, None) for name in ("lower", "upper", "velocity", "effort")}
    declared = {name: value for name, value in given.items() if value is not None}
    if {"lower", "upper"} & declared.keys():
        declared = {"lower": 0.0, "upper": 0.0} | declared
    elif JOINT_TYPES[joint.type].bounded:
        ledger.honour("joint/limit", "no lower and upper limit given: none assumed", f"joint {joint.name!r}")
    return Limits(**declared)


# --- mimics and locks -------------------------------------------------------------------------------------------------


def couple(mechanism: Mechanism, mimics: "Mapping[str, urdf.Mimic]", locked: Mapping[str, Any], ledger: Ledger) -> Mechanism:
    """The mechanism with its mimic joints coupled to the joints that lead, and joints fixed where `locked` says."""
    joints = list(mechanism.joints)
    held = {name: locked_value(joints[mechanism.joint_index(name)], value) for name, value in locked.items()}
    for name in held:
        ledger.ignore("joint@type", "the caller locked the joint", f"joint {name!r} at {locked[name]}")

    for name in mimics:
        i = mechanism.joint_index(name)
        if name in held:
            ledger.ignore("joint/mimic", "the caller locked the joint", f"joint {name!r}")
            continue

        # Down the chain β = ratio · β_leader + offset, to a joint that has a value or a coordinate of its own.
        ratio, offset, leader = 1.0, 0.0, name
        while leader in mimics and leader not in locked:
            follows = mimics[leader]
            offset += ratio * (follows.offset or 0.0)
            ratio *= 1.0 if follows.multiplier is None else follows.multiplier
            leader = follows.joint
        index = mechanism.joint_index(leader)
        if leader in locked or joints[index].type.nv == 0:
            value = ratio * float(held[leader][0] if leader in locked else 0.0) + offset
            held[name] = np.array([value])
            ledger.ignore(
                "joint/mimic", "the joint that leads does not move, so the one that follows is locked", f"joint {name!r} at {value:g}"
            )
        else:
            joints[i] = replace(joints[i], mimic=Mimic(index, ratio, offset))

    for name, value in held.items():
        i = mechanism.joint_index(name)
        joints[i] = locked_at(joints[i], value)
    return replace(mechanism, joints=tuple(joints), ledger=ledger.rows())


def locked_value(joint: Joint, value: Any) -> Array:
    """The coordinates (nq,) at which the caller wants a joint locked; InputError where they are no pose of it."""
    nq = joint.type.nq
    given = f"locked[{joint.name!r}] = {value!r:.80}"
    if nq == 0:
        raise InputError(f"{given}: a {joint.type.kind} joint does not move, leave it out")
    wanted = "one number" if nq == 1 else f"{nq} numbers ({', '.join(name for name, _ in joint.type.coordinates)})"
    try:
        numbers = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{given}: a {joint.type.kind} joint has {wanted}") from error
    if numbers.size != nq or numbers.ndim > 1:
        raise InputError(f"{given}: a {joint.type.kind} joint has {wanted}")
    with np.errstate(all="ignore"):
        q = joint.type.project(numbers.reshape(nq))
    if not np.isfinite(q).all():
        raise InputError(f"{given}: give finite numbers, and quaternions (w, x, y, z) that are not zero")
    return q


def locked_at(joint: Joint, q: Array) -> Joint:
    """The joint fixed in the pose that it has at q."""
    R, r = joint.type.pose(q)
    rotation, translation = frozen(orthonormal(snapped(joint.rotation @ R))), frozen(joint.rotation @ r + joint.translation)
    return Joint(joint.name, Fixed(), joint.parent, rotation, translation)
