"""Types; sin and cos in LLVM IR, for scalars and for SIMD vectors of any width, within 1 ulp.

Reduction by multiples of π/2 (Cody and Waite) in fused multiply-adds, with the rounding of the reduced argument carried along;
then the minimax polynomials on [−π/4, π/4] of fdlibm (Sun Microsystems, 1993). Beyond |x| = 1e5 the reduction would lose
digits: such arguments take a slow path, one lane at a time, through the one of `payne_hanek`, which loses none.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...arithmetic.operations import OPERATIONS

EXACT_BEYOND = 1e5
TOGETHER = 8  # arguments that share one test for large ones

INTRINSICS = {"fma": 3, "fabs": 1, "sqrt": 1, "rint": 1, "minnum": 2, "maxnum": 2, "minimum": 2, "maximum": 2, "copysign": 2}
INTRINSICS |= {op.intrinsic: op.arity for op in OPERATIONS.values() if op.intrinsic}

# Functions of the C library, by its name, with their number of arguments.
LIBRARY = {op.name: op.arity for op in OPERATIONS.values() if op.library}


@dataclass(frozen=True)
class Circular:
    """Constants of sin and cos for a floating-point format."""

    half_pi: tuple[float, float, float]  # π/2 = P1 + P2 + P3 + …, each the number nearest to what is left
    sin: tuple[float, ...]  # sin r = r + r z S(z), z = r², |r| ≤ π/4
    cos: tuple[float, ...]  # cos r = 1 − z/2 + z² C(z)


DOUBLE = Circular(
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
SINGLE = Circular(
    (1.5707963705062866, -4.371138828673793e-08, -1.7151245100058819e-15),
    (-0.166666672, 0.00833333191, -0.000198400841, 2.72496209e-06),
    (0.0416666642, -0.00138883013, 2.45476895e-05),
)


class Type:
    """A floating-point scalar, "double" or "float", or a vector of `lanes` of them."""

    def __init__(self, lanes: int, scalar: str = "double") -> None:
        self.lanes, self.scalar = lanes, scalar
        self.bits = 64 if scalar == "double" else 32
        self.bytes = self.bits // 8
        self.integer_scalar = f"i{self.bits}"
        self.name = f"f{self.bits}" if lanes == 1 else f"v{lanes}f{self.bits}"
        self.float = self.of(scalar)
        self.int = self.of(self.integer_scalar)
        self.bool = self.of("i1")
        # Attributes of a function that holds many: LLVM would spill vectors across the borders of cache lines.
        self.frame = f'alignstack({self.bytes * lanes}) "stackrealign"' if lanes > 1 else ""

    def of(self, scalar: str) -> str:
        """The type of a scalar in every lane."""
        return scalar if self.lanes == 1 else f"<{self.lanes} x {scalar}>"

    def widened(self) -> "Type":
        """As many doubles."""
        return Type(self.lanes)

    def constant(self, x: float) -> str:
        """A number, rounded once to this type, in every lane, to the last bit."""
        if self.bits == 32:  # LLVM spells a float as the double of the same value
            with np.errstate(over="ignore"):
                x = float(np.float32(x))
        return self.splat(self.scalar, f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}")

    def integer(self, k: int) -> str:
        """An integer in every lane."""
        return self.splat(self.integer_scalar, str(k))

    def splat(self, scalar: str, text: str) -> str:
        """A constant, spelt out for every lane."""
        return text if self.lanes == 1 else "<" + ", ".join([f"{scalar} {text}"] * self.lanes) + ">"


def declarations(t: Type) -> Iterator[str]:
    """The intrinsics that kernels and the functions here call, for a type and, where it is another, for doubles in its lanes."""
    for u in {t.name: t, t.widened().name: t.widened()}.values():
        for name, n in INTRINSICS.items():
            yield f"declare {u.float} @llvm.{name}.{u.name}({', '.join([u.float] * n)})"
    if t.lanes > 1:
        yield "declare double @llvm.fma.f64(double, double, double)"  # of the exact reduction


def sincos(t: Type) -> Iterator[str]:
    """define {sin, cos, large} @sincos(x), always inlined; and {sin, cos} @sincos_exact(x, sin, cos), to replace them where x is large."""
    F, N, B, c = t.float, t.int, t.bool, t.constant
    constants = DOUBLE if t.bits == 64 else SINGLE
    (P1, P2, P3), SIN, COS = constants.half_pi, constants.sin, constants.cos

    def fma(out: str, a: str, b: str, d: str) -> str:
        return f"  %{out} = call {F} @llvm.fma.{t.name}({F} {a}, {F} {b}, {F} {d})"

    def polynomial(name: str, coefficients: tuple[float, ...]) -> Iterator[str]:
        value = c(coefficients[-1])
        for i, a in enumerate(coefficients[-2::-1]):
            yield fma(f"{name}{i}", value, "%z", c(a))
            value = f"%{name}{i}"

    pair, flagged = f"{{{F}, {F}}}", f"{{{F}, {F}, {B}}}"
    yield f"define internal {pair} @sincos_reduced({F} %r, {F} %t, {N} %n) alwaysinline nounwind {{"
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
    # Quadrants.
    yield f"  %n1 = and {N} %n, {t.integer(1)}"
    yield f"  %odd = icmp ne {N} %n1, {t.integer(0)}"
    yield f"  %sq = select {B} %odd, {F} %cos0, {F} %sin0"
    yield f"  %cq = select {B} %odd, {F} %sin0, {F} %cos0"
    # The sign bits: bit 1 of n for the sine, of n + 1 for the cosine.
    for name, n in (("s", "%n"), ("c", "%next")):
        if name == "c":
            yield f"  %next = add {N} %n, {t.integer(1)}"
        yield f"  %{name}b = and {N} {n}, {t.integer(2)}"
        yield f"  %{name}m = shl {N} %{name}b, {t.integer(t.bits - 2)}"
        yield f"  %{name}i = bitcast {F} %{name}q to {N}"
        yield f"  %{name}x = xor {N} %{name}i, %{name}m"
        yield f"  %{name}f = bitcast {N} %{name}x to {F}"
    yield from _returned(pair, {"%sf": F, "%cf": F})

    yield f"define internal {flagged} @sincos({F} %x) alwaysinline nounwind {{"
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
    # Where x is too large, n is poison, and so are results that `@sincos_exact` replaces lane by lane.
    yield f"  %n = fptosi {F} %k to {N}"
    yield f"  %y = call {pair} @sincos_reduced({F} %r, {F} %t, {N} %n)"
    yield f"  %s = extractvalue {pair} %y, 0"
    yield f"  %c = extractvalue {pair} %y, 1"
    yield f"  %size = call {F} @llvm.fabs.{t.name}({F} %x)"
    yield f"  %large = fcmp ugt {F} %size, {c(EXACT_BEYOND)}"
    yield from _returned(flagged, {"%s": F, "%c": F, "%large": B})

    # The slow path: lanes beyond the bound from their exact reduction, the others as they are.
    yield f"define internal {pair} @sincos_exact({F} %x, {F} %s, {F} %c) noinline cold nounwind {{"
    yield f"  %size = call {F} @llvm.fabs.{t.name}({F} %x)"
    yield f"  %large = fcmp ugt {F} %size, {c(EXACT_BEYOND)}"
    scalars, vectors = {"r": t.scalar, "t": t.scalar, "n": t.integer_scalar}, {"r": F, "t": F, "n": N}
    reduced = dict.fromkeys(vectors, "undef")
    for i in range(t.lanes):
        x = "%x"
        if t.lanes > 1:
            yield f"  %x{i} = extractelement {F} %x, i32 {i}"
            x = f"%x{i}"
        if t.bits == 32:
            yield f"  %w{i} = fpext float {x} to double"
            x = f"%w{i}"
        yield f"  %e{i} = call {{double, double, i64}} @reduce_exact(double {x})"
        for j, name in enumerate(vectors):
            yield f"  %{name}{i} = extractvalue {{double, double, i64}} %e{i}, {j}"
        lane = {name: f"%{name}{i}" for name in vectors}
        if t.bits == 32:
            yield f"  %rf{i} = fptrunc double %r{i} to float"
            yield f"  %rw{i} = fpext float %rf{i} to double"
            yield f"  %lost{i} = fsub double %r{i}, %rw{i}"
            yield f"  %tf{i} = fptrunc double %lost{i} to float"
            yield f"  %nf{i} = trunc i64 %n{i} to i32"
            lane = {name: f"%{name}f{i}" for name in vectors}
        for name in vectors if t.lanes > 1 else ():
            yield f"  %{name}v{i} = insertelement {vectors[name]} {reduced[name]}, {scalars[name]} {lane[name]}, i32 {i}"
            lane[name] = f"%{name}v{i}"
        reduced = lane
    yield f"  %y = call {pair} @sincos_reduced({', '.join(f'{vectors[name]} {value}' for name, value in reduced.items())})"
    for j, name in enumerate("sc"):
        yield f"  %{name}y = extractvalue {pair} %y, {j}"
        yield f"  %{name}k = select {B} %large, {F} %{name}y, {F} %{name}"
    yield from _returned(pair, {"%sk": F, "%ck": F})


def _returned(kind: str, values: dict[str, str]) -> Iterator[str]:
    """The end of a function that returns several values, given with their types."""
    last = "undef"
    for j, (value, of) in enumerate(values.items()):
        yield f"  %return{j} = insertvalue {kind} {last}, {of} {value}, {j}"
        last = f"%return{j}"
    yield f"  ret {kind} {last}"
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
    """define @name.lanes(x, …): a function of the C library for doubles, one lane after the other."""
    F, n = t.float, LIBRARY[name]
    yield f"declare double @{name}({', '.join(['double'] * n)}) nounwind memory(none)"
    yield f"define internal {F} @{name}.lanes({', '.join(f'{F} %a{k}' for k in range(n))}) noinline nounwind {{"
    last = "undef"
    for i in range(t.lanes):
        arguments = []
        for k in range(n):
            value = f"%a{k}"
            if t.lanes > 1:
                yield f"  %x{k}_{i} = extractelement {F} %a{k}, i32 {i}"
                value = f"%x{k}_{i}"
            if t.bits == 32:
                yield f"  %w{k}_{i} = fpext float {value} to double"
                value = f"%w{k}_{i}"
            arguments.append(f"double {value}")
        yield f"  %y{i} = call double @{name}({', '.join(arguments)})"
        value = f"%y{i}"
        if t.bits == 32:
            yield f"  %n{i} = fptrunc double %y{i} to float"
            value = f"%n{i}"
        if t.lanes > 1:
            yield f"  %v{i} = insertelement {F} {last}, {t.scalar} {value}, i32 {i}"
            value = f"%v{i}"
        last = value
    yield f"  ret {F} {last}"
    yield "}"
