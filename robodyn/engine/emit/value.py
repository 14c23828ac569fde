"""Values in LLVM IR: a notation in which functions read like their formulas."""

from collections.abc import Sequence

from .code import Code, Name
from .types import Type

ONE = Type(1)  # a double; its integers are i64
COMPARED = {"lt": ("olt", "slt"), "le": ("ole", "sle"), "gt": ("ogt", "sgt"), "ge": ("oge", "sge"), "eq": ("oeq", "eq")}


class Value:
    """A value in a function being written: operators append instructions.

    kind: "float", "int" or "bool", in every lane of a type; or LLVM's name of what has no lanes, such as "ptr" or "i256".
    """

    __slots__ = ("code", "kind", "name", "t")

    def __init__(self, code: Code, t: Type, kind: str, name: str) -> None:
        self.code, self.t, self.kind, self.name = code, t, kind, name

    def __str__(self) -> str:
        return self.name

    @property
    def type(self) -> str:
        """The LLVM type."""
        return self.t.of_kind(self.kind)

    def new(self, text: str, kind: str = "", t: Type | None = None) -> "Value":
        """The value of an instruction, of this kind and type if none is given."""
        return Value(self.code, t or self.t, kind or self.kind, self.code.value(text))

    def named(self, name: str) -> "Value":
        """Another value of this kind, by its name."""
        return Value(self.code, self.t, self.kind, name)

    def like(self, x: "Value | float") -> "Value":
        """A constant of this kind."""
        return x if isinstance(x, Value) else constant(self.code, self.t, x, self.kind)

    def binary(self, op: str, x: "Value | float", kind: str = "") -> "Value":
        """An instruction of two operands."""
        return self.new(f"{op} {self.type} {self.name}, {self.like(x).name}", kind)

    def _arithmetic(self, op: str, x: "Value | float") -> "Value":
        return self.binary(f"f{op}" if self.kind == "float" else op, x)

    def __add__(self, x: "Value | float") -> "Value":
        return self._arithmetic("add", x)

    def __radd__(self, x: float) -> "Value":
        return self + x

    def __sub__(self, x: "Value | float") -> "Value":
        return self._arithmetic("sub", x)

    def __rsub__(self, x: float) -> "Value":
        return self.like(x) - self

    def __mul__(self, x: "Value | float") -> "Value":
        return self._arithmetic("mul", x)

    def __rmul__(self, x: float) -> "Value":
        return self * x

    def __truediv__(self, x: "Value | float") -> "Value":
        return self.binary("fdiv", x)

    def __rtruediv__(self, x: float) -> "Value":
        return self.like(x) / self

    def __neg__(self) -> "Value":
        return self.new(f"fneg {self.type} {self.name}") if self.kind == "float" else 0 - self

    def __and__(self, x: "Value | int") -> "Value":
        return self.binary("and", x)

    def __or__(self, x: "Value | int") -> "Value":
        return self.binary("or", x)

    def __xor__(self, x: "Value | int") -> "Value":
        return self.binary("xor", x)

    def __invert__(self) -> "Value":
        return self ^ (1 if self.kind == "bool" else -1)

    def __lshift__(self, x: "Value | int") -> "Value":
        return self.binary("shl", x)

    def __rshift__(self, x: "Value | int") -> "Value":
        return self.binary("ashr", x)

    # --- comparisons ---

    def compare(self, how: str, x: "Value | float") -> "Value":
        """A comparison by its name in LLVM: "olt", "uno", … of floats ("o…": false for NaN), "slt", "ult", … of integers."""
        return self.binary(f"{'fcmp' if self.kind == 'float' else 'icmp'} {how}", x, "bool")

    def _compare(self, how: str, x: "Value | float") -> "Value":
        return self.compare(COMPARED[how][self.kind != "float"], x)

    def __lt__(self, x: "Value | float") -> "Value":
        return self._compare("lt", x)

    def __le__(self, x: "Value | float") -> "Value":
        return self._compare("le", x)

    def __gt__(self, x: "Value | float") -> "Value":
        return self._compare("gt", x)

    def __ge__(self, x: "Value | float") -> "Value":
        return self._compare("ge", x)

    def equals(self, x: "Value | float") -> "Value":
        """Whether both are the same; NaN equals nothing."""
        return self._compare("eq", x)

    # --- functions ---

    def intrinsic(self, name: str, *others: "Value | float") -> "Value":
        """An intrinsic function of this value and others."""
        values = ", ".join(f"{self.type} {self.like(x).name}" for x in (self, *others))
        return self.new(f"call {self.type} @llvm.{name}.{self.t.name}({values})")

    def __abs__(self) -> "Value":
        return self.intrinsic("fabs")

    def smaller(self, x: "Value | float") -> "Value":
        """The smaller of both; of a number and NaN the number."""
        return self.intrinsic("minnum", x)

    def larger(self, x: "Value | float") -> "Value":
        """The larger of both; of a number and NaN the number."""
        return self.intrinsic("maxnum", x)

    # --- other types ---

    def cast(self, how: str, kind: str, t: Type | None = None) -> "Value":
        """A conversion by its name in LLVM."""
        return self.new(f"{how} {self.type} {self.name} to {(t or self.t).of_kind(kind)}", kind, t)

    @property
    def bits(self) -> "Value":
        """The bits of a number, as an integer."""
        return self.cast("bitcast", "int")

    @property
    def number(self) -> "Value":
        """The number that an integer holds the bits of."""
        return self.cast("bitcast", "float")

    def widened(self) -> "Value":
        """The number in double precision."""
        return self if self.t.bits == 64 else self.cast("fpext", "float", self.t.widened())

    def rounded(self, t: Type) -> "Value":
        """The number, or the integer, in the precision of another type with as many lanes."""
        return self if t.bits == self.t.bits else self.cast("fptrunc" if self.kind == "float" else "trunc", self.kind, t)

    # --- lanes ---

    def lane(self, i: int) -> "Value":
        """The scalar in one lane."""
        if self.t.lanes == 1:
            return self
        return self.new(f"extractelement {self.type} {self.name}, i32 {i}", t=Type(1, self.t.scalar))

    def with_lane(self, i: int, x: "Value") -> "Value":
        """The same with another scalar in one lane."""
        return x if self.t.lanes == 1 else self.new(f"insertelement {self.type} {self.name}, {x.type} {x.name}, i32 {i}")

    def splat(self, t: Type) -> "Value":
        """This scalar in every lane."""
        if t.lanes == 1:
            return self
        one = undefined(self.code, t, self.kind).with_lane(0, self)
        return one.new(f"shufflevector {one.type} {one.name}, {one.type} undef, <{t.lanes} x i32> zeroinitializer")

    @property
    def everywhere(self) -> "Value":
        """i1: the condition holds in all lanes."""
        return self if self.t.lanes == 1 else self._packed().equals(-1)

    @property
    def anywhere(self) -> "Value":
        """i1: the condition holds in some lane."""
        return self if self.t.lanes == 1 else self._packed().compare("ne", 0)

    def _packed(self) -> "Value":
        packed = self.cast("bitcast", f"i{self.t.lanes}")
        return Value(self.code, ONE, packed.kind, packed.name)


