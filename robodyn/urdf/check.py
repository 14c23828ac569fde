"""The document against the table of `grammar`, and what no table can say: the tree, inertias, limits, mimics.

Nothing stops at the first problem: each goes to the ledger, which reports them together.
"""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from ..arithmetic import EPS, Array
from ..joints import JOINT_TYPES
from ..model import GROUND
from .document import Element, quoted
from .grammar import ROBOT, Alarm, Tag, Value, similar, unknown
from .ledger import Ledger

TINY_AXIS, HUGE_AXIS = 1e-9, 1e9  # beyond, an axis is a slip of the pen, and its square loses digits
TRIANGLE = 1e-3  # what the rounding of a file's decimals can do to the triangle inequality, relative to the largest moment


def check(root: Element, ledger: Ledger) -> Element:
    """A copy of the robot that holds what is honoured and nothing else; the ledger tells about the rest and the problems.

    What the copy holds can be read without another look: numbers are finite, names are there, the joints form a tree.
    """
    refuse_other_formats(root, ledger)
    robot = honoured(root, ROBOT, "robot", ledger)
    links, joints = unique(robot, "link", ledger), unique(robot, "joint", ledger)
    if GROUND in joints:
        ledger.reject(
            joints[GROUND], f"has the name of the joint that carries the root link: rename it, for example to {GROUND + '_joint'!r}"
        )
    check_materials(robot, ledger)
    for link in links.values():
        check_inertia(link, ledger)
        check_shapes(link, ledger)
    for joint in joints.values():
        check_axis(joint, ledger)
        check_limits(joint, ledger)
    check_mimics(joints, ledger)
    check_tree(robot, links, joints, ledger)
    ledger.settle()
    return robot


# --- the format -------------------------------------------------------------------------------------------------------


def refuse_other_formats(root: Element, ledger: Ledger) -> None:
    """Files that only look like a URDF would give a flood of problems: name the one that matters."""
    kinds = {"sdf": "an SDF file", "mujoco": "a MuJoCo (MJCF) file"}
    if root.tag != "robot":
        ledger.reject(root, f"is {kinds.get(root.tag, 'the root of something else')}: give a URDF, whose root is <robot name=…>")
    macros = [element for element in root.everything() if element.tag.startswith("xacro:")]
    if macros:
        ledger.reject(macros[0], f"is one of {len(macros)} xacro tags: run `xacro robot.urdf.xacro > robot.urdf` and load the result")
    ledger.settle()


# --- the table --------------------------------------------------------------------------------------------------------


def honoured(element: Element, tag: Tag, path: str, ledger: Ledger) -> Element:
    """A copy of the element with those attributes and children that the table knows and finds sound."""
    copy = Element(element.tag, {}, element.line, element.within)
    line = f"line {element.line}"

    # Attributes, present and absent.
    for name, text in element.attributes.items():
        value = tag.attributes.get(name) or unknown(name, tag.attributes)
        if isinstance(value, str):
            ledger.ignore(f"{path}@{name}", value, line)
        elif fault := value.fault(text):
            ledger.reject(element, f"{name}={quoted(text)} {fault}")
        else:
            copy.attributes[name] = text
    for name, value in tag.attributes.items():
        if isinstance(value, Value) and value.required and name not in element.attributes:
            ledger.reject(element, f'has no {name}: write {name}="{value.example()}"')

    ledger.honour(path, tag.use, line, set(copy.attributes))
    if element.has_text:
        ledger.ignore(f"{path}/text()", "URDF has no text between tags", line)

    # Children, present and absent.
    seen: Counter[str] = Counter()
    for child in element.children:
        rule = tag.children.get(child.tag) or unknown(child.tag, tag.children)
        rule = rule(child) if callable(rule) else rule
        inner = f"{path}/{child.tag}".removeprefix("robot/")
        seen[child.tag] += 1
        if isinstance(rule, str):
            ledger.ignore(inner, rule, f"line {child.line}")
        elif seen[child.tag] > 1 and not rule.many:
            ledger.reject(child, f"is number {seen[child.tag]} of its kind: keep one")
        else:
            copy.children.append(honoured(child, rule, inner, ledger))
    for name, rule in tag.children.items():
        if isinstance(rule, Tag) and rule.required and not seen[name]:
            ledger.reject(element, f"has no <{name}>: add {rule.example(name)}")

    return copy


