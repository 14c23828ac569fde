"""Explicit Runge-Kutta methods with the step loop in native code.

A program computes dx = ẋ from t and x; another may put x back on its side conditions. One function advances the state until it is
done or a budget of steps is used up, so that Python can show progress and take Ctrl-C in between. A method is a tableau, as data.
Hairer, Nørsett, Wanner, Solving ODEs I: sections II.1, II.4 (error control), II.6 (dense output).
"""

from collections.abc import Callable, Iterator
from functools import partial, reduce
from typing import NamedTuple

import numpy as np

from ...arithmetic import Array
from ..trace.layout import Looped
from ..trace.program import Program
from . import parts
from .code import Code
from .tableau import Tableau
from .types import INTRINSICS, Type

DONE, PAUSED, STEP_TOO_SMALL, NOT_FINITE = range(4)  # what `advance` returns
STATUSES = 4

# The numbers that `advance` reads and writes, each a double. An adaptive method with h = 0 chooses its first step.
HEADER = ("t", "h", "t0", "t_end", "count", "rtol", "atol", "next", "steps", "rejected", "evaluations", "started", "shrink")
ON_STACK = 4000  # entries of the workspace up to which it is on the stack, from where LLVM lifts it into registers
INLINED = 3000  # operations of the right-hand side, times its calls, up to which each call takes it in
UNROLLED = 48  # entries of a state vector up to which loops over it are written out
WIDTHS = (8, 4, 2, 1)  # entries of one state that are taken side by side, the most first: whatever the CPU, for the same code

EPS = float(np.finfo(float).eps)
SAFETY, SHRINK, GROW = 0.9, 0.2, 10.0  # of the step size control, as in SciPy


def module(method: Tableau, rhs: Program | Looped, project: Program | Looped | None, lanes: int) -> str:
    """IR text with `i64 @advance(ptr header, ptr x, ptr k, ptr held, ptr times, i64 ntimes, ptr out, i64 budget)`.

    header: see HEADER. x: nx entries; k: room for `room(…)` entries; held: the rhs's input of that name, where it has one;
    out: ntimes × nx. An entry is a double, or `lanes` of them. Negative ntimes: the ends of steps go to times and out, which the steps
    fill one by one from row `next` on; `advance` pauses where −ntimes of them are full.

    And `i64 @advance_each(…, i64 count)`: the same for `count` headers, x and out, one behind the other, each until it is done. Returns
    how many are done, times STATUSES, plus the status of the one that is not.
    """
    return _Writer(method, rhs, project, Type(lanes)).text()


def tables(rhs: Program | Looped, project: Program | Looped | None) -> dict[str, Array]:
    """What the module's code reads beside its arguments, by name."""
    return parts.tables(f=rhs, project=project)


def room(method: Tableau, rhs: Program | Looped, project: Program | Looped | None) -> int:
    """Entries of the array k: derivatives, and behind them the workspace of a right-hand side that is too large for the stack."""
    writer = _Writer(method, rhs, project, Type(1))
    return rows(method) * writer.nx + (writer.workspace if writer.large else 0)


def stages(method: Tableau) -> int:
    """Derivatives that the method takes in a step with dense output, that at its end counted too."""
    return len(method.b) + 1 + (0 if method.extra_c is None else len(method.extra_c))


def rows(method: Tableau) -> int:
    """Derivatives that it keeps at a time."""
    return stages(method) if method.errors else 1


class Entries(NamedTuple):
    """Entries of a state vector, side by side as one value: the first one's index, and the type of that value."""

    first: str
    type: Type


