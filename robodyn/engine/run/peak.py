"""What this CPU's floating-point units can do at most: independent fused multiply-adds on full vectors, nothing else."""

import ctypes
from collections.abc import Callable

from .compile import Loaded, lanes, object_code

CHAINS = 16  # in flight at a time: more than latency times units on any CPU so far (5 × 2), and fits the 16 registers of AVX2
REPEATS = 8  # multiply-adds of each chain per turn of the loop, so that counting costs nothing


def fused_multiply_adds() -> tuple[Callable[[int], float], int]:
    """A function that takes a number of turns, and the floating-point operations of a turn: two per multiply-add and lane."""
    width = lanes()
    T, name, chains = f"<{width} x double>", f"v{width}f64", CHAINS - 2 if width < 8 else CHAINS  # AVX2: two registers hold constants

    def filled(x: str) -> str:
        return "<" + ", ".join([f"double {x}"] * width) + ">"

    lines = [f"declare {T} @llvm.fma.{name}({T}, {T}, {T})", "define double @peak(i64 %turns) {", "entry:", "  br label %loop", "loop:"]
    lines.append("  %i = phi i64 [0, %entry], [%next, %loop]")
    lines += [f"  %x{c}.0 = phi {T} [{filled(f'{c}.0')}, %entry], [%x{c}.{REPEATS}, %loop]" for c in range(chains)]
    # x ← x/2 + 1 tends to 2: neither overflow nor subnormal numbers, which some CPUs slow down for.
    for r in range(REPEATS):
        lines += [
            f"  %x{c}.{r + 1} = call {T} @llvm.fma.{name}({T} %x{c}.{r}, {T} {filled('0.5')}, {T} {filled('1.0')})" for c in range(chains)
        ]
    lines += ["  %next = add i64 %i, 1", "  %more = icmp slt i64 %next, %turns", "  br i1 %more, label %loop, label %done", "done:"]
    lines.append(f"  %s0 = fadd {T} %x0.{REPEATS}, {filled('0.0')}")
    lines += [f"  %s{c} = fadd {T} %s{c - 1}, %x{c}.{REPEATS}" for c in range(1, chains)]
    lines += [f"  %result = extractelement {T} %s{chains - 1}, i64 0", "  ret double %result", "}"]
    loaded = Loaded(object_code("\n".join(lines)))
    function = loaded.function("peak", ctypes.c_int64, result=ctypes.c_double)
    function.owner = loaded  # the code lives as long as the function
    return function, 2 * width * chains * REPEATS
