"""The contract of a native method: a class that writes the code of one step. The loop around it (`integrate`) knows no method.

The defaults are those of a method of one derivative a step: f at its start is row 0 of `k`, f at its end is what the right-hand side
left at `dx`, and outputs in between lie on the cubic through both. Such a method, explicit or implicit, has to write `step` alone.
Hairer, Nørsett, Wanner, Solving ODEs I: sections II.4 (error control), II.6 (dense output).
"""

from functools import partial

import numpy as np

from .value import Value, fma, select
from .vectors import Entries, Vectors


class Stepper:
    """How a method steps. Every function writes code by `v`, and is called once or twice for a module."""

    order: int | None = None  # of the error estimate; None: equal steps, whose number the header's `count` tells
    calls = 2  # of the right-hand side that `step` and `arrive` write: they decide whether each takes it in
    rows = 1  # vectors in `k`, which are kept from one call of `advance` to the next
    prepares = False  # whether outputs within a step need more than its new state and the derivatives at both ends
    in_place = False  # whether the new state is made where the right-hand side reads it

    def init(self, v: Vectors) -> None:
        """The derivative at the start of an integration, taken last, to be seen whether it can be trusted."""
        v.evaluate(v.header["t"], v.x)

    def first_step(self, v: Vectors) -> Value:
        """With error control: the first h [s], what a crude Euler step from k_0 finds safe; it takes a second row of `k`. Section II.4."""
        assert self.order is not None
        t = v.header["t"]
        span = v.header["t_end"] - t

        # h0: Euler's step changes the state by a hundredth of its size.
        d0, d1 = map(v.root_mean, v.squares([partial(v.load, v.x), partial(v.load, v.k)], v.x))
        smaller = d0.smaller(d1)
        ratio = d0 * 0.01 / d1
        h0 = select(smaller < 1e-5, 1e-6, ratio).smaller(span)

        # h1: the step's error would be a hundredth of the tolerance, judged by what Euler's step did to the derivative.
        v.put(v.moved(np.ones(1), h0), v.new)
        v.projected(v.new)
        v.evaluate(t + h0, v.new, 1)
        (square,) = v.squares([lambda i: v.load(v.k, i, 1) - v.load(v.k, i)], v.x)
        largest = d1.larger(v.root_mean(square) / h0)
        root = (0.01 / largest).intrinsic("pow", 1.0 / (self.order + 1))
        flat = largest <= 1e-15
        h1 = select(flat, h0.like(1e-6).larger(h0 * 1e-3), root)
        # Where there is no such derivative, h0: the attempt will shrink it, or name the cause.
        h = h1.smaller(h0 * 100.0)
        return select(v.trusted(), h, h0)

    def enter(self, v: Vectors) -> None:
        """What an `advance` begins with, the derivatives in `k` being known."""

    def leave(self, v: Vectors) -> None:
        """Before `advance` returns in mid-course, and before a step in which outputs are wanted: what `k` must hold then."""

    def step(self, v: Vectors, t_old: Value, t_new: Value, h: Value) -> Value | None:
        """The state at `v.new` from that at `v.x`; its error in units of the tolerance where the method estimates one.

        An error above 1, or NaN, rejects the step: t and `v.x` then are what they were, and h is smaller.
        """
        raise NotImplementedError(f"{type(self).__name__} has no step")

    def arrive(self, v: Vectors, t_new: Value) -> None:
        """The derivative at `v.new`, the step being accepted and on its side conditions: taken last, to be checked as in `init`."""
        v.put(v.new, v.argument)
        v.call(t_new)

    def prepare(self, v: Vectors, t_old: Value, h: Value) -> None:
        """What outputs within the step need beside, where `prepares`: run before the first of them."""

    def derivatives(self, v: Vectors, i: Entries) -> tuple[Value, Value]:
        """Entries of f at both ends of the step."""
        last = v.load(v.dx, i)
        return v.load(v.k, i), last

    def terms(self, v: Vectors, i: Entries, h: Value) -> list[Value]:
        """Terms of the state in between behind those of the cubic, see `between`."""
        return []

    def between(self, v: Vectors, part: Value, h: Value, row: str) -> None:
        """The state at t_old + part · h, at the address `row`."""

        def at(i: Entries) -> None:
            s, step = part.splat(i.type), h.splat(i.type)
            rest = 1.0 - s
            x, new = v.load(v.x, i), v.load(v.new, i)
            difference = new - x
            start, end = (k * step for k in self.derivatives(v, i))
            # x + s (Δ + (1 − s) (b₀ + s (b₁ + (1 − s) (b₂ + …)))): section II.6.
            first = start - difference
            second = difference * 2.0 - start - end
            terms = [difference, first, second, *self.terms(v, i, step)]
            value = terms[-1]
            for n in reversed(range(len(terms) - 1)):
                value = fma(value, rest if n % 2 == 0 else s, terms[n])
            v.store(fma(value, s, x), row, i)

        v.runs(at)

    def advanced(self, v: Vectors) -> None:
        """The end of a step becomes the start of the next; the state itself is moved already."""
        v.put(v.dx, v.k)
