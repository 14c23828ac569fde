"""sin and cos in LLVM IR, for scalars and for SIMD vectors of any width, within 1 ulp.

Reduction by multiples of π/2 (Cody and Waite) in fused multiply-adds, with the rounding of the reduced argument carried along;
then the minimax polynomials on [−π/4, π/4] of fdlibm (Sun Microsystems, 1993). Beyond |x| = 1e5 the reduction would lose
digits: such arguments take a slow path, one lane at a time, through the one of `large_angles`, which loses none.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from .code import UNLIKELY, Code
from .types import Type
from .value import Value, call, fma, give, polynomial, select, struct, undefined

EXACT_BEYOND = 1e5
TOGETHER = 8  # arguments that share one test for large ones
PAIR, FLAGGED, REDUCED = ("float", "float"), ("float", "float", "bool"), ("float", "float", "int")  # (sin, cos), …, (r, rest, n)


@dataclass(frozen=True)
class Circular:
    """Constants of sin and cos for a floating-point format."""

    half_pi: tuple[float, float, float]  # π/2 = P1 + P2 + P3 + …, each the number nearest to what is left
    sin: tuple[float, ...]  # sin r = r + r z S(z), z = r², |r| ≤ π/4
    cos: tuple[float, ...]  # cos r = 1 − z/2 + z² C(z)


CIRCULAR_DOUBLE = Circular(
    (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33),
    (
        -1.66666666666666324348e-01,
        8.33333333332248946124e-03,
        -1.98412698298579493134e-04,
        2.75573137070700676789e-06,
        -2.50507602534068634195e-08,
        1.58969099521155010221e-10,
    ),
    (
        4.16666666666666019037e-02,
        -1.38888888888741095749e-03,
        2.48015872894767294178e-05,
        -2.75573143513906633035e-07,
        2.08757232129817482790e-09,
        -1.13596475577881948265e-11,
    ),
)
# Fitted at Chebyshev's nodes in 60 digits, within 2⁻²⁸ of the result.
CIRCULAR_SINGLE = Circular(
    (1.5707963705062866, -4.371138828673793e-08, -1.7151245100058819e-15),
    (-0.166666672, 0.00833333191, -0.000198400841, 2.72496209e-06),
    (0.0416666642, -0.00138883013, 2.45476895e-05),
)


def sincos(t: Type) -> Iterator[str]:
    """define {sin, cos, large} @sincos(x), always inlined; and {sin, cos} @sincos_exact(x, sin, cos), to replace them where x is large."""
    constants = CIRCULAR_DOUBLE if t.bits == 64 else CIRCULAR_SINGLE
    yield from _of_reduced(t, constants)
    yield from _fast(t, constants)
    yield from _exact(t)


def _function(t: Type, name: str, results: tuple[str, ...], arguments: dict[str, Value], how: str) -> Iterator[str]:
    """The definition of a function whose code is written; arguments by name."""
    head = ", ".join(f"{x.type} {x}" for x in arguments.values())
    (code,) = {x.code for x in arguments.values()}
    yield from code.function(f"define internal {struct([t.of_kind(kind) for kind in results])} @{name}({head}) {how} nounwind")


def _arguments(t: Type, **kinds: str) -> dict[str, Value]:
    """Arguments of a new function, by name."""
    code = Code()
    return {name: Value(code, t, kind, f"%{name}") for name, kind in kinds.items()}


def _of_reduced(t: Type, constants: Circular) -> Iterator[str]:
    """{sin, cos} of n π/2 + r + rest."""
    arguments = _arguments(t, r="float", rest="float", n="int")
    r, rest, n = arguments.values()
    z = r * r
    # sin(r + rest) = r + (rest (1 − z/2) + r z S(z))
    s = polynomial(z, constants.sin)
    rz = r * z
    w = fma(z, z.like(-0.5), 1.0)
    sin = r + fma(rz, s, rest * w)
    # cos(r + rest) = w + ((1 − w − z/2) + (z² C(z) − r rest)), w = 1 − z/2 rounded
    c = polynomial(z, constants.cos)
    tail = fma(z * z, c, -r * rest)
    cos = w + (fma(z, -0.5, 1.0 - w) + tail)
    # Quadrants. The sign bits: bit 1 of n for the sine, of n + 1 for the cosine.
    odd = (n & 1).compare("ne", 0)
    sin, cos = select(odd, cos, sin), select(odd, sin, cos)

    def signed(x: Value, k: Value) -> Value:
        sign = (k & 2) << t.bits - 2
        return (x.bits ^ sign).number

    give([signed(sin, n), signed(cos, n + 1)])
    yield from _function(t, "sincos_reduced", PAIR, arguments, "alwaysinline")


def _fast(t: Type, constants: Circular) -> Iterator[str]:
    """{sin, cos, whether they have to be replaced} of x."""
    arguments, (P1, P2, P3) = _arguments(t, x="float"), constants.half_pi
    x = arguments["x"]
    # r + rest = x − k π/2: x − k P1 is exact, and so are the roundings of k P2 and of the difference.
    k = (x * (2 / math.pi)).intrinsic("rint")
    minus = -k
    first = fma(minus, P1, x)
    p = k * P2
    lost = fma(k, P2, -p)
    r = first - p
    rest = fma(minus, P3, ((first - r) - p) - lost)  # P3: what is left where x is all but a multiple of π/2
    # Where x is too large, n is poison, and so are results that `@sincos_exact` replaces lane by lane.
    sin, cos = call("sincos_reduced", PAIR, r, rest, k.cast("fptosi", "int"))
    give([sin, cos, _large(x)])
    yield from _function(t, "sincos", FLAGGED, arguments, "alwaysinline")


def _large(x: Value) -> Value:
    return abs(x).compare("ugt", EXACT_BEYOND)


def _exact(t: Type) -> Iterator[str]:
    """The slow path: lanes beyond the bound from their exact reduction, the others as they are."""
    arguments, one = _arguments(t, x="float", s="float", c="float"), Type(1, t.scalar)
    x, *known = arguments.values()
    large = _large(x)
    reduced = [undefined(x.code, t, kind) for kind in REDUCED]
    for i in range(t.lanes):
        r, rest, n = call("reduce_exact", REDUCED, x.lane(i).widened())
        if t.bits == 32:
            r, whole = r.rounded(one), r
            rest, n = (whole - r.widened()).rounded(one), n.rounded(one)
        reduced = [vector.with_lane(i, part) for vector, part in zip(reduced, (r, rest, n), strict=True)]
    exact = call("sincos_reduced", PAIR, *reduced)
    give([select(large, y, before) for y, before in zip(exact, known, strict=True)])
    yield from _function(t, "sincos_exact", PAIR, arguments, "noinline cold")


def sincos_together(t: Type, n: int) -> Iterator[str]:
    """define {sin, cos, …} @sincos.n(x, …) of n arguments: always inlined, with one test for large arguments and one slow path for all."""
    arguments = _arguments(t, **{f"a{k}": "float" for k in range(n)})
    xs = list(arguments.values())
    *quick, large = call("sincos", FLAGGED, xs[0])
    for x in xs[1:]:
        sin, cos, also = call("sincos", FLAGGED, x)
        quick, large = [*quick, sin, cos], large | also
    with large.code.branch(large.anywhere, UNLIKELY) as merged:
        exact = [y for k, x in enumerate(xs) for y in call("sincos_exact", PAIR, x, *quick[2 * k : 2 * k + 2])]
    give([before.named(merged(t.float, after, before)) for after, before in zip(exact, quick, strict=True)])
    yield from _function(t, f"sincos.{n}", PAIR * n, arguments, "alwaysinline")
