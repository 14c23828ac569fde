"""LLVM IR of `run`: the loop over the rows of a batch, a block of lanes at a time: gather, compute, check, scatter."""

from collections import defaultdict
from collections.abc import Callable

from ..trace.graph import LEAVES
from ..trace.layout import Looped
from ..trace.program import Program
from . import parts, rows
from .code import Code
from .constants import Constants
from .loops import LoopedPart
from .straight import Operands, Part
from .types import Type
from .value import ONE, Value, Variable, constant, fma, select

NAME = "evaluate"  # of the part that `run` calls
WRITTEN_OUT = 600  # inputs and outputs up to which the code that moves them is written out
ON_STACK = 4000  # slots of a program in pieces up to which they are on the stack
FETCHING = 0.5  # the part of a block's instructions during which the rows of the next are fetched
LONG = 128  # bytes of a row from which its lines are fetched ahead: of shorter ones the hardware does it
LINE = 64  # bytes of a cache line
SUMS = 4  # of what must be finite: a single one would be a chain as long as all inputs and outputs

Rows = dict[str, list[str]]  # the addresses of a block's rows, by the name of the input or output


def module(program: Program | Looped, lanes: int, scalar: str = "double") -> str:
    """IR text with `i64 @run(ptr in…, i64 stride…, ptr out…, i64 count)`, for a count of 0, or of at least `lanes`.

    in: one pointer per input, to rows of scalars ("double" or "float"), `stride` of them apart (0: one row for all); out: rows without
    gaps. Returns the first row of the first block in which an input, output or guard is not finite or a guard not positive, or −1.
    """
    t, c = Type(lanes, scalar), Code()
    part = parts.part(program, t, NAME)
    moved = sum(program.inputs.values()) + sum(map(len, program.outputs.values()))
    if isinstance(part, Part) and part.straight and moved <= WRITTEN_OUT:
        constants = Constants(t, f"{NAME}.constants")
        _run(c, t, program, lambda *block: _straight(c, t, part.program, constants, *block))
        definitions = constants.definition()
    else:
        slots, free = _slots(c, t, part.size, heap=not isinstance(part, Part) or part.size > ON_STACK)
        _run(c, t, program, lambda *block: _through_slots(c, t, part, slots, *block), free)
        definitions = part.functions()
    arguments = [f"ptr noalias readonly %in{k}, i64 %stride{k}" for k in range(len(program.inputs))]
    arguments += [f"ptr noalias %out{k}" for k in range(len(program.outputs))]
    head = f"define i64 @run({', '.join(arguments)}, i64 %count) nounwind {t.frame}"
    lines = [*parts.prologue(t, program), *rows.declarations(t), "declare ptr @malloc(i64)", "declare void @free(ptr)"]
    lines += ["declare void @llvm.prefetch.p0(ptr, i32, i32, i32)"]
    return "\n".join([*lines, "declare i64 @llvm.smin.i64(i64, i64)", *definitions, *c.function(head)]) + "\n"


class _Trust:
    """What a block must pass: numbers that are finite, guards that are positive as well."""

    def __init__(self, c: Code, t: Type) -> None:
        self._sums = [Variable(constant(c, t, 0.0)) for _ in range(SUMS)]
        self._good = Variable(constant(c, t, True, "bool"))
        self._like, self._count = constant(c, t, 0.0), 0

    def finite(self, name: str) -> None:
        # x · 0 is 0 for a finite x, and NaN for every other: one sum tells of many.
        total = self._sums[self._count % SUMS]
        total.value = fma(self._like.named(name), 0.0, total.value)
        self._count += 1

    def positive(self, name: str) -> None:
        self.finite(name)
        self._good.value = self._good.value & (self._like.named(name) > 0.0)

    def passed(self) -> Value:
        """i1: in all lanes."""
        good = self._good.value
        for total in self._sums:
            good = good & total.value.equals(0.0)
        return good.everywhere


