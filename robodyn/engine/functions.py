"""sin and cos in LLVM IR, for scalars and for SIMD vectors of any width, within 1 ulp.

Reduction by multiples of π/2 (Cody and Waite) in fused multiply-adds, with the rounding of the reduced argument carried along;
then the minimax polynomials on [−π/4, π/4] of fdlibm (Sun Microsystems, 1993). Beyond |x| = 1e5 the reduction would lose
digits: such arguments take a slow, exact path through the C library, one lane at a time.
"""

import struct
from collections.abc import Iterator

EXACT_BEYOND = 1e5
TOGETHER = 8  # arguments that share one test for large ones

# π/2 = P1 + P2 + P3 + …, each the double nearest to what is left.
P1, P2, P3 = 1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33
SIN = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
COS = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


class Type:
    """double, or a vector of `lanes` doubles."""

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes
        self.name = "f64" if lanes == 1 else f"v{lanes}f64"
        self.float = self.of("double")
        self.int = self.of("i64")
        self.bool = self.of("i1")

    def of(self, scalar: str) -> str:
        """The type of a scalar in every lane."""
        return scalar if self.lanes == 1 else f"<{self.lanes} x {scalar}>"

    def constant(self, x: float) -> str:
        """A double, in every lane, to the last bit."""
        return self.splat("double", f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}")

    def integer(self, k: int) -> str:
        """An integer in every lane."""
        return self.splat("i64", str(k))

    def splat(self, scalar: str, text: str) -> str:
        """A constant, spelt out for every lane."""
        return text if self.lanes == 1 else "<" + ", ".join([f"{scalar} {text}"] * self.lanes) + ">"


def declarations(t: Type) -> Iterator[str]:
    """What the functions below call."""
    F = t.float
    yield f"declare {F} @llvm.fma.{t.name}({F}, {F}, {F})"
    for name in ("fabs", "sqrt", "rint", "minnum", "maxnum"):
        yield f"declare {F} @llvm.{name}.{t.name}({', '.join([F] * (2 if name.endswith('num') else 1))})"
    for name in ("sin", "cos", "exp", "log", "tanh"):
        yield f"declare double @{name}(double) nounwind memory(none)"
    if t.lanes > 1:
        yield "declare double @llvm.fabs.f64(double)"


def sincos(t: Type) -> Iterator[str]:
    """define {sin, cos, large} @sincos(x), always inlined; and {sin, cos} @sincos_exact(x, sin, cos), to replace them where x is large."""
    F, N, B, c = t.float, t.int, t.bool, t.constant

    def fma(out: str, a: str, b: str, d: str) -> str:
        return f"  %{out} = call {F} @llvm.fma.{t.name}({F} {a}, {F} {b}, {F} {d})"

    def polynomial(name: str, coefficients: tuple[float, ...]) -> Iterator[str]:
        value = c(coefficients[-1])
        for i, a in enumerate(coefficients[-2::-1]):
            yield fma(f"{name}{i}", value, "%z", c(a))
            value = f"%{name}{i}"

    yield f"define internal {{{F}, {F}, {B}}} @sincos({F} %x) alwaysinline nounwind {{"
    # r + t = x − k π/2: x − k P1 is exact, and so are the roundings of k P2 and of the difference.
    yield f"  %turns = fmul {F} %x, {c(2 / 3.141592653589793)}"
    yield f"  %k = call {F} @llvm.rint.{t.name}({F} %turns)"
    yield f"  %nk = fneg {F} %k"
    yield fma("r0", "%nk", c(P1), "%x")
    yield f"  %p = fmul {F} %k, {c(P2)}"
    yield f"  %np = fneg {F} %p"
    yield fma("plost", "%k", c(P2), "%np")
    yield f"  %r = fsub {F} %r0, %p"
    yield f"  %back = fsub {F} %r0, %r"
    yield f"  %rlost = fsub {F} %back, %p"
    yield f"  %t0 = fsub {F} %rlost, %plost"
    yield fma("t", "%nk", c(P3), "%t0")  # what is left where x is all but a multiple of π/2
    yield f"  %z = fmul {F} %r, %r"
    # sin(r + t) = r + (t (1 − z/2) + r z S(z))
    yield from polynomial("s", SIN)
    yield f"  %rz = fmul {F} %r, %z"
    yield fma("w", "%z", c(-0.5), c(1.0))
    yield f"  %tw = fmul {F} %t, %w"
    yield fma("stail", "%rz", f"%s{len(SIN) - 2}", "%tw")
    yield f"  %sin0 = fadd {F} %r, %stail"
    # cos(r + t) = w + ((1 − w − z/2) + (z² C(z) − r t)), w = 1 − z/2 rounded
    yield from polynomial("c", COS)
    yield f"  %zz = fmul {F} %z, %z"
    yield f"  %nr = fneg {F} %r"
    yield f"  %rt = fmul {F} %nr, %t"
    yield fma("ctail", "%zz", f"%c{len(COS) - 2}", "%rt")
    yield f"  %onew = fsub {F} {c(1.0)}, %w"
    yield fma("wlost", "%z", c(-0.5), "%onew")
    yield f"  %ctail2 = fadd {F} %wlost, %ctail"
    yield f"  %cos0 = fadd {F} %w, %ctail2"
    # Quadrants. Where x is too large, n is poison, and so are results that `@sincos_exact` replaces lane by lane.
    yield f"  %size = call {F} @llvm.fabs.{t.name}({F} %x)"
    yield f"  %large = fcmp ugt {F} %size, {c(EXACT_BEYOND)}"
    yield f"  %n = fptosi {F} %k to {N}"
    yield f"  %n1 = and {N} %n, {t.integer(1)}"
    yield f"  %odd = icmp ne {N} %n1, {t.integer(0)}"
    yield f"  %sq = select {B} %odd, {F} %cos0, {F} %sin0"
    yield f"  %cq = select {B} %odd, {F} %sin0, {F} %cos0"
    # The sign bits: bit 1 of n for the sine, of n + 1 for the cosine.
    for name, n in (("s", "%n"), ("c", "%next")):
        if name == "c":
            yield f"  %next = add {N} %n, {t.integer(1)}"
        yield f"  %{name}b = and {N} {n}, {t.integer(2)}"
        yield f"  %{name}m = shl {N} %{name}b, {t.integer(62)}"
        yield f"  %{name}i = bitcast {F} %{name}q to {N}"
        yield f"  %{name}x = xor {N} %{name}i, %{name}m"
        yield f"  %{name}f = bitcast {N} %{name}x to {F}"
    pair = f"{{{F}, {F}, {B}}}"
    yield f"  %a = insertvalue {pair} undef, {F} %sf, 0"
    yield f"  %b = insertvalue {pair} %a, {F} %cf, 1"
    yield f"  %r3 = insertvalue {pair} %b, {B} %large, 2"
    yield f"  ret {pair} %r3"
    yield "}"

    # The slow path: lanes beyond the bound by the C library, the others as they are.
    yield f"define internal {{{F}, {F}}} @sincos_exact({F} %x, {F} %s, {F} %c) noinline cold nounwind {{"
    s, co = "%s", "%c"
    bound = Type(1).constant(EXACT_BEYOND)
    for i in range(t.lanes):
        x = "%x"
        if t.lanes > 1:
            yield f"  %x{i} = extractelement {F} %x, i32 {i}"
            x = f"%x{i}"
        yield f"  %sl{i} = call double @sin(double {x})"
        yield f"  %cl{i} = call double @cos(double {x})"
        yield f"  %a{i} = call double @llvm.fabs.f64(double {x})"
        yield f"  %l{i} = fcmp ugt double %a{i}, {bound}"
        for name, old in (("s", s), ("c", co)):
            new = f"%{name}l{i}"
            if t.lanes > 1:
                yield f"  %{name}n{i} = insertelement {F} {old}, double {new}, i32 {i}"
                new = f"%{name}n{i}"
            yield f"  %{name}k{i} = select i1 %l{i}, {F} {new}, {F} {old}"
        s, co = f"%sk{i}", f"%ck{i}"
    yield f"  %p = insertvalue {{{F}, {F}}} undef, {F} {s}, 0"
    yield f"  %q = insertvalue {{{F}, {F}}} %p, {F} {co}, 1"
    yield f"  ret {{{F}, {F}}} %q"
    yield "}"


