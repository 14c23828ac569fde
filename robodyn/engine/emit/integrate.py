"""The step loop in native code: `advance`, around whichever method.

A program computes dx = ẋ from t and x; another may put x back on its side conditions. One function advances the state until it is
done or a budget of steps is used up, so that Python can show progress and take Ctrl-C in between. A method is a tableau, as data, or
any other `Stepper`, which writes the code of one step.
"""

from collections.abc import Iterator

from ...arithmetic import EPS, Array
from ..trace.layout import Looped
from ..trace.program import Program
from . import parts, runge_kutta
from .code import Code
from .header import HEADER
from .stepper import Stepper
from .tableau import Tableau
from .types import INTRINSICS, Type
from .value import ONE, Memory, Value, Variable, constant, fma, select
from .vectors import WIDTHS, Vectors

DONE, PAUSED, STEP_TOO_SMALL, NOT_FINITE = range(4)  # what `advance` returns
STATUSES = 4

ON_STACK = 4000  # entries of the workspace up to which it is on the stack, from where LLVM lifts it into registers
INLINED = 3000  # operations of the right-hand side, times its calls, up to which each call takes it in

SAFETY, SHRINK, GROW = 0.9, 0.2, 10.0  # of the step size control, as in SciPy


def module(method: Tableau | Stepper, rhs: Program | Looped, project: Program | Looped | None, lanes: int) -> str:
    """IR text with `i64 @advance(ptr header, ptr x, ptr k, ptr held, ptr times, i64 ntimes, ptr out, i64 budget)`.

    header: see HEADER. x: nx entries; k: room for `room(…)` entries; held: the rhs's input of that name, where it has one;
    out: ntimes × nx. An entry is a double, or `lanes` of them. Negative ntimes: the ends of steps go to times and out, which the steps
    fill one by one from row `next` on; `advance` pauses where −ntimes of them are full.

    And `i64 @advance_each(…, i64 count)`: the same for `count` headers, x and out, one behind the other, each until it is done. Returns
    how many are done, times STATUSES, plus the status of the one that is not.
    """
    return _Module(method, rhs, project, Type(lanes)).text()


def tables(rhs: Program | Looped, project: Program | Looped | None) -> dict[str, Array]:
    """What the module's code reads beside its arguments, by name."""
    return parts.tables(f=rhs, project=project)


def room(method: Tableau | Stepper, rhs: Program | Looped, project: Program | Looped | None) -> int:
    """Entries of the array k: the method's rows, and behind them the workspace of a right-hand side that is too large for the stack."""
    m = _Module(method, rhs, project, Type(1))
    return m.method.rows * m.nx + (sum(m.arrays.values()) if m.large else 0)


