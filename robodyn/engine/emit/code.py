"""The body of a function in LLVM IR: its lines, names for its values, variables, and the flow from block to block.

What a line computes is written in `value`, as formulas. The thousands of instructions of a program are appended as text (see `straight`).
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

UNLIKELY = ", !prof !0"  # of a branch that is hardly ever taken: metadata that every module with programs has


class Name(Protocol):
    """A value, whose text is its name."""

    def __str__(self) -> str: ...


class Code:
    """The body of one function. Values are names; variables live in memory, from where LLVM lifts them into registers."""

    def __init__(self) -> None:
        self.allocations: list[str] = []
        self.lines: list[str] = []
        self._count, self._block = 0, "0"  # LLVM's own name of the first block

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

    def variable(self, kind: str, first: Name) -> str:
        """The address of a variable of an LLVM type, set to its first value here."""
        name = self.name()
        self.allocations.append(f"  {name} = alloca {kind}")
        self.set(kind, name, first)
        return name

    def get(self, kind: str, address: str) -> str:
        """The value at an address."""
        return self.value(f"load {kind}, ptr {address}{_aligned(kind)}")

    def set(self, kind: str, address: str, value: Name) -> None:
        """Put a value there."""
        self.add(f"store {kind} {value}, ptr {address}{_aligned(kind)}")

    def at(self, kind: str, base: str, index: Name) -> str:
        """The address of an entry of an array."""
        return self.value(f"getelementptr {kind}, ptr {base}, i64 {index}")

    # --- flow ---

    def block(self, name: str) -> None:
        """What follows is a block of this name."""
        if self.lines and self.lines[-1] == f"{self._block}:":
            self.lines.pop()  # the empty one behind `leave`
        self.lines.append(f"{name}:")
        self._block = name

    @contextmanager
    def when(self, condition: Name) -> Iterator[None]:
        """What follows, only where the condition (i1) holds."""
        with self.branch(condition):
            yield

    @contextmanager
    def branch(self, condition: Name, how: str = "") -> Iterator[Callable[[str, Name, Name], str]]:
        """What follows, only where the condition holds; yields merged(type, value there, value elsewhere), for afterwards."""
        before, inside, done = self._block, self._label(), self._label()
        self.add(f"br i1 {condition}, label %{inside}, label %{done}{how}")
        self.block(inside)
        ends: list[str] = []
        yield lambda kind, there, elsewhere: self.value(f"phi {kind} [{there}, %{ends[0]}], [{elsewhere}, %{before}]")
        ends.append(self._block)
        self.add(f"br label %{done}")
        self.block(done)

    @contextmanager
    def repeat(self, condition: Callable[[], Name]) -> Iterator[None]:
        """What follows, as long as the condition holds, asked before each turn."""
        top, body, done = self._label(), self._label(), self._label()
        self.add(f"br label %{top}")
        self.block(top)
        self.add(f"br i1 {condition()}, label %{body}, label %{done}")
        self.block(body)
        yield
        self.add(f"br label %{top}")
        self.block(done)

    def require(self, condition: Name, otherwise: str) -> None:
        """Go on where the condition holds; to the block of this name where not."""
        further = self._label()
        self.add(f"br i1 {condition}, label %{further}, label %{otherwise}")
        self.block(further)

    def leave(self, kind: str, value: Name = "") -> None:
        """Return from the function; what follows is another block."""
        self.add(f"ret {kind} {value}")
        self.block(self._label())

    def function(self, head: str) -> Iterator[str]:
        """The whole function; its code must end in `leave`."""
        yield head + " {"
        yield from self.allocations
        yield from self.lines[:-1]  # the block behind `leave` is empty
        yield "}"

    def _label(self) -> str:
        return self.name()[1:]


def _aligned(kind: str) -> str:
    """Entries of arrays lie as their scalars do, vectors too; what is not in arrays lies as LLVM puts it."""
    return ", align 8" if "double" in kind or kind in ("i64", "ptr") else ", align 4" if "float" in kind else ""
