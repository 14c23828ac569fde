"""Expressions that are alike: the same operations on other numbers, worth a loop where there are many."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ...arithmetic.operations import OPERATIONS
from .graph import LEAVES, Graph, Node, Scalar
from .recording import OfNode

MANY, LONG = 32, 64  # expressions alike that are worth a loop; nodes of one that is looked at

Steps = tuple[tuple[Any, ...], ...]  # operations in order; operands are earlier steps; of "in" the region, of "const" nothing


class Pattern(NamedTuple):
    """An expression taken apart: its steps, and the numbers that tell it from others with the same steps."""

    steps: Steps
    places: tuple[int, ...]  # entries of the regions that its "in" read
    constants: tuple[float, ...]
    nodes: tuple[int, ...]  # of the graph: one per step


class Alike:
    """Looks at expressions of a graph; `computed`: those that are entries of a region by now, a region's name and k."""

    def __init__(self, graph: Graph, computed: Mapping[int, tuple[str, int]]) -> None:
        self._graph, self._computed = graph, computed

    def sort(self, entries: list[tuple[int, Scalar]]):
        """Entries alike, terms of long sums alike; the other entries, the other terms."""
        whole, rest = self._alike(entries)
        sums = ((k, self._terms(x)) for k, x in rest)
        # One term of each sum after the other: an addition need not wait for the one before.
        split = sorted(((n, k, x) for k, terms in sums if len(terms) >= MANY for n, x in enumerate(terms)), key=lambda term: term[0])
        terms, straight = self._alike((k, x) for _, k, x in split)
        return whole, terms, rest, straight

    def _alike(self, entries: Iterable[tuple[int, Scalar]]) -> tuple[dict[Steps, list[tuple[int, Pattern]]], list[tuple[int, Scalar]]]:
        """Entries by their pattern's steps where at least `MANY` share them, and the others."""
        groups: dict[Any, list[tuple[int, Scalar, Pattern]]] = {}
        rest = []
        for k, x in entries:
            if (pattern := self._pattern(x)) is None:
                rest.append((k, x))
            else:
                groups.setdefault(pattern.steps, []).append((k, x, pattern))
        rest += [(k, x) for found in groups.values() if len(found) < MANY for k, x, _ in found]
        return {steps: [(k, pattern) for k, _, pattern in found] for steps, found in groups.items() if len(found) >= MANY}, rest

    def _pattern(self, x: Scalar) -> Pattern | None:
        """The expression with its numbers left out; None where it is long, or of numbers that live at a node."""
        found: dict[int, int] = {}
        steps, places, constants, todo = [], [], [], [x.number]
        while todo:
            i = todo[-1]
            node: Node = ("in", *self._computed[i]) if i in self._computed else self._graph.nodes[i]
            op, *rest = node
            if op not in LEAVES and OPERATIONS[op].commutative:  # a constant may be older than what it meets, or younger
                rest.sort(key=lambda j: self._graph.nodes[j][0] == "const")
            missing = [j for j in rest if j not in found] if op not in LEAVES else []
            if i in found or not missing:
                todo.pop()
            if i in found:
                continue
            if len(found) + len(todo) + len(missing) > LONG or (op == "in" and isinstance(rest[0], OfNode)):
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
        return Pattern(tuple(steps), tuple(places), tuple(constants), tuple(found))

    def shared(self, found: list[tuple[int, Pattern]]) -> set[int]:
        """The largest expressions that are one and the same node in all of these."""
        steps, nodes = found[0][1].steps, np.array([x.nodes for _, x in found])
        same = [
            op not in LEAVES and not OPERATIONS[op].condition and bool((nodes[:, n] == nodes[0, n]).all())
            for n, (op, *_) in enumerate(steps)
        ]
        used = {len(steps) - 1, *(j for n, (op, *operands) in enumerate(steps) if op not in LEAVES and not same[n] for j in operands)}
        return {int(nodes[0, n]) for n in used if same[n]}

    def _terms(self, x: Scalar) -> list[Scalar]:
        """The terms of a sum, as far as its partial sums are needed for nothing else in it."""
        nodes = self._graph.nodes
        uses = Counter(j for i in self._graph.live([x]) if nodes[i][0] not in LEAVES for j in nodes[i][1:])
        terms, todo = [], [(x.number, False)]
        while todo:
            i, negative = todo.pop()
            op, *operands = nodes[i]
            if op not in ("add", "sub", "neg") or uses[i] > 1 or i in self._computed:
                terms.append(-self._graph.at(i) if negative else self._graph.at(i))
                continue
            signs = [negative != (op == "neg" or (op == "sub" and n == 1)) for n in range(len(operands))]
            todo += reversed([*zip(operands, signs, strict=True)])
        return terms
