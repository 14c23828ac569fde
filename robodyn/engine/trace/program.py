"""A graph made ready for a machine: live nodes in order, multiply-adds fused, and the places of inputs and outputs.

The fusing is decided here, once, and not left to LLVM: scalar code, SIMD code of any width and every machine with an FMA
unit then round alike, so a result does not depend on the batch it was computed in.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arithmetic.operations import OPERATIONS
from .graph import LEAVES, TRIGONOMETRIC, Graph, Scalar

Instruction = tuple[Any, ...]  # (operation, operand, …), as in a graph; "fma" a·b + c, "fms" a·b − c, "fnma" c − a·b

NEAR = 256  # values that the first-level cache has room for beside all else: vectors of 64 bytes in 32 KB
FAR = 4  # operations in the time that a value from farther away takes


@dataclass(frozen=True, eq=False)
class Program:
    """Straight-line code: value i is what instruction i computes."""

    instructions: tuple[Instruction, ...]
    inputs: dict[str, int]  # name → length
    outputs: dict[str, tuple[int, ...]]  # name → values
    guards: tuple[int, ...]  # values that must be positive for the outputs to be trusted

    @property
    def programs(self) -> "tuple[Program, ...]":
        """The straight-line programs in it: itself."""
        return (self,)

    @property
    def tables(self) -> dict[str, np.ndarray]:
        """What the code reads beside its arguments: nothing."""
        return {}

    @property
    def length(self) -> int:
        """Instructions of one evaluation."""
        return len(self.instructions)

    @property
    def operations(self) -> int:
        """Floating-point operations of one evaluation, a fused multiply-add counted as two, functions not at all."""
        return sum(OPERATIONS[op].flops for op, *_ in self.instructions if op not in LEAVES)

    @property
    def telling(self) -> set[int]:
        """Values that need no test for finiteness: where one is not finite, an output or a guard is not either, and shows it."""
        told: set[int] = set()
        shown = {i for values in (*self.outputs.values(), self.guards) for i in values}
        for i in reversed(range(len(self.instructions))):
            op, *operands = self.instructions[i]
            if (i in shown or i in told) and op not in LEAVES:
                told.update(operands[: OPERATIONS[op].passed_on])
        return told

    @property
    def cost(self) -> int:
        """The time of one evaluation, in operations: those, and FAR for each use of a value that NEAR others have been used since."""
        last = {j: i for i, (op, *operands) in enumerate(self.instructions) if op not in LEAVES for j in operands}
        near: dict[int, None] = {}  # the latest used last
        far = 0
        for i, (op, *operands) in enumerate(self.instructions):
            if op in LEAVES:
                continue
            for j in {j for j in operands if self.instructions[j][0] not in LEAVES}:
                far += j not in near
                near.pop(j, None)
                if last[j] > i:
                    near[j] = None
            if i in last:
                near[i] = None
            while len(near) > NEAR:
                del near[next(iter(near))]
        return self.operations + FAR * far


def program(
    graph: Graph, inputs: Mapping[str, int], outputs: Mapping[str, np.ndarray], guards: Any = (), optional: Sequence[str] = ()
) -> Program:
    """The program that computes arrays of scalars of a graph; `guards` are scalars that must turn out positive.

    optional: inputs that the program does not take where it does not need them.
    """
    scalars = {name: [graph.lift(x) for x in np.ravel(array)] for name, array in outputs.items()}
    checks = [graph.lift(x) for x in guards]
    wanted = [x for xs in scalars.values() for x in xs] + checks
    live = graph.live(wanted)
    fused, absorbed = _fused(graph, live, wanted)

    numbers: dict[int, int] = {}
    code: list[Instruction] = []
    for i in _ordered(graph, live, wanted):
        if i in absorbed:
            continue
        op, *operands = fused.get(i, graph.nodes[i])
        numbers[i] = len(code)
        code.append((op, *(operands if op in LEAVES else (numbers[j] for j in operands))))
    places = {name: tuple(numbers[x.number] for x in xs) for name, xs in scalars.items()}
    needed = {operands[0] for op, *operands in code if op == "in"}
    taken = {name: size for name, size in inputs.items() if name in needed or name not in optional}
    return Program(tuple(code), taken, places, tuple(numbers[x.number] for x in checks))


def _ordered(graph: Graph, live: list[int], wanted: list[Scalar]) -> list[int]:
    """An order of evaluation for machines: sines and cosines first, in runs, then depth first, so that few values wait at a time."""
    nodes = graph.nodes
    depth, level = {}, {}  # the longest way to a node, in operations and in sines and cosines
    for i in live:
        op, *operands = nodes[i]
        below = () if op in LEAVES else operands
        depth[i] = 1 + max((depth[j] for j in below), default=0)
        level[i] = (op in TRIGONOMETRIC) + max((level[j] for j in below), default=0)

    order: dict[int, None] = {}

    def add(i: int) -> None:
        todo = [i]
        while todo:
            i = todo[-1]
            below = () if i in order or nodes[i][0] in LEAVES else nodes[i][1:]
            missing = [j for j in below if j not in order]
            if missing:
                todo += sorted(missing, key=lambda j: depth[j])  # the deepest first
            else:
                order[todo.pop()] = None

    for k in range(1, max(level.values(), default=0) + 1):
        run = [i for i in live if nodes[i][0] in TRIGONOMETRIC and level[i] == k]
        for i in run:
            add(nodes[i][1])
        order |= dict.fromkeys(run)
    for x in wanted:
        add(x.number)
    return list(order)


def _fused(graph: Graph, live: list[int], wanted: list[Scalar]) -> tuple[dict[int, Instruction], set[int]]:
    """Sums that absorb a product, and the products that vanish: those whose every use can absorb them."""
    nodes, uses = graph.nodes, {i: [] for i in live}
    for i in live:
        if nodes[i][0] not in LEAVES:
            for j in nodes[i][1:]:
                uses[j].append(i)
    kept = {x.number for x in wanted}

    fused: dict[int, Instruction] = {}
    absorbed: set[int] = set()
    for i in live:
        op = nodes[i][0]
        # A sum of the product with itself needs it as a value.
        sums = [k for k in uses[i] if nodes[k][0] in ("add", "sub") and k not in fused and nodes[k][1] != nodes[k][2]]
        if op != "mul" or i in kept or not uses[i] or len(sums) < len(uses[i]):
            continue
        a, b = nodes[i][1:]
        for k in sums:
            left, x, y = nodes[k]
            other = y if x == i else x
            if left == "add":
                fused[k] = ("fma", a, b, other)
            else:
                fused[k] = ("fms", a, b, y) if x == i else ("fnma", a, b, x)
        absorbed.add(i)
    return fused, absorbed
