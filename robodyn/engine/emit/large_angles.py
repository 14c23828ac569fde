"""Large angles in LLVM IR: what is left of any x beyond the nearest multiple of π/2, to 100 bits.

x = m 2^E with a whole number m of 53 bits, so of the binary digits of 2/π those that only add whole turns to x · 2/π drop out, and 256 of
the others suffice: where a double comes closest to a multiple of π/2, 62 digits of the fraction are zeros (Payne, Hanek, Radian reduction
for trigonometric functions, ACM SIGNUM Newsletter 18, 1983; Muller, Elementary Functions, section 11.4).
"""

import math
from collections.abc import Iterator

from .code import Code
from .trigonometry import CIRCULAR_DOUBLE
from .value import ONE, Value, fma, give, select

LEADING = 40  # zeros before the digits of 2/π: the first that count, for x = m 2^E, are LEADING + E − 2 behind the start
SMALLEST = 2.0 ** (52 + 2 - LEADING)  # where that is the start itself
DIGITS = 1280  # with the zeros: the largest exponent needs 1265
WINDOW = 256
NAME = "two_over_pi"


def two_over_pi(digits: int) -> int:
    """⌊2/π · 2^digits⌋, with Machin's π = 16 arccot 5 − 4 arccot 239."""
    one = 1 << digits + 64

    def arccot(n: int) -> int:
        power, total, k = one // n, 0, 1
        while power:
            total += power // k if k % 4 == 1 else -(power // k)
            power //= n * n
            k += 2
        return total

    return (one << digits + 1) // (16 * arccot(5) - 4 * arccot(239))


def reduction() -> Iterator[str]:
    """define {r, t, n} @reduce_exact(x) of |x| ≥ SMALLEST: x = n π/2 + r + t, |r + t| ≤ π/4, n modulo 4; NaN where x is not finite.

    Of smaller x, which are neighbours of a large one, the answer means nothing.
    """
    number = two_over_pi(DIGITS - LEADING)
    words = ", ".join(f"i64 {number >> 64 * k & (1 << 64) - 1}" for k in range(DIGITS // 64 + 2))  # two of zeros: reads go beyond
    yield f"@{NAME} = global [{DIGITS // 64 + 2} x i64] [{words}], align 8"
    yield "declare i256 @llvm.ctlz.i256(i256, i1)"
    code = Code()
    bits, exponent, turns = _turns(Value(code, ONE, "float", "%x"))
    # The nearest whole number, and the signed fraction in units of 2^−256.
    whole = turns.binary("lshr", 254).cast("trunc", "int")
    fraction = turns << 2
    below = fraction < 0
    n = whole + below.cast("zext", "int")
    r, rest = _angle(select(below, -fraction, fraction))
    # Signs: of the fraction, and of x.
    negative = bits < 0
    turned = negative ^ below
    n = select(negative, -n, n)
    r, rest = (select(turned, -x, x) for x in (r, rest))
    known = exponent.compare("ne", 2047)
    give([select(known, r, math.nan), rest, n])
    yield from code.function("define internal {double, double, i64} @reduce_exact(double %x) noinline cold nounwind")


def _turns(x: Value) -> tuple[Value, Value, Value]:
    """The bits of x, its exponent's, and |x| · 2/π modulo 4 in units of 2^−254."""
    bits = x.bits
    e = bits.binary("lshr", 52) & 2047
    m = (bits & (1 << 52) - 1) | 1 << 52
    # The window begins with the digit that counts 2 in x · 2/π, and `a` digits follow it; E = e − 1075.
    a = DIGITS - WINDOW - LEADING + 2 + 1075 - e
    a = select(a.compare("ult", DIGITS - WINDOW), a, DIGITS - WINDOW)
    byte, bit = a.binary("lshr", 3), a & 7
    place = x.code.at("i8", f"@{NAME}", byte)
    read = x.new(f"load i320, ptr {place}, align 1", "i320")
    window = read.binary("lshr", bit.cast("zext", "i320")).cast("trunc", f"i{WINDOW}")
    return bits, e, window * m.cast("zext", f"i{WINDOW}")


def _angle(fraction: Value) -> tuple[Value, Value]:
    """(r, rest), their sum π/2 times an unsigned fraction in units of 2^−256."""
    P1, P2, _ = CIRCULAR_DOUBLE.half_pi
    zeros = fraction.new(f"call i256 @llvm.ctlz.i256(i256 {fraction}, i1 false)")
    digits = fraction << zeros
    zeros = zeros.cast("trunc", "int")

    def number(skipped: int) -> Value:
        """53 digits behind those that are skipped."""
        found = (digits << skipped).binary("lshr", WINDOW - 53).cast("trunc", "int").cast("uitofp", "float")
        return found * ((1023 - 53 - skipped - zeros) << 52).number

    high, low = number(0), number(53)
    p = high * P1
    tail = fma(low, P1, fma(high, P2, fma(high, P1, -p)))
    r = p + tail
    return r, tail - (r - p)
