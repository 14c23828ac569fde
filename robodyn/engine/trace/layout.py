"""From what was recorded to what runs: what is needed of it, and where every number lies.

The result is a program with loops, `Looped`: what `Program` is for straight-line code.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ...arithmetic import Array
from ...system.processes import cached_property
from .graph import Scalar
from .program import Program, program
from .recording import SUM, Entry, Kept, Key, OfNode, Own, Param, Passed, Place, Recording, Segment, Sweep, Target, Up, Zero, objects

ADDED = ("up", "slot", SUM)  # bases of addresses to which a store adds
FIXED_COLUMNS = ("own", "up", "param", "kind")  # of a node's row, before the forest's own


class Address(NamedTuple):
    """Where a step finds a number of its node: so far from a base, which is a column of the node's row; "slot": the workspace's start."""

    base: str
    offset: int


Step = tuple[Program, tuple[Address, ...]]  # its inputs are addresses; where each of its outputs goes (`ADDED`: is added there)


@dataclass(frozen=True, eq=False)
class Loop:
    """One pass over a forest, a step of each kind."""

    forest: int
    inward: bool
    steps: tuple[Step | None, ...]
    clears: tuple[int, ...] = ()  # entries of every node's block to be set to zero: sums of a later pass


@dataclass(frozen=True, eq=False)
class Straight:
    """A program between loops, with the slots of its inputs and outputs."""

    program: Program
    slots: dict[Any, int]


@dataclass(frozen=True, eq=False)
class Fill:
    """Constants in consecutive slots."""

    start: int
    values: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Looped:
    """A program with loops: what `Program` is for straight-line code. Slots number the places of the workspace."""

    items: tuple[Loop | Straight | Fill, ...]
    inputs: dict[str, int]  # name → length
    outputs: dict[str, range]  # name → slots
    starts: dict[str, int]  # slot of each input's first entry
    checks: range  # slots whose values must be positive for the outputs to be trusted
    size: int  # slots
    counts: tuple[int, ...]  # nodes of each forest
    columns: tuple[tuple[str, ...], ...]  # names of the columns of its rows behind the fixed ones
    tables: dict[str, Array] = field(repr=False)  # rows{f} (n, columns) int64, parameters{f} float64: what the code reads

    @property
    def programs(self) -> tuple[Program, ...]:
        """The straight-line programs in it."""
        loops = [step[0] for item in self.items if isinstance(item, Loop) for step in item.steps if step]
        return (*(item.program for item in self.items if isinstance(item, Straight)), *loops)

    def _weighed(self, weigh: Callable[[Program], int]) -> int:
        total = 0
        for item in self.items:
            if isinstance(item, Straight):
                total += weigh(item.program)
            elif isinstance(item, Loop):
                kinds = np.bincount(self.tables[f"rows{item.forest}"][:, FIXED_COLUMNS.index("kind")], minlength=len(item.steps))
                total += sum(int(n) * weigh(step[0]) for n, step in zip(kinds, item.steps, strict=True) if step)
        return total

    @property
    def operations(self) -> int:
        """Floating-point operations of one evaluation, counted as for a `Program`."""
        return self._weighed(lambda p: p.operations)

    @property
    def cost(self) -> int:
        """The time of one evaluation in operations, as of a `Program`."""
        return self._weighed(lambda p: p.cost)

    @cached_property
    def length(self) -> int:
        """Instructions of one evaluation."""
        return self._weighed(lambda p: p.length)


class Layout:
    """Finds out what is needed, from the end to the beginning, and gives it places."""

    def __init__(self, recording: Recording, outputs: Mapping[str, str], inputs: dict[str, int]) -> None:
        """outputs: the region of each; the guards are that of the name "". inputs: their lengths."""
        self.r, self.outputs, self.inputs = recording, outputs, inputs
        self.needed: set[str | tuple[int, Key]] = set(outputs.values())  # names of regions, nodes' numbers by forest and key

    def looped(self) -> Looped:
        """The program."""
        r, kept = self.r, []
        for item in reversed(r.items):
            if isinstance(item, Sweep):
                while self._grew(item):
                    pass
                if any(self._wanted(item, kind) for kind in range(len(item.stores))):
                    kept.append(item)
            elif item.region in self.needed:
                if isinstance(item, Segment):
                    for op, *rest in map(r.graph.nodes.__getitem__, r.graph.live(x for _, x in item.entries)):
                        if op == "in":
                            x = rest[0]
                            self.needed.add(self._owner(x.forest, Own(x.key)) if isinstance(x, OfNode) else x)
                kept.append(item)
        kept.reverse()
        self._place()

        items: list[Any] = [Fill(self.ground[f], (0.0,) * len(header)) for f, header in enumerate(self.headers) if header]
        for item in kept:
            items += self._final(item)
        outputs = {name: self._range(region) for name, region in self.outputs.items() if name}
        counts = tuple(len(f.kinds) for f in r.forests)
        columns = tuple(tuple(f.columns) for f in r.forests)
        checks, tables = self._range(self.outputs[""]), self._tables()
        return Looped(tuple(_cleared(items)), self.inputs, outputs, self.start, checks, self.size, counts, columns, tables)

    def _range(self, region: str) -> range:
        return range(self.start[region], self.start[region] + self.r.regions[region])

    # --- what is needed ---

    def _owner(self, forest: int, place: Target) -> str | tuple[int, Key]:
        """What `needed` knows a place by."""
        lies = self.r.lies(forest, place)
        return lies.region if isinstance(lies, Entry) else (forest, lies.key)

    def _wanted(self, sweep: Sweep, kind: int) -> list[tuple[Target, Scalar]]:
        """The stores of a kind's step that something needs."""
        return [(place, x) for place, x in sweep.stores[kind] if self._owner(sweep.forest, place) in self.needed]

    def _grew(self, sweep: Sweep) -> bool:
        """Note what the wanted stores need; whether that was news, which may want more stores of the same sweep."""
        before = len(self.needed)
        for kind in range(len(sweep.stores)):
            if wanted := self._wanted(sweep, kind):
                graph = wanted[0][1].graph
                for i in graph.live(x for _, x in wanted):
                    op, *rest = graph.nodes[i]
                    if op == "in" and not isinstance(rest[0], Param):
                        self.needed.add(self._owner(sweep.forest, rest[0]))
        return len(self.needed) > before

    # --- places ---

    def _place(self) -> None:
        """Regions first, then for each forest the ground's block and the nodes': what is passed on, then what is kept."""
        r, self.start, slot = self.r, {}, 0
        for region, size in r.regions.items():
            if region in self.needed or region in self.inputs:
                self.start[region] = slot
                slot += size
        self.headers, self.ground, self.blocks, self.kept = [], [], [], []
        for f, forest in enumerate(r.forests):
            keys = [x[1] for x in self.needed if isinstance(x, tuple) and x[0] == f]
            header = {key: k for k, key in enumerate(sorted(key for key in keys if isinstance(key, Passed)))}
            own = [{} for _ in range(forest.count)]
            for key in sorted(key for key in keys if isinstance(key, Kept)):
                own[key.kind][key] = len(header) + len(own[key.kind])
            self.headers.append(header)
            self.kept.append(own)
            self.ground.append(slot)
            sizes = np.array([len(header) + len(x) for x in own], dtype=np.int64)
            ends = slot + len(header) + np.cumsum([0, *sizes[forest.kinds]]) if len(own) else np.array([slot + len(header)])
            self.blocks.append(ends[:-1])
            slot = int(ends[-1])
        self.size = max(slot, 1)

    def _slot(self, node: OfNode) -> int:
        forest, i, key = node.forest, node.i, node.key
        if isinstance(entry := self.r.lies(forest, Own(key)), Entry):
            return self.start[entry.region] + self.r.index(forest, i, entry)
        return int(self.blocks[forest][i]) + self._offset(forest, int(self.r.forests[forest].kinds[i]), key)

    def _offset(self, forest: int, kind: int, key: Key) -> int:
        """In a node's block."""
        return self.headers[forest][key] if isinstance(key, Passed) else self.kept[forest][kind][key]

    def _tables(self) -> dict[str, Array]:
        tables: dict[str, Array] = {}
        for f, forest in enumerate(self.r.forests):
            lengths = [len(x) for x in forest.parameters]
            parents = np.where(forest.parents >= 0, self.blocks[f][forest.parents] if len(lengths) else 0, self.ground[f])
            columns = [self.blocks[f], parents, np.cumsum([0, *lengths])[:-1], forest.kinds, *forest.columns.values()]
            tables[f"rows{f}"] = np.ascontiguousarray(np.stack(columns, axis=-1), dtype=np.int64)
            tables[f"parameters{f}"] = np.concatenate([np.zeros(1), *forest.parameters])[1:].astype(float)
        return tables

    # --- what runs ---

    def _final(self, item: Any) -> list[Any]:
        r = self.r
        if isinstance(item, Zero):
            return [Fill(self.start[item.region], (0.0,) * r.regions[item.region])]
        if isinstance(item, Segment):
            return self._straight(item)
        ground, header = self.ground[item.forest], self.headers[item.forest]
        fills = [Fill(ground + header[key], (x,)) for key, x in item.root.items() if x and key in header]
        steps = [self._step(item, kind) for kind in range(len(item.stores))]
        sums = sorted({offset for step in steps if step for base, offset in step[1] if base == "up"})
        return [
            *fills,
            *([Loop(item.forest, False, (None,) * len(steps), tuple(sums))] if sums else []),
            Loop(item.forest, item.inward, tuple(steps)),
        ]

    def _step(self, sweep: Sweep, kind: int) -> Step | None:
        if not (wanted := self._wanted(sweep, kind)):
            return None
        code = program(wanted[0][1].graph, {}, {"": objects([x for _, x in wanted])})
        placed = (("in", self._address(sweep.forest, kind, x[1])) if x[0] == "in" else x for x in code.instructions)
        return replace(code, instructions=tuple(placed)), tuple(self._address(sweep.forest, kind, place) for place, _ in wanted)

    def _address(self, forest: int, kind: int, place: Place) -> Address:
        lies = self.r.lies(forest, place)
        if isinstance(lies, Param):
            return Address("param", lies.k)
        if isinstance(lies, Entry):
            return Address(lies.column or "slot", self.start[lies.region] + lies.k)
        return Address("up" if isinstance(lies, Up) else "own", self._offset(forest, kind, lies.key))

    def _straight(self, segment: Segment) -> list[Any]:
        graph, region = self.r.graph, segment.region
        code = program(graph, {}, {region: objects([x for _, x in segment.entries])})
        slots: dict[Any, int] = {("out", region, n): self.start[region] + k for n, (k, _) in enumerate(segment.entries)}
        for op, *rest in code.instructions:
            if op == "in":
                slots["in", *rest] = self._slot(rest[0]) if isinstance(rest[0], OfNode) else self.start[rest[0]] + rest[1]
        return [Straight(code, slots)]


def _cleared(items: list[Any]) -> list[Any]:
    """The items, with sums set to zero in a pass over the same forest that runs anyway, where there is one."""
    out: list[Any] = []
    for item in items:
        if isinstance(item, Loop) and item.clears:
            host = next((k for k in reversed(range(len(out))) if isinstance(out[k], Loop) and out[k].forest == item.forest), None)
            if host is not None and not out[host].inward:
                out[host] = replace(out[host], clears=out[host].clears + item.clears)
                continue
        out.append(item)
    return out