class _Module:
    """The functions of a module, and where their workspace lies."""

    def __init__(self, method: Tableau | Stepper, rhs: Program | Looped, project: Program | Looped | None, t: Type) -> None:
        self.method = runge_kutta.stepper(method) if isinstance(method, Tableau) else method
        self.t, self.nx = t, rhs.inputs["x"]
        self.f = parts.part(rhs, t, "f", inline=self.method.calls * rhs.length <= INLINED)
        self.project = parts.part(project, t, "project", inline=False) if project else None
        self.arrays = {"%f.slots": self.f.size, Vectors.known: self.nx}
        self.arrays |= {"%project.slots": self.project.size} if self.project else {}
        self.arrays |= {} if self.method.in_place else {"%x.new": self.nx}
        self.large = sum(self.arrays.values()) > ON_STACK

    def text(self) -> str:
        """All of it."""
        programs = [part.program for part in (self.f, self.project) if part]
        lines = [*parts.prologue(self.t, *programs), "declare double @llvm.pow.f64(double, double)"]
        # Beside the intrinsics of the programs' own type: those of entries side by side, or of the time.
        for t in (Type(width) for width in (WIDTHS[:-1] if self.t.lanes == 1 else (1,))):
            names = [name for name in INTRINSICS if self.t.lanes == 1 or name != "fma"]
            lines += [f"declare {t.float} @llvm.{name}.{t.name}({', '.join([t.float] * INTRINSICS[name])})" for name in names]
        for part in (self.f, self.project):
            lines += part.functions() if part else ()
        return "\n".join([*lines, *self._advance(), *self._advance_each()]) + "\n"

    def _advance(self) -> Iterator[str]:
        code, start = Code(), self.method.rows * self.nx
        vectors = Vectors(code, self.t, self.f, self.project, in_place=self.method.in_place)
        for name, size in self.arrays.items():
            F, lanes = self.t.float, self.t.lanes
            place = f"getelementptr {F}, ptr {vectors.k}, i64 {start}" if self.large else f"alloca {F}, i64 {size}, align {8 * lanes}"
            code.allocations.append(f"  {name} = {place}")
            start += size
        _Loop(self.method, vectors).write()
        arrays = ", ".join(f"ptr noalias %{name}" for name in ("header", "x", "k", "held", "times"))
        yield from code.function(f"define i64 @advance({arrays}, i64 %ntimes, ptr noalias %out, i64 %budget) nounwind {self.t.frame}")

    def _advance_each(self) -> Iterator[str]:
        """The loop over blocks of lanes: Python would spend longer on calling one after the other than they take."""
        c, t, rest = Code(), self.t, "ptr %times, i64 %ntimes"
        count, ntimes = (Value(c, ONE, "int", f"%{name}") for name in ("count", "ntimes"))
        i = Variable(constant(c, ONE, 0, "int"))
        with c.repeat(lambda: i.value < count):
            now = i.value
            header = Memory(c, ONE, "%header").at(now * len(HEADER))
            x = Memory(c, t, "%x").at(now * self.nx)
            out = Memory(c, t, "%out").at(now * (ntimes * self.nx))
            arguments = f"ptr {header}, ptr {x}, ptr %k, ptr %held, {rest}, ptr {out}, i64 %budget"
            status = now.new(f"call i64 @advance({arguments})")
            with c.when(status.compare("ne", DONE)):
                c.leave("i64", now * STATUSES + status)
            i.value = now + 1
        c.leave("i64", count * STATUSES)
        arrays = "ptr %header, ptr %x, ptr %k, ptr %held"
        yield from c.function(f"define i64 @advance_each({arrays}, {rest}, ptr %out, i64 %budget, i64 %count) nounwind")


