"""LLVM IR of a program: the same instructions once for scalars and once for SIMD vectors, one state per lane.

The text is written directly: a program is straight-line code, and building it through objects would take longer than LLVM does.
A block of states lives in `slots`, an array with one (vector of) number per value that crosses a border: inputs, outputs, and,
where a program is cut into functions of a few thousand operations to keep LLVM's time linear, values that a later one needs.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from . import elementary
from .functions import LIBRARY, TOGETHER, Type, by_lane, declarations, sincos, sincos_together
from .graph import LEAVES, TRIGONOMETRIC
from .program import Program

if TYPE_CHECKING:
    from .loops import LoopedPart
    from .sweeps import Looped

RUN = "evaluate"  # the part that `run` of a module calls
WHOLE = 10000  # instructions up to which a program is one function: what crosses a border goes through memory
PIECE = 2500  # instructions in one function beyond: LLVM's time grows faster than linearly, and it spills more than crosses
BINARY = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
INTRINSIC = {"sqrt": "sqrt", "abs": "fabs", "min": "minimum", "max": "maximum"}
# Conditions: i1 in a function; in a slot 1 or 0.
CONDITION = {"lt": "fcmp olt", "le": "fcmp ole", "eq": "fcmp oeq", "and": "and", "or": "or", "not": "xor"}


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

    def calls(self, slots: str) -> list[str]:
        """The lines that evaluate the program on slots whose inputs are set."""
        return [f"  call void @{self.name}{k}(ptr {slots})" for k in range(len(self._pieces))]


def prologue(t: Type, *programs: "Program | Looped") -> Iterator[str]:
    """Declarations and functions that the programs call."""
    used = {op for program in programs for code in program.programs for op, *_ in code.instructions}
    yield from declarations(t)
    yield from sincos(t)
    for n in range(1, TOGETHER + 1):
        yield from sincos_together(t, n)
    for name in sorted(used & LIBRARY.keys()):
        yield from by_lane(t, name)
    for name in sorted(used & elementary.FUNCTIONS.keys()):
        yield from elementary.definition(t, name)
    yield '!0 = !{!"branch_weights", i32 1, i32 100000}'


def part(program: "Program | Looped", t: Type, name: str, *, inline: bool = True) -> "Part | LoopedPart":
    """The functions of a program of either kind."""
    if isinstance(program, Program):
        return Part(program, t, name, inline=inline)
    from .loops import LoopedPart

    return LoopedPart(program, t, name)


def tables(**programs: "Program | Looped | None") -> dict[str, np.ndarray]:
    """What the code of programs reads beside its arguments, by the names that it has in a module with parts of these names."""
    return {f"{name}.{key}": x for name, program in programs.items() if program for key, x in program.tables.items()}


def module(program: "Program | Looped", lanes: int, scalar: str = "double") -> str:
    """IR text with `i64 @run(ptr in…, i64 stride…, ptr out…, i64 count)`, for a count of 0, or of at least `lanes`.

    in: one pointer per input, to rows of scalars ("double" or "float"), `stride` of them apart (0: one row for all); out: rows without
    gaps. Returns the first row of the first block in which an input, output or guard is not finite or a guard not positive, or −1.
    """
    t = Type(lanes, scalar)
    if not isinstance(program, Program):
        from . import loops

        return loops.module(program, t)
    piece = Part(program, t, RUN)
    lines = [*prologue(t, program), *piece.functions(), *_run(piece, t)]
    if lanes > 1:
        lines.append(f"declare {t.float} @llvm.masked.load.{t.name}.p0(ptr, i32, {t.bool}, {t.float})")
        lines.append(f"declare void @llvm.masked.store.{t.name}.p0({t.float}, ptr, i32, {t.bool})")
    return "\n".join(lines) + "\n"


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

    operand = instructions(program, t, piece, load, lines)

    # What is needed later. Inputs and constants that are outputs are stored by the first piece.
    stores = [(i, slot) for i, slot in slots.items() if isinstance(i, int)]
    stores += [(i, slots["out", name, k]) for name, values in program.outputs.items() for k, i in enumerate(values)]
    for i, slot in stores:
        if i in piece if program.instructions[i][0] not in LEAVES else piece.start == 0:
            value = operand(i)
            if program.instructions[i][0] in CONDITION:
                lines.append(f"  %f{slot} = select {t.bool} {value}, {F} {t.constant(1.0)}, {F} {t.constant(0.0)}")
                value = f"%f{slot}"
            lines.append(f"  %q{slot} = getelementptr {F}, ptr %slots, i64 {slot}")
            lines.append(f"  store {F} {value}, ptr %q{slot}")
    yield f"define internal void @{name}(ptr noalias %slots) {'alwaysinline' if inline else 'noinline'} nounwind {{"
    yield from lines
    yield "  ret void"
    yield "}"


def instructions(program: Program, t: Type, piece: range, load: Callable[[int], str], lines: list[str]) -> Callable[[int], str]:
    """Append the code of a run of instructions to the lines; `load` appends what fetches a value from elsewhere and tells its name.

    Returns a function that tells the name of any value.
    """
    F, names = t.float, {}

    def operand(j: int) -> str:
        """The name of value j here; a constant's is itself."""
        if j not in names:
            op, *rest = program.instructions[j]
            names[j] = t.constant(rest[0]) if op == "const" else load(j)
        return names[j]

    for i in piece:
        op, *args = program.instructions[i]
        if op in LEAVES or i in names:
            continue
        if op in TRIGONOMETRIC:
            places = _together(program, piece, i)
            arguments = dict.fromkeys(program.instructions[k][1] for k in places)
            results = "{" + ", ".join([F] * (2 * len(arguments))) + "}"
            passed = ", ".join(f"{F} {operand(j)}" for j in arguments)
            lines.append(f"  %t{i} = call {results} @sincos.{len(arguments)}({passed})")
            for k, place in places.items():
                lines.append(f"  %v{k} = extractvalue {results} %t{i}, {place}")
                names[k] = f"%v{k}"
            continue
        xs = [operand(j) for j in args]
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
        names[i] = f"%v{i}"
    return operand


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


