"""One URDF file → `Mechanism`."""

import os
import warnings
from collections.abc import Iterable, Mapping
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any
from xml.etree import ElementTree

from ..errors import InputError, RobodynWarning, UrdfError
from ..model import Mechanism
from .assemble import assemble, couple
from .check import check
from .document import Element, parse
from .ledger import Ledger
from .packages import find

if TYPE_CHECKING:
    from yourdfpy import urdf

Source = str | os.PathLike[str] | IO[str] | IO[bytes]


def read(
    source: Source,
    *,
    floating_base: bool = False,
    package_dirs: Iterable[str | os.PathLike[str]] = (),
    locked: Mapping[str, Any] | None = None,
) -> Mechanism:
    """The robot in a URDF file.

    source: a path, or an open file (io.StringIO for XML that is a string); meshes are then sought from its `name`, if it has one.
    floating_base: the root link moves freely instead of being fixed to the ground.
    package_dirs: folders that hold, or are, the packages of package://… meshes.
    locked: joints that become fixed, by name: the angle [rad] or displacement [m], or the nq coordinates of other joints.

    UrdfError: the file cannot be read, or says what a robot cannot be; all problems at once, each with its line.
    ModelError: a name in `locked` is no joint. InputError: an argument cannot be what it should be.
    What is ignored stands in the mechanism's `ledger`; a RobodynWarning tells of what is likely a mistake.
    """
    data, file, path = contents(source)
    ledger = Ledger(file)
    robot = values(check(parse(data, file), ledger))

    dirs = [package_dirs] if isinstance(package_dirs, str | os.PathLike) else package_dirs
    folder = Path(os.path.abspath(path)).parent if path else None
    where = partial(find, folder=folder, package_dirs=[Path(os.path.abspath(d)) for d in dirs])
    mechanism = assemble(robot, where, ledger, source=path, floating_base=floating_base)
    mechanism = couple(mechanism, {joint.name: joint.mimic for joint in robot.joints if joint.mimic}, locked or {}, ledger)

    for message in ledger.warnings():
        warnings.warn(message, RobodynWarning, stacklevel=3)  # the line that calls `robodyn.load`
    return mechanism


def contents(source: Source) -> tuple[bytes | str, str, str | None]:
    """What the source holds, its name for messages, and its path where it has one."""
    if not isinstance(source, str | os.PathLike):
        if not hasattr(source, "read"):
            raise InputError(f"cannot read a robot from {source!r:.80}: give a path or an open file")
        name = getattr(source, "name", None)
        path = name if isinstance(name, str) else None
        return source.read(), path or "<stream>", path
    path = os.fspath(source)
    if path.lstrip().startswith("<"):
        raise InputError("robodyn reads files: wrap XML that is a string in io.StringIO")
    try:
        return Path(path).read_bytes(), path, path
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UrdfError(f"{path}: cannot be read ({reason}): give the path of a URDF file") from error


def values(robot: Element) -> "urdf.Robot":
    """The checked copy, read by yourdfpy. It never sees the file itself: it would guess at what is missing or broken."""
    from yourdfpy import URDF  # takes half a second to import

    text = ElementTree.tostring(robot, encoding="utf-8")
    result = URDF.load(BytesIO(text), build_scene_graph=False, load_meshes=False).robot
    assert result is not None
    return result
