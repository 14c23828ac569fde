"""Which formalism was the cheapest for a robot, and the like, kept beside the kernels on disk: to find it takes half of a first call.

What is remembered is what would be found again: its name holds all that the choice depends on.
"""

import hashlib
import io
import pickle
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from types import BuiltinFunctionType, FunctionType
from typing import Any

from ..model import Mechanism
from ..system import cache as disk

KNOWN = ("robodyn", "numpy", "builtins")  # whose code the version of robodyn stands for, or no count depends on


def choice(robot: Mechanism, what: object, choices: Sequence[str], find: Callable[[], str]) -> str:
    """The one of the choices that `find` found before, or finds now; it depends on the robot's links and joints and on `what`."""
    bodies = [(link.name, link.inertia) for link in robot.links]
    try:
        key = _content((source(Path(__file__).parents[1]), what, bodies, robot.joints))
    except (pickle.PicklingError, AttributeError, TypeError):  # the last two: what is defined inside a function, or has no pickle
        return find()
    name = disk.key("choice", hashlib.sha256(key).hexdigest())
    if (known := (disk.get(name) or b"").decode(errors="replace")) in choices:
        return known
    found = find()
    disk.put(name, found.encode())
    return found


@cache
def source(folder: Path) -> str:
    """A hash of the Python files in a folder and below: of robodyn's, which say what was compared."""
    return hashlib.sha256(b"".join(file.read_bytes() for file in sorted(folder.rglob("*.py")))).hexdigest()


class _Pickler(pickle.Pickler):
    """Refuses what a pickle has by name alone, and whose code it does not hold: a control law, someone's own load or type of joint."""

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, (type, FunctionType, BuiltinFunctionType)) and (obj.__module__ or "").partition(".")[0] not in KNOWN:
            raise pickle.PicklingError(f"{obj!r} is known by its name alone")
        return NotImplemented


def _content(x: object) -> bytes:
    stream = io.BytesIO()
    _Pickler(stream).dump(x)
    return stream.getvalue()