def _run(part: Part, t: Type) -> Iterator[str]:
    """The loop over blocks of `lanes` rows: gather, compute, check, scatter."""
    F, L, program, slots = t.float, t.lanes, part.program, part.slots
    arguments = [f"ptr noalias readonly %in{k}, i64 %stride{k}" for k in range(len(program.inputs))]
    arguments += [f"ptr noalias %out{k}" for k in range(len(program.outputs))]
    yield f"define i64 @run({', '.join(arguments)}, i64 %count) nounwind {{"
    yield "entry:"
    yield f"  %slots = alloca {F}, i64 {len(slots)}, align {t.bytes * L}"
    yield f"  %last = sub i64 %count, {L}"
    for k in range(len(program.inputs)):
        for i in range(1, L):
            yield f"  %far{k}_{i} = mul i64 %stride{k}, {i}"
    yield "  %none = icmp slt i64 %last, 0"
    yield "  br i1 %none, label %good, label %loop"
    yield "loop:"
    yield "  %row = phi i64 [0, %entry], [%next, %step]"
    # The last block ends with the last row: it may compute rows of the one before again, and writes the same.
    yield "  %first = call i64 @llvm.smin.i64(i64 %row, i64 %last)"
    finite = t.constant(0.0)
    for k, (name, size) in enumerate(program.inputs.items()):
        yield f"  %o{k} = mul i64 %first, %stride{k}"
        yield f"  %i{k}_0 = getelementptr {t.scalar}, ptr %in{k}, i64 %o{k}"
        for i in range(1, L):
            yield f"  %i{k}_{i} = getelementptr {t.scalar}, ptr %i{k}_0, i64 %far{k}_{i}"
        entries, text = gathered(t, f"i{k}", [f"%i{k}_{i}" for i in range(L)], size)
        yield from text
        for j, value in enumerate(entries):
            yield f"  %ip{k}_{j} = getelementptr {F}, ptr %slots, i64 {slots['in', name, j]}"
            yield f"  store {F} {value}, ptr %ip{k}_{j}"
            # x · 0 is 0 for a finite x, and NaN for every other: one sum tells of them all.
            yield f"  %if{k}_{j} = call {F} @llvm.fma.{t.name}({F} {value}, {F} {t.constant(0.0)}, {F} {finite})"
            finite = f"%if{k}_{j}"
    yield from part.calls("%slots")

    ok = None
    for n, i in enumerate(dict.fromkeys(program.guards)):
        yield f"  %gp{n} = getelementptr {F}, ptr %slots, i64 {slots[i]}"
        yield f"  %gv{n} = load {F}, ptr %gp{n}"
        yield f"  %gf{n} = call {F} @llvm.fma.{t.name}({F} %gv{n}, {F} {t.constant(0.0)}, {F} {finite})"
        finite = f"%gf{n}"
        yield f"  %gc{n} = fcmp ogt {F} %gv{n}, {t.constant(0.0)}"
        if ok is not None:
            yield f"  %ga{n} = and {t.bool} %gc{n}, {ok}"
        ok = f"%ga{n}" if ok is not None else f"%gc{n}"
    for k, (name, values) in enumerate(program.outputs.items()):
        yield f"  %u{k} = mul i64 %first, {len(values)}"
        yield f"  %w{k}_0 = getelementptr {t.scalar}, ptr %out{k}, i64 %u{k}"
        for i in range(1, L):
            yield f"  %w{k}_{i} = getelementptr {t.scalar}, ptr %w{k}_0, i64 {i * len(values)}"
        columns = []
        for j in range(len(values)):
            yield f"  %op{k}_{j} = getelementptr {F}, ptr %slots, i64 {slots['out', name, j]}"
            yield f"  %ov{k}_{j} = load {F}, ptr %op{k}_{j}"
            yield f"  %of{k}_{j} = call {F} @llvm.fma.{t.name}({F} %ov{k}_{j}, {F} {t.constant(0.0)}, {F} {finite})"
            finite = f"%of{k}_{j}"
            columns.append(f"%ov{k}_{j}")
        yield from scattered(t, f"o{k}", [f"%w{k}_{i}" for i in range(L)], columns)

    yield f"  %fine = fcmp oeq {F} {finite}, {t.constant(0.0)}"
    if ok is not None:
        yield f"  %all = and {t.bool} %fine, {ok}"
    bits = "%all" if ok is not None else "%fine"
    if L > 1:
        yield f"  %mask = bitcast {t.bool} {bits} to i{L}"
        yield f"  %pass = icmp eq i{L} %mask, -1"
        bits = "%pass"
    yield f"  br i1 {bits}, label %step, label %bad, !prof !1"
    yield "step:"
    yield f"  %next = add i64 %row, {L}"
    yield "  %more = icmp slt i64 %next, %count"
    yield "  br i1 %more, label %loop, label %good"
    yield "good:"
    yield "  ret i64 -1"
    yield "bad:"
    yield "  ret i64 %row"
    yield "}"
    yield "declare i64 @llvm.smin.i64(i64, i64)"
    yield '!1 = !{!"branch_weights", i32 100000, i32 1}'


