"""LLVM IR of a program with loops (`layout.Looped`): steps as functions of a node's row, a driver over each forest.

What differs from node to node (where its numbers lie, its parameters) comes from tables that are bound when the code is loaded, so one
compiled driver serves forests of any size. The workspace is on the heap: ten thousand nodes do not fit on a thread's stack.
"""

import math
from collections.abc import Iterator
from typing import Any

from ..trace.layout import ADDED, FIXED_COLUMNS, Address, Fill, Loop, Looped, Step, Straight
from .code import Code
from .constants import Constants
from .straight import Operands, Part
from .types import Type
from .value import ONE, Memory, Variable, constant, select

OWN, UP, PARAM, KIND = range(len(FIXED_COLUMNS))
STRAIGHT = 400  # instructions in one function between loops: they read and write memory all over, which costs LLVM more than linear time
INLINED = 2  # kinds up to which steps become part of the driver's loop: one function of many costs LLVM more than linear time
TRUSTED = ("trusted",)  # the slot of 1, or of −1 where a check failed


class LoopedPart:
    """A program with loops as one function over slots: what `straight.Part` is for straight-line code."""

    def __init__(self, program: Looped, t: Type, name: str) -> None:
        self.program, self.name, self._t = program, name, t
        self.guards = (TRUSTED,)
        self._straight = {
            n: Part(item.program, t, f"{name}{n}.", item.slots, free=program.size + 1, size=STRAIGHT)
            for n, item in enumerate(program.items)
            if isinstance(item, Straight)
        }
        self.size = max([program.size + 1, *(part.size for part in self._straight.values())])
        self.slots: dict[Any, int] = {("in", x, 0): start for x, start in program.starts.items()}
        self.slots |= {("out", x, 0): place.start for x, place in program.outputs.items()} | {TRUSTED: program.size}

    def functions(self) -> Iterator[str]:
        """The definitions, and the tables they read."""
        for f in range(len(self.program.counts)):
            yield f"@{self.name}.rows{f} = global ptr null"
            yield f"@{self.name}.parameters{f} = global ptr null"
        for part in self._straight.values():
            yield from part.functions()
        for n, item in enumerate(self.program.items):
            if isinstance(item, Loop):
                for kind, step in enumerate(item.steps):
                    if step or item.clears:
                        yield from self._step(f"{self.name}{n}.{kind}", item, step, "" if len(item.steps) <= INLINED else "noinline ")
        yield from self._evaluate()

    def calls(self, slots: str) -> list[str]:
        """The lines that evaluate the program on slots whose inputs are set."""
        return [f"  call void @{self.name}(ptr {slots})"]

    def _step(self, name: str, loop: Loop, step: Step | None, how: str) -> Iterator[str]:
        """void @name(slots, row, parameters): one node."""
        t, F, lines, bases = self._t, self._t.float, [], {}
        columns = (*FIXED_COLUMNS, *self.program.columns[loop.forest])

        def pointer(address: Address) -> str:
            base, offset = address
            if base != "slot" and base not in bases:
                lines.append(f"  %{base}.row = getelementptr i64, ptr %row, i64 {columns.index(base)}")
                lines.append(f"  %{base}.offset = load i64, ptr %{base}.row")
                kind, origin = ("double", "parameters") if base == "param" else (F, "slots")
                lines.append(f"  %{base}.base = getelementptr {kind}, ptr %{origin}, i64 %{base}.offset")
                bases[base] = f"%{base}.base"
            name = f"%a{len(lines)}"
            lines.append(f"  {name} = getelementptr {'double' if base == 'param' else F}, ptr {bases.get(base, '%slots')}, i64 {offset}")
            return name

        constants, stores = Constants(t, f"{name}.constants"), []
        if step:
            code, places = step

            def load(j: int) -> str:
                address = code.instructions[j][1]
                where = pointer(address)
                if address.base != "param":
                    lines.append(f"  %v{j} = load {F}, ptr {where}")
                    return f"%v{j}"
                lines.append(f"  %d{j} = load double, ptr {where}")
                one = f"%d{j}"
                if t.scalar != "double":
                    lines.append(f"  %s{j} = fptrunc double {one} to {t.scalar}")
                    one = f"%s{j}"
                if t.lanes == 1:
                    return one
                lines.append(f"  %i{j} = insertelement {F} undef, {t.scalar} {one}, i32 0")
                lines.append(f"  %v{j} = shufflevector {F} %i{j}, {F} undef, <{t.lanes} x i32> zeroinitializer")
                return f"%v{j}"

            operand = Operands(code, t, load, constants, lines)
            operand.compute(range(len(code.instructions)))
            stores = [(place, operand(value)) for place, value in zip(places, code.outputs[""], strict=True)]
        stores += [(Address("own", offset), t.constant(0.0)) for offset in loop.clears]
        for n, (address, value) in enumerate(stores):
            where = pointer(address)
            if address.base in ADDED:
                lines.append(f"  %old{n} = load {F}, ptr {where}")
                lines.append(f"  %new{n} = fadd {F} %old{n}, {value}")
                value = f"%new{n}"
            lines.append(f"  store {F} {value}, ptr {where}")
        yield from constants.definition()
        arguments = "ptr noalias %slots, ptr noalias readonly %row, ptr noalias readonly %parameters"
        yield f"define internal void @{name}({arguments}) {how}nounwind {t.frame} {{"
        yield from lines
        yield "  ret void"
        yield "}"

    def _evaluate(self) -> Iterator[str]:
        """void @name(slots): item after item, then the checks."""
        c, t, program = Code(), self._t, self.program
        for n, item in enumerate(program.items):
            if isinstance(item, Straight):
                c.lines += self._straight[n].calls("%slots")
            elif isinstance(item, Fill):
                self._fill(c, item)
            else:
                self._loop(c, f"{self.name}{n}", item)

        # Every checked value is positive, and not infinite.
        slots, good = Memory(c, t, "%slots"), Variable(constant(c, t, True, "bool"))
        i = Variable(constant(c, ONE, program.checks.start, "int"))
        with c.repeat(lambda: i.value < program.checks.stop):
            x = slots[i.value]
            fine = (x > 0.0) & (x < math.inf)
            good.value = good.value & fine
            i.value = i.value + 1
        slots[program.size] = select(good.value, constant(c, t, 1.0), -1.0)
        c.leave("void")
        yield from c.function(f"define internal void @{self.name}(ptr noalias %slots) noinline nounwind {t.frame}")

    def _fill(self, c: Code, item: Fill) -> None:
        slots = Memory(c, self._t, "%slots")
        if len(item.values) <= 8 or any(item.values):
            for k, x in enumerate(item.values):
                slots[item.start + k] = x
            return
        i = Variable(constant(c, ONE, item.start, "int"))
        with c.repeat(lambda: i.value < item.start + len(item.values)):
            slots[i.value] = 0.0
            i.value = i.value + 1

    def _loop(self, c: Code, name: str, loop: Loop) -> None:
        """All nodes in order, each by its kind's step."""
        n, width = self.program.counts[loop.forest], len(FIXED_COLUMNS) + len(self.program.columns[loop.forest])
        table, parameters = (c.get("ptr", f"@{self.name}.{x}{loop.forest}") for x in ("rows", "parameters"))
        rows, i = Memory(c, ONE, table, "int"), Variable(constant(c, ONE, n - 1 if loop.inward else 0, "int"))
        with c.repeat(lambda: i.value >= 0 if loop.inward else i.value < n):
            row = rows.behind(i.value * width)
            kind = row[KIND] if len(loop.steps) > 1 else None
            for k in (kind for kind, step in enumerate(loop.steps) if step or loop.clears):
                call = f"call void @{name}.{k}(ptr %slots, ptr {row.base}, ptr {parameters})"
                if kind is None:
                    c.add(call)
                    continue
                with c.when(kind.equals(k)):
                    c.add(call)
            i.value = i.value + (-1 if loop.inward else 1)
