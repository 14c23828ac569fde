"""Sweeps over a forest of nodes, recorded: one traced step per kind of node, run in a loop instead of written out for every node.

A `Recorder` traces like a `Graph`, with one thing more: `sweep` runs a step once per kind of node on symbols, and the compiled loop
runs it at every node. Numbers of a node live in its block of the workspace, from where its own later steps and its children's read
them; vectors (inputs, outputs, what straight-line code computes between the sweeps) live in regions. Compile time does not grow with
the number of nodes, and what no output needs is neither computed nor stored. The engine does not know what the nodes are.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ..arithmetic import Array
from ..processes import cached_property
from .graph import CONDITIONS, LEAVES, Graph, Node, Scalar
from .program import Program, program

# Where a number of a node is found: ("own", key) and ("up", key) in the node's and its parent's block, ("param", k), or
# ("vector", region, start, column, k): entry start + offset + k of a region, the offset from a column of the node's row (None: 0).
Place = tuple[Any, ...]
Rebuild = Callable[[Sequence[Any]], Any]

MANY, LONG = 32, 64  # expressions alike that are worth a loop; nodes of one that is looked at
COMMUTATIVE = ("add", "mul", "min", "max", "eq")
SUM = "sum"  # the column of offsets to which numbers are added
ADDED = ("up", "slot", SUM)  # bases of places to which a store adds
FIXED_COLUMNS = ("own", "up", "param", "kind")  # of a node's row, before the forest's own


def flatten(record: Any) -> tuple[list[Any], Rebuild]:
    """The numbers of an array, or of (named) tuples of arrays, and what puts others in their places."""
    if isinstance(record, np.ndarray):
        shape = record.shape
        return list(record.ravel()), lambda xs: objects(xs).reshape(shape)
    if isinstance(record, (tuple, list)):
        parts = [flatten(x) for x in record]
        make = getattr(type(record), "_make", type(record))

        def rebuild(xs: Sequence[Any]) -> Any:
            out, start = [], 0
            for leaves, build in parts:
                out.append(build(xs[start : start + len(leaves)]))
                start += len(leaves)
            return make(out)

        return [x for leaves, _ in parts for x in leaves], rebuild
    return ([], lambda xs: None) if record is None else ([record], lambda xs: xs[0])


def objects(entries: Sequence[Any]) -> Array:
    """A vector of objects."""
    x = np.empty(len(entries), dtype=object)
    x[:] = entries
    return x


def constant(x: Any) -> float | None:
    """The value of a number that is known."""
    return x.constant if isinstance(x, Scalar) else float(x)


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
class Records:
    """One record per node: for each kind the places or constants of its numbers, and what puts them together."""

    recorder: "Recorder"
    forest: int
    places: list[list[Any]]
    rebuild: list[Rebuild]

    def inner(self, kind: int, graph: Graph) -> Any:
        """The record of a node of a kind, inside a step that is traced on `graph`."""
        return self.rebuild[kind]([graph.node("in", *p) if isinstance(p, tuple) else p for p in self.places[kind]])

    def unzip(self, count: int) -> tuple["Records", ...]:
        """Records of `count` entries as as many, one for each entry."""
        out = []
        for n in range(count):
            places, builders = [], []
            for where, build in zip(self.places, self.rebuild, strict=True):
                numbers, rebuild = flatten(build(range(len(where)))[n])  # type: ignore[arg-type]
                places.append([where[k] for k in numbers])
                builders.append(rebuild)
            out.append(Records(self.recorder, self.forest, places, builders))
        return tuple(out)

    def __getitem__(self, i: int) -> Any:
        """The record of one node, for straight-line code after the sweep."""
        kind = int(self.recorder.forests[self.forest].kinds[i])
        return self.rebuild[kind]([self.recorder.at(self.forest, i, p) if isinstance(p, tuple) else p for p in self.places[kind]])


@dataclass(frozen=True, eq=False)
class _Sweep:
    forest: int
    inward: bool
    stores: list[list[tuple[Place, Scalar]]]  # by kind
    root: dict[Any, float]  # key → what the ground passes on


@dataclass(frozen=True, eq=False)
class _Segment:
    """Straight-line code: entries k of a region."""

    region: str
    entries: list[tuple[int, Scalar]]


@dataclass(frozen=True, eq=False)
class _Zero:
    region: str


Steps = tuple[tuple[Any, ...], ...]  # operations in order; operands are earlier steps; of "in" the region, of "const" nothing


class _Pattern(NamedTuple):
    """An expression taken apart: its steps, and the numbers that tell it from others with the same steps."""

    steps: Steps
    places: tuple[int, ...]  # entries of the regions that its "in" read
    constants: tuple[float, ...]
    nodes: tuple[int, ...]  # of the graph: one per step


class Recorder:
    """What is recorded, in the order in which it will run."""

    def __init__(self) -> None:
        self.graph = Graph()
        self.forests: list[Forest] = []
        self._regions: dict[str, int] = {}
        self._items: list[Any] = []
        self._moved: dict[tuple[int, Any], tuple[str, str, int]] = {}  # numbers of nodes that live in a region: region, column, k
        self._computed: dict[int, tuple[str, int]] = {}  # expressions that are entries of a region by now

    # --- vectors ---

    def inputs(self, name: str, shape: tuple[int, ...]) -> Array:
        """An array of the entries of an input vector."""
        array = self.graph.inputs(name, shape)
        self._regions[name] = array.size
        return array

    def _region(self, size: int) -> str:
        name = f"region{len(self._regions)}"
        self._regions[name] = size
        return name

    def _entries(self, region: str) -> Array:
        return objects([self.graph.node("in", region, k) for k in range(self._regions[region])])

    def vector(self, x: Array) -> tuple[str, int] | None:
        """The region and the start where x (n,) is to be found; None where x is zero. Computed here, unless it lies there already."""
        entries = [self.graph.lift(a) for a in x]
        if all(a.constant == 0 for a in entries):
            return None
        places = [self._computed.get(a.number) or (a.node[1:] if a.node[0] == "in" else ("", None)) for a in entries]
        name, start = places[0]
        if isinstance(start, int) and all(place == (name, start + k) for k, place in enumerate(places)):
            return name, start
        region = self._region(len(entries))
        self._compute(region, list(enumerate(entries)))
        return region, 0

    def sparse(self, size: int, entries: Iterable[tuple[int, Any]]) -> str:
        """A region that is zero but for some entries."""
        region = self._region(size)
        self._items.append(_Zero(region))
        self._compute(region, [(k, self.graph.lift(x)) for k, x in entries])
        return region

    def _compute(self, region: str, entries: list[tuple[int, Scalar]]) -> None:
        """Entries k of a region: in loops where many are the same expression of other numbers, or many terms of their sums are."""
        whole, terms, rest, straight = self._sorted(entries)
        # What is one number in all that are alike is computed once.
        if shared := {i for found in (*whole.values(), *terms.values()) for i in self._shared(found)}:
            self._compute(self._region(len(shared)), list(enumerate(self.graph.at(i) for i in sorted(shared))))
            whole, terms, rest, straight = self._sorted(entries)

        begun = {k for found in terms.values() for k, _ in found}
        sums: dict[int, Any] = {k: x for k, x in rest if k not in begun} | dict.fromkeys(sorted(begun), 0.0)
        for k, x in straight:
            if k in begun:
                sums[k] = sums[k] + x
        if sums:
            self._items.append(_Segment(region, [(k, self.graph.lift(x)) for k, x in sums.items()]))
        for steps, found in whole.items():
            self._loop(region, steps, found, "entry")
        for steps, found in terms.items():
            self._loop(region, steps, found, SUM)
        for k, x in entries:
            if x.node[0] not in LEAVES:
                self._computed.setdefault(x.number, (region, k))

    def _sorted(self, entries: list[tuple[int, Scalar]]):
        """Entries alike, terms of long sums alike; the other entries, the other terms."""
        whole, rest = self._alike(entries)
        sums = ((k, self._terms(x)) for k, x in rest)
        # One term of each sum after the other: an addition need not wait for the one before.
        split = sorted(((n, k, x) for k, terms in sums if len(terms) >= MANY for n, x in enumerate(terms)), key=lambda term: term[0])
        terms, straight = self._alike((k, x) for _, k, x in split)
        return whole, terms, rest, straight

    def _alike(self, entries: Iterable[tuple[int, Scalar]]) -> tuple[dict[Steps, list[tuple[int, _Pattern]]], list[tuple[int, Scalar]]]:
        """Entries by their pattern's steps where at least `MANY` share them, and the others."""
        groups: dict[Any, list[tuple[int, Scalar, _Pattern]]] = {}
        rest = []
        for k, x in entries:
            if (pattern := self._pattern(x)) is None:
                rest.append((k, x))
            else:
                groups.setdefault(pattern.steps, []).append((k, x, pattern))
        rest += [(k, x) for found in groups.values() if len(found) < MANY for k, x, _ in found]
        return {steps: [(k, pattern) for k, _, pattern in found] for steps, found in groups.items() if len(found) >= MANY}, rest

    def _pattern(self, x: Scalar) -> "_Pattern | None":
        """The expression with its numbers left out; None where it is long, or of numbers that live at a node."""
        found: dict[int, int] = {}
        steps, places, constants, todo = [], [], [], [x.number]
        while todo:
            i = todo[-1]
            node: Node = ("in", *self._computed[i]) if i in self._computed else self.graph.nodes[i]
            op, *rest = node
            if op in COMMUTATIVE:  # a constant may be older than what it meets, or younger
                rest.sort(key=lambda j: self.graph.nodes[j][0] == "const")
            missing = [j for j in rest if j not in found] if op not in LEAVES else []
            if i in found or not missing:
                todo.pop()
            if i in found:
                continue
            if len(found) + len(todo) + len(missing) > LONG or (op == "in" and not isinstance(rest[1], int)):
                return None
            if missing:
                todo += reversed(missing)
                continue
            if op == "in":
                steps.append((op, rest[0]))
                places.append(rest[1])
            elif op == "const":
                steps.append((op,))
                constants.append(rest[0])
            else:
                steps.append((op, *(found[j] for j in rest)))
            found[i] = len(found)
        return _Pattern(tuple(steps), tuple(places), tuple(constants), tuple(found))

    def _shared(self, found: "list[tuple[int, _Pattern]]") -> set[int]:
        """The largest expressions that are one and the same node in all of these."""
        steps, nodes = found[0][1].steps, np.array([x.nodes for _, x in found])
        same = [op not in (*LEAVES, *CONDITIONS) and bool((nodes[:, n] == nodes[0, n]).all()) for n, (op, *_) in enumerate(steps)]
        used = {len(steps) - 1, *(j for n, (op, *operands) in enumerate(steps) if op not in LEAVES and not same[n] for j in operands)}
        return {int(nodes[0, n]) for n in used if same[n]}

    def _terms(self, x: Scalar) -> list[Scalar]:
        """The terms of a sum, as far as its partial sums are needed for nothing else in it."""
        nodes = self.graph.nodes
        uses = Counter(j for i in self.graph.live([x]) if nodes[i][0] not in LEAVES for j in nodes[i][1:])
        terms, todo = [], [(x.number, False)]
        while todo:
            i, negative = todo.pop()
            op, *operands = nodes[i]
            if op not in ("add", "sub", "neg") or uses[i] > 1 or i in self._computed:
                terms.append(-self.graph.at(i) if negative else self.graph.at(i))
                continue
            signs = [negative != (op == "neg" or (op == "sub" and n == 1)) for n in range(len(operands))]
            todo += reversed([*zip(operands, signs, strict=True)])
        return terms

    def _loop(self, region: str, steps: Steps, found: list[tuple[int, "_Pattern"]], target: str) -> None:
        """Expressions with these steps in a loop of their own: what they read lies in columns, shared where it lies side by side."""
        columns = {target: np.array([k for k, _ in found])}
        graph, values, inputs, constants = Graph(), [], zip(*(x.places for _, x in found), strict=True), 0
        for op, *rest in steps:
            if op == "in":
                places = np.array(next(inputs))
                beside = (name for name, column in columns.items() if (places - column == places[0] - column[0]).all())
                name = next(beside, f"in{len(columns)}")
                columns.setdefault(name, places)
                values.append(graph.node("in", "vector", rest[0], int(places[0] - columns[name][0]), name, 0))
            elif op == "const":
                values.append(graph.node("in", "param", constants))
                constants += 1
            else:
                values.append(graph.node(op, *(values[j].number for j in rest)))
        parameters = [np.array(x.constants) for _, x in found]
        number = self.forest(Forest(np.zeros(len(found), dtype=np.int64), np.full(len(found), -1), columns, parameters))
        self._items.append(_Sweep(number, False, [[(("vector", region, 0, target, 0), values[-1])]], {}))

    # --- sweeps ---

    def forest(self, forest: Forest) -> int:
        """Its number."""
        self.forests.append(forest)
        return len(self.forests) - 1

    def column(self, forest: int, name: str, offsets: Array) -> str:
        """The name, with a column of offsets (n,) added to the forest where it has none of that name."""
        self.forests[forest].columns.setdefault(name, offsets)
        return name

    def at(self, forest: int, i: int, place: Place) -> Any:
        """A number of node i, for straight-line code."""
        f = self.forests[forest]
        if place[0] == "param":
            return float(f.parameters[i][place[1]])
        if place[0] == "vector":
            _, region, start, column, k = place
            return self.graph.node("in", region, start + (int(f.columns[column][i]) if column else 0) + k)
        if (forest, place[1]) in self._moved:
            region, column, k = self._moved[forest, place[1]]
            return self.graph.node("in", region, int(f.columns[column][i]) + k)
        return self.graph.node("in", f"block{forest}", (i, place[1]))

    def sweep(
        self, forest: int, step: Callable[..., tuple[Any, Any]], fields: Sequence[Records], *, root: Any = None, inward: bool = False
    ):
        """The records that step(kind, comes, graph, *records) → (goes, kept) keeps, traced on the graph.

        Outward, what goes comes to the children, `root` to those of the ground. Inward the parent gets the sum of what goes; the step is
        first called once with None, for the shape.
        """
        number, kinds = len(self._items), range(self.forests[forest].count)
        shape = (
            flatten(step(0, None, scratch := Graph(), *(x.inner(0, scratch) for x in fields))[0] if inward else root)
            if len(kinds)
            else ([], objects)
        )
        leaves, rebuild = shape
        ground: list[Any] = [0.0] * len(leaves) if inward else [constant(x) for x in leaves]
        came = "own" if inward else "up"

        def traced(same: Sequence[Any]) -> list[tuple[Graph, list[Any], Any]]:
            found = []
            for kind in kinds:
                graph = Graph()
                comes = rebuild([x if isinstance(x, float) else graph.node("in", came, ("passed", number, x)) for x in same])
                on, kept = step(kind, comes, graph, *(x.inner(kind, graph) for x in fields))
                found.append((graph, flatten(on)[0], kept))
            return found

        # Entries that are one number at every kind (a symmetric matrix), or one constant, need one place or none.
        same: list[Any] = list(range(len(leaves)))
        found = traced(same)
        merged = _merged([on for _, on, _ in found], ground, inward=inward)
        if merged != same:
            again = traced(merged)
            after = _merged([on for _, on, _ in again], ground, inward=inward)
            if all(after[k] == (merged[k] if isinstance(merged[k], float) else after[merged[k]]) for k in range(len(same))):
                same, found = merged, again

        stores: list[list[tuple[Place, Scalar]]] = []
        places, builders = [], []
        for kind, (graph, on, kept) in enumerate(found):
            passed = {("passed", number, k): graph.lift(on[k]) for k, x in enumerate(same) if x == k and not isinstance(x, float)}
            todo: list[tuple[Place, Scalar]] = [(("up" if inward else "own", key), x) for key, x in passed.items()]
            known: dict[int, Place] = {x.number: ("own", key) for key, x in passed.items()} if not inward else {}
            entries, build = flatten(kept)
            places.append([])
            for k, x in enumerate(entries):
                if (value := constant(x)) is not None:
                    places[-1].append(value)
                    continue
                op, *rest = x.node
                if op == "in" and rest[0] != "up":  # it has a place already
                    place = tuple(rest)
                else:
                    place = known.setdefault(x.number, ("own", ("kept", number, kind, k)))
                    if place[1][0] == "kept" and place[1][3] == k:
                        todo.append((place, x))
                places[-1].append(place)
            stores.append(todo)
            builders.append(build)
        self._items.append(_Sweep(forest, inward, stores, {("passed", number, k): x for k, x in enumerate(ground)}))
        return Records(self, forest, places, builders)

    def total(self, forest: int, step: Callable[..., Any], fields: Sequence[Records]) -> Any:
        """The sum of step(kind, *records) over all nodes, for straight-line code."""
        traced, rebuild = [], None
        for kind in range(self.forests[forest].count):
            graph = Graph()
            leaves, rebuild = flatten(step(kind, graph, *(x.inner(kind, graph) for x in fields)))
            traced.append([graph.lift(x) for x in leaves])
        if rebuild is None:
            return 0.0
        region = self._region(len(traced[0]))
        stores = [[(("vector", region, 0, None, k), x) for k, x in enumerate(leaves)] for leaves in traced]
        self._items += [_Zero(region), _Sweep(forest, True, stores, {})]
        return rebuild(list(self._entries(region)))

    def gathered(self, records: Records, column: str, size: int) -> Array:
        """The numbers of all nodes as one vector (size,), each node's at its offset; their sums where the column is `SUM`."""
        region, forest = self._region(size), records.forest
        keys = [p[1] if isinstance(p, tuple) and p[0] == "own" else None for places in records.places for p in places]
        if (
            column != SUM
            and all(key and key[0] == "kept" and (forest, key) not in self._moved for key in keys)
            and len(set(keys)) == len(keys)
        ):
            for places in records.places:  # they live there from the start
                self._moved.update({(forest, p[1]): (region, column, k) for k, p in enumerate(places)})
        else:
            stores = []
            for kind in range(len(records.places)):
                graph = Graph()
                numbers = flatten(records.inner(kind, graph))[0]
                stores.append([(("vector", region, 0, column, k), graph.lift(x)) for k, x in enumerate(numbers)])
            self._items += [_Zero(region)] * (column == SUM) + [_Sweep(forest, False, stores, {})]
        return self._entries(region)

    # --- the end ---

    def finish(self, inputs: Mapping[str, int], outputs: Mapping[str, Array], guards: Sequence[Any]) -> "Looped":
        """The program; `guards` are scalars that must turn out positive for the outputs to be trusted."""
        regions = {}
        for name, x in {**outputs, "": objects([*guards])}.items():
            x = np.ravel(x)
            whole = self.vector(x) if len(x) else None
            if whole is None or whole[0] in inputs or whole[1] or self._regions[whole[0]] != len(x) or whole[0] in regions.values():
                region = self._region(len(x))
                self._compute(region, [(k, self.graph.lift(a)) for k, a in enumerate(x)])
            else:
                region = whole[0]
            regions[name] = region
        for name, size in inputs.items():
            self._regions.setdefault(name, size)
        return _Layout(self, regions, dict(inputs)).looped()


