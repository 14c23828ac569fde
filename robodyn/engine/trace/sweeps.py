"""Sweeps over a forest of nodes, recorded: one traced step per kind of node, run in a loop instead of written out for every node.

A `Recorder` traces like a `Graph`, with one thing more: `sweep` runs a step once per kind of node on symbols, and the compiled loop
runs it at every node. Numbers of a node live in its block of the workspace, from where its own later steps and its children's read
them; vectors (inputs, outputs, what straight-line code computes between the sweeps) live in regions. Compile time does not grow with
the number of nodes. What is written down (`recording`) gets its places in `layout`; what no output needs is then neither computed nor
stored. The engine does not know what the nodes are.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arithmetic import Array
from .alike import Alike, Pattern, Steps
from .graph import LEAVES, Graph, Scalar
from .layout import Layout, Looped
from .recording import SUM, Entry, Forest, Kept, OfNode, Own, Param, Passed, Place, Recording, Segment, Sweep, Target, Up, Zero, objects

Rebuild = Callable[[Sequence[Any]], Any]


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


def constant(x: Any) -> float | None:
    """The value of a number that is known."""
    return x.constant if isinstance(x, Scalar) else float(x)


@dataclass(frozen=True, eq=False)
class NodeRecords:
    """One record per node: for each kind the places or constants of its numbers, and what puts them together.

    ValueError where a place is not there.
    """

    recorder: "Recorder"
    forest: int
    places: list[list[Any]]
    rebuild: list[Rebuild]

    def __post_init__(self) -> None:
        for kind, places in enumerate(self.places):
            for place in places:
                if isinstance(place, Place):
                    self.recorder.check_place(self.forest, kind, place)

    def inner(self, kind: int, graph: Graph) -> Any:
        """The record of a node of a kind, inside a step that is traced on `graph`."""
        return self.rebuild[kind]([graph.node("in", p) if isinstance(p, Place) else p for p in self.places[kind]])

    def unzip(self, count: int) -> tuple["NodeRecords", ...]:
        """Records of `count` entries as as many, one for each entry."""
        out = []
        for n in range(count):
            places, builders = [], []
            for where, build in zip(self.places, self.rebuild, strict=True):
                numbers, rebuild = flatten(build(range(len(where)))[n])  # type: ignore[arg-type]
                places.append([where[k] for k in numbers])
                builders.append(rebuild)
            out.append(NodeRecords(self.recorder, self.forest, places, builders))
        return tuple(out)

    def __getitem__(self, i: int) -> Any:
        """The record of one node, for straight-line code after the sweep."""
        kind = int(self.recorder.forests[self.forest].kinds[i])
        return self.rebuild[kind]([self.recorder.at(self.forest, i, p) if isinstance(p, Place) else p for p in self.places[kind]])


class Recorder(Recording):
    """Writes the recording: vectors, sweeps, and at the end the program."""

    def __init__(self) -> None:
        super().__init__()
        self._computed: dict[int, tuple[str, int]] = {}  # expressions that are entries of a region by now
        self._alike = Alike(self.graph, self._computed)

    # --- vectors ---

    def inputs(self, name: str, shape: tuple[int, ...]) -> Array:
        """An array of the entries of an input vector."""
        array = self.graph.inputs(name, shape)
        self.regions[name] = array.size
        return array

    def _region(self, size: int) -> str:
        name = f"region{len(self.regions)}"
        self.regions[name] = size
        return name

    def _entries(self, region: str) -> Array:
        return objects([self.graph.node("in", region, k) for k in range(self.regions[region])])

    def vector(self, x: Array) -> tuple[str, int] | None:
        """The region and the start where x (n,) is to be found; None where x is zero. Computed here, unless it lies there already."""
        entries = [self.graph.lift(a) for a in x]
        if all(a.constant == 0 for a in entries):
            return None
        places = [self._computed.get(a.number) or (a.node[1:] if a.node[0] == "in" else ()) for a in entries]
        if len(places[0]) == 2 and all(place == (places[0][0], places[0][1] + k) for k, place in enumerate(places)):
            return places[0]
        region = self._region(len(entries))
        self._compute(region, list(enumerate(entries)))
        return region, 0

    def sparse(self, size: int, entries: Iterable[tuple[int, Any]]) -> str:
        """A region that is zero but for some entries."""
        region = self._region(size)
        self.items.append(Zero(region))
        self._compute(region, [(k, self.graph.lift(x)) for k, x in entries])
        return region

    def _compute(self, region: str, entries: list[tuple[int, Scalar]]) -> None:
        """Entries k of a region: in loops where many are the same expression of other numbers, or many terms of their sums are."""
        whole, terms, rest, straight = self._alike.sort(entries)
        # What is one number in all that are alike is computed once.
        if shared := {i for found in (*whole.values(), *terms.values()) for i in self._alike.shared(found)}:
            self._compute(self._region(len(shared)), list(enumerate(self.graph.at(i) for i in sorted(shared))))
            whole, terms, rest, straight = self._alike.sort(entries)

        begun = {k for found in terms.values() for k, _ in found}
        sums: dict[int, Any] = {k: x for k, x in rest if k not in begun} | dict.fromkeys(sorted(begun), 0.0)
        for k, x in straight:
            if k in begun:
                sums[k] = sums[k] + x
        if sums:
            self.items.append(Segment(region, [(k, self.graph.lift(x)) for k, x in sums.items()]))
        for steps, found in whole.items():
            self._loop(region, steps, found, "entry")
        for steps, found in terms.items():
            self._loop(region, steps, found, SUM)
        for k, x in entries:
            if x.node[0] not in LEAVES:
                self._computed.setdefault(x.number, (region, k))

    def _loop(self, region: str, steps: Steps, found: list[tuple[int, Pattern]], target: str) -> None:
        """Expressions with these steps in a loop of their own: what they read lies in columns, shared where it lies side by side."""
        columns = {target: np.array([k for k, _ in found])}
        graph, values, inputs, constants = Graph(), [], zip(*(x.places for _, x in found), strict=True), 0
        for op, *rest in steps:
            if op == "in":
                places = np.array(next(inputs))
                beside = (name for name, column in columns.items() if (places - column == places[0] - column[0]).all())
                name = next(beside, f"in{len(columns)}")
                columns.setdefault(name, places)
                values.append(graph.node("in", Entry(rest[0], name, int(places[0] - columns[name][0]))))
            elif op == "const":
                values.append(graph.node("in", Param(constants)))
                constants += 1
            else:
                values.append(graph.node(op, *(values[j].number for j in rest)))
        parameters = [np.array(x.constants) for _, x in found]
        number = self.forest(Forest(np.zeros(len(found), dtype=np.int64), np.full(len(found), -1), columns, parameters))
        self.items.append(Sweep(number, False, [[(Entry(region, target, 0), values[-1])]], {}))

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
        if isinstance(place, Param):
            return float(self.forests[forest].parameters[i][place.k])
        place = self.lies(forest, place)
        if isinstance(place, Entry):
            return self.graph.node("in", place.region, self.index(forest, i, place))
        return self.graph.node("in", OfNode(forest, i, place.key))

    def sweep(
        self, forest: int, step: Callable[..., tuple[Any, Any]], fields: Sequence[NodeRecords], *, root: Any = None, inward: bool = False
    ):
        """The records that step(kind, comes, graph, *records) → (goes, kept) keeps, traced on the graph.

        Outward, what goes comes to the children, `root` to those of the ground. Inward the parent gets the sum of what goes; the step is
        first called once with None, for the shape.
        """
        number, kinds = len(self.items), range(self.forests[forest].count)
        shape = (
            flatten(step(0, None, scratch := Graph(), *(x.inner(0, scratch) for x in fields))[0] if inward else root)
            if len(kinds)
            else ([], objects)
        )
        leaves, rebuild = shape
        ground: list[Any] = [0.0] * len(leaves) if inward else [constant(x) for x in leaves]
        came, gone = (Own, Up) if inward else (Up, Own)

        def traced(same: Sequence[Any]) -> list[tuple[Graph, list[Any], Any]]:
            found = []
            for kind in kinds:
                graph = Graph()
                comes = rebuild([x if isinstance(x, float) else graph.node("in", came(Passed(number, x))) for x in same])
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

        stores: list[list[tuple[Target, Scalar]]] = []
        places, builders = [], []
        for kind, (graph, on, kept) in enumerate(found):
            passed = {Passed(number, k): graph.lift(on[k]) for k, x in enumerate(same) if x == k and not isinstance(x, float)}
            todo: list[tuple[Target, Scalar]] = [(gone(key), x) for key, x in passed.items()]
            known = {x.number: Own(key) for key, x in passed.items()} if not inward else {}
            entries, build = flatten(kept)
            places.append([])
            for k, x in enumerate(entries):
                if (value := constant(x)) is not None:
                    places[-1].append(value)
                    continue
                op, *rest = x.node
                if op == "in" and not isinstance(rest[0], Up):  # it has a place already
                    place = rest[0]
                else:
                    place = known.setdefault(x.number, Own(Kept(number, kind, k)))
                    if place.key == Kept(number, kind, k):
                        todo.append((place, x))
                places[-1].append(place)
            stores.append(todo)
            builders.append(build)
        self.items.append(Sweep(forest, inward, stores, {Passed(number, k): x for k, x in enumerate(ground)}))
        return NodeRecords(self, forest, places, builders)

    def total(self, forest: int, step: Callable[..., Any], fields: Sequence[NodeRecords]) -> Any:
        """The sum of step(kind, *records) over all nodes, for straight-line code."""
        traced, rebuild = [], None
        for kind in range(self.forests[forest].count):
            graph = Graph()
            leaves, rebuild = flatten(step(kind, graph, *(x.inner(kind, graph) for x in fields)))
            traced.append([graph.lift(x) for x in leaves])
        if rebuild is None:
            return 0.0
        region = self._region(len(traced[0]))
        stores: list[list[tuple[Target, Scalar]]] = [[(Entry(region, None, k), x) for k, x in enumerate(leaves)] for leaves in traced]
        self.items += [Zero(region), Sweep(forest, True, stores, {})]
        return rebuild(list(self._entries(region)))

    def gathered(self, field: NodeRecords, column: str, size: int) -> Array:
        """The numbers of all nodes as one vector (size,), each node's at its offset; their sums where the column is `SUM`."""
        region, forest = self._region(size), field.forest
        keys = [p.key if isinstance(p, Own) else None for places in field.places for p in places]
        if column != SUM and all(isinstance(key, Kept) and (forest, key) not in self.moved for key in keys) and len(set(keys)) == len(keys):
            for places in field.places:  # they live there from the start
                self.moved.update({(forest, p.key): Entry(region, column, k) for k, p in enumerate(places)})
        else:
            stores: list[list[tuple[Target, Scalar]]] = []
            for kind in range(len(field.places)):
                graph = Graph()
                numbers = flatten(field.inner(kind, graph))[0]
                stores.append([(Entry(region, column, k), graph.lift(x)) for k, x in enumerate(numbers)])
            self.items += [Zero(region)] * (column == SUM) + [Sweep(forest, False, stores, {})]
        return self._entries(region)

    # --- the end ---

    def finish(self, inputs: Mapping[str, int], outputs: Mapping[str, Array], guards: Sequence[Any]) -> "Looped":
        """The program; `guards` are scalars that must turn out positive for the outputs to be trusted.

        ValueError where what was recorded reads or stores at a place that is not there.
        """
        regions = {}
        for name, x in {**outputs, "": objects([*guards])}.items():
            x = np.ravel(x)
            whole = self.vector(x) if len(x) else None
            if whole is None or whole[0] in inputs or whole[1] or self.regions[whole[0]] != len(x) or whole[0] in regions.values():
                region = self._region(len(x))
                self._compute(region, [(k, self.graph.lift(a)) for k, a in enumerate(x)])
            else:
                region = whole[0]
            regions[name] = region
        for name, size in inputs.items():
            self.regions.setdefault(name, size)
        self.check()
        return Layout(self, regions, dict(inputs)).looped()


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
