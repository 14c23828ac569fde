"""One URDF file → `Mechanism`."""

import os
import warnings
from collections.abc import Iterable, Mapping
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from ..errors import InputError, RobodynWarning, UrdfError
from ..model import Mechanism
from .assemble import assemble, couple
from .check import check, constants
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
    if not isinstance(locked or {}, Mapping):
        raise InputError(f"locked = {locked!r:.80}: give a dictionary, as in {{'elbow': 0.5}}")
    data, file, path = contents(source)
    ledger = Ledger(file)
    sound = check(parse(data, file), ledger)
    robot = values(sound)

    dirs = [package_dirs] if isinstance(package_dirs, str | os.PathLike) else package_dirs
    folder = Path(os.path.abspath(path)).parent if path else None
    where = partial(find, folder=folder, package_dirs=[Path(os.path.abspath(d)) for d in dirs])
    told = {joint.get("name"): constants(joint) for joint in sound.all("joint")}
    mechanism = assemble(robot, told, where, ledger, source=path, floating_base=floating_base)
    mechanism = couple(mechanism, {joint.name: joint.mimic for joint in robot.joints if joint.mimic}, locked or {}, ledger)

    for message in ledger.warnings():
        warnings.warn(message, RobodynWarning, stacklevel=3)  # the line that calls `robodyn.load`
    return mechanism


def contents(source: Source) -> tuple[bytes | str, str, str | None]:
    """What the source holds, its name for messages, and its path where it has one.

    InputError where it is neither a path nor a file, UrdfError where it cannot be read.
    """
    if isinstance(source, str | os.PathLike):
        path, content = os.fsdecode(source), lambda: Path(source).read_bytes()
    elif hasattr(source, "read"):
        path, content = getattr(source, "name", None), source.read
    else:
        raise InputError(f"cannot read a robot from {source!r:.80}: give a path or an open file")
    path = path if isinstance(path, str) else None
    if path and path.lstrip().startswith("<"):
        raise InputError("a robot is read from a file: wrap XML that is a string in io.StringIO")
    try:
        return content(), path or "<stream>", path
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UrdfError(f"{path or '<stream>'}: cannot be read ({reason}): give a URDF file") from error


def values(robot: Element) -> "urdf.Robot":
    """The checked copy, read by yourdfpy. It never sees the file itself: it would guess at what is missing or broken."""
    from yourdfpy import URDF  # takes half a second to import

    result = URDF.load(BytesIO(robot.xml().encode()), build_scene_graph=False, load_meshes=False).robot
    assert result is not None
    return result
