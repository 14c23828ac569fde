"""What a `sweeps.Recorder` writes down, for `layout` to find places for: sweeps over forests, straight-line code and zeros, in order.

Each kind of place is a class of its own: nodes of a graph are found by what they hold, and named tuples of one key would be equal.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from ...arithmetic import Array
from ...system.processes import cached_property
from .graph import Graph, Scalar

SUM = "sum"  # the column of offsets to which numbers are added

# --- where a number is found ---


@dataclass(frozen=True, slots=True, order=True)
class Passed:
    """The k-th number that a sweep passes on; a sweep is known by its index among the items."""

    sweep: int
    k: int


@dataclass(frozen=True, slots=True, order=True)
class Kept:
    """The k-th number that a sweep keeps at the nodes of a kind."""

    sweep: int
    kind: int
    k: int


Key = Passed | Kept


@dataclass(frozen=True, slots=True)
class Own:
    """A number in the node's block."""

    key: Key


@dataclass(frozen=True, slots=True)
class Up:
    """A number in the block of the node's parent."""

    key: Key


@dataclass(frozen=True, slots=True)
class Param:
    """The node's k-th parameter."""

    k: int


@dataclass(frozen=True, slots=True)
class Entry:
    """Entry k of a region, counted from the node's offset in a column of its forest; from the region's start where that is None."""

    region: str
    column: str | None
    k: int


Target = Own | Up | Entry  # where a step stores, at the node that it runs at
Place = Target | Param  # where it reads
P = TypeVar("P", bound=Place)


@dataclass(frozen=True, slots=True)
class OfNode:
    """A number in the block of node i of a forest, in straight-line code."""

    forest: int
    i: int
    key: Key


# --- what is written down ---


def objects(entries: Sequence[Any]) -> Array:
    """A vector of objects."""
    x = np.empty(len(entries), dtype=object)
    x[:] = entries
    return x


@dataclass(frozen=True, eq=False)
class Forest:
    """Nodes, a parent before its children: kinds (n,), parents (n,) with −1 for the ground, offsets (n,) into vectors by column
    name, and the numbers of each node that its kind's steps take as parameters."""

    kinds: Array
    parents: Array
    columns: dict[str, Array]
    parameters: Sequence[Array]

    @property
    def count(self) -> int:
        """Number of kinds."""
        return int(self.kinds.max(initial=-1)) + 1

    @cached_property
    def lengths(self) -> Array:
        """Numbers of parameters (n,)."""
        return np.array([len(x) for x in self.parameters], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Sweep:
    """A step per kind, run at every node, parents first or (inward) children first; each stores numbers at its node or parent or in
    a region."""

    forest: int
    inward: bool
    stores: list[list[tuple[Target, Scalar]]]  # by kind
    root: dict[Key, float]  # what the ground passes on


@dataclass(frozen=True, eq=False)
class Segment:
    """Straight-line code: entries k of a region."""

    region: str
    entries: list[tuple[int, Scalar]]


@dataclass(frozen=True, eq=False)
class Zero:
    """A region is zero until something is added."""

    region: str


class Recording:
    """What was recorded, in the order in which it will run."""

    def __init__(self) -> None:
        self.graph = Graph()
        self.forests: list[Forest] = []
        self.regions: dict[str, int] = {}  # name → length
        self.items: list[Sweep | Segment | Zero] = []
        self.moved: dict[tuple[int, Key], Entry] = {}  # numbers of a forest's nodes that live in a region

    def lies(self, forest: int, place: P) -> P | Entry:
        """The place, or the entry of a region where the number lives instead."""
        return self.moved.get((forest, place.key), place) if isinstance(place, Own) else place

    def index(self, forest: int, i: int, entry: Entry) -> int:
        """Which entry of its region it is at node i."""
        return entry.k + (int(self.forests[forest].columns[entry.column][i]) if entry.column else 0)

    # --- checks ---

    def check(self) -> None:
        """ValueError where a place that is read or stored to is not there."""
        stored = {
            (item.forest, place.key)
            for item in self.items
            if isinstance(item, Sweep)
            for stores in item.stores
            for place, _ in stores
            if isinstance(place, Own | Up)
        }

        def check_stored(forest: int, key: Key) -> None:
            if (forest, key) not in stored:
                raise ValueError(f"no sweep over forest {forest} stores {key}, which is read")

        for item in self.items:
            if isinstance(item, Sweep):
                for kind, stores in enumerate(item.stores):
                    graphs = {id(x.graph): x.graph for _, x in stores}.values()
                    read = (node[1] for graph in graphs for node in graph.nodes if node[0] == "in")
                    for place in (*(place for place, _ in stores), *read):
                        if isinstance(place, Own | Up):
                            check_stored(item.forest, place.key)
                        else:
                            self.check_place(item.forest, kind, place)
            elif isinstance(item, Segment):
                for k, _ in item.entries:
                    self._check_entries(item.region, k, k)
            else:
                self._check_entries(item.region, 0, -1)
        for (forest, key), entry in self.moved.items():
            if isinstance(key, Kept):
                self.check_place(forest, key.kind, entry)
        for op, *rest in self.graph.nodes:
            if op == "in" and isinstance(rest[0], OfNode):
                node = rest[0]
                if not 0 <= node.i < len(self._forest(node.forest).kinds):
                    raise ValueError(f"forest {node.forest} has {len(self.forests[node.forest].kinds)} nodes, and none numbered {node.i}")
                check_stored(node.forest, node.key)
            elif op == "in":
                self._check_entries(rest[0], rest[1], rest[1])

    def check_place(self, forest: int, kind: int, place: Place) -> None:
        """ValueError where a node of this kind has no such place: an unknown forest, region or column, an entry or parameter beyond."""
        f = self._forest(forest)
        if isinstance(place, Param):
            fewest = f.lengths[f.kinds == kind].min(initial=place.k + 1)
            if not 0 <= place.k < fewest:
                raise ValueError(f"nodes of kind {kind} of forest {forest} have {fewest} parameters, and none numbered {place.k}")
        elif isinstance(place, Entry):
            if place.column is not None and place.column not in f.columns:
                raise ValueError(f"forest {forest} has no column {place.column!r} for {place}: there are {', '.join(f.columns) or 'none'}")
            offsets = f.columns[place.column][f.kinds == kind] if place.column else np.zeros(1, dtype=np.int64)
            if len(offsets):
                self._check_entries(place.region, int(offsets.min()) + place.k, int(offsets.max()) + place.k)

    def _forest(self, number: int) -> Forest:
        if not 0 <= number < len(self.forests):
            raise ValueError(f"there is no forest {number}: {len(self.forests)} were recorded")
        return self.forests[number]

    def _check_entries(self, region: str, first: int, last: int) -> None:
        if region not in self.regions:
            raise ValueError(f"there is no region {region!r}: there are {', '.join(self.regions) or 'none'}")
        if first < 0 or last >= self.regions[region]:
            k = first if first < 0 else last
            raise ValueError(f"region {region!r} has {self.regions[region]} entries, and none numbered {k}")
