"""Calls of the C library, for functions that are not worth code of their own: doubles, one lane after the other."""

from collections.abc import Iterator

from ...arithmetic.operations import OPERATIONS
from .code import Code
from .types import Type
from .value import Value, undefined

# Functions of the C library, by its name, with their number of arguments.
LIBRARY = {op.name: op.arity for op in OPERATIONS.values() if op.library}


def by_lane(t: Type, name: str) -> Iterator[str]:
    """define @name.lanes(x, …)."""
    code, F, n = Code(), t.float, LIBRARY[name]
    arguments = [Value(code, t, "float", f"%a{k}") for k in range(n)]
    result = undefined(code, t)
    for i in range(t.lanes):
        xs = [x.lane(i).widened() for x in arguments]
        y = xs[0].new(f"call double @{name}({', '.join(f'double {x}' for x in xs)})")
        result = result.with_lane(i, y.rounded(Type(1, t.scalar)))
    code.leave(F, result)
    yield f"declare double @{name}({', '.join(['double'] * n)}) nounwind memory(none)"
    yield from code.function(f"define internal {F} @{name}.lanes({', '.join(f'{F} {x}' for x in arguments)}) noinline nounwind")