class _Loop:
    """The code of `advance`: steps, their size, outputs within and at the ends of steps, the budget."""

    def __init__(self, method: Stepper, vectors: Vectors) -> None:
        self.m, self.v, self.c, self.header = method, vectors, vectors.code, vectors.header
        self._ntimes, self._budget = (Value(self.c, ONE, "int", f"%{name}") for name in ("ntimes", "budget"))
        self._times = Memory(self.c, ONE, "%times")

    def write(self) -> None:
        """All of it."""
        c, m, v, header = self.c, self.m, self.v, self.header
        with c.when(header["started"].equals(0.0)):
            m.init(v)
            self._leave_unless_trusted()
            header["started"] = 1.0
        m.enter(v)
        if m.order is not None:
            unknown = header["h"].equals(0.0)
            with c.when(unknown & (header["t"] < header["t_end"])):
                header["h"] = m.first_step(v)

        left = Variable(self._budget)
        with c.repeat(lambda: header["t"] < header["t_end"]):
            full = self._recording() & (self._row() >= -self._ntimes)
            with c.when(full | (left.value <= 0)):
                m.leave(v)
                c.leave("i64", PAUSED)
            left.value = left.value - 1
            (self._equal_step if m.order is None else self._controlled_step)()
        c.leave("i64", DONE)

    def _leave_unless_trusted(self) -> None:
        with self.c.when(~self.v.trusted()):
            self.c.leave("i64", NOT_FINITE)

    # --- a step ---

    def _equal_step(self) -> None:
        """Step i of `count`, from t0 + i h to t0 + (i + 1) h; the last one ends at t_end."""
        c, m, v, header = self.c, self.m, self.v, self.header
        h, t_old = header["h"], header["t"]
        i = header["steps"] + 1.0
        regular = fma(i, h, header["t0"])
        t_new = select(i >= header["count"], header["t_end"], regular)
        with c.when(self._ntimes > 0), c.when(self._wanted(t_new)):
            m.leave(v)  # between the ends of a step, outputs need the derivatives at both
        m.step(v, t_old, t_new, h)
        self._accept(t_old, t_new, h)

    def _controlled_step(self) -> None:
        """One attempt; accepted where the error is at most 1, then h is adapted either way."""
        c, v, header = self.c, self.v, self.header
        t_old = header["t"]
        left = header["t_end"] - t_old
        h = header["h"].smaller(left)
        ends = h >= left
        t_new = select(ends, header["t_end"], t_old + h)
        # Near t = 0 times can be told apart for ever: there it is the span that says what is too small.
        smallest = abs(t_old) * (16 * EPS)
        floor = (header["t_end"] - header["t0"]) * EPS**2
        tiny = h.compare("ule", smallest.larger(floor))
        with c.when(tiny & ~ends):
            c.leave("i64", STEP_TOO_SMALL)
        error = self.m.step(v, t_old, t_new, h)
        assert error is not None
        good = self._adapt(h, error, ends)
        with c.when(~good):
            header.count("rejected")
        with c.when(good):
            self._accept(t_old, t_new, h)

    def _adapt(self, h: Value, error: Value, ends: Value) -> Value:
        """The next step size; whether this step is good.

        h_new = h · 0.9 · error^(−1/(q + 1)), within 0.2 … 10, and no growth right after a rejection. A NaN counts as a rejection: no
        comparison holds for it, and of it and another number `larger` gives the other. Hairer, Nørsett, Wanner, Solving ODEs I, II.4.
        """
        assert self.m.order is not None
        header = self.header
        factor = error.intrinsic("pow", -1.0 / (self.m.order + 1)) * SAFETY
        shrink = header["shrink"]
        good = error <= 1.0
        ceiling = select(good, select(shrink > 0.0, h.like(1.0), GROW), 1.0)
        factor = factor.larger(SHRINK).smaller(ceiling)
        header["shrink"] = select(good, h.like(0.0), 1.0)
        # The last step may have been cut short: what it says about h does not count then.
        wanted = h * factor
        header["h"] = select(ends & good, header["h"], wanted)
        return good

    def _accept(self, t_old: Value, t_new: Value, h: Value) -> None:
        """The derivative at the new state, outputs within the step, then the new state becomes the old."""
        c, m, v, header = self.c, self.m, self.v, self.header
        v.projected(v.new)
        m.arrive(v, t_new)
        self._leave_unless_trusted()
        prepared = Variable(constant(c, ONE, False, "bool"))
        with c.when(self._ntimes > 0), c.repeat(lambda: self._wanted(t_new)):
            time = self._times[self._row()]
            row = self._place()
            at_end = time >= t_new
            with c.when(at_end):
                v.copy(v.new, row)
            with c.when(~at_end):
                if m.prepares:
                    with c.when(~prepared.value):
                        m.prepare(v, t_old, h)
                        prepared.value = True
                m.between(v, (time - t_old) / h, h, row)
                v.projected(row)
            header.count("next")
        with c.when(self._recording()):
            self._times[self._row()] = t_new
            v.copy(v.new, self._place())
            header.count("next")
        v.copy(v.new, v.x)
        m.advanced(v)
        header["t"] = t_new
        header.count("steps")

    # --- outputs ---

    def _recording(self) -> Value:
        """i1: every step is kept."""
        return self._ntimes < 0

    def _row(self) -> Value:
        """The first row of times and out that is not yet reached."""
        return self.header["next"].cast("fptosi", "int")

    def _place(self) -> str:
        """The address of that row of out."""
        return Memory(self.c, self.v.t, "%out").at(self._row() * self.v.nx)

    def _wanted(self, t_new: Value) -> Value:
        """i1: there is an output time left, and it lies within the step."""
        i = self._row()
        more = i < self._ntimes
        return more & (self._times[select(more, i, 0)] <= t_new)
