"""A kernel as a function of CPython's own kind, for one state or a small batch at a time.

ctypes needs longer to pass four pointers than the dynamics of an arm take. The function bound here (see `emit.call`) speaks CPython's
fast calling convention and reads NumPy arrays where their public C structure has them. Whatever is not the plain case (keywords, other
types, layouts and sizes, a result that is not trusted) goes to a Python function instead, which then says what is wrong.
"""

import ctypes
import inspect
import sys
import sysconfig
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from ..emit import call
from ..emit.call import DATA, DESCR, DIMS, FLAGS, ND, PLAIN, TABLE, TYPE
from .compile import Loaded, lanes
from .kernel import WORK, Kernel, load

METH_FASTCALL, METH_KEYWORDS = 0x80, 0x2


class _MethodDef(ctypes.Structure):
    _fields_ = [("name", ctypes.c_char_p), ("function", ctypes.c_void_p), ("flags", ctypes.c_int), ("doc", ctypes.c_char_p)]


@cache
def supported() -> bool:
    """Whether this interpreter and this NumPy lay things out as assumed: asked of an array whose fields are known."""
    if ctypes.sizeof(ctypes.c_void_p) != 8 or sysconfig.get_config_var("Py_GIL_DISABLED"):
        return False
    x = np.zeros((3, 5))
    try:
        word = lambda offset: ctypes.c_void_p.from_address(id(x) + offset).value  # noqa: E731
        number = lambda offset: ctypes.c_int.from_address(id(x) + offset).value  # noqa: E731
        dims = (ctypes.c_int64 * 2).from_address(word(DIMS) or 0)
        fields = word(TYPE) == id(np.ndarray) and word(DATA) == x.ctypes.data and word(DESCR) == id(np.dtype(float))
        return fields and number(ND) == 2 and list(dims) == [3, 5] and number(FLAGS) & PLAIN == PLAIN
    except (ValueError, TypeError):
        return False


def bind(kernel: Kernel, arrays: Sequence[str], fallback: Callable[..., Any], *, optional: int = 0) -> Any:
    """A built-in function (*arrays, threads=None, out=None) that computes the kernel's one output; `fallback` takes every other call.

    arrays: the inputs that are arguments, in order; the last `optional` of them may be left out, and are then zero like all other inputs.
    """
    loaded = load(call.module(kernel.program, tuple(arrays), optional, lanes(), 2 * WORK - 1))
    table = (ctypes.c_void_p * len(TABLE)).from_address(loaded.address("table"))
    table.owner = loaded  # type: ignore[attr-defined]  # whoever writes into it keeps it
    values = {
        "ndarray": id(np.ndarray),
        "float64": id(np.dtype(float)),
        "none": id(None),
        "one": id(1),
        "out": id(sys.intern("out")),
        "threads": id(sys.intern("threads")),
        "array_new": _numpy_api(93),
        "vectorcall": _address("PyObject_Vectorcall"),
        "incref": _address("Py_IncRef"),
        "decref": _address("Py_DecRef"),
        "save_thread": _address("PyEval_SaveThread"),
        "restore_thread": _address("PyEval_RestoreThread"),
    }
    for name, value in values.items():
        table[TABLE.index(name)] = value

    def code_is_there(width: int, function: Any) -> None:
        table[TABLE.index("vector_run" if width > 1 else "scalar_run")] = ctypes.cast(function, ctypes.c_void_p).value

    kernel.on_code(code_is_there)
    return _builtin(fallback, loaded)


class _Answering:
    """What a built-in function belongs to: it answers calls that are not plain, and keeps the code alive."""

    def __init__(self, method: Callable[..., Any], code: Loaded) -> None:
        self._method, self._code = method, code

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        return self._method(*arguments, **keywords)

    def __reduce__(self) -> tuple:
        # A built-in function is pickled as an attribute of what it belongs to: the object whose method it stands before.
        return _itself, (self._method.__self__,)  # type: ignore[attr-defined]


def _itself(owner: object) -> object:
    return owner


def _builtin(fallback: Callable[..., Any], loaded: Loaded) -> Any:
    name, doc = _text(fallback.__name__), _text(_described(fallback))
    # CPython reads a function's definition when that is freed, be it after all else of a cycle or at its own end: definitions stay.
    definition = _immortal(_MethodDef(name, loaded.address("call"), METH_FASTCALL | METH_KEYWORDS, doc))
    new = ctypes.pythonapi.PyCFunction_NewEx
    new.restype, new.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    return new(ctypes.addressof(definition), _Answering(fallback, loaded), None)


def _described(fallback: Callable[..., Any]) -> str:
    """The docstring behind a signature, as CPython keeps them together; of defaults only what can be spelt."""
    found = []
    for parameter in inspect.signature(fallback).parameters.values():
        spelt = parameter.default is inspect.Parameter.empty or isinstance(parameter.default, (int, float, str, tuple, type(None)))
        found.append(parameter.replace(annotation=inspect.Parameter.empty, default=parameter.default if spelt else None))
    text = str(inspect.Signature(found))[1:]
    return f"{fallback.__name__}($self, {text}\n--\n\n{inspect.getdoc(fallback) or ''}"


@cache
def _text(text: str) -> bytes:
    """The same bytes for the same text, for ever."""
    return _immortal(text.encode())


def _immortal(x: Any) -> Any:
    """x, with a reference that nobody gives back."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(x))
    return x


def _address(symbol: str) -> int:
    return ctypes.cast(getattr(ctypes.pythonapi, symbol), ctypes.c_void_p).value or 0


def _numpy_api(index: int) -> int:
    """A function of NumPy's C API, from the table that every extension module gets."""
    from numpy._core import _multiarray_umath  # type: ignore[attr-defined]

    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return (ctypes.c_void_p * (index + 1)).from_address(pointer(_multiarray_umath._ARRAY_API, None))[index] or 0
