"""The numbers of a function, read from a table where they are needed.

Left to itself LLVM puts every number into a vector register before the loop over blocks, and spills it: 64 bytes of the first-level
cache for a number of 8, which it has not room for. From a table, most are operands in memory of the instructions that need them.

It also puts instructions into an order of its own, in which more values wait for their use than in a program's. LLVM moves no reading of
the table across a line that gives its address a new name, and so nothing that waits for such a number: every few instructions one does.
"""

from collections.abc import Iterator

from .types import Type

WINDOW = 4  # instructions in which a number is read once, and which LLVM may put in another order


class Constants:
    """The numbers of one function, one place in the table for each."""

    def __init__(self, t: Type, name: str) -> None:
        self._t, self._name, self._one = t, name, Type(1, t.scalar)
        self._places: dict[str, int] = {}
        self._names: dict[str, str] = {}
        self._base, self._count = f"@{name}", 0

    def renew(self, lines: list[str]) -> None:
        """Give the address of the table a new name, of which LLVM knows nothing, least of all what has been read there before."""
        base = f"%kb{self._fresh()}"
        lines.append(f'  {base} = call ptr asm sideeffect "", "=r,0"(ptr {self._base})')
        self._base = base
        self._names.clear()

    def value(self, x: float, lines: list[str]) -> str:
        """The name of a number in every lane; what reads it is appended to the lines."""
        if x == 0.0:
            return self._t.constant(x)
        key = self._one.constant(x)
        if key not in self._names:
            n, place, F = self._fresh(), self._places.setdefault(key, len(self._places)), self._t.float
            lines.append(f"  %kp{n} = getelementptr {self._t.scalar}, ptr {self._base}, i64 {place}")
            lines.append(f"  %ks{n} = load {self._t.scalar}, ptr %kp{n}, align {self._t.bytes}")
            self._names[key] = f"%ks{n}"
            if self._t.lanes > 1:
                lines.append(f"  %ki{n} = insertelement {F} undef, {self._t.scalar} %ks{n}, i32 0")
                lines.append(f"  %kv{n} = shufflevector {F} %ki{n}, {F} undef, <{self._t.lanes} x i32> zeroinitializer")
                self._names[key] = f"%kv{n}"
        return self._names[key]

    def definition(self) -> Iterator[str]:
        """The table. It is no constant of LLVM's, which would go where its loader for machine code in memory cannot address it."""
        numbers = ", ".join(f"{self._t.scalar} {x}" for x in self._places)
        yield f"@{self._name} = global [{len(self._places)} x {self._t.scalar}] [{numbers}], align {self._t.bytes}"

    def _fresh(self) -> int:
        self._count += 1
        return self._count