def sincos_together(t: Type, n: int) -> Iterator[str]:
    """define {sin, cos, …} @sincos.n(x, …) of n arguments: always inlined, with one test for large arguments and one slow path for all."""
    F, B, pair = t.float, t.bool, f"{{{t.float}, {t.float}}}"
    results = "{" + ", ".join([F] * (2 * n)) + "}"
    yield f"define internal {results} @sincos.{n}({', '.join(f'{F} %x{k}' for k in range(n))}) alwaysinline nounwind {{"
    large = ""
    for k in range(n):
        yield f"  %t{k} = call {{{F}, {F}, {B}}} @sincos({F} %x{k})"
        for j, name in enumerate(("s", "c", "l")):
            yield f"  %{name}{k} = extractvalue {{{F}, {F}, {B}}} %t{k}, {j}"
        if large:
            yield f"  %any{k} = or {B} {large}, %l{k}"
        large = f"%any{k}" if large else f"%l{k}"
    if t.lanes > 1:
        yield f"  %bits = bitcast {B} {large} to i{t.lanes}"
        yield f"  %any = icmp ne i{t.lanes} %bits, 0"
        large = "%any"
    yield f"  br i1 {large}, label %slow, label %done, !prof !0"
    yield "slow:"
    for k in range(n):
        yield f"  %e{k} = call {pair} @sincos_exact({F} %x{k}, {F} %s{k}, {F} %c{k})"
        yield f"  %se{k} = extractvalue {pair} %e{k}, 0"
        yield f"  %ce{k} = extractvalue {pair} %e{k}, 1"
    yield "  br label %done"
    yield "done:"
    value = "undef"
    for k in range(n):
        yield f"  %sr{k} = phi {F} [%s{k}, %0], [%se{k}, %slow]"
        yield f"  %cr{k} = phi {F} [%c{k}, %0], [%ce{k}, %slow]"
    for j in range(2 * n):
        yield f"  %r{j} = insertvalue {results} {value}, {F} %{'sc'[j % 2]}r{j // 2}, {j}"
        value = f"%r{j}"
    yield f"  ret {results} {value}"
    yield "}"


def by_lane(t: Type, name: str) -> Iterator[str]:
    """define @name.lanes(x): a function of the C library, one lane after the other."""
    F = t.float
    yield f"define internal {F} @{name}.lanes({F} %x) noinline nounwind {{"
    if t.lanes == 1:
        yield f"  %y = call double @{name}(double %x)"
        yield "  ret double %y"
    else:
        last = "undef"
        for i in range(t.lanes):
            yield f"  %x{i} = extractelement {F} %x, i32 {i}"
            yield f"  %y{i} = call double @{name}(double %x{i})"
            yield f"  %v{i} = insertelement {F} {last}, double %y{i}, i32 {i}"
            last = f"%v{i}"
        yield f"  ret {F} {last}"
    yield "}"
