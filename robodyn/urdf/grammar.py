"""URDF as a table: what each tag may hold, what it becomes, and why the rest is ignored.

One table serves the check, the ledger and the copy that yourdfpy gets to read. Where a `Tag` or a `Value` would stand,
a text is the reason why that child or attribute is ignored.

Absent means, as URDF has it: origin the identity, axis (1, 0, 0), ixy = ixz = iyz = 0, mimic multiplier 1 and offset 0,
damping and friction 0, a lower or upper limit 0 beside one that is given. No bounds at all means no limit.
"""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache

from ..joints import JOINT_TYPES, JointType
from .document import Element, quoted

LARGEST = 1e100  # a number beyond it overflows where it is squared
LONGEST = 10_000  # characters; no honest value comes near, and parsers have limits


class Alarm(str):
    """A reason that is also worth a warning."""


# --- values ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Value(ABC):
    """What an attribute may hold."""

    required: bool = False

    @abstractmethod
    def example(self) -> str:
        """A text that would do, for a remedy."""

    @abstractmethod
    def condition(self, text: str) -> str | None:
        """What is wrong with a text; None where nothing is."""

    def fault(self, text: str) -> str | None:
        """What is wrong with a text, and the remedy; None where nothing is."""
        if len(text) > LONGEST:
            return f"is {len(text)} characters long: {LONGEST} are enough"
        if "${" in text or "$(" in text:
            return "is not expanded yet: run `xacro robot.urdf.xacro > robot.urdf` and load the result"
        return self.condition(text)


@dataclass(frozen=True, kw_only=True)
class Text(Value):
    """A name, or one of a few words."""

    empty: bool = False  # may be
    words: tuple[str, ...] = ()

    def example(self) -> str:
        """A text that would do, for a remedy."""
        return self.words[0] if self.words else "…"

    def condition(self, text: str) -> str | None:
        """What is wrong with a text; None where nothing is."""
        if self.words and text not in self.words:
            return f"is unknown: {similar(text, self.words) or 'write ' + ', '.join(self.words)}"
        return None if text.strip() or self.empty else "is empty: write a name"


@dataclass(frozen=True, kw_only=True)
class Numbers(Value):
    """Decimal numbers between blanks."""

    count: tuple[int, ...] = (1,)
    lowest: float = -math.inf
    infinite: bool = False  # may be: a limit that is none

    def example(self) -> str:
        """A text that would do, for a remedy."""
        return " ".join(["0.5"] * self.count[-1])

    def condition(self, text: str) -> str | None:
        """What is wrong with a text; None where nothing is."""
        words = text.split()
        for word in words:
            if self.infinite and re.fullmatch(r"[+-]?inf(inity)?", word, re.IGNORECASE):
                continue
            if not re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", word, re.IGNORECASE | re.ASCII):
                return f"has {quoted(word)} where a finite number must stand: write it as 0.5 or 5e-1"
            if not self.infinite and abs(float(word)) > LARGEST:
                return f"has {quoted(word)}, beyond {LARGEST:g}: write a number in SI units"
            if float(word) < self.lowest:
                return f"is below {self.lowest:g}: write a number of at least {self.lowest:g}"
        if len(words) not in self.count:
            return f"has {len(words)} numbers: write {' or '.join(map(str, self.count))}, as in {self.example()!r}"
        return None


@dataclass(frozen=True, kw_only=True)
class Refused(Value):
    """Means something that is not read, and cannot be left out either."""

    remedy: str

    def example(self) -> str:
        """A text that would do, for a remedy."""
        return ""

    def condition(self, text: str) -> str:
        """What is wrong with a text; None where nothing is."""
        return f"is not read: {self.remedy}"


NAME = Text(required=True)
NUMBER = Numbers()
NEEDED = Numbers(required=True)
POSITIVE = Numbers(lowest=0.0)  # or zero
SIZE = Numbers(lowest=0.0, required=True)
LIMIT = Numbers(infinite=True)
VECTOR = Numbers(count=(3,))


# --- tags -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Tag:
    """An element that is honoured."""

    use: str  # what it becomes
    attributes: Mapping[str, Value | str] = field(default_factory=dict)
    children: Mapping[str, "Rule"] = field(default_factory=dict)
    required: bool = False  # must stand in its parent
    many: bool = False  # may stand there several times

    def example(self, name: str) -> str:
        """The shortest one, for a remedy."""
        needed = [f'{a}="{v.example()}"' for a, v in self.attributes.items() if isinstance(v, Value) and v.required]
        return f"<{' '.join([name, *needed])}/>"


Rule = Tag | str | Callable[[Element], Tag | str]

ORIGIN = Tag("pose of a frame", {"xyz": VECTOR, "rpy": VECTOR, "quat_xyzw": Refused(remedy="write the rotation as rpy")})

INERTIAL = Tag(
    "mass properties",
    children={
        "origin": ORIGIN,
        "mass": Tag("mass of the link", {"value": SIZE}, required=True),
        "inertia": Tag(
            "inertia about the centre of mass",
            {"ixx": NEEDED, "ixy": NUMBER, "ixz": NUMBER, "iyy": NEEDED, "iyz": NUMBER, "izz": NEEDED},
            required=True,
        ),
    },
)

