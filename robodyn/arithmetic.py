"""What the formalism asks of numbers, beyond + − × ÷ and `@`.

The formalism is written once, on NumPy arrays. Their elements may be float64 (the readable reference), mpmath numbers
(the 50-digit reference) or traced symbols (anything with methods `sin`, `cos`, `sqrt`, `tanh`, …). Arrays of the last two
have dtype object. These few functions are all that has to know the difference.
"""

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


def _elementwise(name: str) -> Callable[[Any], Any]:
    def one(x: Any) -> Any:
        method = getattr(x, name, None)
        return method() if callable(method) else getattr(mpmath(), name)(x)

    on_objects = np.frompyfunc(one, 1, 1)

    def function(x: Any) -> Any:
        x = np.asarray(x)
        return on_objects(x) if x.dtype == object else getattr(np, name)(x)

    function.__name__ = name
    function.__doc__ = f"Elementwise {name} of an array of any arithmetic."
    return function


sin = _elementwise("sin")
cos = _elementwise("cos")
sqrt = _elementwise("sqrt")
tanh = _elementwise("tanh")


def zeros(shape: tuple[int, ...], dtype: np.dtype) -> Array:
    """Zeros that can hold numbers of `dtype`; an object array gets Python floats, which fold away when traced."""
    return np.full(shape, 0.0, dtype=dtype)


def dtype_of(*arrays: Any) -> np.dtype:
    """The dtype that results from mixing these arrays: object as soon as one of them is."""
    return np.result_type(float, *(np.asarray(a) for a in arrays if a is not None))


def known(x: Any) -> Any:
    """The value of a number; None for a traced symbol whose value only a kernel will know."""
    return x.constant if hasattr(x, "constant") else x


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
    return x.dtype == object and any(isinstance(e, mpmath().mpf) for e in x.flat)


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
