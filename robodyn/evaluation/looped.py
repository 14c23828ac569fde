"""A tree whose sweeps are recorded: the formalism's step of one body is traced once per kind of body, and compiled into a loop.

What `model.Tree` is for arrays, `LoopedTree` is for robots of more bodies than can be written out. Bodies are of one kind where their
joints are of one type and their constants have zeros and ones in the same places; all other constants become parameters. Of many kinds,
the rarest join others.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from ..arithmetic import Array
from ..dynamics.equations import Equations
from ..dynamics.views import Views
from ..engine.trace.graph import Graph
from ..engine.trace.recording import SUM, Entry, Forest, Param, objects
from ..engine.trace.sweeps import NodeRecords, Recorder
from ..model import Body, Field, Tree
from ..model.constants import constants, likeness, with_constants
from ..system.processes import cached_property

KINDS = 8  # of a tree: beyond, those that are most alike share a step, as each takes some hundredths of a second to compile


@dataclass(frozen=True, eq=False)
class LoopedTree(Tree):
    """The same bodies, visited by a recorder."""

    recorder: Recorder

    @classmethod
    def of(cls, tree: Tree, recorder: Recorder) -> "LoopedTree":
        """The looped form of a tree."""
        return cls(**{f.name: getattr(tree, f.name) for f in fields(Tree)}, recorder=recorder)

    @cached_property
    def _kinds(self) -> list["_Kind"]:
        return _kinds(self.bodies)

    @cached_property
    def _forest(self) -> int:
        kinds, parameters = np.zeros(len(self.bodies), dtype=np.int64), [np.zeros(0)] * len(self.bodies)
        for k, kind in enumerate(self._kinds):
            for i in kind.members:
                kinds[i], parameters[i] = k, constants(self.bodies[i])[kind.free]
        starts = {name: np.array([getattr(body, name).start for body in self.bodies]) for name in ("q", "v", "u")}
        parents = np.array([body.parent for body in self.bodies])
        return self.recorder.forest(Forest(kinds, parents, starts, parameters))

    def _body(self, kind: int, graph: Graph | None) -> Body:
        return self._kinds[kind].body(graph)

    def _same(self, value: Callable[[Body], list[Any]]) -> NodeRecords:
        """Records of places that each kind knows."""
        places = [value(kind.example) for kind in self._kinds]
        return NodeRecords(self.recorder, self._forest, places, [lambda xs: objects(xs)] * len(places))

    # --- sweeps ---

    def each(self, step: Callable[..., Any], *fields: Field) -> Field:
        return self.outward(lambda body, _, *records: ((), step(body, *records)), (), *fields)

    def outward(self, step: Callable[..., tuple[Any, Any]], root: Any, *fields: Field) -> Field:
        def at(kind: int, comes: Any, graph: Graph, *records: Any) -> tuple[Any, Any]:
            return step(self._body(kind, graph), comes, *records)

        return self.recorder.sweep(self._forest, at, fields, root=root)

    def inward(self, step: Callable[..., tuple[Any, Any]], *fields: Field) -> Field:
        def at(kind: int, comes: Any, graph: Graph, *records: Any) -> tuple[Any, Any]:
            return step(self._body(kind, graph), [] if comes is None else [comes], *records)

        return self.recorder.sweep(self._forest, at, fields, inward=True)

    def total(self, step: Callable[..., Any], *fields: Field) -> Any:
        def at(kind: int, graph: Graph, *records: Any) -> Any:
            return step(self._body(kind, graph), *records)

        return self.recorder.total(self._forest, at, fields)

    def unzip(self, records: Field, count: int) -> tuple[Field, ...]:
        return records.unzip(count)

    def split(self, x: Array, kind: str) -> Field:
        size = {"q": lambda body: body.joint.nq, "v": lambda body: body.joint.nv, "u": lambda body: body.joint.nv}[kind]
        found = self.recorder.vector(x)
        if found is None:
            return self._same(lambda body: [0.0] * size(body))
        region, start = found
        return self._same(lambda body: [Entry(region, kind, start + k) for k in range(size(body))])

    def everywhere(self, x: Array) -> Field:
        region, start = self.recorder.vector(x.reshape(1)) or (self.recorder.sparse(1, ()), 0)
        kinds = len(self._kinds)
        return NodeRecords(self.recorder, self._forest, [[Entry(region, None, start)]] * kinds, [lambda xs: xs[0]] * kinds)

    def on_bodies(self, values: Mapping[int, Array]) -> Field:
        if not values:
            return NodeRecords(self.recorder, self._forest, [[] for _ in self._kinds], [lambda xs: None] * len(self._kinds))
        entries = [(6 * i + k, x) for i, wrench in sorted(values.items()) for k, x in enumerate(wrench)]
        region = self.recorder.sparse(6 * len(self.bodies), entries)
        return self._same(lambda body: [Entry(region, self._column(6), k) for k in range(6)])

    def gathered(self, parts: Field) -> Array:
        column = self.recorder.column(self._forest, SUM, self.recorder.forests[self._forest].columns["v"]) if self.has_mimic else "v"
        return self.recorder.gathered(parts, column, self.nv)

    def coordinates(self, parts: Field) -> Array:
        return self.recorder.gathered(parts, "q", self.nq)

    def rows(self, parts: Field, bodies: Sequence[int], size: int) -> Array:
        return self.recorder.gathered(parts, self._column(size), size * len(self.bodies)).reshape(-1, size)[list(bodies)]

    def _column(self, size: int) -> str:
        """The column of offsets where every body has `size` entries."""
        return self.recorder.column(self._forest, f"row{size}", size * np.arange(len(self.bodies)))


class LoopedViews(Views):
    """A scene's equations on looped trees, recorded together."""

    def __init__(self, views: Views, recorder: Recorder) -> None:
        self._views, self._recorder = views, recorder
        self._looped: dict[Tree, Equations] = {}

    def opened_at(self, joints: Iterable[int]) -> Equations:
        equations = self._views.opened_at(joints)
        if equations.tree not in self._looped:
            self._looped[equations.tree] = replace(equations, tree=LoopedTree.of(equations.tree, self._recorder))
        return self._looped[equations.tree]

    @property
    def placed(self) -> Equations:
        return self.opened  # each link a body, and so a turn of the loop

    @property
    def opened(self) -> Equations:
        return self.opened_at(range(len(self._views.lumped.mechanism.joints)))


