"""A small assembler for LLVM IR: variables, loops and branches for the code around a program."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from .trigonometry import Type

Condition = Callable[[], str]


class Code:
    """The body of one function. Values are names; variables live in memory, from where LLVM lifts them into registers."""

    def __init__(self) -> None:
        self.allocations: list[str] = []
        self.lines: list[str] = []
        self._count = 0

    def name(self) -> str:
        """A fresh name."""
        self._count += 1
        return f"%x{self._count}"

    def add(self, text: str) -> None:
        """A line without a result."""
        self.lines.append("  " + text)

    def value(self, text: str) -> str:
        """A line with a result; its name."""
        name = self.name()
        self.lines.append(f"  {name} = {text}")
        return name

    def variable(self, kind: str, first: str) -> str:
        """A variable of an LLVM type, set to its first value here."""
        name = self.name()
        self.allocations.append(f"  {name} = alloca {kind}")
        self.set(kind, name, first)
        return name

    def get(self, kind: str, variable: str) -> str:
        """The value of a variable, or at an address."""
        return self.value(f"load {kind}, ptr {variable}{_aligned(kind)}")

    def set(self, kind: str, variable: str, value: str) -> None:
        """Give a variable, or an address, a value."""
        self.add(f"store {kind} {value}, ptr {variable}{_aligned(kind)}")

    def at(self, kind: str, base: str, index: str | int) -> str:
        """The address of an entry of an array."""
        return self.value(f"getelementptr {kind}, ptr {base}, i64 {index}")

    # --- floating point ---

    def fma(self, t: Type, a: str, b: str, c: str) -> str:
        """a·b + c, rounded once."""
        F = t.float
        return self.value(f"call {F} @llvm.fma.{t.name}({F} {a}, {F} {b}, {F} {c})")

    def binary(self, op: str, kind: str, a: str, b: str) -> str:
        """A binary instruction."""
        return self.value(f"{op} {kind} {a}, {b}")

    def call(self, kind: str, function: str, *arguments: str) -> str:
        """A function of arguments of its own type."""
        return self.value(f"call {kind} @{function}({', '.join(f'{kind} {a}' for a in arguments)})")

    def splat(self, t: Type, x: str) -> str:
        """A double in every lane."""
        if t.lanes == 1:
            return x
        one = self.value(f"insertelement {t.float} undef, double {x}, i32 0")
        return self.value(f"shufflevector {t.float} {one}, {t.float} undef, <{t.lanes} x i32> zeroinitializer")

    def lanes(self, t: Type, x: str) -> Iterator[str]:
        """The doubles of all lanes, the first lane's first."""
        if t.lanes == 1:
            yield x
            return
        for lane in range(t.lanes):
            yield self.value(f"extractelement {t.float} {x}, i32 {lane}")

    # --- flow ---

    def label(self, name: str) -> None:
        """Go on in a block of this name."""
        self.lines += [f"  br label %{name}", f"{name}:"]

    @contextmanager
    def when(self, condition: str) -> Iterator[None]:
        """What follows, only where the condition (i1) holds."""
        yes, done = self.name()[1:], self.name()[1:]
        self.lines += [f"  br i1 {condition}, label %{yes}, label %{done}", f"{yes}:"]
        yield
        self.label(done)

    @contextmanager
    def repeat(self, condition: Condition) -> Iterator[None]:
        """What follows, as long as the condition holds, asked before each turn."""
        top, body, done = (self.name()[1:] for _ in range(3))
        self.label(top)
        holds = condition()
        self.lines += [f"  br i1 {holds}, label %{body}, label %{done}", f"{body}:"]
        yield
        self.lines += [f"  br label %{top}", f"{done}:"]

    def leave(self, kind: str, value: str) -> None:
        """Return from the function; what follows is another block."""
        self.lines += [f"  ret {kind} {value}", f"{self.name()[1:]}:"]

    def function(self, head: str) -> Iterator[str]:
        """The whole function; its code must end in `leave`."""
        yield head + " {"
        yield from self.allocations
        yield from self.lines
        yield "  unreachable"
        yield "}"


def _aligned(kind: str) -> str:
    """Entries of arrays lie as their scalars do, vectors too; what is not in arrays lies as LLVM puts it."""
    return ", align 8" if "double" in kind or kind in ("i64", "ptr") else ", align 4" if "float" in kind else ""
