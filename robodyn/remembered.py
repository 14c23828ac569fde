"""Which formalism was the cheapest for a robot, kept beside the kernels on disk: to find it takes half of a first call's time.

What is remembered decides on speed alone, and is what would be found again: its name holds the robot, the question and robodyn's source.
"""

import hashlib
import pickle
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

from .arithmetic import Array
from .engine import cache as disk
from .model import Mechanism
from .questions import Question


def route(question: Question, robot: Mechanism, gravity: Array, routes: Sequence[str], find: Callable[[], str]) -> str:
    """The one of the routes that `find` found before, or finds now; for a robot under gravity alone."""
    try:
        key = pickle.dumps((_source(), repr(question), gravity.tolist(), robot))
    except (pickle.PicklingError, AttributeError, TypeError):  # a type of joint that was defined inside a function, say
        return find()
    name = disk.key("route", hashlib.sha256(key).hexdigest())
    if (known := (disk.get(name) or b"").decode(errors="replace")) in routes:
        return known
    found = find()
    disk.put(name, found.encode())
    return found


@cache
def _source() -> str:
    """A hash of robodyn's own files, which say what a route costs."""
    files = sorted(Path(__file__).parent.rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
