"""What each tag and attribute of a file became: honoured, ignored with a reason, or rejected."""

from collections import defaultdict
from operator import itemgetter

from ..errors import UrdfError
from .document import Element
from .grammar import Alarm


class Ledger:
    """Collects the verdicts on one file. A tag or attribute goes by its path, as in joint/limit@velocity."""

    def __init__(self, file: str) -> None:
        self.file = file
        self._places: dict[tuple[str, str, str], list[str]] = defaultdict(list)  # (path, verdict, reason) → where
        self._attributes: dict[tuple[str, str, str], set[str]] = defaultdict(set)
        self._rejected: list[tuple[int, str]] = []
        self._alarms: list[tuple[str, str, str]] = []

    def honour(self, path: str, use: str, where: str, attributes: set[str] | None = None) -> None:
        """A tag was used for something, or used in spite of something."""
        self._note((path, "honoured", use), where)
        self._attributes[path, "honoured", use] |= attributes or set()

    def ignore(self, path: str, reason: str, where: str) -> None:
        """A tag or an attribute was not used."""
        self._note((path, "ignored", reason), where)

    def _note(self, key: tuple[str, str, str], where: str) -> None:
        if isinstance(key[2], Alarm) and key not in self._places:
            self._alarms.append(key)
        self._places[key].append(where)

    def reject(self, element: Element, problem: str) -> None:
        """An element says something that a robot cannot be: `problem` is condition, number, remedy."""
        self._rejected.append((element.line, f"{self.file}:{element.line}: {element} {problem}"))

    def settle(self) -> None:
        """Raise all that was rejected as one UrdfError, in the order of the file."""
        lines = [text for _, text in sorted(self._rejected)]
        if lines:
            head = [f"{self.file} has {len(lines)} problems:"] if len(lines) > 1 else []
            raise UrdfError("\n  ".join([*head, *lines]))

    def rows(self) -> tuple[tuple[str, str, str], ...]:
        """(path, "honoured" | "ignored", reason), equal ones counted; the honoured first."""
        rows = [(path, verdict, self._reason((path, verdict, reason))) for path, verdict, reason in self._places]
        return tuple(sorted(rows, key=itemgetter(1)))

    def warnings(self) -> list[str]:
        """What a user should hear of without asking for the ledger."""
        return [f"{self.file}: {key[0]} {self._reason(key)}" for key in self._alarms]

    def _reason(self, key: tuple[str, str, str]) -> str:
        places = self._places[key]
        attributes = f" [{', '.join(sorted(self._attributes[key]))}]" if self._attributes[key] else ""
        count = f"{len(places)}×: " if len(places) > 1 else ""
        return f"{key[2]}{attributes} ({count}{', '.join(places[:3])}{', …' if len(places) > 3 else ''})"
