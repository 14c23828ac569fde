"""Traced scalars and the graph they leave behind: hash-consed, folded, with nothing in it that the outputs do not need.

Functions written for NumPy arrays run once on arrays of `Scalar`; every operation becomes a node, the same operation on the
same operands only once. Zeros, ones and minus ones fold away, negations move outward until they meet an addition. The graph
knows nothing of what the numbers mean.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

Node = tuple[Any, ...]  # (operation, operand, …): operands are node numbers, of "const" a float, of "in" a name and an index

UNARY = ("sqrt", "sin", "cos", "exp", "log", "tanh", "abs")
TRIGONOMETRIC = ("sin", "cos")
COMMUTATIVE = ("add", "mul", "min", "max")
LEAVES = ("const", "in")


class Graph:
    """Nodes in the order of their creation, which is an order of evaluation."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._numbers: dict[Node, int] = {}

    def node(self, *key: Any) -> "Scalar":
        """The scalar of an operation; the one that is there already, if it is."""
        # −0.0 equals 0.0 as a key but is another number.
        key = ("const", 0.0, "-") if key[0] == "const" and key[1] == 0 and math.copysign(1, key[1]) < 0 else key
        if key not in self._numbers:
            self._numbers[key] = len(self.nodes)
            self.nodes.append(key[:2] if key[-1] == "-" else key)
        return Scalar(self, self._numbers[key])

    def inputs(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """An array of the entries of an input vector."""
        entries = [self.node("in", name, k) for k in range(math.prod(shape))]
        return np.array([*entries, None], dtype=object)[:-1].reshape(shape)

    def lift(self, x: object) -> "Scalar":
        """A number as a scalar of this graph."""
        if isinstance(x, Scalar):
            return x
        return self.node("const", float(x))  # type: ignore[arg-type]

    def live(self, outputs: Iterable["Scalar"]) -> list[int]:
        """The nodes that the outputs need, in order of evaluation."""
        found: set[int] = set()
        todo = [x.number for x in outputs]
        while todo:
            i = todo.pop()
            if i not in found:
                found.add(i)
                op, *operands = self.nodes[i]
                if op not in LEAVES:
                    todo.extend(operands)
        return sorted(found)


class Scalar:
    """A number that is not known yet. Behaves like a float under + − × ÷ and the functions of `arithmetic`."""

    __slots__ = ("graph", "number")

    def __init__(self, graph: Graph, number: int) -> None:
        self.graph, self.number = graph, number

    # --- what is known ---

    @property
    def node(self) -> Node:
        """The operation and its operands."""
        return self.graph.nodes[self.number]

    @property
    def constant(self) -> float | None:
        """The value of a constant; None for all others."""
        node = self.node
        return node[1] if node[0] == "const" else None

    def _negated(self) -> "Scalar | None":
        """x where this is −x."""
        node = self.node
        return Scalar(self.graph, node[1]) if node[0] == "neg" else None

    # --- arithmetic, with what folds ---

    def __neg__(self) -> "Scalar":
        node, c = self.node, self.constant
        if c is not None:
            return self.graph.lift(-c)
        if node[0] == "neg":
            return Scalar(self.graph, node[1])
        if node[0] == "sub":  # −(a − b) = b − a
            return self.graph.node("sub", node[2], node[1])
        return self.graph.node("neg", self.number)

    def __add__(self, other: object) -> "Scalar":
        if isinstance(other, np.ndarray):
            return NotImplemented  # the array asks for each entry
        y = self.graph.lift(other)
        a, b = self.constant, y.constant
        if a is not None and b is not None:
            return self.graph.lift(a + b)
        if a == 0:
            return y
        if b == 0:
            return self
        if (z := y._negated()) is not None:
            return self - z
        if (z := self._negated()) is not None:
            return y - z
        return self.graph.node("add", *sorted((self.number, y.number)))

    def __sub__(self, other: object) -> "Scalar":
        if isinstance(other, np.ndarray):
            return NotImplemented  # the array asks for each entry
        y = self.graph.lift(other)
        a, b = self.constant, y.constant
        if a is not None and b is not None:
            return self.graph.lift(a - b)
        if b == 0:
            return self
        if a == 0:
            return -y
        if self.number == y.number:
            return self.graph.lift(0.0)
        if (z := y._negated()) is not None:
            return self + z
        if (z := self._negated()) is not None:
            return -(z + y)
        return self.graph.node("sub", self.number, y.number)

    def __mul__(self, other: object) -> "Scalar":
        if isinstance(other, np.ndarray):
            return NotImplemented  # the array asks for each entry
        y = self.graph.lift(other)
        a, b = self.constant, y.constant
        if a is not None and b is not None:
            return self.graph.lift(a * b)
        for c, x in ((a, y), (b, self)):
            if c == 0:
                return self.graph.lift(0.0)
            if c == 1:
                return x
            if c == -1:
                return -x
        if (z := self._negated()) is not None:
            return -(z * y)
        if (z := y._negated()) is not None:
            return -(self * z)
        # A constant's sign moves out, so that c·x and −c·x are one product.
        if a is not None and a < 0:
            return -(self.graph.lift(-a) * y)
        if b is not None and b < 0:
            return -(self * self.graph.lift(-b))
        return self.graph.node("mul", *sorted((self.number, y.number)))

    def __truediv__(self, other: object) -> "Scalar":
        if isinstance(other, np.ndarray):
            return NotImplemented  # the array asks for each entry
        y = self.graph.lift(other)
        a, b = self.constant, y.constant
        if a is not None and b:
            return self.graph.lift(a / b)
        if b == 1:
            return self
        if a == 0:
            return self.graph.lift(0.0)
        if (z := self._negated()) is not None:
            return -(z / y)
        if (z := y._negated()) is not None:
            return -(self / z)
        return self.graph.node("div", self.number, y.number)

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other: object) -> "Scalar":
        return NotImplemented if isinstance(other, np.ndarray) else self.graph.lift(other) - self

    def __rtruediv__(self, other: object) -> "Scalar":
        return NotImplemented if isinstance(other, np.ndarray) else self.graph.lift(other) / self

    def __pow__(self, n: object) -> "Scalar":
        if n == 2:
            return self * self
        raise TypeError(f"a traced number can be squared, not raised to {n!r}: write it with exp and log")

    # --- functions ---

    def _function(self, name: str) -> "Scalar":
        c = self.constant
        if c is not None:
            return self.graph.lift(float(getattr(np, name)(c)))
        x = self._negated()
        if x is not None and name in ("sin", "tanh"):
            return -x._function(name)
        if x is not None and name in ("cos", "abs"):
            return x._function(name)
        return self.graph.node(name, self.number)

    def sin(self) -> "Scalar":
        """sin x."""
        return self._function("sin")

    def cos(self) -> "Scalar":
        """cos x."""
        return self._function("cos")

    def sqrt(self) -> "Scalar":
        """√x."""
        return self._function("sqrt")

    def exp(self) -> "Scalar":
        """eˣ."""
        return self._function("exp")

    def log(self) -> "Scalar":
        """The natural logarithm."""
        return self._function("log")

    def tanh(self) -> "Scalar":
        """tanh x."""
        return self._function("tanh")

    def __abs__(self) -> "Scalar":
        return self._function("abs")

    def __bool__(self) -> bool:
        raise TypeError("a traced number has no truth value: which way a branch goes is not known before the kernel runs")

    def __repr__(self) -> str:
        return f"<traced {self.node}>"


def scalars(outputs: Sequence[object], graph: Graph) -> list[Scalar]:
    """The entries of output arrays as scalars of the graph, constants lifted."""
    return [graph.lift(x) for x in outputs]
