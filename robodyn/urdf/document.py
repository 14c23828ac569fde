"""Bytes → XML elements that know their line.

Expat, from the standard library, and not lxml: its line numbers hold beyond line 65535, a prefix that is bound to no
namespace is a name like any other (as it is for ROS), and it opens no file and no connection, whatever the text says.
"""

from typing import Any, NoReturn
from xml.etree import ElementTree
from xml.parsers import expat

from ..errors import UrdfError


class Element(ElementTree.Element):
    """An XML element that knows where it stands."""

    line: int = 0
    within: str = ""  # the nearest element around it that has a name

    def __str__(self) -> str:
        """How messages call it: <joint name='elbow'>, or <axis> in <joint name='elbow'>."""
        name = self.get("name")
        if name is None:
            return f"<{self.tag}>" + (f" in {self.within}" if self.within else "")
        return f"<{self.tag} name={quoted(name)}>"

    def bare(self) -> "Element":
        """The same element without attributes and children."""
        copy = Element(self.tag)
        copy.line, copy.within = self.line, self.within
        return copy


def quoted(text: str) -> str:
    """A text of the file, safe to print and of bounded length."""
    return repr(text if len(text) <= 80 else text[:77] + "…")


def parse(data: bytes | str, file: str) -> Element:
    """The root element; UrdfError at the first thing that is not well-formed. Text that was decoded already is a str."""
    builder = ElementTree.TreeBuilder(element_factory=Element)
    parser = expat.ParserCreate("utf-8" if isinstance(data, str) else None)
    inside: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        element: Any = builder.start(tag, attributes)
        element.line = parser.CurrentLineNumber
        if inside:
            element.within = str(inside[-1]) if "name" in inside[-1].attrib else inside[-1].within
        inside.append(element)

    def end(tag: str) -> None:
        builder.end(tag)
        inside.pop()

    def doctype(name: str, system: str | None, public: str | None, subset: bool) -> None:
        # Entities can fetch files, hide text and grow without bound; a robot needs none.
        if system or public or subset:
            fail(parser.CurrentLineNumber, "<!DOCTYPE> declares entities or names another file: delete it, a URDF needs none")

    def fail(line: int, problem: str) -> NoReturn:
        raise UrdfError(f"{file}:{line}: {problem}")

    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, builder.data
    parser.StartDoctypeDeclHandler = doctype
    if not data.strip():
        fail(1, "the file is empty: name a file that holds a <robot>")
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        where = f" inside {inside[-1]} of line {inside[-1].line}" if inside else ""
        fail(error.lineno, f"not well-formed XML: {expat.ErrorString(error.code)}, column {error.offset + 1}{where}: {REPAIR}")
    except (ValueError, LookupError) as error:
        fail(1, f"cannot be decoded, {error}: save the file as UTF-8")
    return builder.close()


REPAIR = "repair the file, nothing is guessed (is it a URDF, in the encoding that its first line declares?)"
