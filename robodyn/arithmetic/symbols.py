"""NumPy's own functions on numbers that are not known yet.

NumPy runs many functions on arrays of objects, but asks each comparison for its truth, which a number that is not known yet does not
have. Symbols and arrays of them are therefore asked first (NEP 13 and 18) and answer with the functions of `arithmetic`.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from . import functions as arithmetic
from .functions import ON_OBJECTS
from .numbers import Array


class Symbolic:
    """Base of what NumPy's functions are to ask first."""

    __slots__ = ()

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        if out := kwargs.get("out"):
            kwargs["out"] = tuple(_plain(x) for x in out)
        found = getattr(ON_OBJECTS.get(ufunc.__name__, ufunc), method)(*(_plain(x) for x in inputs), **kwargs)
        return out[0] if out else symbols(found)

    def __array_function__(self, function: Callable[..., Any], types: Any, args: Any, kwargs: Any) -> Any:
        if function in FUNCTIONS:
            return symbols(FUNCTIONS[function](*args, **kwargs))
        return symbols(np.ndarray.__array_function__(_EMPTY, function, (), args, kwargs))  # NumPy's own way


class SymbolArray(Symbolic, np.ndarray):
    """An object array of symbols: what a control law sees when it is traced."""


_EMPTY = np.empty(0, dtype=object)


def symbols(x: Any) -> Any:
    """A copy of an object array that NumPy's functions ask first: whoever gets it may write into it. All else as it is."""
    return x.copy().view(SymbolArray) if isinstance(x, np.ndarray) and x.dtype == object else x


def _plain(x: Any) -> Any:
    return np.asarray(x) if isinstance(x, Symbolic) else x


def _norm(x: Any, ord: Any = None, axis: int | None = None, keepdims: bool = False) -> Any:
    if ord not in (None, 2) or (ord == 2 and axis is None and np.ndim(x) > 1):
        raise TypeError(f"np.linalg.norm(…, ord={ord!r}) of numbers that are not known yet: only the Euclidean norm is there")
    x = np.asarray(x)
    return arithmetic.sqrt((x * x).sum(axis=axis, keepdims=keepdims))


def _select(conditions: Any, choices: Any, default: Any = 0.0) -> Array:
    result = default
    for condition, choice in zip(reversed(conditions), reversed(choices), strict=True):
        result = arithmetic.where(condition, choice, result)
    return result


def _clip(x: Any, a_min: Any = None, a_max: Any = None, out: Any = None, *, min: Any = None, max: Any = None) -> Array:
    low, high = (min if a_min is None else a_min), (max if a_max is None else a_max)
    x = x if low is None else arithmetic.maximum(x, low)
    x = x if high is None else arithmetic.minimum(x, high)
    if out is None:
        return x
    out[...] = x
    return out


FUNCTIONS: dict[Callable[..., Any], Callable[..., Any]] = {
    np.where: arithmetic.where,
    np.clip: _clip,
    np.select: _select,
    np.linalg.norm: _norm,
}
