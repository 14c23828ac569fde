"""Types of LLVM IR: scalars, and SIMD vectors of them; the intrinsic functions that there are of both."""

import struct
from collections.abc import Iterator

import numpy as np

from ...arithmetic.operations import OPERATIONS

# Intrinsic functions with their number of arguments: what the code here calls by itself, and the operations' own.
INTRINSICS = {"fma": 3, "fabs": 1, "sqrt": 1, "rint": 1, "minnum": 2, "maxnum": 2, "minimum": 2, "maximum": 2, "copysign": 2}
INTRINSICS |= {op.intrinsic: op.arity for op in OPERATIONS.values() if op.intrinsic}


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

    def of_kind(self, kind: str) -> str:
        """The type of its numbers "float", of integers "int" or conditions "bool" in as many lanes; what has no lanes is its own name."""
        return {"float": self.float, "int": self.int, "bool": self.bool}.get(kind, kind)

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