# --- kinds of bodies -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Kind:
    """Bodies that share a step: an example, who they are, and which of their constants are parameters."""

    example: Body
    members: Sequence[int]
    free: Array  # (n,) bool

    def body(self, graph: Graph | None) -> Body:
        """The example with its free constants as symbols."""
        if graph is None:
            return self.example
        values: list[Any] = constants(self.example).tolist()
        for k, place in enumerate(np.flatnonzero(self.free)):
            values[place] = graph.node("in", Param(k))
        return with_constants(self.example, values)


def _kinds(bodies: Sequence[Body]) -> list[_Kind]:
    numbers = [constants(body) for body in bodies]

    def kind(members: list[int]) -> _Kind:
        table = np.array([numbers[i] for i in members])
        return _Kind(bodies[members[0]], members, (table != table[0]).any(0) | ~_simple(table[0]))

    patterns: dict[Any, list[int]] = {}
    for i, (body, x) in enumerate(zip(bodies, numbers, strict=True)):
        patterns.setdefault((likeness(body), np.where(_simple(x), x + 0.0, np.inf).tobytes()), []).append(i)
    kinds = [kind(members) for members in patterns.values()]

    # The rarest joins the one of its joint type that it has most in common with: where the fewest constants become free that were not.
    while len(kinds) > KINDS:
        types = Counter(likeness(x.example) for x in kinds)
        if not (joinable := [x for x in kinds if types[likeness(x.example)] > 1]):
            break
        rare = min(joinable, key=lambda x: len(x.members))
        others = [x for x in joinable if x is not rare and likeness(x.example) == likeness(rare.example)]
        known = np.array([np.where(x.free, np.nan, numbers[x.members[0]]) for x in (rare, *others)])
        common, counts = (known[1:] == known[0]).sum(1), (~np.isnan(known)).sum(1)
        costs = len(rare.members) * (counts[0] - common) + np.array([len(x.members) for x in others]) * (counts[1:] - common)
        other = others[int(costs.argmin())]
        kinds = [x for x in kinds if x is not rare and x is not other] + [kind(sorted([*rare.members, *other.members]))]
    return kinds


def _simple(x: Array) -> Array:
    """Which numbers fold away when traced."""
    return np.isin(abs(x), (0.0, 1.0))
