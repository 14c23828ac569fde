"""Trace → graph → program → LLVM → machine code. Knows nothing of robots: it sees arrays of scalars, by name.

`graph` traces, `program` fuses and orders. For forests of any size `sweeps` traces a step per kind of node (`recording`: what it
writes down, `alike`: expressions worth a loop) and `layout` gives everything its place.
`blocks`, `emit` and `loops` write IR for scalars and SIMD lanes of doubles or floats (`functions`: sin and cos, `payne_hanek`: large
angles, `elementary`: exp, log, tanh, pow, `constants`: a table of numbers, `rows`: rows of memory to lanes and back).
`compile` and `cache` make machine code of it, `kernel` calls it on arrays, `fastcall` as a built-in function, `integrate` puts a step
loop around it.
"""
