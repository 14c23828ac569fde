"""exp, log, tanh and pow in LLVM IR: the same instructions for scalars and for SIMD vectors of any width, in either precision.

Each reduces its argument, carries the rounding of the reduction along, and evaluates a polynomial there. The polynomials interpolate at
Chebyshev's nodes, fitted in 60 digits; their errors stay below 2⁻⁵⁷ (2⁻³⁰ in single precision) of the result. Reductions are the classical
ones (Muller, Elementary Functions, chapters 5, 9 and 11). Errors, measured against 60 digits, stay below 1 ulp: tanh and pow carry
their last steps in two parts. Special cases are those of C99, annex F.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ...arithmetic.operations import OPERATIONS
from .code import Code
from .types import Type
from .value import Value, fma, polynomial, select

FUNCTIONS = {op.name: op.arity for op in OPERATIONS.values() if op.writer}  # name → arguments


@dataclass(frozen=True)
class Format:
    """What a function needs to know of its floating-point numbers."""

    mantissa: int  # bits stored
    ln2: tuple[float, float]  # the number nearest to it, and to what is left
    ln2_short: tuple[float, float]  # the first with so few bits that its products with exponents are exact
    exp_range: tuple[float, float]  # beyond, eˣ is 0 or ∞
    tanh_end: float  # beyond, tanh x rounds to 1
    exp: tuple[float, ...]  # eʳ = 1 + r + r² P(r), |r| ≤ ½ ln 2
    log: tuple[float, ...]  # log((1 + s)/(1 − s)) = 2 s + s z Q(z), z = s², (1 + s)/(1 − s) in [√½, √2]

    @property
    def bias(self) -> int:
        """Of the exponent."""
        return 1023 if self.mantissa == 52 else 127

    @property
    def magic(self) -> float:
        """1.5 · 2^mantissa: adding it rounds to whole numbers, which the lowest bits of the sum then hold."""
        return 1.5 * 2.0**self.mantissa


FORMAT_DOUBLE = Format(
    52,
    (0.6931471805599453, 2.3190468138462996e-17),
    (0.693147180559663, 2.8235290563031577e-13),
    (-800.0, 800.0),
    22.0,
    (
        0.5,
        0.1666666666666667,
        0.04166666666666667,
        0.008333333333326112,
        0.001388888888888373,
        0.0001984126987490126,
        2.4801587325605324e-05,
        2.7557255297969643e-06,
        2.755727357010214e-07,
        2.5105259538448494e-08,
        2.0914717341716378e-09,
    ),
    (
        0.666666666666667,
        0.39999999999899444,
        0.2857142862600327,
        0.22222211130259878,
        0.18182889455674947,
        0.15331710618210773,
        0.14616585424888623,
    ),
)
FORMAT_SINGLE = Format(
    23,
    (0.6931471824645996, -1.9046542121259336e-09),
    (0.693145751953125, 1.428606765330187e-06),
    (-150.0, 130.0),
    10.0,
    (0.5, 0.166666672, 0.041666463, 0.00833331048, 0.00139336858, 0.000198910304),
    (0.666666687, 0.400001228, 0.285508156, 0.233305827),
)
# pow: Q(z) = 2/3 + z Q₂(z), with 2/3 in two parts.
TWO_THIRDS = (2 / 3, 3.700743415417188e-17)
LOG_TAIL = (
    0.4,
    0.28571428571429364,
    0.22222222221655885,
    0.18181818335392802,
    0.1538459496251843,
    0.1333480469384731,
    0.11706236339491206,
    0.11723178623876518,
)


def format_of(t: Type) -> Format:
    """The format of a type's scalars."""
    return FORMAT_DOUBLE if t.bits == 64 else FORMAT_SINGLE


# --- the functions ------------------------------------------------------------------------------------------------------


def _bits(f: Format, x: float) -> int:
    return int(np.float64(x).view(np.int64)) if f.mantissa == 52 else int(np.float32(x).view(np.int32))


def _reduced(f: Format, x: Value, low: Value | None = None) -> tuple[Value, Value, Value]:
    """The whole number k (an integer), and r + t = x + low − k ln 2 with |r| ≤ ½ ln 2."""
    shifted = fma(x, 1 / math.log(2), f.magic)
    k = shifted - f.magic
    first = fma(-k, f.ln2[0], x)  # exact
    second = k * f.ln2[1]
    r = first - second
    t = (first - r) - second
    if low is not None:
        t = t + low
        r, before = r + t, r
        t = (before - r) + t
    return shifted.bits - _bits(f, f.magic), r, t


def _power_of_two(f: Format, k: Value) -> Value:
    return ((k + f.bias) << f.mantissa).number


def _exp(f: Format, x: Value, low: Value | None = None) -> Value:
    """e^(x + low). Two factors for 2ᵏ: it may overflow or be subnormal where the result is neither."""
    x = x.intrinsic("minimum", f.exp_range[1]).intrinsic("maximum", f.exp_range[0])
    k, r, t = _reduced(f, x, low)
    y = 1.0 + (r + fma(r * r, polynomial(r, f.exp), t))
    half = k >> 1
    return y * _power_of_two(f, half) * _power_of_two(f, k - half)


def exp(t: Type, x: Value) -> Value:
    """eˣ."""
    return _exp(format_of(t), x)


