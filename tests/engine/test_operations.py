"""The records of operations: what each says of itself, against 50 digits."""

import mpmath
import numpy as np
import pytest
from tools import derivative

from robodyn import arithmetic
from robodyn.arithmetic.operations import OPERATIONS

PLAIN = {
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y,
    "neg": lambda x: -x,
    "pow": lambda x, y: x**y,
    "abs": abs,
}
POINTS = [(0.37, 0.71), (0.83, 0.25), (0.52, 1.9)]  # where every function is smooth
DIFFERENTIABLE = [name for name, operation in OPERATIONS.items() if operation.derivative]


def value(name, *xs):
    return (PLAIN.get(name) or OPERATIONS[name].exact)(*xs)


@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
@pytest.mark.parametrize("name", DIFFERENTIABLE)
def test_derivatives_are_the_limits_of_differences(name, signs):
    """Truncation 1e-36 and rounding 1e-32 of a central difference in 50 digits."""
    operation = OPERATIONS[name]
    with mpmath.workdps(50):
        for point in POINTS:
            xs = [mpmath.mpf(s * x) for s, x in zip(signs, point[: operation.arity], strict=False)]
            if any(x < 0 for x in xs[:1]) and name in ("pow", "sqrt", "log"):
                continue
            for k, found in enumerate(operation.derivative(arithmetic, *xs)):
                step = np.array([mpmath.mpf(j == k) for j in range(operation.arity)], dtype=object)
                expected = derivative(lambda x: value(name, *x), np.array(xs, dtype=object), step)
                assert abs(found - expected) < 1e-28 * (1 + abs(expected)), (name, k, xs)


@pytest.mark.parametrize("name", sorted(OPERATIONS))
def test_what_is_odd_or_even_or_commutes(name):
    """Every statement of a record, at numbers of both signs, by NumPy's function."""
    operation = OPERATIONS[name]
    f = operation.on_floats or PLAIN.get(name)
    if f is None or operation.condition:
        return
    for x, y in [*POINTS, (-0.37, 0.71), (-0.83, -0.25)]:
        with np.errstate(all="ignore"):
            if operation.odd:
                assert f(-x) == -f(x)
            if operation.even:
                assert f(-x) == f(x)
            if operation.commutative:
                assert f(x, y) == f(y, x)
            if operation.idempotent:
                assert f(x, x) == x
            if operation.passed_on:
                assert not np.isfinite(f(*([np.nan] + [y] * (operation.arity - 1))))