def unique(robot: Element, kind: str, ledger: Ledger) -> dict[str, Element]:
    """The links, or the joints, by name."""
    found: dict[str, Element] = {}
    for element in robot.all(kind):
        name = element.attributes.get("name")
        if name in found:
            ledger.reject(element, f"has the name of the {kind} in line {found[name].line}: rename one of them")
        elif name is not None:
            found[name] = element
    return found


def numbers(element: Element | None, attribute: str, default: str) -> Array:
    """The numbers of an attribute, or what stands for them where they are absent."""
    text = default if element is None else element.get(attribute, default)
    return np.array([float(word) for word in text.split()])


# --- links ------------------------------------------------------------------------------------------------------------


def check_inertia(link: Element, ledger: Ledger) -> None:
    """Moments that no matter can have, a < 0 or c > a + b, are reported and used: the link may be part of a body that has sound ones."""
    inertia = link.first("inertial", "inertia")
    if inertia is None or not {"ixx", "iyy", "izz"} <= inertia.attributes.keys():
        return
    xx, xy, xz, yy, yz, zz = (numbers(inertia, name, "0")[0] for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    a, b, c = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))

    # Rounding is what is lost in Θ about O anyway, beside the moments themselves and Steiner's share m ρ².
    mass = numbers(link.first("inertial", "mass"), "value", "0")[0]
    centre = numbers(link.first("inertial", "origin"), "xyz", "0 0 0")
    rounding = 16 * EPS * max(abs(a), abs(c), mass * (centre @ centre))

    path, where = "link/inertial/inertia", f"{quoted(link.get('name'))} line {inertia.line}"
    if a < -rounding:
        reason = "used although no rigid body has it: it has a negative principal moment; a body that moves with one is refused"
        ledger.honour(path, Alarm(reason), where)
    elif c - a - b > TRIANGLE * c + rounding:
        ledger.honour(path, Alarm("used although no rigid body has it: its largest principal moment exceeds the sum of the others"), where)
    if mass == 0 and c > 0:
        ledger.honour(path, "used although the link has no mass", where)


def check_materials(robot: Element, ledger: Ledger) -> None:
    """A name may be given twice; that is no reason to refuse a robot."""
    seen: set[str] = set()
    for material in robot.all("material"):
        if material.get("name") in seen:
            ledger.ignore("material", "a name that was given before: the first definition counts", f"line {material.line}")
        seen.add(material.get("name"))


def check_shapes(link: Element, ledger: Ledger) -> None:
    """One shape for each visual."""
    for geometry in link.all("visual", "geometry"):
        if len(geometry.children) > 1:
            ledger.reject(geometry, f"holds {len(geometry.children)} shapes: write one <visual> for each")


# --- joints -----------------------------------------------------------------------------------------------------------


def check_axis(joint: Element, ledger: Ledger) -> None:
    """An axis has a direction."""
    axis = joint.first("axis")
    length = np.linalg.norm(numbers(axis, "xyz", "1 0 0"))
    if axis is not None and not TINY_AXIS < length < HUGE_AXIS:
        ledger.reject(axis, f'xyz={quoted(axis.get("xyz"))} has the length {length:g}, no direction: write one, as in xyz="0 0 1"')


def check_limits(joint: Element, ledger: Ledger) -> None:
    """The lower limit is not above the upper one; one that is absent is 0."""
    limit = joint.first("limit")
    lower, upper = numbers(limit, "lower", "0")[0], numbers(limit, "upper", "0")[0]
    if limit is not None and lower > upper:
        ledger.reject(limit, f"has lower={lower:g} above upper={upper:g}: exchange or correct them")


