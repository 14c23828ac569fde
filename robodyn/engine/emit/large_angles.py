"""Large angles in LLVM IR: what is left of any x beyond the nearest multiple of π/2, to 100 bits.

x = m 2^E with a whole number m of 53 bits, so of the binary digits of 2/π those that only add whole turns to x · 2/π drop out, and 256 of
the others suffice: where a double comes closest to a multiple of π/2, 62 digits of the fraction are zeros (Payne, Hanek, Radian reduction
for trigonometric functions, ACM SIGNUM Newsletter 18, 1983; Muller, Elementary Functions, section 11.4).
"""

from collections.abc import Iterator

from .trigonometry import DOUBLE, Type

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
    c = Type(1).constant
    P1, P2, _ = DOUBLE.half_pi
    number = two_over_pi(DIGITS - LEADING)
    words = ", ".join(f"i64 {number >> 64 * k & (1 << 64) - 1}" for k in range(DIGITS // 64 + 2))  # two of zeros: reads go beyond
    yield f"@{NAME} = global [{DIGITS // 64 + 2} x i64] [{words}], align 8"
    yield "declare i256 @llvm.ctlz.i256(i256, i1)"
    yield "define internal {double, double, i64} @reduce_exact(double %x) noinline cold nounwind {"
    yield "  %bits = bitcast double %x to i64"
    yield "  %up = lshr i64 %bits, 52"
    yield "  %e = and i64 %up, 2047"
    yield f"  %f = and i64 %bits, {(1 << 52) - 1}"
    yield f"  %m = or i64 %f, {1 << 52}"
    # The window begins with the digit that counts 2 in x · 2/π, and %a digits follow it; E = e − 1075.
    yield f"  %a0 = sub i64 {DIGITS - WINDOW - LEADING + 2 + 1075}, %e"
    yield f"  %a1 = icmp ult i64 %a0, {DIGITS - WINDOW}"
    yield f"  %a = select i1 %a1, i64 %a0, i64 {DIGITS - WINDOW}"
    yield "  %byte = lshr i64 %a, 3"
    yield "  %bit = and i64 %a, 7"
    yield f"  %p = getelementptr i8, ptr @{NAME}, i64 %byte"
    yield "  %read = load i320, ptr %p, align 1"
    yield "  %bit320 = zext i64 %bit to i320"
    yield "  %shifted = lshr i320 %read, %bit320"
    yield f"  %w = trunc i320 %shifted to i{WINDOW}"
    yield "  %m256 = zext i64 %m to i256"
    yield "  %turns = mul i256 %w, %m256"  # x · 2/π modulo 4, in units of 2^−254
    # The nearest whole number, and the signed fraction in units of 2^−256.
    yield "  %n256 = lshr i256 %turns, 254"
    yield "  %n0 = trunc i256 %n256 to i64"
    yield "  %g = shl i256 %turns, 2"
    yield "  %below = icmp slt i256 %g, 0"
    yield "  %one = zext i1 %below to i64"
    yield "  %n1 = add i64 %n0, %one"
    yield "  %g- = sub i256 0, %g"
    yield "  %size = select i1 %below, i256 %g-, i256 %g"
    # Its first 53 digits, and the next 53.
    yield "  %zeros = call i256 @llvm.ctlz.i256(i256 %size, i1 false)"
    yield "  %digits = shl i256 %size, %zeros"
    yield "  %zeros64 = trunc i256 %zeros to i64"
    for name, skipped in (("h", 0), ("l", 53)):
        yield f"  %{name}0 = shl i256 %digits, {skipped}"
        yield f"  %{name}1 = lshr i256 %{name}0, {WINDOW - 53}"
        yield f"  %{name}2 = trunc i256 %{name}1 to i64"
        yield f"  %{name}3 = uitofp i64 %{name}2 to double"
        yield f"  %{name}4 = sub i64 {1023 - 53 - skipped}, %zeros64"
        yield f"  %{name}5 = shl i64 %{name}4, 52"
        yield f"  %{name}6 = bitcast i64 %{name}5 to double"
        yield f"  %{name} = fmul double %{name}3, %{name}6"
    # Times π/2 = P1 + P2.
    yield f"  %p1 = fmul double %h, {c(P1)}"
    yield "  %p1- = fneg double %p1"
    yield f"  %lost = call double @llvm.fma.f64(double %h, double {c(P1)}, double %p1-)"
    yield f"  %p2 = call double @llvm.fma.f64(double %h, double {c(P2)}, double %lost)"
    yield f"  %tail = call double @llvm.fma.f64(double %l, double {c(P1)}, double %p2)"
    yield "  %r0 = fadd double %p1, %tail"
    yield "  %back = fsub double %r0, %p1"
    yield "  %t0 = fsub double %tail, %back"
    # Signs: of the fraction, and of x.
    yield "  %negative = icmp slt i64 %bits, 0"
    yield "  %turned = xor i1 %negative, %below"
    yield "  %n1- = sub i64 0, %n1"
    yield "  %n = select i1 %negative, i64 %n1-, i64 %n1"
    for name in ("r", "t"):
        yield f"  %{name}- = fneg double %{name}0"
        yield f"  %{name}1 = select i1 %turned, double %{name}-, double %{name}0"
    yield "  %known = icmp ne i64 %e, 2047"
    yield f"  %r = select i1 %known, double %r1, double {c(float('nan'))}"
    yield "  %v0 = insertvalue {double, double, i64} undef, double %r, 0"
    yield "  %v1 = insertvalue {double, double, i64} %v0, double %t1, 1"
    yield "  %v2 = insertvalue {double, double, i64} %v1, i64 %n, 2"
    yield "  ret {double, double, i64} %v2"
    yield "}"