def _merged(outputs: list[list[Any]], ground: Sequence[float | None], *, inward: bool) -> list[Any]:
    """For each passed entry: the constant that it is at every kind, or the first entry that equals it at every kind."""
    first: dict[tuple, int] = {}
    out: list[Any] = []
    for k, at_ground in enumerate(ground):
        values = [constant(on[k]) for on in outputs]
        if all(x is not None and x == at_ground for x in values):
            out.append(float(at_ground))  # type: ignore[arg-type]
            continue
        numbers = [
            on[k].number if isinstance(on[k], Scalar) and v is None else ("constant", v) for on, v in zip(outputs, values, strict=True)
        ]
        out.append(first.setdefault((at_ground, *numbers), k))
    return out


# --- from what was recorded to what runs ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Loop:
    """One pass over a forest: by kind, the step's program and where each of its outputs goes (`ADDED`: is added there)."""

    forest: int
    inward: bool
    steps: tuple[tuple[Program, tuple[tuple[str, int], ...]] | None, ...]
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


class _Layout:
    """Finds out what is needed, from the end to the beginning, and gives it places."""

    def __init__(self, recorder: Recorder, regions: Mapping[str, str], inputs: dict[str, int]) -> None:
        self.r, self.regions, self.inputs = recorder, regions, inputs
        self.needed: set[Any] = set(regions.values())  # names of regions, (forest, key) of nodes' numbers

    def looped(self) -> Looped:
        r, kept = self.r, []
        for item in reversed(r._items):
            if isinstance(item, _Sweep):
                while self._grew(item):
                    pass
                if any(self._wanted(item, kind) for kind in range(len(item.stores))):
                    kept.append(item)
            elif item.region in self.needed:
                if isinstance(item, _Segment):
                    for i in r.graph.live(x for _, x in item.entries):
                        if r.graph.nodes[i][0] == "in":
                            self._need_outer(*r.graph.nodes[i][1:])
                kept.append(item)
        kept.reverse()
        self._place()

        items: list[Any] = [Fill(self.ground[f], (0.0,) * len(header)) for f, header in enumerate(self.headers) if header]
        for item in kept:
            items += self._final(item)
        outputs = {name: self._range(region) for name, region in self.regions.items() if name}
        counts = tuple(len(f.kinds) for f in r.forests)
        columns = tuple(tuple(f.columns) for f in r.forests)
        checks, tables = self._range(self.regions[""]), self._tables()
        return Looped(tuple(_cleared(items)), self.inputs, outputs, self.start, checks, self.size, counts, columns, tables)

    def _range(self, region: str) -> range:
        return range(self.start[region], self.start[region] + self.r._regions[region])

    # --- what is needed ---

    def _need(self, forest: int, key: Any) -> None:
        moved = self.r._moved.get((forest, key))
        self.needed.add(moved[0] if moved else (forest, key))

    def _need_outer(self, name: str, k: Any) -> None:
        if name.startswith("block"):
            self._need(int(name[5:]), k[1])
        else:
            self.needed.add(name)

    def _wanted(self, sweep: _Sweep, kind: int) -> list[tuple[Place, Scalar]]:
        """The stores of a kind's step that something needs."""

        def wanted(place: Place) -> bool:
            if place[0] == "vector":
                return place[1] in self.needed
            moved = self.r._moved.get((sweep.forest, place[1]))
            return (moved[0] if moved else (sweep.forest, place[1])) in self.needed

        return [(place, x) for place, x in sweep.stores[kind] if wanted(place)]

    def _grew(self, sweep: _Sweep) -> bool:
        """Note what the wanted stores need; whether that was news, which may want more stores of the same sweep."""
        before = len(self.needed)
        for kind in range(len(sweep.stores)):
            if wanted := self._wanted(sweep, kind):
                graph = wanted[0][1].graph
                for i in graph.live(x for _, x in wanted):
                    op, *place = graph.nodes[i]
                    if op == "in" and place[0] in ("own", "up"):
                        self._need(sweep.forest, place[1])
                    elif op == "in" and place[0] == "vector":
                        self.needed.add(place[1])
        return len(self.needed) > before

    # --- places ---

    def _place(self) -> None:
        """Regions first, then for each forest the ground's block and the nodes': what is passed on, then what is kept."""
        r, self.start, slot = self.r, {}, 0
        for region, size in r._regions.items():
            if region in self.needed or region in self.inputs:
                self.start[region] = slot
                slot += size
        self.headers, self.ground, self.blocks, self.kept = [], [], [], []
        for f, forest in enumerate(r.forests):
            keys = sorted(x[1] for x in self.needed if isinstance(x, tuple) and x[0] == f)
            header = {key: k for k, key in enumerate(key for key in keys if key[0] == "passed")}
            own = [{} for _ in range(forest.count)]
            for key in keys:
                if key[0] == "kept":
                    own[key[2]][key] = len(header) + len(own[key[2]])
            self.headers.append(header)
            self.kept.append(own)
            self.ground.append(slot)
            sizes = np.array([len(header) + len(x) for x in own], dtype=np.int64)
            ends = slot + len(header) + np.cumsum([0, *sizes[forest.kinds]]) if len(own) else np.array([slot + len(header)])
            self.blocks.append(ends[:-1])
            slot = int(ends[-1])
        self.size = max(slot, 1)

    def _slot(self, forest: int, i: int, key: Any) -> int:
        if (moved := self.r._moved.get((forest, key))) is not None:
            region, column, k = moved
            return self.start[region] + int(self.r.forests[forest].columns[column][i]) + k
        header, own = self.headers[forest], self.kept[forest][int(self.r.forests[forest].kinds[i])]
        return int(self.blocks[forest][i]) + (header[key] if key in header else own[key])

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
        if isinstance(item, _Zero):
            return [Fill(self.start[item.region], (0.0,) * r._regions[item.region])]
        if isinstance(item, _Segment):
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

    def _step(self, sweep: _Sweep, kind: int) -> tuple[Program, tuple[tuple[str, int], ...]] | None:
        if not (wanted := self._wanted(sweep, kind)):
            return None
        code = program(wanted[0][1].graph, {}, {"": objects([x for _, x in wanted])})
        placed = (("in", *self._address(sweep.forest, kind, tuple(x[1:]))) if x[0] == "in" else x for x in code.instructions)
        return replace(code, instructions=tuple(placed)), tuple(self._address(sweep.forest, kind, place) for place, _ in wanted)

    def _address(self, forest: int, kind: int, place: Place) -> tuple[str, int]:
        """(base, offset): "own", "up", "param" or a column's name with its offset from there; "slot": from the workspace's start."""
        if place[0] == "param":
            return "param", place[1]
        if place[0] == "vector":
            _, region, start, column, k = place
            return (column or "slot", self.start[region] + start + k)
        key = place[1]
        if (moved := self.r._moved.get((forest, key))) is not None:
            region, column, k = moved
            return column, self.start[region] + k
        header = self.headers[forest]
        return place[0], header[key] if key in header else self.kept[forest][kind][key]

    def _straight(self, segment: _Segment) -> list[Any]:
        graph, region = self.r.graph, segment.region
        code = program(graph, {}, {region: objects([x for _, x in segment.entries])})
        slots: dict[Any, int] = {("out", region, n): self.start[region] + k for n, (k, _) in enumerate(segment.entries)}
        for op, *rest in code.instructions:
            if op == "in":
                name, k = rest
                slots["in", name, k] = self._slot(int(name[5:]), *k) if name.startswith("block") else self.start[name] + k
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
