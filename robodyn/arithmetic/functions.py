"""What the formalism asks of numbers, beyond + − × ÷ and `@`.

The formalism is written once, on NumPy arrays. Their elements may be float64 (the readable reference), mpmath numbers
(the 50-digit reference) or traced symbols (anything with methods `sin`, `cos`, `sqrt`, `tanh`, …). Arrays of the last two
have dtype object. These few functions are all that has to know the difference.
"""

import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from .numbers import mpmath
from .operations import FUNCTIONS

# By the names of NumPy's ufuncs: what does the same to objects, mpmath numbers and traced ones alike.
ON_OBJECTS: dict[str, np.ufunc] = {}


def _elementwise(name: str, on_numbers: Callable[..., Any], arguments: int = 1) -> Callable[..., Any]:
    """A function of arrays: NumPy's on floats, a method of this name on what has one, `on_numbers` on other objects."""

    def one(*xs: Any) -> Any:
        method = getattr(xs[0], name, None)
        if callable(method):
            return method(*xs[1:])
        # A symbol may stand second; it knows how to lift a number.
        for x in xs[1:]:
            if (lift := getattr(getattr(x, "graph", None), "lift", None)) is not None:
                return one(lift(xs[0]), *xs[1:])
        return on_numbers(*xs)

    return _of_arrays(name, one, arguments)


def _of_arrays(name: str, one: Callable[..., Any], arguments: int, **identity: Any) -> Callable[..., Any]:
    on_objects = ON_OBJECTS[name] = np.frompyfunc(one, arguments, 1, **identity)

    def function(*xs: Any) -> Any:
        arrays = [np.asarray(x) for x in xs]
        return (on_objects if any(x.dtype == object for x in arrays) else getattr(np, name))(*arrays)

    function.__name__ = name
    function.__doc__ = f"np.{name} of arrays of any arithmetic."
    return function


_FUNCTIONS = {f.called: _elementwise(f.called, f.exact, f.arity) for f in FUNCTIONS}
sin, cos, tan = (_FUNCTIONS[name] for name in ("sin", "cos", "tan"))
arcsin, arccos, arctan, arctan2 = (_FUNCTIONS[name] for name in ("arcsin", "arccos", "arctan", "arctan2"))
sqrt, cbrt, hypot = (_FUNCTIONS[name] for name in ("sqrt", "cbrt", "hypot"))
exp, log, expm1, log1p = (_FUNCTIONS[name] for name in ("exp", "log", "expm1", "log1p"))
sinh, cosh, tanh = (_FUNCTIONS[name] for name in ("sinh", "cosh", "tanh"))
floor, ceil, trunc, rint = (_FUNCTIONS[name] for name in ("floor", "ceil", "trunc", "rint"))
minimum, maximum = (_FUNCTIONS[name] for name in ("minimum", "maximum"))
sign = _elementwise("sign", lambda x: mpmath().sign(x))
remainder = _of_arrays("remainder", operator.mod, 2)
floor_divide = _of_arrays("floor_divide", operator.floordiv, 2)
power = _of_arrays("power", operator.pow, 2)

# Conditions: bool arrays, or objects that have no truth value before a kernel runs. `x > 0` itself is not for arrays of symbols, whose
# truth NumPy would ask for.
less = _of_arrays("less", operator.lt, 2)
less_equal = _of_arrays("less_equal", operator.le, 2)
greater = _of_arrays("greater", operator.gt, 2)
greater_equal = _of_arrays("greater_equal", operator.ge, 2)
equal = _of_arrays("equal", operator.eq, 2)
not_equal = _of_arrays("not_equal", operator.ne, 2)
logical_and = _of_arrays("logical_and", operator.and_, 2, identity=True)
logical_or = _of_arrays("logical_or", operator.or_, 2, identity=False)
logical_xor = _of_arrays("logical_xor", operator.xor, 2, identity=False)
logical_not = _of_arrays("logical_not", lambda c: ~c if hasattr(c, "select") else not c, 1)
ON_OBJECTS |= {f"bitwise_{name}": ON_OBJECTS[f"logical_{name}"] for name in ("and", "or", "xor")}
ON_OBJECTS["invert"] = ON_OBJECTS["logical_not"]
for _names, _factor in ((("degrees", "rad2deg"), 180.0 / np.pi), (("radians", "deg2rad"), np.pi / 180.0)):
    ON_OBJECTS |= dict.fromkeys(_names, np.frompyfunc(lambda x, factor=_factor: x * factor, 1, 1))
ON_OBJECTS["clip"] = np.frompyfunc(lambda x, low, high: ON_OBJECTS["minimum"](ON_OBJECTS["maximum"](x, low), high), 3, 1)
_where = np.frompyfunc(lambda c, a, b: c.select(a, b) if hasattr(c, "select") else a if c else b, 3, 1)


def where(condition: Any, a: Any, b: Any) -> Any:
    """np.where of arrays of any arithmetic: a where the condition holds, b elsewhere. Both are computed."""
    arrays = [np.asarray(x) for x in (condition, a, b)]
    return (_where if any(x.dtype == object for x in arrays) else np.where)(*arrays)


def clip(x: Any, low: Any, high: Any) -> Any:
    """np.clip of arrays of any arithmetic: min(max(x, low), high)."""
    return minimum(maximum(x, low), high)
