"""The kinds of numbers that the formalism is computed with: float64, mpmath's of 50 digits, symbols that are not known yet.

Arrays of the last two have dtype object.
"""

import sys
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np

from ..errors import MissingPackageError

Array = np.ndarray[Any, Any]
EPS = float(np.finfo(float).eps)
DIGITS = 50  # of backend="mpmath"


def mpmath():
    """The mpmath module, imported when first used. MissingPackageError where it is not installed."""
    try:
        import mpmath as module
    except ImportError as error:
        raise MissingPackageError("backend='mpmath' needs the package mpmath: pip install 'robodyn[mpmath]'") from error
    return module


def precision(backend: str) -> AbstractContextManager[object]:
    """The working precision of a backend, for as long as it computes."""
    return mpmath().workdps(DIGITS) if backend == "mpmath" else nullcontext()


def exact(x: Any) -> Any:
    """The same numbers as mpmath numbers, bit for bit."""
    mpf = mpmath().mpf
    return np.frompyfunc(lambda a: mpf(a) if isinstance(a, float) else mpf(float(a)), 1, 1)(np.asarray(x, dtype=float))


def is_exact(x: Array) -> bool:
    """Whether an array holds mpmath numbers."""
    module = sys.modules.get("mpmath")  # where nobody has imported it, there are none of its numbers
    return module is not None and x.dtype == object and any(isinstance(e, module.mpf) for e in x.flat)


def known(x: Any) -> Any:
    """A number as it is; None for a symbol whose value is not known yet."""
    return getattr(x, "constant", x)


def zeros(shape: tuple[int, ...], dtype: np.dtype) -> Array:
    """Zeros that can hold numbers of `dtype`; an object array gets Python floats, which fold away when traced."""
    return np.full(shape, 0.0, dtype=dtype)


def dtype_of(*arrays: Any) -> np.dtype:
    """The dtype that results from mixing these arrays: object as soon as one of them is."""
    return np.result_type(float, *(np.asarray(a) for a in arrays if a is not None))
