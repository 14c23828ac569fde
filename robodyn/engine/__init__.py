"""Trace → graph → program → LLVM → machine code. Knows nothing of robots: it sees arrays of scalars, by name.

trace   what was computed, as a graph; a program of it, or loops over forests of any size
emit    programs as LLVM IR, for scalars and for SIMD lanes; around them a batch's loop, an integrator's, a call from Python
run     IR as machine code in this process, kept on disk, called on arrays
"""
