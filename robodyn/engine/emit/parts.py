"""What a module needs of its programs, straight-line ones and those with loops alike: their functions, tables, and what those call."""

from collections.abc import Iterator

from ...arithmetic import Array
from ..trace.layout import Looped
from ..trace.program import Program
from . import elementary, large_angles
from .library import LIBRARY, by_lane
from .loops import LoopedPart
from .straight import Part
from .trigonometry import TOGETHER, sincos, sincos_together
from .types import Type, declarations


def prologue(t: Type, *programs: Program | Looped) -> Iterator[str]:
    """Declarations and functions that the programs call."""
    used = {op for program in programs for code in program.programs for op, *_ in code.instructions}
    yield from declarations(t)
    yield from large_angles.reduction()
    yield from sincos(t)
    for n in range(1, TOGETHER + 1):
        yield from sincos_together(t, n)
    for name in sorted(used & LIBRARY.keys()):
        yield from by_lane(t, name)
    for name in sorted(used & elementary.FUNCTIONS.keys()):
        yield from elementary.definition(t, name)
    yield '!0 = !{!"branch_weights", i32 1, i32 100000}'


def part(program: Program | Looped, t: Type, name: str, *, inline: bool = True) -> Part | LoopedPart:
    """The functions of a program of either kind."""
    if isinstance(program, Program):
        return Part(program, t, name, inline=inline)
    return LoopedPart(program, t, name)


def tables(**programs: Program | Looped | None) -> dict[str, Array]:
    """What the code of programs reads beside its arguments, by the names that it has in a module with parts of these names."""
    return {f"{name}.{key}": x for name, program in programs.items() if program for key, x in program.tables.items()}
