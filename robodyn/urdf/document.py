"""Bytes → XML elements that know their line.

Expat, from the standard library, and not lxml: its line numbers hold beyond line 65535, a prefix that is bound to no
namespace is a name like any other (as it is for ROS), and it opens no file and no connection, whatever the text says.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NoReturn
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from ..errors import UrdfError

REPAIR = "repair the file, nothing is guessed (is it a URDF, in the encoding that its first line declares?)"


@dataclass(eq=False)
class Element:
    """An XML element that knows where it stands."""

    tag: str
    attributes: dict[str, str]
    line: int
    within: str  # the nearest element around it that has a name
    children: list["Element"] = field(default_factory=list)
    has_text: bool = False  # of its own

    def __str__(self) -> str:
        """How messages call it: <joint name='elbow'>, or <axis> in <joint name='elbow'>."""
        if "name" in self.attributes:
            return f"<{self.tag} name={quoted(self.attributes['name'])}>"
        return f"<{self.tag}>" + (f" in {self.within}" if self.within else "")

    def get(self, attribute: str, default: str = "") -> str:
        """The text of an attribute."""
        return self.attributes.get(attribute, default)

    def all(self, *path: str) -> Iterator["Element"]:
        """The elements that these tags lead to, from child to child."""
        for child in self.children:
            if child.tag == path[0]:
                yield from child.all(*path[1:]) if path[1:] else (child,)

    def first(self, *path: str) -> "Element | None":
        """The first element down a path of tags; None where there is none."""
        return next(self.all(*path), None)

    def everything(self) -> Iterator["Element"]:
        """This element and all below it, however deep, in the order of the file."""
        stack: list[Element] = [self]
        while stack:
            element = stack.pop()
            yield element
            stack += reversed(element.children)

    def xml(self) -> str:
        """The element as text, for a shallow tree."""
        attributes = "".join(f" {name}={quoteattr(text)}" for name, text in self.attributes.items())
        return f"<{self.tag}{attributes}>{''.join(child.xml() for child in self.children)}</{self.tag}>"


def quoted(text: str) -> str:
    """A text of the file, safe to print and of bounded length."""
    return repr(text if len(text) <= 80 else text[:77] + "…")


def parse(data: bytes | str, file: str) -> Element:
    """The root element; UrdfError at the first thing that is not well-formed. Of a str, the declared encoding does not count."""
    parser = expat.ParserCreate()
    inside: list[Element] = [Element("", {}, 0, "")]  # what encloses the root

    def start(tag: str, attributes: dict[str, str]) -> None:
        around = inside[-1]
        element = Element(tag, attributes, parser.CurrentLineNumber, str(around) if "name" in around.attributes else around.within)
        around.children.append(element)
        inside.append(element)

    def end(tag: str) -> None:
        inside.pop()

    def text(characters: str) -> None:
        inside[-1].has_text |= not characters.isspace()

    def doctype(name: str, system: str | None, public: str | None, subset: bool) -> None:
        # Entities can fetch files, hide text and grow without bound; a robot needs none.
        if system or public or subset:
            fail(parser.CurrentLineNumber, "<!DOCTYPE> declares entities or names another file: delete it, a URDF needs none")

    def fail(line: int, problem: str) -> NoReturn:
        raise UrdfError(f"{file}:{line}: {problem}")

    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, text
    parser.StartDoctypeDeclHandler = doctype
    if not data.strip():
        fail(1, "the file is empty: name a file that holds a <robot>")
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        where = f" in {inside[-1]} of line {inside[-1].line}" if inside[-1].tag else ""
        fail(error.lineno, f"broken XML: {expat.ErrorString(error.code)}, column {error.offset + 1}{where}: {REPAIR}")
    except (ValueError, LookupError) as error:
        fail(1, f"cannot be decoded, {error}: save the file as UTF-8")
    return inside[0].children[0]