def _scaled(f: Format, x: Value) -> tuple[Value, Value]:
    """k, as a float, and m in [√½, √2) with x = 2ᵏ m, for a positive and finite x."""
    tiny = x < 2.0 ** (1 - f.bias)
    bits = select(tiny, x * 2.0 ** (f.mantissa + 2), x).bits
    k = (bits - _bits(f, math.sqrt(0.5))) >> f.mantissa
    m = (bits - (k << f.mantissa)).number
    whole = (k + _bits(f, f.magic)).number - f.magic
    return select(tiny, whole - float(f.mantissa + 2), whole), m


def _log_specials(x: Value, y: Value) -> Value:
    """y, but for x = ∞ or NaN: x; for 0: −∞; for what is negative: NaN."""
    y = select(x < math.inf, y, x)
    y = select(x < 0.0, math.nan, y)
    return select(x.equals(0.0), -math.inf, y)


def log(t: Type, x: Value) -> Value:
    """The natural logarithm: with f = m − 1, log m = f − (f²/2 − s (f²/2 + R)), where s = f/(2 + f), R = z Q(z)."""
    form = format_of(t)
    k, m = _scaled(form, x)
    f = m - 1.0
    s = f / (2.0 + f)
    z = s * s
    half = 0.5 * f * f
    rest = fma(s, fma(z, polynomial(z, form.log), half), k * form.ln2_short[1])
    return _log_specials(x, fma(k, form.ln2_short[0], -((half - rest) - f)))


def tanh(t: Type, x: Value) -> Value:
    """e/(e + 2) with e = e^(2|x|) − 1, both in two parts."""
    f = format_of(t)
    a = abs(x).intrinsic("minimum", f.tanh_end)
    k, r, t2 = _reduced(f, a + a)
    # e^r − 1 = u + v
    c = fma(r * r, polynomial(r, f.exp), t2)
    u = r + c
    v = c - (u - r)
    # e = 2ᵏ (u + v) + (2ᵏ − 1) = high + low
    scale = _power_of_two(f, k)
    whole = scale - 1.0
    high = fma(scale, u, whole)
    low = fma(scale, v, fma(scale, u, whole - high))
    # e + 2 = d + lost
    d = high + 2.0
    back = d - high
    lost = (high - (d - back)) + (2.0 - back) + low
    inverse = 1.0 / d
    q = high * inverse
    rest = fma(-q, d, high) + fma(-q, lost, low)
    return fma(rest, inverse, q).intrinsic("copysign", x)


def pow(t: Type, x: Value, y: Value) -> Value:
    """xʸ as e^(y log|x|), the logarithm and the product in two parts; special cases as in C99 (annex F.10.4.4)."""
    f = FORMAT_DOUBLE
    a = abs(x)
    k, m = _scaled(f, a)
    # s + s2 = (m − 1)/(m + 1)
    above, below = m - 1.0, m + 1.0
    lost = m - (below - 1.0)
    inverse = 1.0 / below
    s = above * inverse
    s2 = fma(-s, lost, fma(-s, below, above)) * inverse
    # z + z2 = s², w + w2 = s³, q + q2 = Q(z)
    z = s * s
    z2 = fma(s + s, s2, fma(s, s, -z))
    w = s * z
    w2 = fma(s, z2, fma(s2, z, fma(s, z, -w)))
    tail = z * polynomial(z, LOG_TAIL)
    q = tail + TWO_THIRDS[0]
    q2 = (tail - (q - TWO_THIRDS[0])) + TWO_THIRDS[1]
    # log m = 2 (s + s2) + (w + w2)(q + q2), the larger part first
    p = w * q
    p2 = fma(w2, q, fma(w, q2, fma(w, q, -p)))
    h = fma(s, 2.0, p)
    l = (fma(s, 2.0, -h) + p) + fma(s2, 2.0, p2)
    # + k ln 2, whose first part is exact and, where k is not 0, larger
    start = k * f.ln2_short[0]
    high = start + h
    back = high - start
    low = (start - (high - back)) + (h - back) + fma(k, f.ln2_short[1], l)
    high, before = high + low, high
    low = (before - high) + low
    high = _log_specials(a, high)
    # y log|x|
    e = y * high
    e2 = fma(y, low, fma(y, high, -e))
    e2 = select(abs(e) < 1000.0, e2, 0.0)
    size = _exp(f, e, e2)
    size = select(a.equals(1.0) | y.equals(0.0), 1.0, size)
    # Signs: an odd power keeps that of x; what is no whole number has no real power of a negative x.
    half = y * 0.5
    whole = y.equals(y.intrinsic("rint"))
    odd = whole & half.compare("one", half.intrinsic("rint"))
    result = select(odd, size.intrinsic("copysign", x), size)
    result = select((x < 0.0) & (x > -math.inf) & ~whole, math.nan, result)
    unknown = x.compare("uno", y) & y.compare("une", 0.0) & x.compare("une", 1.0)
    return select(unknown, math.nan, result)


WRITERS: dict[str, Callable[..., Value]] = {"exp": exp, "log": log, "tanh": tanh, "pow": pow}


def definition(t: Type, name: str) -> Iterator[str]:
    """define @name.lanes(x, …)."""
    wide = t.widened() if name == "pow" else t
    code, names = Code(), [f"%a{i}" for i in range(FUNCTIONS[name])]
    arguments = [Value(code, t, "float", a) for a in names]
    result = WRITERS[name](wide, *(x if wide is t else x.widened() for x in arguments)).rounded(t)
    code.leave(t.float, result)
    yield from code.function(f"define internal {t.float} @{name}.lanes({', '.join(f'{t.float} {a}' for a in names)}) noinline nounwind")
