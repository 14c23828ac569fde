"""LLVM IR of a program: the same instructions once for scalars and once for SIMD vectors, one state per lane.

The text is written directly, here and in `rows`, and not through `value`: a program is thousands of instructions of straight-line code, and
an object for each would take longer than LLVM does.
A block of states lives in `slots`, an array with one (vector of) number per value that crosses a border: inputs, outputs, and,
where a program is cut into functions of a few thousand operations to keep LLVM's time linear, values that a later one needs.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

from ...arithmetic.operations import OPERATIONS
from ..trace.graph import LEAVES, TRIGONOMETRIC
from ..trace.program import Program
from .constants import WINDOW, Constants
from .trigonometry import TOGETHER
from .types import Type

WHOLE = 10000  # instructions up to which a program is one function: what crosses a border goes through memory
PIECE = 2500  # instructions in one function beyond: LLVM's time grows faster than linearly, and it spills more than crosses
BINARY = {op.name: op.instruction for op in OPERATIONS.values() if op.instruction and not op.condition}
INTRINSIC = {op.name: op.intrinsic for op in OPERATIONS.values() if op.intrinsic}
# Conditions: i1 in a function; in a slot 1 or 0.
CONDITION = {op.name: op.instruction for op in OPERATIONS.values() if op.instruction and op.condition}


class Part:
    """A program as functions over slots: what a module that calls it needs to know."""

    def __init__(
        self,
        program: Program,
        t: Type,
        name: str,
        slots: dict[Any, int] | None = None,
        *,
        free: int = 0,
        size: int | None = None,
        inline: bool = True,
    ) -> None:
        """slots: where inputs and outputs are, if not in slots of its own; from `free` on there is room for more.

        size: instructions in one function, chosen for a program alone if not given. inline: the only call of a function in one piece
        takes it in; several calls would multiply LLVM's time.
        """
        self.program, self.name, self.guards = program, name, program.guards
        self._pieces = _pieces(program, size)
        self._inline = inline and len(self._pieces) == 1
        self.slots, self.size = _slots(program, self._pieces, slots or _own_slots(program), free)
        self._t = t

    def functions(self) -> Iterator[str]:
        """The definitions."""
        for k, piece in enumerate(self._pieces):
            yield from _piece(self.program, self._t, f"{self.name}{k}", piece, self.slots, inline=self._inline)

    @property
    def straight(self) -> bool:
        """Whether it is one piece."""
        return len(self._pieces) == 1

    def calls(self, slots: str) -> list[str]:
        """The lines that evaluate the program on slots whose inputs are set."""
        return [f"  call void @{self.name}{k}(ptr {slots})" for k in range(len(self._pieces))]


def _pieces(program: Program, size: int | None) -> list[range]:
    """The instructions: all of them, or cut into runs of at most `size`."""
    n = len(program.instructions)
    count = max(1, -(-n // (size or (WHOLE if n <= WHOLE else PIECE))))
    ends = [n * k // count for k in range(count + 1)]
    return [range(a, b) for a, b in pairwise(ends)]


def _own_slots(program: Program) -> dict[Any, int]:
    """("in", name, k) and ("out", name, k), each vector in one run."""
    keys = [("in", name, k) for name, size in program.inputs.items() for k in range(size)]
    keys += [("out", name, k) for name, values in program.outputs.items() for k in range(len(values))]
    return {key: slot for slot, key in enumerate(keys)}


def _slots(program: Program, pieces: list[range], places: dict[Any, int], free: int) -> tuple[dict[Any, int], int]:
    """The places of inputs and outputs, and of values, by number, that cross a border or are guards; and where the slots end."""
    slots = dict(places)
    free = max(free, len(slots))
    where = {i: p for p, piece in enumerate(pieces) for i in piece}
    crossing = [
        j
        for i, (op, *operands) in enumerate(program.instructions)
        for j in (() if op in LEAVES else operands)
        if where[j] != where[i] and program.instructions[j][0] not in LEAVES
    ]
    for i in dict.fromkeys([*crossing, *program.guards]):
        slots[i] = free
        free += 1
    return slots, free


def _piece(program: Program, t: Type, name: str, piece: range, slots: dict[Any, int], *, inline: bool) -> Iterator[str]:
    """One function: loads what it needs from the slots, computes, stores what others need."""
    F = t.float
    lines: list[str] = []

    def load(j: int) -> str:
        op, *rest = program.instructions[j]
        slot = slots[("in", *rest)] if op == "in" else slots[j]
        lines.append(f"  %p{j} = getelementptr {F}, ptr %slots, i64 {slot}")
        lines.append(f"  %v{j} = load {F}, ptr %p{j}")
        if op not in CONDITION:
            return f"%v{j}"
        lines.append(f"  %b{j} = fcmp one {F} %v{j}, {t.constant(0.0)}")
        return f"%b{j}"

    constants = Constants(t, f"{name}.constants")
    operand = Operands(program, t, load, constants, lines)
    operand.compute(piece)

    # What is needed later. Inputs and constants that are outputs are stored by the first piece.
    stores = [(i, slot) for i, slot in slots.items() if isinstance(i, int)]
    stores += [(i, slots["out", name, k]) for name, values in program.outputs.items() for k, i in enumerate(values)]
    for i, slot in stores:
        if i in piece if program.instructions[i][0] not in LEAVES else piece.start == 0:
            value = operand.number(i)
            lines.append(f"  %q{slot} = getelementptr {F}, ptr %slots, i64 {slot}")
            lines.append(f"  store {F} {value}, ptr %q{slot}")
    yield from constants.definition()
    yield f"define internal void @{name}(ptr noalias %slots) {'alwaysinline' if inline else 'noinline'} nounwind {t.frame} {{"
    yield from lines
    yield "  ret void"
    yield "}"


class Operands:
    """The code of a program's instructions, and the names of its values in it."""

    def __init__(self, program: Program, t: Type, load: Callable[[int], str], constants: Constants, lines: list[str]) -> None:
        """load: appends what fetches a value from elsewhere to the lines, and tells its name."""
        self._program, self._t, self._load, self._constants, self._lines = program, t, load, constants, lines
        self._names: dict[int, str] = {}
        self._numbers: dict[int, str] = {}

    def __call__(self, j: int) -> str:
        """The name of a value."""
        op, *rest = self._program.instructions[j]
        if op == "const":
            return self._constants.value(rest[0], self._lines)
        if j not in self._names:
            self._names[j] = self._load(j)
        return self._names[j]

    def number(self, j: int) -> str:
        """The name of a value as a number: of a condition, 1 or 0."""
        value = self(j)
        if self._program.instructions[j][0] not in CONDITION:
            return value
        if j not in self._numbers:
            t, self._numbers[j] = self._t, f"%f{j}"
            self._lines.append(f"  %f{j} = select {t.bool} {value}, {t.float} {t.constant(1.0)}, {t.float} {t.constant(0.0)}")
        return self._numbers[j]

    def compute(self, piece: range, done: Callable[[int], None] = lambda i: None) -> None:
        """Append the code of a run of instructions; `done` is called with each value that there is a name of."""
        for n, i in enumerate(piece):
            if n % WINDOW == 0:
                self._constants.renew(self._lines)
            op, *args = self._program.instructions[i]
            if op in LEAVES or i in self._names:
                continue
            if op in TRIGONOMETRIC:
                together = _together(self._program, piece, i)
                self._sines(i, together)
            else:
                together = {i: 0}
                self._names[i] = self._instruction(i, op, [self(j) for j in args])
            for k in together:
                done(k)

    def _sines(self, i: int, places: dict[int, int]) -> None:
        """Sines and cosines of several arguments at once."""
        F, lines = self._t.float, self._lines
        arguments = dict.fromkeys(self._program.instructions[k][1] for k in places)
        results = "{" + ", ".join([F] * (2 * len(arguments))) + "}"
        passed = ", ".join(f"{F} {self(j)}" for j in arguments)
        lines.append(f"  %t{i} = call {results} @sincos.{len(arguments)}({passed})")
        for k, place in places.items():
            lines.append(f"  %v{k} = extractvalue {results} %t{i}, {place}")
            self._names[k] = f"%v{k}"

    def _instruction(self, i: int, op: str, xs: list[str]) -> str:
        """Append instruction i; the name of its value."""
        t, F, lines = self._t, self._t.float, self._lines
        if op in BINARY:
            lines.append(f"  %v{i} = {BINARY[op]} {F} {xs[0]}, {xs[1]}")
        elif op in ("fma", "fms", "fnma"):
            a, b, c = xs
            if op == "fms":
                lines.append(f"  %n{i} = fneg {F} {c}")
                c = f"%n{i}"
            elif op == "fnma":
                lines.append(f"  %n{i} = fneg {F} {a}")
                a = f"%n{i}"
            lines.append(f"  %v{i} = call {F} @llvm.fma.{t.name}({F} {a}, {F} {b}, {F} {c})")
        elif op == "neg":
            lines.append(f"  %v{i} = fneg {F} {xs[0]}")
        elif op in INTRINSIC:
            lines.append(f"  %v{i} = call {F} @llvm.{INTRINSIC[op]}.{t.name}({', '.join(f'{F} {x}' for x in xs)})")
        elif op in CONDITION:
            kind = F if CONDITION[op].startswith("fcmp") else t.bool
            lines.append(f"  %v{i} = {CONDITION[op]} {kind} {xs[0]}, {xs[1] if len(xs) > 1 else t.splat('i1', 'true')}")
        elif op == "select":
            lines.append(f"  %v{i} = select {t.bool} {xs[0]}, {F} {xs[1]}, {F} {xs[2]}")
        else:
            lines.append(f"  %v{i} = call {F} @{op}.lanes({', '.join(f'{F} {x}' for x in xs)})")
        return f"%v{i}"


def _together(program: Program, piece: range, start: int) -> dict[int, int]:
    """The run of sines and cosines from `start` on, of at most TOGETHER arguments; and the place of each in {sin, cos, …} of them."""
    places: dict[int, int] = {}
    arguments: dict[int, int] = {}
    for i in range(start, piece.stop):
        op, *operands = program.instructions[i]
        full = len(arguments) == TOGETHER and operands[0] not in arguments
        if op not in TRIGONOMETRIC or full or operands[0] in places:  # the sine of a cosine has to wait for it
            break
        places[i] = 2 * arguments.setdefault(operands[0], len(arguments)) + TRIGONOMETRIC.index(op)
    return places
