"""Explicit Runge-Kutta methods in native code, from their tableaus. Hairer, Nørsett, Wanner, Solving ODEs I, chapter II."""

from functools import partial

from .stepper import Stepper
from .tableau import Tableau
from .value import Value, fma, select
from .vectors import Entries, Vectors, plus


class EqualSteps(Stepper):
    """A chain: each derivative stays in f's slots until the next, and Σ b_j k_j is a running sum."""

    in_place = True

    def __init__(self, method: Tableau) -> None:
        self.m, self.calls = method, len(method.b) + 1

    def enter(self, v: Vectors) -> None:
        """The derivative at t, in the slots."""
        v.put(v.k, v.dx)

    def leave(self, v: Vectors) -> None:
        """The derivative at t, which is otherwise in the slots alone."""
        v.put(v.dx, v.k)

    def step(self, v: Vectors, t_old: Value, t_new: Value, h: Value) -> None:
        """The stages, each state in the place of the one before."""
        m, step = self.m, h.splat(v.t)
        for j, b in enumerate(m.b):
            last = j + 1 == len(m.b)

            def move(i: Entries, j: int = j, b: float = b, last: bool = last) -> None:
                k = v.load(v.dx, i)
                total = plus(v.load(v.known, i) if j else None, float(b), k)
                if not last:
                    v.store(total, v.known, i)
                v.store(fma(total if last else k * float(m.a[j + 1, j]), step, v.load(v.x, i)), v.argument, i)

            v.each(move)
            if not last:
                v.call(fma(h, float(m.c[j + 1]), t_old))

    def arrive(self, v: Vectors, t_new: Value) -> None:
        """The new state is where f reads it."""
        v.call(t_new)

    def advanced(self, v: Vectors) -> None:
        """The derivative stays where it is."""


class Controlled(Stepper):
    """All derivatives of a step are kept, for the error estimate and the dense output."""

    def __init__(self, method: Tableau) -> None:
        self.m, self.s, self.order = method, len(method.b), method.order
        self.rows = self.calls = self.s + 1 + (0 if method.extra_c is None else len(method.extra_c))
        self.prepares = method.extra_a is not None
        # Elsewhere f(t_new, x_new) is of no use to a rejected step.
        self._early = any(weights[-1] for weights in method.errors)

    def step(self, v: Vectors, t_old: Value, t_new: Value, h: Value) -> Value:
        """k_1 … k_{s−1} and the new state; where the error needs it, k_s."""
        m = self.m
        weights = [*(m.a[i, :i] for i in range(1, self.s)), m.b]  # of the states at which k_1 … k_{s−1} are taken, and of x_new
        for i in range(1, self.s):
            v.evaluate(fma(h, float(m.c[i]), t_old), v.moved(weights[i - 1], h), i, following=weights[i])
        v.put(v.moved(m.b, h), v.new)
        if self._early:
            v.evaluate(t_new, v.new, self.s)
        return self._error(v, h)

    def _error(self, v: Vectors, h: Value) -> Value:
        """The root mean square over the entries."""
        squares = v.squares([partial(v.combination, weights) for weights in self.m.errors], v.x, v.new)
        if len(squares) == 1:
            return v.root_mean(squares[0]) * h
        # DOP853: err5² / sqrt(err5² + 0.01 err3²), section II.10.
        e5, e3 = squares
        both = fma(e3, 0.01, e5)
        ratio = e5 / (both / (1.0 / v.nx)).intrinsic("sqrt")
        return select(both.equals(0.0), 0.0, ratio) * h

    def arrive(self, v: Vectors, t_new: Value) -> None:
        """k_s."""
        if v.constrained or not self._early:
            v.evaluate(t_new, v.new, self.s)

    def prepare(self, v: Vectors, t_old: Value, h: Value) -> None:
        """The further derivatives that dense output of high order needs."""
        m = self.m
        assert m.extra_a is not None
        assert m.extra_c is not None
        for n, (weights, node) in enumerate(zip(m.extra_a, m.extra_c, strict=True)):
            state = lambda i, weights=weights: fma(v.combination(weights, i), h.splat(i.type), v.load(v.x, i))  # noqa: E731
            v.evaluate(fma(h, float(node), t_old), state, self.s + 1 + n)

    def derivatives(self, v: Vectors, i: Entries) -> tuple[Value, Value]:
        """k_0 and k_s."""
        last = v.load(v.k, i, self.s)
        return v.load(v.k, i), last

    def terms(self, v: Vectors, i: Entries, h: Value) -> list[Value]:
        """Those of the tableau."""
        return [] if self.m.dense is None else [v.combination(w, i) * h for w in self.m.dense]

    def advanced(self, v: Vectors) -> None:
        """k_s becomes k_0."""
        v.each(lambda i: v.store(v.load(v.k, i, self.s), v.k, i))


def stepper(method: Tableau) -> Stepper:
    """Equal steps, or with an error estimate error control."""
    return Controlled(method) if method.errors else EqualSteps(method)
