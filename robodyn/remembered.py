"""Which formalism was the cheapest for a robot, kept beside the kernels on disk: to find it takes half of a first call's time.

What is remembered decides on speed alone, and is what would be found again: its name holds all that the count of operations depends on.
"""

import hashlib
import io
import pickle
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from types import BuiltinFunctionType, FunctionType
from typing import Any

from .arithmetic import Array
from .engine import cache as disk
from .loads import Load
from .model import Mechanism
from .questions import Question

KNOWN = ("robodyn", "numpy", "builtins")  # whose code the version of robodyn stands for, or no count depends on


def route(
    question: Question, robot: Mechanism, gravity: Array, loads: Sequence[Load], routes: Sequence[str], find: Callable[[], str]
) -> str:
    """The one of the routes that `find` found before, or finds now."""
    bodies = [(link.name, link.inertia) for link in robot.links]
    try:
        key = _content((source(Path(__file__).parent), question, gravity, loads, bodies, robot.joints))
    except (pickle.PicklingError, AttributeError, TypeError):  # the last two: what is defined inside a function, or has no pickle
        return find()
    name = disk.key("route", hashlib.sha256(key).hexdigest())
    if (known := (disk.get(name) or b"").decode(errors="replace")) in routes:
        return known
    found = find()
    disk.put(name, found.encode())
    return found


@cache
def source(folder: Path) -> str:
    """A hash of the Python files in a folder and below: of robodyn's, which say what a route costs."""
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