def _run(c: Code, t: Type, program: Program | Looped, body: Callable[[Rows, Rows, _Trust], None], end: Callable[[], None] | None = None):
    """The loop; `body` writes the code of one block."""
    L, count = t.lanes, Value(c, ONE, "int", "%count")
    last = count - L
    row, bad = Variable(constant(c, ONE, 0, "int")), Variable(constant(c, ONE, -1, "int"))

    with c.repeat(lambda: (row.value < count) & (bad.value < 0)):
        # The last block ends with the last row: it may compute rows of the one before again, and writes the same.
        first = row.value.new(f"call i64 @llvm.smin.i64(i64 {row.value}, i64 {last})")

        def addresses(base: str, stride: Value) -> list[str]:
            here = c.at(t.scalar, base, first * stride)
            return [here, *(c.at(t.scalar, here, stride * i) for i in range(1, L))]

        strides = [Value(c, ONE, "int", f"%stride{k}") for k in range(len(program.inputs))]
        ins = {name: addresses(f"%in{k}", stride) for k, (name, stride) in enumerate(zip(program.inputs, strides, strict=True))}
        widths = [constant(c, ONE, len(values), "int") for values in program.outputs.values()]
        outs = {name: addresses(f"%out{k}", width) for k, (name, width) in enumerate(zip(program.outputs, widths, strict=True))}
        trust = _Trust(c, t)
        body(ins, outs, trust)
        bad.value = select(trust.passed(), -1, row.value)
        row.value = row.value + L
    if end:
        end()
    c.leave("i64", bad.value)


# --- in one piece: columns are gathered where they are first needed, and scattered as soon as a row's next lanes of them are there ---