def gathered(t: Type, name: str, rows: list[str], size: int) -> tuple[list[str], list[str]]:
    """Names of the columns (one vector per entry, a row per lane) of rows in memory, and the code that gathers them."""
    F, L, columns, lines = t.float, t.lanes, [], []
    if L == 1:
        for j in range(size):
            lines.append(f"  %{name}a{j} = getelementptr {t.scalar}, ptr {rows[0]}, i64 {j}")
            lines.append(f"  %{name}c{j} = load {t.scalar}, ptr %{name}a{j}, align {t.bytes}")
            columns.append(f"%{name}c{j}")
        return columns, lines
    for start in range(0, size, L):
        width = min(L, size - start)
        loaded = []
        for i, row in enumerate(rows):
            lines.append(f"  %{name}a{start}_{i} = getelementptr {t.scalar}, ptr {row}, i64 {start}")
            value = f"%{name}l{start}_{i}"
            if width == L:
                lines.append(f"  {value} = load {F}, ptr %{name}a{start}_{i}, align {t.bytes}")
            else:
                arguments = f"ptr %{name}a{start}_{i}, i32 {t.bytes}, {t.bool} {_mask(L, width)}, {F} zeroinitializer"
                lines.append(f"  {value} = call {F} @llvm.masked.load.{t.name}.p0({arguments})")
            loaded.append(value)
        transposed, text = _transposed(t, f"{name}t{start}", loaded)
        lines += text
        columns += transposed[:width]
    return columns, lines


def scattered(t: Type, name: str, rows: list[str], columns: list[str]) -> Iterator[str]:
    """Code that writes columns (a row per lane) to rows in memory."""
    F, L = t.float, t.lanes
    if L == 1:
        for j, value in enumerate(columns):
            yield f"  %{name}a{j} = getelementptr {t.scalar}, ptr {rows[0]}, i64 {j}"
            yield f"  store {t.scalar} {value}, ptr %{name}a{j}, align {t.bytes}"
        return
    for start in range(0, len(columns), L):
        group = columns[start : start + L]
        padded = group + [group[-1]] * (L - len(group))
        transposed, text = _transposed(t, f"{name}t{start}", padded)
        yield from text
        for i, (row, value) in enumerate(zip(rows, transposed, strict=True)):
            yield f"  %{name}a{start}_{i} = getelementptr {t.scalar}, ptr {row}, i64 {start}"
            if len(group) == L:
                yield f"  store {F} {value}, ptr %{name}a{start}_{i}, align {t.bytes}"
            else:
                arguments = f"{F} {value}, ptr %{name}a{start}_{i}, i32 {t.bytes}, {t.bool} {_mask(L, len(group))}"
                yield f"  call void @llvm.masked.store.{t.name}.p0({arguments})"


def _mask(lanes: int, width: int) -> str:
    return "<" + ", ".join(f"i1 {int(k < width)}" for k in range(lanes)) + ">"


def _transposed(t: Type, name: str, rows: list[str]) -> tuple[list[str], list[str]]:
    """A square of lanes × lanes numbers, transposed by swapping blocks of 1, 2, 4, … within pairs of rows."""
    F, L, rows, lines = t.float, t.lanes, list(rows), []
    k = 1
    while k < L:
        low = [j if not j & k else L + j - k for j in range(L)]
        high = [j + k if not j & k else L + j for j in range(L)]
        for i in range(L):
            if i & k:
                continue
            a, b = rows[i], rows[i + k]
            for target, mask in ((i, low), (i + k, high)):
                text = ", ".join(f"i32 {m}" for m in mask)
                lines.append(f"  %{name}_{k}_{target} = shufflevector {F} {a}, {F} {b}, <{L} x i32> <{text}>")
                rows[target] = f"%{name}_{k}_{target}"
        k *= 2
    return rows, lines
