"""Traced scalars and the graph they leave behind: hash-consed, folded, with nothing in it that the outputs do not need.

Functions written for NumPy arrays run once on arrays of `Scalar`; every operation becomes a node, the same operation on the
same operands only once. Zeros, ones and minus ones fold away, negations move outward until they meet an addition. The graph
knows nothing of what the numbers mean.
"""

import math
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from ...arithmetic.operations import FUNCTIONS, OPERATIONS, Operation
from ...arithmetic.symbols import Symbolic

Node = tuple[Any, ...]  # (operation, operand, …): operands are node numbers, of "const" a float, of "in" a name and an index, or a place

TRIGONOMETRIC = ("sin", "cos")
LEAVES = ("const", "in")
POWERS = 16  # whole exponents up to which a power is computed by multiplication


class Graph:
    """Nodes in the order of their creation, which is an order of evaluation."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._scalars: list[Scalar] = []
        self._known: dict[Node, Scalar] = {}
        self._constants: dict[float | str, Scalar] = {}

    def node(self, *key: Any) -> "Scalar":
        """The scalar of an operation; the one that is there already, if it is."""
        scalar = self._known.get(key)
        if scalar is None:
            scalar = self._known[key] = self._new(key)
        return scalar

    def _new(self, node: Node) -> "Scalar":
        scalar = Scalar(self, len(self.nodes), node)
        self.nodes.append(node)
        self._scalars.append(scalar)
        return scalar

    def constant(self, x: float) -> "Scalar":
        """The scalar of a number."""
        # −0.0 equals 0.0 as a key but is another number.
        key = "-0" if x == 0 and math.copysign(1, x) < 0 else x
        scalar = self._constants.get(key)
        if scalar is None:
            scalar = self._constants[key] = self._new(("const", x))
        return scalar

    def at(self, number: int) -> "Scalar":
        """The scalar of a node."""
        return self._scalars[number]

    def inputs(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """An array of the entries of an input vector."""
        entries = [self.node("in", name, k) for k in range(math.prod(shape))]
        return np.array([*entries, None], dtype=object)[:-1].reshape(shape)

    def lift(self, x: object) -> "Scalar":
        """A number as a scalar of this graph."""
        if x.__class__ is Scalar:
            return x  # type: ignore[return-value]
        if x.__class__ is float:
            return self.constant(x)  # type: ignore[arg-type]
        if isinstance(x, Condition):
            return x.select(1.0, 0.0)
        if isinstance(x, complex):
            raise TypeError(f"{x} is a complex number, and compiled numbers are real")
        return self.constant(float(x))  # type: ignore[arg-type]

    def condition(self, *key: Any) -> "Condition":
        """The condition of an operation, as `node`."""
        x = self.node(*key)
        return Condition(self, x.number, x.node)

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


class Traced(Symbolic):
    """What is not known yet: a node of a graph. NumPy's functions take it, as far as `arithmetic.symbols` goes."""

    __slots__ = ("graph", "node", "number")

    def __init__(self, graph: Graph, number: int, node: Node) -> None:
        self.graph, self.number, self.node = graph, number, node  # the operation and its operands

    def __float__(self) -> float:
        raise TypeError("a traced number has no value yet, and no array of floats can hold it: make room with np.zeros_like(q)")

    def __repr__(self) -> str:
        return f"<traced {self.node}>"