def constant(code: Code, t: Type, x: float, kind: str = "float") -> Value:
    """A number in every lane, an integer or a truth value."""
    texts = {"float": t.constant, "int": t.integer, "bool": lambda b: t.splat("i1", str(int(b)))}
    return Value(code, t, kind, texts.get(kind, str)(x))  # type: ignore[operator]


def undefined(code: Code, t: Type, kind: str = "float") -> Value:
    """What is still to be filled lane by lane."""
    return Value(code, t, kind, "undef")


def fma(a: Value, b: Value | float, c: Value | float) -> Value:
    """a·b + c, rounded once."""
    return a.intrinsic("fma", b, c)


def select(condition: Value, a: Value | float, b: Value | float) -> Value:
    """a where the condition holds, b elsewhere."""
    known = a if isinstance(a, Value) else b
    assert isinstance(known, Value)
    a, b = known.like(a), known.like(b)
    return known.new(f"select {condition.type} {condition.name}, {known.type} {a.name}, {known.type} {b.name}")


def polynomial(x: Value, coefficients: Sequence[float]) -> Value:
    """Σ c_i xⁱ by Horner's rule."""
    value = x.like(coefficients[-1])
    for c in coefficients[-2::-1]:
        value = fma(value, x, c)
    return value


class Variable:
    """A value that changes."""

    __slots__ = ("_first", "_place")

    def __init__(self, first: Value) -> None:
        """Set to its first value here."""
        self._first, self._place = first, first.code.variable(first.type, first)

    @property
    def value(self) -> Value:
        """What it is now."""
        return self._first.named(self._first.code.get(self._first.type, self._place))

    @value.setter
    def value(self, x: Value | float) -> None:
        self._first.code.set(self._first.type, self._place, self._first.like(x))


class Memory:
    """An array of values of one type, at an address; indices may be values."""

    __slots__ = ("base", "code", "kind", "t")

    def __init__(self, code: Code, t: Type, base: Name, kind: str = "float") -> None:
        self.code, self.t, self.base, self.kind = code, t, str(base), kind

    def at(self, i: Name) -> str:
        """The address of an entry."""
        return self.code.at(self._like.type, self.base, i)

    def behind(self, i: Name) -> "Memory":
        """The array from an entry on."""
        return Memory(self.code, self.t, self.at(i), self.kind)

    @property
    def first(self) -> Value:
        """The value at the address itself."""
        return self._like.named(self.code.get(self._like.type, self.base))

    @first.setter
    def first(self, x: Value | float) -> None:
        self.code.set(self._like.type, self.base, self._like.like(x))

    def __getitem__(self, i: Name) -> Value:
        return self._like.named(self.code.get(self._like.type, self.at(i)))

    def __setitem__(self, i: Name, x: Value | float) -> None:
        self.code.set(self._like.type, self.at(i), self._like.like(x))

    @property
    def _like(self) -> Value:
        return Value(self.code, self.t, self.kind, "")


# --- functions of several results ------------------------------------------------------------------------------------------


def call(name: str, kinds: Sequence[str], *arguments: Value) -> list[Value]:
    """The results, of these kinds and the first argument's type, of a function."""
    first = arguments[0]
    result = struct([first.t.of_kind(kind) for kind in kinds])
    passed = ", ".join(f"{x.type} {x.name}" for x in arguments)
    together = first.code.value(f"call {result} @{name}({passed})")
    return [first.new(f"extractvalue {result} {together}, {j}", kind) for j, kind in enumerate(kinds)]


def give(values: Sequence[Value]) -> None:
    """Return several values."""
    code, kind, last = values[0].code, struct([x.type for x in values]), "undef"
    for j, x in enumerate(values):
        last = code.value(f"insertvalue {kind} {last}, {x.type} {x.name}, {j}")
    code.leave(kind, last)


def struct(types: Sequence[str]) -> str:
    """The type of several values together."""
    return "{" + ", ".join(types) + "}"
