"""What a `sweeps.Recorder` writes down, for `layout` to find places for: sweeps over forests, straight-line code and zeros, in order."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arithmetic import Array
from .graph import Graph, Scalar

# Where a number of a node is found: ("own", key) and ("up", key) in the node's and its parent's block, ("param", k), or
# ("vector", region, start, column, k): entry start + offset + k of a region, the offset from a column of the node's row (None: 0).
Place = tuple[Any, ...]

SUM = "sum"  # the column of offsets to which numbers are added


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


@dataclass(frozen=True, eq=False)
class Sweep:
    """A step per kind, run at every node, parents first or (inward) children first; each stores numbers at its node or parent or in
    a region."""

    forest: int
    inward: bool
    stores: list[list[tuple[Place, Scalar]]]  # by kind
    root: dict[Any, float]  # key → what the ground passes on


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
        self.moved: dict[tuple[int, Any], tuple[str, str, int]] = {}  # numbers of nodes that live in a region: region, column, k