def _as_numbers(operation: Callable[[Any, Any], Any]) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Methods of a condition that compute with it as with a number: with the other operand behind it, and before it."""

    def forward(self: "Condition", other: object) -> Any:
        return NotImplemented if isinstance(other, np.ndarray) else operation(self.graph.lift(self), other)

    def backward(self: "Condition", other: object) -> Any:
        return NotImplemented if isinstance(other, np.ndarray) else operation(self.graph.lift(other), self.graph.lift(self))

    return forward, backward


class Condition(Traced):
    """A comparison of numbers that are not known yet, for `select` (np.where), & | ~ ^ == !=; in arithmetic 1 where it holds, else 0."""

    __slots__ = ()

    @property
    def constant(self) -> bool | None:
        """What holds, or does not, whatever the numbers; None for all others."""
        return self.node[0] == "true" if self.node[0] in ("true", "false") else None

    def _lift(self, x: object) -> "Condition":
        return x if isinstance(x, Condition) else self.graph.condition("true" if x else "false")

    def __and__(self, other: object) -> "Condition":
        if isinstance(other, np.ndarray):
            return NotImplemented
        y = self._lift(other)
        for a, b in ((self, y), (y, self)):
            if a.constant is not None:
                return b if a.constant else a
        return self if self.number == y.number else self.graph.condition("and", *sorted((self.number, y.number)))

    def __or__(self, other: object) -> "Condition":
        if isinstance(other, np.ndarray):
            return NotImplemented
        y = self._lift(other)
        for a, b in ((self, y), (y, self)):
            if a.constant is not None:
                return a if a.constant else b
        return self if self.number == y.number else self.graph.condition("or", *sorted((self.number, y.number)))

    def __invert__(self) -> "Condition":
        if self.constant is not None:
            return self._lift(not self.constant)
        return self.graph.condition(*self.graph.nodes[self.node[1]]) if self.node[0] == "not" else self.graph.condition("not", self.number)

    def __xor__(self, other: object) -> "Condition":
        if isinstance(other, np.ndarray):
            return NotImplemented
        y = self._lift(other)
        return (self & ~y) | (~self & y)

    __rand__, __ror__, __rxor__ = __and__, __or__, __xor__

    def __eq__(self, other: object) -> Any:  # type: ignore[override]
        if isinstance(other, (Condition, bool, np.bool_)):
            return ~(self ^ other)
        return NotImplemented if isinstance(other, np.ndarray) else self.graph.lift(self) == other

    def __ne__(self, other: object) -> Any:  # type: ignore[override]
        if isinstance(other, (Condition, bool, np.bool_)):
            return self ^ other
        return NotImplemented if isinstance(other, np.ndarray) else self.graph.lift(self) != other

    __hash__ = object.__hash__

    def select(self, yes: object, no: object) -> "Scalar":
        """`yes` where the condition holds, `no` elsewhere; what is not chosen may be NaN."""
        a, b = self.graph.lift(yes), self.graph.lift(no)
        if self.constant is not None:
            return a if self.constant else b
        if a.number == b.number:
            return a
        if self.node[0] == "not":
            return (~self).select(b, a)
        return self.graph.node("select", self.number, a.number, b.number)

    __add__, __radd__ = _as_numbers(operator.add)
    __sub__, __rsub__ = _as_numbers(operator.sub)
    __mul__, __rmul__ = _as_numbers(operator.mul)
    __truediv__, __rtruediv__ = _as_numbers(operator.truediv)
    __pow__, __rpow__ = _as_numbers(operator.pow)

    def __bool__(self) -> bool:
        if self.constant is not None:
            return self.constant
        raise TypeError(
            "a traced comparison has no truth value, as the numbers are not known before the kernel runs: choose with "
            "np.where(x > 0, a, b) and join conditions with & | ~; entries become an array that can be compared by np.stack([x, y]), "
            "not by np.array([x, y])"
        )


class Scalar(Traced):
    """A number that is not known yet. Behaves like a float under + − × ÷, comparisons and the functions of `arithmetic`."""

    __slots__ = ("constant",)

    def __init__(self, graph: Graph, number: int, node: Node) -> None:
        super().__init__(graph, number, node)
        self.constant: float | None = node[1] if node[0] == "const" else None  # its value, where it is known

    def _negated(self) -> "Scalar | None":
        """x where this is −x."""
        return self.graph.at(self.node[1]) if self.node[0] == "neg" else None

    # --- arithmetic, with what folds ---

    def __neg__(self) -> "Scalar":
        node, c = self.node, self.constant
        if c is not None:
            return self.graph.lift(-c)
        if node[0] == "neg":
            return self.graph.at(node[1])
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
        i, j = self.number, y.number
        return self.graph.node("add", i, j) if i < j else self.graph.node("add", j, i)

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
        if a is not None or b is not None:
            c, x = (a, y) if b is None else (b, self)
            if c == 0:
                return self.graph.constant(0.0)
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
        i, j = self.number, y.number
        return self.graph.node("mul", i, j) if i < j else self.graph.node("mul", j, i)

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

    def __pow__(self, other: object) -> "Scalar":
        if isinstance(other, np.ndarray):
            return NotImplemented  # the array asks for each entry
        y = self.graph.lift(other)
        a, n = self.constant, y.constant
        if a is not None and n is not None:
            with np.errstate(all="ignore"):
                return self.graph.lift(float(np.float64(a) ** np.float64(n)))
        if n == 0.5:
            return self._of_one(OPERATIONS["sqrt"])
        if n is None or n != round(n) or abs(n) > POWERS:
            return self.graph.node("pow", self.number, y.number)
        if n < 0:
            return 1.0 / self**-n
        result, square, n = self.graph.lift(1.0), self, int(n)
        while n:
            result, n = (result * square if n % 2 else result), n // 2
            square = square * square if n else square
        return result

    def __rpow__(self, other: object) -> "Scalar":
        return NotImplemented if isinstance(other, np.ndarray) else self.graph.lift(other) ** self

    # --- comparisons, false for NaN but for ≠ ---

    def _compare(self, op: str, other: object, *, swapped: bool = False) -> Condition:
        if isinstance(other, np.ndarray):
            return NotImplemented
        try:
            y = self.graph.lift(other)
        except (TypeError, ValueError):  # not a number
            return NotImplemented
        x, y = (y, self) if swapped else (self, y)
        a, b = x.constant, y.constant
        if a is not None and b is not None:
            return self.graph.condition("true" if {"lt": a < b, "le": a <= b, "eq": a == b}[op] else "false")
        if op == "lt" and x.number == y.number:
            return self.graph.condition("false")
        return self.graph.condition(op, *(sorted((x.number, y.number)) if op == "eq" else (x.number, y.number)))

    def __lt__(self, other: object) -> Condition:
        return self._compare("lt", other)

    def __le__(self, other: object) -> Condition:
        return self._compare("le", other)

    def __gt__(self, other: object) -> Condition:
        return self._compare("lt", other, swapped=True)

    def __ge__(self, other: object) -> Condition:
        return self._compare("le", other, swapped=True)

    def __eq__(self, other: object) -> Condition:  # type: ignore[override]
        return self._compare("eq", other)

    def __ne__(self, other: object) -> Condition:  # type: ignore[override]
        equal = self._compare("eq", other)
        return equal if equal is NotImplemented else ~equal

    __hash__ = object.__hash__  # nodes are found by their numbers, never by comparing scalars

    # --- functions, by the names that NumPy gives them ---

    def _of_one(self, op: Operation) -> "Scalar":
        c = self.constant
        if c is not None:
            return self.graph.lift(float(op.on_floats(c)))  # type: ignore[misc]
        x = self._negated()
        if x is not None and op.odd:
            return -x._of_one(op)
        if x is not None and op.even:
            return x._of_one(op)
        return self.graph.node(op.name, self.number)

    def _of_two(self, op: Operation, other: object) -> "Scalar":
        y = self.graph.lift(other)
        a, b = self.constant, y.constant
        if a is not None and b is not None:
            return self.graph.lift(float(op.on_floats(a, b)))  # type: ignore[misc]
        if op.idempotent and self.number == y.number:
            return self
        operands = self.number, y.number
        return self.graph.node(op.name, *(sorted(operands) if op.commutative else operands))

    def sign(self) -> "Scalar":
        """−1, 0 or 1; NaN for NaN, as np.sign."""
        return (self > 0.0).select(1.0, (self < 0.0).select(-1.0, (self == 0.0).select(0.0, self)))

    def __mod__(self, other: object) -> "Scalar":
        """x − ⌊x/y⌋ y without rounding, of the sign of y, as np.remainder."""
        if isinstance(other, np.ndarray):
            return NotImplemented
        y = self.graph.lift(other)
        rest, beyond = self._divided(y)
        return (rest == 0.0).select(0.0, beyond.select(rest + y, rest))

    def __rmod__(self, other: object) -> "Scalar":
        return NotImplemented if isinstance(other, np.ndarray) else self.graph.lift(other) % self

    def __floordiv__(self, other: object) -> "Scalar":
        """⌊x/y⌋, where rounding of x/y does not make it another, as np.floor_divide."""
        if isinstance(other, np.ndarray):
            return NotImplemented
        y = self.graph.lift(other)
        rest, beyond = self._divided(y)
        whole = ((self - rest) / y)._of_one(OPERATIONS["rint"])
        return (y == 0.0).select(self / y, beyond.select(whole - 1.0, whole))

    def _divided(self, y: "Scalar") -> tuple["Scalar", Condition]:
        """What division by y towards zero leaves, and whether the whole number below is another, as the signs differ."""
        rest = self._of_two(OPERATIONS["fmod"], y)
        return rest, (rest < 0.0) & (y > 0.0) | (rest > 0.0) & (y < 0.0)

    def __rfloordiv__(self, other: object) -> "Scalar":
        return NotImplemented if isinstance(other, np.ndarray) else self.graph.lift(other) // self

    def __abs__(self) -> "Scalar":
        return self._of_one(OPERATIONS["abs"])

    def __bool__(self) -> bool:
        raise TypeError("a traced number has no truth value: which way a branch goes is not known before the kernel runs")


def _method(op: Operation) -> Callable[..., Scalar]:
    """The method of traced scalars that NumPy and `arithmetic` call for a function."""

    def of_one(self: Scalar) -> Scalar:
        return self._of_one(op)

    def of_two(self: Scalar, other: object) -> Scalar:
        return self._of_two(op, other)

    method = of_one if op.arity == 1 else of_two
    method.__name__, method.__qualname__, method.__doc__ = op.called, f"Scalar.{op.called}", op.meaning
    return method


for _op in FUNCTIONS:
    setattr(Scalar, _op.called, _method(_op))


def scalars(outputs: Sequence[object], graph: Graph) -> list[Scalar]:
    """The entries of output arrays as scalars of the graph, constants lifted."""
    return [graph.lift(x) for x in outputs]