SHAPES: dict[str, Rule] = {
    "box": Tag("a shape to show", {"size": Numbers(count=(3,), lowest=0.0, required=True)}),
    "cylinder": Tag("a shape to show", {"radius": SIZE, "length": SIZE}),
    "sphere": Tag("a shape to show", {"radius": SIZE}),
    "mesh": Tag("a file to show", {"filename": NAME, "scale": Numbers(count=(1, 3))}),
}


def texture(element: Element) -> Tag | str:
    """A picture, which is known and not shown."""
    return Tag("an image to show", {"filename": NAME}) if "filename" in element.attributes else "names no file"


LOOK: dict[str, Rule] = {"color": Tag("a colour", {"rgba": Numbers(count=(4,), required=True)}), "texture": texture}


def visual(element: Element) -> Tag | str:
    """A visual without a shape that can be shown is ignored: nothing depends on it."""
    shapes = [shape.tag for geometry in element.all("geometry") for shape in geometry.children]
    if not set(shapes) & set(SHAPES):
        return f"holds {' and '.join(shapes) or 'no shape'}: only {', '.join(SHAPES)} can be shown"
    children: dict[str, Rule] = {
        "origin": ORIGIN,
        "geometry": Tag("a shape to show", children=SHAPES),
        "material": Tag("how a visual looks", {"name": Text(empty=True)}, LOOK),
    }
    return Tag("what a link looks like", {"name": "visuals need no name"}, children, many=True)


@cache
def joint_tag(joint: type[JointType], words: tuple[str, ...]) -> Tag:
    """The tag of a joint, by its type: what does not move has no limit, and each type declares the constants that it reads."""
    kind = joint.kind
    unbounded = f"a {kind} joint has no bounds"
    bounds: dict[str, Value | str] = {"lower": LIMIT, "upper": LIMIT} if joint.bounded else {"lower": unbounded, "upper": unbounded}
    children: dict[str, Rule] = {
        "parent": Tag("the link that carries the joint", {"link": NAME}, required=True),
        "child": Tag("the link that the joint carries", {"link": NAME}, required=True),
        "origin": ORIGIN,
        "axis": f"a {kind} joint has no axis",
        "limit": Tag("declared limits; the equations enforce none", {**bounds, "effort": LIMIT, "velocity": LIMIT}),
        "dynamics": Tag("forces in the joint", {"damping": POSITIVE, "friction": POSITIVE}),
        "mimic": Tag("coupling to another joint", {"joint": NAME, "multiplier": NUMBER, "offset": NUMBER}),
        "calibration": "reference positions of a sensor change no motion",
        "safety_controller": "soft limits belong to a controller",
    }
    if not joint.velocities:
        children["limit"] = children["dynamics"] = f"a {kind} joint does not move"
        children["mimic"] = Alarm(f"a {kind} joint does not move and can follow no other")
    own: dict[str, Value | str] = {"name": NAME, "type": Text(required=True, words=words)}
    for constant in joint.attributes.values():
        inside = Numbers(count=(constant.size,), required=bool(constant.tag) or constant.default is None)
        if not constant.tag:
            own[constant.name] = inside
            continue
        known = children.get(constant.tag)
        attributes = known.attributes if isinstance(known, Tag) else {}
        needed = constant.default is None or (isinstance(known, Tag) and known.required)
        use = known.use if isinstance(known, Tag) else constant.use
        children[constant.tag] = Tag(use, {**attributes, constant.name: inside}, required=needed)
    return Tag("a joint", own, children, many=True)


def joint(element: Element) -> Tag:
    """Of a joint whose type is wrong, everything else can still be checked."""
    return joint_tag(JOINT_TYPES.get(element.get("type"), JOINT_TYPES["revolute"]), tuple(JOINT_TYPES))


ROBOT = Tag(
    "the robot",
    {"name": NAME, "version": "every version is read alike"},
    {
        "link": Tag(
            "a link",
            {"name": NAME},
            {
                "inertial": INERTIAL,
                "visual": visual,
                "collision": "contact is not modelled",
                "contact": "contact is not modelled",
                "sensor": "sensors change no motion",
            },
            many=True,
        ),
        "joint": joint,
        "material": Tag("a look that visuals refer to", {"name": NAME}, LOOK, many=True),
        "transmission": "joint forces act at the joint itself, without gears and motors",
        "ros2_control": "interfaces of a controller change no motion",
        "gazebo": "is meant for Gazebo alone",
        "mujoco": "is meant for MuJoCo alone",
        "sensor": "sensors change no motion",
    },
)


# --- names that nobody knows ------------------------------------------------------------------------------------------


def similar(name: str, names: Collection[str], cutoff: float = 0.6) -> str:
    """`did you mean 'axis'?`, or nothing."""
    close = [n for n in names if n.lower() == name.lower()] or get_close_matches(name, list(names), n=1, cutoff=cutoff)
    return f"did you mean {quoted(close[0])}?" if close else ""


def unknown(name: str, names: Collection[str]) -> str:
    """Why a name that is not in the table is ignored; an alarm where it looks like a slip of the pen."""
    if name.split(":")[0] == "xmlns":
        return "namespaces mean nothing in URDF"
    hint = similar(name, names, cutoff=0.8)
    return Alarm(f"is no part of URDF: {hint}") if hint else "is no part of URDF"
