"""Vectors of nx entries, of one state or of one per lane: what a step is written in."""

from collections.abc import Callable, Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np

from ...arithmetic import Array
from ..trace.program import Program
from .code import Code, Name
from .header import Header
from .loops import LoopedPart
from .straight import Part
from .types import Type
from .value import ONE, Memory, Value, Variable, constant, fma

UNROLLED = 48  # entries of a state vector up to which loops over it are written out
WIDTHS = (8, 4, 2, 1)  # entries of one state that are taken side by side, the most first: whatever the CPU, for the same code


class Entries(NamedTuple):
    """Entries of a state vector, side by side as one value: the first one's index, and the type of that value."""

    first: Name
    type: Type


State = str | Callable[[Entries], Value]  # the address of an array, or a function of the entries


class Vectors:
    """The code for vectors. They lie at addresses: `x` the state at the start of a step, `new` that at its end, `k` rows of a method's own.

    The right-hand side reads the state at `argument` and leaves its derivative at `dx`. `known` is for sums that are worked out early.
    """

    x, k, known = "%x", "%k", "%known"

    def __init__(self, code: Code, t: Type, rhs: Part | LoopedPart, project: Part | LoopedPart | None, *, in_place: bool) -> None:
        """in_place: a step's new state is made where the right-hand side reads it."""
        self.code, self.t, self.nx, self.header = code, t, rhs.program.inputs["x"], Header(code)
        self._f, self._project = rhs, project
        self._slots, self._project_slots = Memory(code, t, "%f.slots"), Memory(code, t, "%project.slots")
        self.argument, self.dx = (self._slots.at(rhs.slots[key]) for key in (("in", "x", 0), ("out", "dx", 0)))
        self.new = self.argument if in_place else "%x.new"
        self.constrained = project is not None
        held = Memory(code, t, "%held")
        for i in range(rhs.program.inputs.get("held", 0)):
            self._slots[rhs.slots["in", "held", 0] + i] = held[i]

    # --- entries ---

    def each(self, body: Callable[[Entries], None]) -> None:
        """Code for every single entry."""
        self._over(0, self.nx, 1, body)

    def runs(self, body: Callable[[Entries], None]) -> None:
        """Code for all entries, those of one state as many side by side as there are."""
        start = 0
        for width in WIDTHS if self.t.lanes == 1 else (1,):
            end = self.nx - (self.nx - start) % width
            self._over(start, end, width, body)
            start = end

    def _over(self, start: int, end: int, width: int, body: Callable[[Entries], None]) -> None:
        kind = self.t if width == 1 else Type(width)
        if end - start <= UNROLLED:
            for i in range(start, end, width):
                body(Entries(str(i), kind))
            return
        i = Variable(constant(self.code, ONE, start, "int"))
        with self.code.repeat(lambda: i.value < end):
            now = i.value
            body(Entries(now, kind))
            i.value = now + width

    def load(self, base: str, entries: Entries, row: int = 0) -> Value:
        """Entries of row `row` of an array of vectors."""
        return Memory(self.code, entries.type, self._address(base, entries, row)).first

    def store(self, value: Value, base: str, entries: Entries, row: int = 0) -> None:
        """Put entries into a row."""
        Memory(self.code, entries.type, self._address(base, entries, row)).first = value

    def _address(self, base: str, entries: Entries, row: int) -> str:
        index = self.code.value(f"add i64 {entries.first}, {row * self.nx}") if row else entries.first
        return self.code.at(self.t.float, base, index)

    def copy(self, source: str, target: str) -> None:
        """A vector from one address to another, entries side by side."""
        self.runs(lambda i: self.store(self.load(source, i), target, i))

    def put(self, state: State, target: str, row: int = 0) -> None:
        """A vector, entry by entry, into a row of an array."""
        self.each(lambda i: self.store(self.load(state, i) if isinstance(state, str) else state(i), target, i, row))

    # --- sums and norms ---

    def combination(self, weights: Array, i: Entries, first: Value | None = None) -> Value:
        """The first + Σ w_j k_j, smallest index first."""
        total = first
        for j in np.flatnonzero(weights):
            total = plus(total, float(weights[j]), self.load(self.k, i, int(j)))
        return constant(self.code, i.type, 0.0) if total is None else total

    def squares(self, values: Sequence[Callable[[Entries], Value]], *states: str) -> list[Value]:
        """Σ (value / scale)² of each of the values, scale = atol + rtol |x|, x the largest of the states; of one state, not of lanes."""
        sums = [Variable(constant(self.code, ONE, 0.0)) for _ in values]

        def add(i: Entries) -> None:
            size = reduce(Value.larger, [abs(self.load(state, i)) for state in states])
            scale = fma(size, self.header["rtol"].splat(i.type), self.header["atol"].splat(i.type))
            for total, value in zip(sums, values, strict=True):
                quotient = value(i) / scale
                for part in map(quotient.lane, range(i.type.lanes)):
                    total.value = fma(part, part, total.value)

        self.runs(add)
        return [total.value for total in sums]

    def root_mean(self, square: Value) -> Value:
        """The root of the mean over nx entries."""
        return (square * (1.0 / self.nx)).intrinsic("sqrt")

    # --- the right-hand side ---

    def evaluate(self, time: Value, state: State, row: int = 0, following: Array | None = None) -> None:
        """k_row = f(time, state).

        following: weights of the state after it, for which `moved` then finds all but the share of k_row summed up.
        """
        self.put(state, self.argument)
        if following is not None and following[:row].any():  # here the processor does it while it waits for f
            self.runs(lambda i: self.store(self.combination(following[:row], i), self.known, i))
        self.call(time)
        # What f stored entry by entry has to be loaded so as well: more at a time would wait for the stores to reach the cache.
        self.put(self.dx, self.k, row)

    def call(self, time: Value) -> None:
        """dx = f(time, argument)."""
        slots = self._f.slots
        for name, value in (("t", time), ("h", self.header["h"])):
            if ("in", name, 0) in slots:
                place = self._slots.behind(slots["in", name, 0])
                place.first = value.splat(self.t)
        self.code.lines += self._f.calls(self._slots.base)
        self.header.count("evaluations")

    def moved(self, weights: Array, h: Value) -> Callable[[Entries], Value]:
        """x + h Σ w_j k_j up to the newest k_j, the sum of the others known from its evaluation's `following`."""

        def at(i: Entries) -> Value:
            newest = np.zeros_like(weights)
            newest[-1] = weights[-1]
            change = self.combination(newest, i, self.load(self.known, i) if weights[:-1].any() else None)
            return fma(change, h.splat(i.type), self.load(self.x, i))

        return at

    def projected(self, state: str) -> None:
        """The state at an address, put back on its side conditions."""
        if self._project is None:
            return
        place, result = (self._project_slots.at(self._project.slots[key]) for key in (("in", "x", 0), ("out", "x", 0)))
        self.copy(state, place)
        self.code.lines += self._project.calls(self._project_slots.base)
        self.copy(result, state)

    def trusted(self) -> Value:
        """i1: the last derivative taken is finite, and every guard of its evaluation is positive, in all lanes."""
        total = Variable(constant(self.code, self.t, 0.0))

        def add(i: Entries) -> None:
            dx = self.load(self.dx, i)
            total.value = fma(dx, 0.0, total.value)  # x · 0 is 0 for a finite x, and NaN for every other: one sum tells of many

        program = self._f.program
        if isinstance(program, Program):
            told = program.telling  # values that are finite where all others, guards included, are: they need no test
            for k in (k for k, value in enumerate(program.outputs["dx"]) if value not in told):
                add(Entries(str(k), self.t))
        else:
            self.each(add)
        good = total.value.equals(0.0)
        for i in dict.fromkeys(self._f.guards):
            guard = self._slots[self._f.slots[i]]
            good = good & (guard < np.inf) & (guard > 0.0)
        return good.everywhere


def plus(total: Value | None, w: float, k: Value) -> Value:
    """The total + w k; no total counts as zero."""
    return k * w if total is None else fma(k, w, total)