def check_mimics(joints: dict[str, Element], ledger: Ledger) -> None:
    """A mimic joint follows another one, both with one coordinate, and no joint follows itself in the end."""
    leaders: dict[str, str] = {}
    for name, joint in joints.items():
        mimic = joint.first("mimic")
        if mimic is None or "joint" not in mimic.attributes:
            continue
        leaders[name] = leader = mimic.get("joint")
        if leader not in joints:
            ledger.reject(mimic, f"follows joint={quoted(leader)}, which the file has not: {similar(leader, joints) or 'name a joint'}")
        elif freedoms(joint) > 1 or freedoms(joints[leader]) > 1:
            kinds = f"{joint.get('type')} joint {quoted(name)} with {joints[leader].get('type')} joint {quoted(leader)}"
            ledger.reject(mimic, f"couples {kinds}: only joints with one coordinate can be coupled")
    for cycle in cycles(leaders):
        names = " → ".join(map(quoted, [*cycle, cycle[0]]))
        ledger.reject(joints[cycle[0]], f"follows itself, {names}: let one of these joints lead")


def freedoms(joint: Element) -> int:
    """Number of joint velocities; of a joint whose type is wrong, one."""
    kind = JOINT_TYPES.get(joint.get("type"), JOINT_TYPES["revolute"])
    return len(kind.velocities)


def constants(joint: Element) -> dict[str, Array | float]:
    """What a sound joint says of the constants that its type declares, by the names of their fields: numbers, or arrays (size,)."""
    found: dict[str, Array | float] = {}
    for name, constant in JOINT_TYPES[joint.get("type")].attributes.items():
        holder = joint.first(constant.tag) if constant.tag else joint
        values = numbers(holder, constant.name, " ".join(map(str, constant.default or ())))
        found[name] = float(values[0]) if constant.size == 1 else values
    return found


# --- the tree ---------------------------------------------------------------------------------------------------------


def check_tree(robot: Element, links: dict[str, Element], joints: dict[str, Element], ledger: Ledger) -> None:
    """Every link but one, the root, is carried by one joint, and no link carries itself in the end."""
    if not links:
        ledger.reject(robot, "has no link: add <link name=…/>")
        return

    # Where each joint hangs, and which links it joins.
    parents: dict[str, str] = {}
    carrier: dict[str, Element] = {}
    sound = len(links) + len(joints) == sum(1 for child in robot.children if child.tag in ("link", "joint"))
    for joint in joints.values():
        ends = {end: link for end in ("parent", "child") if (link := joint.first(end)) and "link" in link.attributes}
        for end in ends.values():
            name = end.get("link")
            if name not in links:
                sound = False
                ledger.reject(end, f"names link={quoted(name)}, which the file has not: {similar(name, links) or 'name a link'}")
        if len(ends) < 2:
            sound = False
            continue
        child = ends["child"].get("link")
        if child in carrier:
            ledger.reject(
                joint, f"carries the link {quoted(child)}, as does {carrier[child]} in line {carrier[child].line}: delete one of them"
            )
        else:
            carrier[child], parents[child] = joint, ends["parent"].get("link")

    # The shape of the whole can be judged only where every joint says what it joins.
    if not sound:
        return
    roots = [name for name in links if name not in carrier]
    for name in roots[1:]:
        first = links[roots[0]]
        ledger.reject(links[name], f"is a second root beside {first} in line {first.line}: let a joint carry it, or delete it")
    for cycle in cycles(parents):
        names = " → ".join(quoted(carrier[link].get("name")) for link in cycle)
        ledger.reject(carrier[cycle[0]], f"closes a loop of joints, {names}: cut it, a URDF is a tree")


def cycles(following: dict[str, str]) -> Iterator[list[str]]:
    """Every closed path name → following[name] → …, once."""
    done: set[str] = set()
    for name in following:
        path: dict[str, None] = {}  # a set that keeps its order
        while name in following and name not in done and name not in path:
            path[name] = None
            name = following[name]
        if name in path:
            steps = list(path)
            yield steps[steps.index(name) :]
        done.update(path)
