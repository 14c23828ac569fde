"""What the formalism asks of numbers, beyond + − × ÷ and `@`.

The formalism is written once, on NumPy arrays. Their elements may be float64 (the readable reference), mpmath numbers
(the 50-digit reference) or traced symbols (anything with methods `sin`, `cos`, `sqrt`, `tanh`, …). Arrays of the last two
have dtype object. These few functions are all that has to know the difference.
"""

import operator
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np

from .errors import MissingPackageError, ModelError

Array = np.ndarray[Any, Any]


def mpmath():
    """The mpmath module, imported when first used."""
    try:
        import mpmath as module
    except ImportError as error:
        raise MissingPackageError("backend='mpmath' needs the package mpmath: pip install 'robodyn[mpmath]'") from error
    return module


DIGITS = 50  # of backend="mpmath"


def precision(backend: str) -> AbstractContextManager[object]:
    """The working precision of a backend, for as long as it computes."""
    return mpmath().workdps(DIGITS) if backend == "mpmath" else nullcontext()


_MPMATH_NAMES = {"arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2"}

# By the names of NumPy's ufuncs: what does the same to objects, mpmath numbers and traced ones alike.
ON_OBJECTS: dict[str, np.ufunc] = {}


def _elementwise(name: str, on_numbers: Callable[..., Any] | None = None, *, arguments: int = 1) -> Callable[..., Any]:
    """A function of arrays: NumPy's on floats, a method of this name on what has one, `on_numbers` (or mpmath's) on other objects."""
    on_numbers = on_numbers or (lambda *xs: getattr(mpmath(), _MPMATH_NAMES.get(name, name))(*xs))

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


sin = _elementwise("sin")
cos = _elementwise("cos")
tan = _elementwise("tan")
arcsin = _elementwise("arcsin")
arccos = _elementwise("arccos")
arctan = _elementwise("arctan")
arctan2 = _elementwise("arctan2", arguments=2)
sqrt = _elementwise("sqrt")
exp = _elementwise("exp")
log = _elementwise("log")
expm1 = _elementwise("expm1")
log1p = _elementwise("log1p")
sinh = _elementwise("sinh")
cosh = _elementwise("cosh")
tanh = _elementwise("tanh")
cbrt = _elementwise("cbrt", lambda x: mpmath().sign(x) * mpmath().cbrt(abs(x)))
hypot = _elementwise("hypot", arguments=2)
floor = _elementwise("floor")
ceil = _elementwise("ceil")
trunc = _elementwise("trunc", lambda x: mpmath().sign(x) * mpmath().floor(abs(x)))
rint = _elementwise("rint", lambda x: mpmath().nint(x))
remainder = _of_arrays("remainder", operator.mod, 2)
floor_divide = _of_arrays("floor_divide", operator.floordiv, 2)
power = _of_arrays("power", operator.pow, 2)
sign = _elementwise("sign")
minimum = _elementwise("minimum", lambda x, y: x if x != x or x < y else y, arguments=2)
maximum = _elementwise("maximum", lambda x, y: x if x != x or x > y else y, arguments=2)

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


def known(x: Any) -> Any:
    """A number as it is; None for a symbol whose value is not known yet."""
    return getattr(x, "constant", x)


def zeros(shape: tuple[int, ...], dtype: np.dtype) -> Array:
    """Zeros that can hold numbers of `dtype`; an object array gets Python floats, which fold away when traced."""
    return np.full(shape, 0.0, dtype=dtype)


def dtype_of(*arrays: Any) -> np.dtype:
    """The dtype that results from mixing these arrays: object as soon as one of them is."""
    return np.result_type(float, *(np.asarray(a) for a in arrays if a is not None))


def solve(A: Array, b: Array) -> Array:
    """x with A x = b for a dense, indefinite A (..., n, n) and b (..., n), by LU with partial pivoting.

    Floats go to LAPACK, and one step of iterative refinement cleans what bad scaling left; mpmath numbers go to mpmath.
    A traced A has no pivots to choose from: the routes that need this function are oracles, not kernels.
    """
    if A.dtype != object:
        x = np.linalg.solve(A, b[..., None])
        return (x + np.linalg.solve(A, b[..., None] - A @ x))[..., 0]
    mp = mpmath()
    if not all(isinstance(a, (mp.mpf, float, int)) for a in A.flat):
        raise ModelError("the saddle-point routes choose pivots and cannot be traced: use 'nonrecursive' or 'recursive'")
    shape = np.broadcast_shapes(A.shape[:-2], b.shape[:-1])
    A, b = np.broadcast_to(A, shape + A.shape[-2:]), np.broadcast_to(b, shape + b.shape[-1:])
    x = np.empty(b.shape, dtype=object)
    for i in np.ndindex(shape):
        x[i] = list(mp.lu_solve(mp.matrix(A[i].tolist()), mp.matrix(b[i].tolist())))
    return x


# --- constants: a robot's numbers, in the arithmetic of the evaluation ------------------------------------------------


def exact(x: Any) -> Any:
    """The same numbers as mpmath numbers, bit for bit."""
    mpf = mpmath().mpf
    return np.frompyfunc(lambda a: mpf(a) if isinstance(a, float) else mpf(float(a)), 1, 1)(np.asarray(x, dtype=float))


def is_exact(x: Array) -> bool:
    """Whether an array holds mpmath numbers."""
    module = sys.modules.get("mpmath")  # where nobody has imported it, there are none of its numbers
    return module is not None and x.dtype == object and any(isinstance(e, module.mpf) for e in x.flat)


def orthonormal(R: Array) -> Array:
    """The rotation nearest to a matrix that is one up to rounding, to the last digit of its own arithmetic.

    Newton's iteration for the polar factor, R ← R (3·1 − RᵀR) / 2, doubles the correct digits at every step.
    """
    steps = 1 if R.dtype != object else 3
    for _ in range(steps):
        R = R @ (3.0 * np.eye(3) - np.swapaxes(R, -1, -2) @ R) / 2
    return R


def unit(a: Array) -> Array:
    """a / |a|, to the last digit of its own arithmetic."""
    return a / sqrt((a * a).sum(-1))
