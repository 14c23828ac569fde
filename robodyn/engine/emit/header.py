"""The numbers that `advance` reads and writes."""

from .code import Code
from .value import ONE, Memory, Value

# Each a double. A method with error control and h = 0 chooses its first step.
HEADER = ("t", "h", "t0", "t_end", "count", "rtol", "atol", "next", "steps", "rejected", "evaluations", "started", "shrink")


class Header:
    """Their values, by name."""

    def __init__(self, code: Code) -> None:
        numbers = Memory(code, ONE, "%header")
        self._places = {name: numbers.behind(i) for i, name in enumerate(HEADER)}

    def __getitem__(self, name: str) -> Value:
        return self._places[name].first

    def __setitem__(self, name: str, x: Value | float) -> None:
        self._places[name].first = x

    def count(self, name: str) -> None:
        """One more."""
        self[name] = self[name] + 1.0