def _straight(c: Code, t: Type, program: Program, constants: Constants, ins: Rows, outs: Rows, trust: _Trust) -> None:
    L, columns = t.lanes, {}
    telling = program.telling  # values that are finite where the others, guards included, are: they need no test
    told = {tuple(operands) for op, *operands in map(program.instructions.__getitem__, telling) if op == "in"}
    fetch = _fetching(c, t, program, ins, outs)

    def gather(name: str, start: int) -> None:
        pointers = [c.at(t.scalar, pointer, start) for pointer in ins[name]]
        values, lines = rows.gathered(t, c.name()[1:], pointers, min(L, program.inputs[name] - start))
        c.lines += lines
        for k, value in enumerate(values):
            columns[name, start + k] = value
            if (name, start + k) not in told:
                trust.finite(value)

    def load(j: int) -> str:
        _, name, k = program.instructions[j]
        if (name, k) not in columns:
            gather(name, k // L * L)
        return columns[name, k]

    operand = Operands(program, t, load, constants, c.lines)

    def scatter(name: str, start: int) -> None:
        group = program.outputs[name][start : start + L]
        values = [operand.number(i) for i in group]
        c.lines += rows.scattered(t, c.name()[1:], [c.at(t.scalar, pointer, start) for pointer in outs[name]], values)
        for i in dict.fromkeys(group):
            if i not in telling:
                trust.finite(operand.number(i))

    groups = [(name, start) for name, values in program.outputs.items() for start in range(0, len(values), L)]
    missing = {(name, start): set(program.outputs[name][start : start + L]) for name, start in groups}
    waiting = defaultdict(list)
    for group, values in missing.items():
        for i in values:
            waiting[i].append(group)
    guards = dict.fromkeys(program.guards)

    def done(i: int) -> None:
        fetch(i)
        if i in guards:
            trust.positive(operand(i))
        for group in waiting.pop(i, ()):
            missing[group].discard(i)
            if not missing[group]:
                scatter(*group)

    operand.compute(range(len(program.instructions)), done)
    for i in dict.fromkeys([*program.guards, *waiting]):  # what is no instruction's: inputs and constants
        if program.instructions[i][0] in LEAVES:
            done(i)
    for name, size in program.inputs.items():
        for start in range(0, size, L):
            if (name, start) not in columns:  # not needed, but it has to be finite
                gather(name, start)


def _fetching(c: Code, t: Type, program: Program, ins: Rows, outs: Rows) -> Callable[[int], None]:
    """What asks, at instruction i, for lines of the next block's rows: they follow this one's, and are there when it begins.

    Behind the last row, or where one row serves all, a line is fetched for nothing: that reads no memory that could not be read.
    """
    sizes = {name: (ins[name][0], size) for name, size in program.inputs.items()}
    sizes |= {name: (outs[name][0], len(values)) for name, values in program.outputs.items()}
    lines = [
        (first, t.bytes * t.lanes * size + offset)
        for first, size in sizes.values()
        if t.lanes > 1 and t.bytes * size >= LONG
        for offset in range(0, t.bytes * t.lanes * size, LINE)
    ]
    due = [(int(FETCHING * len(program.instructions) * k / len(lines)), line) for k, line in enumerate(lines)]

    def fetch(i: int) -> None:
        while due and due[0][0] <= i:
            _, (first, offset) = due.pop(0)
            c.add(f"call void @llvm.prefetch.p0(ptr {c.at('i8', first, offset)}, i32 0, i32 2, i32 1)")

    return fetch


# --- in several pieces, or with loops: columns are in slots ---


def _slots(c: Code, t: Type, size: int, *, heap: bool) -> tuple[str, Callable[[], None] | None]:
    """The name of the workspace, aligned as its vectors are, and what frees it."""
    if not heap:
        name = "%slots"
        c.allocations.append(f"  {name} = alloca {t.float}, i64 {size}, align {t.bytes * t.lanes}")
        return name, None
    memory = c.value(f"call ptr @malloc(i64 {t.bytes * t.lanes * size + 64})")
    with c.when(c.value(f"icmp eq ptr {memory}, null")):
        c.leave("i64", "0")
    address = (Value(c, ONE, "int", c.value(f"ptrtoint ptr {memory} to i64")) + 63) & -64
    return c.value(f"inttoptr i64 {address} to ptr"), lambda: c.add(f"call void @free(ptr {memory})")


def _through_slots(c: Code, t: Type, part: Part | LoopedPart, slots: str, ins: Rows, outs: Rows, trust: _Trust) -> None:
    F, L = t.float, t.lanes

    def groups(size: int, start: int, rows_of: list[str], body: Callable[[list[str], str, int], None]) -> None:
        """body(row pointers, slots pointer, width) for every group of at most L columns of a vector."""
        whole = size // L * L
        j = Variable(constant(c, ONE, 0, "int"))
        if whole:
            with c.repeat(lambda: j.value < whole):
                at = j.value
                place = c.at(F, slots, at + start)
                body([c.at(t.scalar, pointer, at) for pointer in rows_of], place, L)
                j.value = at + L
        if size > whole:
            body([c.at(t.scalar, pointer, whole) for pointer in rows_of], c.at(F, slots, start + whole), size - whole)

    def gather(pointers: list[str], place: str, width: int) -> None:
        values, lines = rows.gathered(t, c.name()[1:], pointers, width)
        c.lines += lines
        for n, x in enumerate(values):
            c.set(F, c.at(F, place, n), x)
            trust.finite(x)

    def scatter(pointers: list[str], place: str, width: int) -> None:
        values = [c.get(F, c.at(F, place, n)) for n in range(width)]
        for x in values:
            trust.finite(x)
        c.lines += rows.scattered(t, c.name()[1:], pointers, values)

    for name, size in part.program.inputs.items():
        if size:
            groups(size, part.slots["in", name, 0], ins[name], gather)
    c.lines += part.calls(slots)
    for i in dict.fromkeys(part.guards):
        trust.positive(c.get(F, c.at(F, slots, part.slots[i])))
    for name, values in part.program.outputs.items():
        if len(values):
            groups(len(values), part.slots["out", name, 0], outs[name], scatter)