class _Writer:
    def __init__(self, method: Tableau, rhs: Program | Looped, project: Program | Looped | None, t: Type) -> None:
        self.m, self.t, self.nx, self.s, self.code = method, t, rhs.inputs["x"], len(method.b), Code()
        self.f = parts.part(rhs, t, "f", inline=stages(method) * rhs.length <= INLINED)
        self.project = parts.part(project, t, "project", inline=False) if project else None
        self.shown = None  # entries of dx that no other nor a guard shows to be finite, where that is known
        if isinstance(rhs, Program):
            telling = rhs.telling
            self.shown = [k for k, value in enumerate(rhs.outputs["dx"]) if value not in telling]
        self.header = {name: f"%header.{name}" for name in HEADER}
        self.workspace = self.f.size + (2 if method.errors else 1) * self.nx + (self.project.size if self.project else 0)
        self.large = self.workspace > ON_STACK

    def text(self) -> str:
        programs = [part.program for part in (self.f, self.project) if part]
        self._advance()
        arrays = ", ".join(f"ptr noalias %{name}" for name in ("header", "x", "k", "held", "times"))
        head = f"define i64 @advance({arrays}, i64 %ntimes, ptr noalias %out, i64 %budget) nounwind {self.t.frame}"
        lines = [*parts.prologue(self.t, *programs), "declare double @llvm.pow.f64(double, double)"]
        # Beside the intrinsics of the programs' own type: those of entries side by side, or of the time.
        for t in (Type(width) for width in (WIDTHS[:-1] if self.t.lanes == 1 else (1,))):
            names = [name for name in INTRINSICS if self.t.lanes == 1 or name != "fma"]
            lines += [f"declare {t.float} @llvm.{name}.{t.name}({', '.join([t.float] * INTRINSICS[name])})" for name in names]
        for part in (self.f, self.project):
            lines += part.functions() if part else ()
        return "\n".join([*lines, *self.code.function(head), *self._advance_each()]) + "\n"

    def _advance_each(self) -> Iterator[str]:
        """The loop over blocks of lanes: Python would spend longer on calling one after the other than they take."""
        c, F = Code(), self.t.float
        rest = "ptr %times, i64 %ntimes"
        i = c.variable("i64", "0")
        with c.repeat(lambda: c.value(f"icmp slt i64 {c.get('i64', i)}, %count")):
            now = c.get("i64", i)
            header = c.at("double", "%header", c.binary("mul", "i64", now, str(len(HEADER))))
            x = c.at(F, "%x", c.binary("mul", "i64", now, str(self.nx)))
            out = c.at(F, "%out", c.binary("mul", "i64", now, c.binary("mul", "i64", "%ntimes", str(self.nx))))
            arguments = f"ptr {header}, ptr {x}, ptr %k, ptr %held, {rest}, ptr {out}, i64 %budget"
            status = c.value(f"call i64 @advance({arguments})")
            with c.when(c.value(f"icmp ne i64 {status}, {DONE}")):
                c.leave("i64", c.binary("add", "i64", c.binary("mul", "i64", now, str(STATUSES)), status))
            c.set("i64", i, c.binary("add", "i64", now, "1"))
        c.leave("i64", c.binary("mul", "i64", "%count", str(STATUSES)))
        arrays = "ptr %header, ptr %x, ptr %k, ptr %held"
        yield from c.function(f"define i64 @advance_each({arrays}, {rest}, ptr %out, i64 %budget, i64 %count) nounwind")

    # --- vectors of nx entries ---

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
        c, kind = self.code, self.t if width == 1 else Type(width)
        if end - start <= UNROLLED:
            for i in range(start, end, width):
                body(Entries(str(i), kind))
            return
        i = c.variable("i64", str(start))
        with c.repeat(lambda: c.value(f"icmp slt i64 {c.get('i64', i)}, {end}")):
            body(Entries(now := c.get("i64", i), kind))
            c.set("i64", i, c.binary("add", "i64", now, str(width)))

    def address(self, base: str, entries: Entries, row: int = 0) -> str:
        """Where entries of row `row` of an array of state vectors are."""
        index = self.code.binary("add", "i64", entries.first, str(row * self.nx)) if row else entries.first
        return self.code.at(self.t.float, base, index)

    def load(self, base: str, entries: Entries, row: int = 0) -> str:
        return self.code.get(entries.type.float, self.address(base, entries, row))

    def store(self, value: str, base: str, entries: Entries, row: int = 0) -> None:
        self.code.set(entries.type.float, self.address(base, entries, row), value)

    def copy(self, source: str, target: str) -> None:
        """One state from an array to another."""
        self.runs(lambda i: self.store(self.load(source, i), target, i))

    def combination(self, weights: Array, entries: Entries, first: str | None = None) -> str:
        """The first + Σ w_j k_j, smallest index first."""
        total = first
        for j in np.flatnonzero(weights):
            total = self.plus(total, float(weights[j]), self.load("%k", entries, int(j)), entries.type)
        return total or entries.type.constant(0.0)

    def plus(self, total: str | None, w: float, k: str, t: Type) -> str:
        """The total + w k; no total counts as zero."""
        return self.code.binary("fmul", t.float, k, t.constant(w)) if total is None else self.code.fma(t, k, t.constant(w), total)

    def squares(self, values: list[Callable[[Entries], str]], *states: str) -> list[str]:
        """Σ (value / scale)² of each of the values, scale = atol + rtol |x|, x the largest of the states; of one state, not of lanes."""
        c = self.code
        sums = [c.variable("double", _hex(0.0)) for _ in values]

        def add(i: Entries) -> None:
            t = i.type
            sizes = [c.call(t.float, f"llvm.fabs.{t.name}", self.load(state, i)) for state in states]
            size = reduce(partial(c.call, t.float, f"llvm.maxnum.{t.name}"), sizes)
            scale = c.fma(t, size, c.splat(t, self.number("rtol")), c.splat(t, self.number("atol")))
            for total, value in zip(sums, values, strict=True):
                for part in c.lanes(t, c.binary("fdiv", t.float, value(i), scale)):
                    c.set("double", total, c.fma(self.t, part, part, c.get("double", total)))

        self.runs(add)
        return [c.get("double", total) for total in sums]

    def root_mean(self, square: str) -> str:
        """The root of the mean over nx entries."""
        return self.code.call("double", "llvm.sqrt.f64", self.code.binary("fmul", "double", square, _hex(1.0 / self.nx)))

    # --- the right-hand side ---

    def evaluate(self, time: str, state: str | Callable[[Entries], str], row: int, following: Array | None = None) -> None:
        """k_row = f(time, state), the state an array or a function of the entries.

        following: weights of the state after it, for which `moved` then finds all but the share of k_row summed up.
        """
        self.each(lambda i: self.store(self.load(state, i) if isinstance(state, str) else state(i), self.x, i))
        if following is not None and following[:row].any():  # here the processor does it while it waits for f
            self.runs(lambda i: self.store(self.combination(following[:row], i), self.known, i))
        self.call(time)
        # What f stored entry by entry has to be loaded so as well: more at a time would wait for the stores to reach the cache.
        self.each(lambda i: self.store(self.load(self.dx, i), "%k", i, row))

    def call(self, time: str) -> None:
        """dx = f(time, x), in the slots of f."""
        c, slots = self.code, self.f.slots
        for name, value in (("t", time), ("h", self.number("h"))):
            if ("in", name, 0) in slots:
                c.set(self.t.float, c.at(self.t.float, self.fs, slots["in", name, 0]), c.splat(self.t, value))
        c.lines += self.f.calls(self.fs)
        self.count("evaluations")

    def moved(self, weights: Array, h: str) -> Callable[[Entries], str]:
        """x + h Σ w_j k_j up to the newest k_j, the sum of the others known from its evaluation's `following`."""

        def at(i: Entries) -> str:
            newest, t = np.zeros_like(weights), i.type
            newest[-1] = weights[-1]
            change = self.combination(newest, i, self.load(self.known, i) if weights[:-1].any() else None)
            return self.code.fma(t, change, self.code.splat(t, h), self.load("%x", i))

        return at

    def projected(self, array: str) -> None:
        """An array of one state, put back on its side conditions."""
        if self.project is None:
            return
        c, slots = self.code, self.project.slots
        base, result = (c.at(self.t.float, self.ps, slots[k]) for k in (("in", "x", 0), ("out", "x", 0)))
        self.copy(array, base)
        c.lines += self.project.calls(self.ps)
        self.copy(result, array)

    def trusted(self) -> str:
        """i1: the last derivative taken is finite, and every guard of its evaluation is positive, in all lanes."""
        c, t = self.code, self.t
        total = c.variable(t.float, t.constant(0.0))

        def add(i: Entries) -> None:
            c.set(t.float, total, c.fma(t, self.load(self.dx, i), t.constant(0.0), c.get(t.float, total)))

        if self.shown is None:
            self.each(add)
        else:
            for k in self.shown:
                add(Entries(str(k), t))
        good = c.value(f"fcmp oeq {t.float} {c.get(t.float, total)}, {t.constant(0.0)}")
        for i in dict.fromkeys(self.f.guards):
            guard = c.get(t.float, c.at(t.float, self.fs, self.f.slots[i]))
            finite = c.value(f"fcmp olt {t.float} {guard}, {t.constant(float('inf'))}")
            good = c.binary("and", t.bool, c.binary("and", t.bool, good, finite), c.value(f"fcmp ogt {t.float} {guard}, {t.constant(0.0)}"))
        if t.lanes == 1:
            return good
        return c.value(f"icmp eq i{t.lanes} {c.value(f'bitcast {t.bool} {good} to i{t.lanes}')}, -1")

    # --- the header ---

    def number(self, name: str) -> str:
        return self.code.get("double", self.header[name])

    def put(self, name: str, value: str) -> None:
        self.code.set("double", self.header[name], value)

    def count(self, name: str) -> None:
        self.put(name, self.code.binary("fadd", "double", self.number(name), _hex(1.0)))

    # --- the loop ---

    def _advance(self) -> None:
        c, m, t = self.code, self.m, self.t
        for i, name in enumerate(HEADER):
            c.add(f"{self.header[name]} = getelementptr double, ptr %header, i64 {i}")
        self.fs, self.known, self.ps = "%f.slots", "%known", "%project.slots"
        arrays = [(self.fs, self.f.size), (self.known, self.nx)]
        arrays += [(self.ps, self.project.size)] if self.project else []
        arrays += [("%x.new", self.nx)] if m.errors else []
        start = rows(m) * self.nx
        for name, size in arrays:
            place = f"getelementptr {t.float}, ptr %k, i64 {start}" if self.large else f"alloca {t.float}, i64 {size}, align {8 * t.lanes}"
            c.allocations.append(f"  {name} = {place}")
            start += size
        self.x, self.dx = (c.at(t.float, self.fs, self.f.slots[key]) for key in (("in", "x", 0), ("out", "dx", 0)))
        self.xnew = "%x.new" if m.errors else self.x
        for i in range(self.f.program.inputs.get("held", 0)):
            held = c.get(t.float, c.at(t.float, "%held", i))
            c.set(t.float, c.at(t.float, self.fs, self.f.slots["in", "held", 0] + i), held)

        # The first derivative, once.
        with c.when(c.value(f"fcmp oeq double {self.number('started')}, {_hex(0.0)}")):
            self.evaluate(self.number("t"), "%x", 0)
            with c.when(c.value(f"icmp eq i1 {self.trusted()}, false")):
                c.leave("i64", str(NOT_FINITE))
            self.put("started", _hex(1.0))
        if not m.errors:
            self.each(lambda i: self.store(self.load("%k", i), self.dx, i))
        else:
            unknown = c.value(f"fcmp oeq double {self.number('h')}, {_hex(0.0)}")
            ahead = c.value(f"fcmp olt double {self.number('t')}, {self.number('t_end')}")
            with c.when(c.binary("and", "i1", unknown, ahead)):
                self._first_step()

        left = c.variable("i64", "%budget")
        with c.repeat(lambda: c.value(f"fcmp olt double {self.number('t')}, {self.number('t_end')}")):
            full = c.binary(
                "and", "i1", self._recording(), c.value(f"icmp sge i64 {self._row()}, {c.binary('sub', 'i64', '0', '%ntimes')}")
            )
            with c.when(c.binary("or", "i1", full, c.value(f"icmp sle i64 {c.get('i64', left)}, 0"))):
                self._keep()
                c.leave("i64", str(PAUSED))
            c.set("i64", left, c.binary("sub", "i64", c.get("i64", left), "1"))
            (self._controlled_step if m.errors else self._equal_step)()
        c.leave("i64", str(DONE))

    def _first_step(self) -> None:
        """h: what a crude Euler step from k_0 finds safe. Section II.4."""
        c = self.code
        t, span = self.number("t"), c.binary("fsub", "double", self.number("t_end"), self.number("t"))
        tiny = _hex(1e-6)

        # h0: Euler's step changes the state by a hundredth of its size.
        d0, d1 = map(self.root_mean, self.squares([partial(self.load, "%x"), partial(self.load, "%k")], "%x"))
        smaller = c.call("double", "llvm.minnum.f64", d0, d1)
        ratio = c.binary("fdiv", "double", c.binary("fmul", "double", d0, _hex(0.01)), d1)
        still = c.value(f"fcmp olt double {smaller}, {_hex(1e-5)}")
        h0 = c.call("double", "llvm.minnum.f64", c.value(f"select i1 {still}, double {tiny}, double {ratio}"), span)

        # h1: the step's error would be a hundredth of the tolerance, judged by what Euler's step did to the derivative.
        self.each(lambda i: self.store(self.moved(np.ones(1), h0)(i), self.xnew, i))
        self.projected(self.xnew)
        self.evaluate(c.binary("fadd", "double", t, h0), self.xnew, 1)
        (square,) = self.squares([lambda i: c.binary("fsub", i.type.float, self.load("%k", i, 1), self.load("%k", i))], "%x")
        largest = c.call("double", "llvm.maxnum.f64", d1, c.binary("fdiv", "double", self.root_mean(square), h0))
        root = c.binary("fdiv", "double", _hex(0.01), largest)
        root = c.value(f"call double @llvm.pow.f64(double {root}, double {_hex(1.0 / (self.m.order + 1))})")
        flat = c.value(f"fcmp ole double {largest}, {_hex(1e-15)}")
        guess = c.call("double", "llvm.maxnum.f64", tiny, c.binary("fmul", "double", h0, _hex(1e-3)))
        h1 = c.value(f"select i1 {flat}, double {guess}, double {root}")
        # Where there is no such derivative, h0: the attempt will shrink it, or name the cause.
        h = c.call("double", "llvm.minnum.f64", h1, c.binary("fmul", "double", h0, _hex(100.0)))
        self.put("h", c.value(f"select i1 {self.trusted()}, double {h}, double {h0}"))

    def _equal_step(self) -> None:
        """Step i of `count`, from t0 + i h to t0 + (i + 1) h; the last one ends at t_end."""
        c = self.code
        h, t_old = self.number("h"), self.number("t")
        i = c.binary("fadd", "double", self.number("steps"), _hex(1.0))
        regular = c.value(f"call double @llvm.fma.f64(double {i}, double {h}, double {self.number('t0')})")
        last = c.value(f"fcmp oge double {i}, {self.number('count')}")
        t_new = c.value(f"select i1 {last}, double {self.number('t_end')}, double {regular}")
        with c.when(c.value("icmp sgt i64 %ntimes, 0")), c.when(self._wanted(t_new)):
            self._keep()  # between the ends of a step, outputs need the derivatives at both
        self._chain(t_old, h)
        self.projected(self.xnew)
        self.call(t_new)
        self._accept(t_old, t_new, h)

    def _keep(self) -> None:
        """k_0 of equal steps, which is otherwise in f's slots alone, for later; of other methods it is there."""
        if not self.m.errors:
            self.each(lambda i: self.store(self.load(self.dx, i), "%k", i))

    def _controlled_step(self) -> None:
        """One attempt; accepted where the error estimate is at most 1, then h is adapted either way."""
        c, m = self.code, self.m
        t_old = self.number("t")
        left = c.binary("fsub", "double", self.number("t_end"), t_old)
        h = c.call("double", "llvm.minnum.f64", self.number("h"), left)
        ends = c.value(f"fcmp oge double {h}, {left}")
        t_new = c.value(f"select i1 {ends}, double {self.number('t_end')}, double {c.binary('fadd', 'double', t_old, h)}")
        # Near t = 0 times can be told apart for ever: there it is the span that says what is too small.
        smallest = c.value(f"fmul double {c.call('double', 'llvm.fabs.f64', t_old)}, {_hex(16 * EPS)}")
        span = c.binary("fsub", "double", self.number("t_end"), self.number("t0"))
        floor = c.binary("fmul", "double", span, _hex(EPS**2))
        tiny = c.value(f"fcmp ule double {h}, {c.call('double', 'llvm.maxnum.f64', smallest, floor)}")
        with c.when(c.binary("and", "i1", tiny, c.value(f"xor i1 {ends}, true"))):
            c.leave("i64", str(STEP_TOO_SMALL))
        self._stages(t_old, h)
        early = any(weights[-1] for weights in m.errors)  # elsewhere f(t_new, x_new) is of no use to a rejected step
        if early:
            self.evaluate(t_new, self.xnew, self.s)
        error = self._error(h)

        # h_new = h · 0.9 · error^(−1/(q + 1)), within 0.2 … 10, and no growth right after a rejection. A NaN counts as a rejection:
        # no comparison holds for it, and of it and another number maxnum gives the other.
        power = c.value(f"call double @llvm.pow.f64(double {error}, double {_hex(-1.0 / (m.order + 1))})")
        factor = c.binary("fmul", "double", power, _hex(SAFETY))
        shrink = self.number("shrink")
        good = c.value(f"fcmp ole double {error}, {_hex(1.0)}")
        ceiling = c.value(f"select i1 {c.value(f'fcmp ogt double {shrink}, {_hex(0.0)}')}, double {_hex(1.0)}, double {_hex(GROW)}")
        ceiling = c.value(f"select i1 {good}, double {ceiling}, double {_hex(1.0)}")
        factor = c.call("double", "llvm.minnum.f64", c.call("double", "llvm.maxnum.f64", factor, _hex(SHRINK)), ceiling)
        self.put("shrink", c.value(f"select i1 {good}, double {_hex(0.0)}, double {_hex(1.0)}"))
        # The last step may have been cut short: what it says about h does not count then.
        wanted = c.binary("fmul", "double", h, factor)
        cut = c.binary("and", "i1", ends, good)
        self.put("h", c.value(f"select i1 {cut}, double {self.number('h')}, double {wanted}"))
        with c.when(c.value(f"xor i1 {good}, true")):
            self.count("rejected")
        with c.when(good):
            if self.project:
                self.projected(self.xnew)
            if self.project or not early:
                self.evaluate(t_new, self.xnew, self.s)
            self._accept(t_old, t_new, h)

    def _stages(self, t_old: str, h: str) -> None:
        """k_1 … k_{s−1} and x_new, all derivatives kept."""
        c, m = self.code, self.m
        weights = [*(m.a[i, :i] for i in range(1, self.s)), m.b]  # of the states at which k_1 … k_{s−1} are taken, and of x_new
        for i in range(1, self.s):
            time = c.value(f"call double @llvm.fma.f64(double {h}, double {_hex(float(m.c[i]))}, double {t_old})")
            self.evaluate(time, self.moved(weights[i - 1], h), i, following=weights[i])
        self.each(lambda i: self.store(self.moved(m.b, h)(i), self.xnew, i))

    def _chain(self, t_old: str, h: str) -> None:
        """x_new of equal steps: each derivative stays in f's slots until the next, and Σ b_j k_j is a running sum."""
        c, m, t = self.code, self.m, self.t
        step = c.splat(t, h)
        for j in range(self.s):
            last, following = j == self.s - 1, 0.0 if j == self.s - 1 else float(m.a[j + 1, j])

            def move(i: Entries, j: int = j, last: bool = last, following: float = following) -> None:
                k = self.load(self.dx, i)
                total = self.plus(self.load(self.known, i) if j else None, float(m.b[j]), k, t)
                if not last:
                    self.store(total, self.known, i)
                self.store(c.fma(t, total if last else self.plus(None, following, k, t), step, self.load("%x", i)), self.x, i)

            self.each(move)
            if not last:
                self.call(c.value(f"call double @llvm.fma.f64(double {h}, double {_hex(float(m.c[j + 1]))}, double {t_old})"))

    def _error(self, h: str) -> str:
        """The error of a step in units of the tolerance: the root mean square over the entries."""
        c = self.code
        squares = self.squares([partial(self.combination, weights) for weights in self.m.errors], "%x", self.xnew)
        if len(squares) == 1:
            return c.binary("fmul", "double", self.root_mean(squares[0]), h)
        # DOP853: err5² / sqrt(err5² + 0.01 err3²), section II.10.
        e5, e3 = squares
        both = c.value(f"call double @llvm.fma.f64(double {e3}, double {_hex(0.01)}, double {e5})")
        root = c.value(f"call double @llvm.sqrt.f64(double {c.binary('fdiv', 'double', both, _hex(1.0 / self.nx))})")
        ratio = c.binary("fdiv", "double", e5, root)
        zero = c.value(f"fcmp oeq double {both}, {_hex(0.0)}")
        return c.binary("fmul", "double", c.value(f"select i1 {zero}, double {_hex(0.0)}, double {ratio}"), h)

    def _accept(self, t_old: str, t_new: str, h: str) -> None:
        """Outputs within the step, then the new state becomes the old."""
        c = self.code
        with c.when(c.value(f"icmp eq i1 {self.trusted()}, false")):
            c.leave("i64", str(NOT_FINITE))
        prepared = c.variable("i1", "false")
        with c.when(c.value("icmp sgt i64 %ntimes, 0")), c.repeat(lambda: self._wanted(t_new)):
            time = c.get("double", c.at("double", "%times", self._row()))
            row = self._place()
            at_end = c.value(f"fcmp oge double {time}, {t_new}")
            with c.when(at_end):
                self.copy(self.xnew, row)
            with c.when(c.value(f"xor i1 {at_end}, true")):
                if self.m.extra_a is not None:
                    with c.when(c.value(f"icmp eq i1 {c.get('i1', prepared)}, false")):
                        self._extra_stages(t_old, h)
                        c.set("i1", prepared, "true")
                part = c.binary("fdiv", "double", c.binary("fsub", "double", time, t_old), h)
                self._between(part, h, row)
                self.projected(row)
            self.count("next")
        with c.when(self._recording()):
            c.set("double", c.at("double", "%times", self._row()), t_new)
            self.copy(self.xnew, self._place())
            self.count("next")
        self.copy(self.xnew, "%x")
        if self.m.errors:
            self.each(lambda i: self.store(self.load("%k", i, self.s), "%k", i))
        self.put("t", t_new)
        self.count("steps")

    def _recording(self) -> str:
        """i1: every step is kept."""
        return self.code.value("icmp slt i64 %ntimes, 0")

    def _row(self) -> str:
        """i64: the first row of times and out that is not yet reached."""
        return self.code.value(f"fptosi double {self.number('next')} to i64")

    def _place(self) -> str:
        """That row of out."""
        return self.code.at(self.t.float, "%out", self.code.binary("mul", "i64", self._row(), str(self.nx)))

    def _wanted(self, t_new: str) -> str:
        """i1: there is an output time left, and it lies within the step."""
        c, i = self.code, self._row()
        more = c.value(f"icmp slt i64 {i}, %ntimes")
        safe = c.value(f"select i1 {more}, i64 {i}, i64 0")
        inside = c.value(f"fcmp ole double {c.get('double', c.at('double', '%times', safe))}, {t_new}")
        return c.binary("and", "i1", more, inside)

    def _between(self, part: str, h: str, row: str) -> None:
        """The state at t_old + part · h."""
        c = self.code

        def at(i: Entries) -> None:
            t, F = i.type, i.type.float
            s, step = c.splat(t, part), c.splat(t, h)
            rest = c.binary("fsub", F, t.constant(1.0), s)
            x, new = self.load("%x", i), self.load(self.xnew, i)
            difference = c.binary("fsub", F, new, x)
            last = self.load("%k", i, self.s) if self.m.errors else self.load(self.dx, i)
            start, end = (c.binary("fmul", F, k, step) for k in (self.load("%k", i), last))
            # Both are x + s (Δ + (1 − s) (b₀ + s (b₁ + (1 − s) (b₂ + …)))): II.6.
            first = c.binary("fsub", F, start, difference)
            second = c.binary("fsub", F, c.binary("fsub", F, c.binary("fmul", F, difference, t.constant(2.0)), start), end)
            tail = [difference, first, second]
            if self.m.dense is not None:
                tail += [c.binary("fmul", F, self.combination(w, i), step) for w in self.m.dense]
            value = tail[-1]
            for n in reversed(range(len(tail) - 1)):
                value = c.fma(t, value, rest if n % 2 == 0 else s, tail[n])
            self.store(c.fma(t, value, s, x), row, i)

        self.runs(at)

    def _extra_stages(self, t_old: str, h: str) -> None:
        """The further derivatives that dense output of high order needs."""
        c, m = self.code, self.m
        assert m.extra_a is not None
        assert m.extra_c is not None
        for n, (weights, node) in enumerate(zip(m.extra_a, m.extra_c, strict=True)):

            def state(i: Entries, weights: Array = weights) -> str:
                return c.fma(i.type, self.combination(weights, i), c.splat(i.type, h), self.load("%x", i))

            time = c.value(f"call double @llvm.fma.f64(double {h}, double {_hex(float(node))}, double {t_old})")
            self.evaluate(time, state, self.s + 1 + n)


def _hex(x: float) -> str:
    return Type(1).constant(x)
