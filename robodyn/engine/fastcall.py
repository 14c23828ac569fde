"""A kernel as a function of CPython's own kind, for one state or a small batch at a time.

ctypes needs longer to pass four pointers than the dynamics of an arm take. The function emitted here speaks CPython's fast calling
convention and reads NumPy arrays where their public C structure has them. Whatever is not the plain case (keywords, other types,
layouts and sizes, a result that is not trusted) goes to a Python function instead, which then says what is wrong.
"""

import ctypes
import sysconfig
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from . import blocks, emit
from .compile import Loaded, lanes
from .kernel import Kernel, load
from .program import Program
from .sweeps import Looped

# Offsets in PyObject and PyArrayObject_fields (numpy/ndarraytypes.h), 64 bit.
TYPE, DATA, ND, DIMS, DESCR, FLAGS = 8, 16, 24, 32, 56, 64
PLAIN = 0x0001 | 0x0100  # C-contiguous, aligned
DOUBLE = 12  # NPY_DOUBLE
SMALL = 50_000  # instructions times states up to which a batch is computed without letting other threads run

# What the code needs of this process, in the order of its table.
TABLE = ("ndarray", "float64", "array_new", "vectorcall", "decref", "vector_run")

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


def bind(kernel: Kernel, arrays: Sequence[str], fallback: Callable[..., Any], *, optional: int = 0) -> tuple[Any, object]:
    """A built-in function of positional arrays that computes the kernel's one output; `fallback` takes every other call.

    arrays: the inputs that are arguments, in order; the last `optional` of them may be left out, and are then zero like all other inputs.
    Also returns what must live as long as the function: CPython keeps pointers into it.
    """
    loaded = load(module(kernel.program, tuple(arrays), optional), emit.tables(**{blocks.NAME: kernel.program}))
    table = (ctypes.c_void_p * len(TABLE)).from_address(loaded.address("table"))
    values = {
        "ndarray": id(np.ndarray),
        "float64": id(np.dtype(float)),
        "array_new": _numpy_api(93),
        "vectorcall": _address("PyObject_Vectorcall"),
        "decref": _address("Py_DecRef"),
        "vector_run": 0,
    }
    for i, name in enumerate(TABLE):
        table[i] = values[name]

    def vector_code_is_there(function: Any) -> None:
        table[TABLE.index("vector_run")] = ctypes.cast(function, ctypes.c_void_p).value

    kernel.adopt(loaded)
    kernel.on_vector_code(vector_code_is_there)
    return _builtin(fallback, loaded)


def _builtin(fallback: Callable[..., Any], loaded: Loaded) -> tuple[Any, object]:
    name, doc = fallback.__name__.encode(), (fallback.__doc__ or "").encode()
    definition = _MethodDef(name, loaded.address("call"), METH_FASTCALL | METH_KEYWORDS, doc)
    new = ctypes.pythonapi.PyCFunction_NewEx
    new.restype, new.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    function = new(ctypes.addressof(definition), fallback, None)
    return function, (definition, name, doc, loaded)


def _address(symbol: str) -> int:
    return ctypes.cast(getattr(ctypes.pythonapi, symbol), ctypes.c_void_p).value or 0


def _numpy_api(index: int) -> int:
    """A function of NumPy's C API, from the table that every extension module gets."""
    from numpy._core import _multiarray_umath  # type: ignore[attr-defined]

    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return (ctypes.c_void_p * (index + 1)).from_address(pointer(_multiarray_umath._ARRAY_API, None))[index] or 0


def module(program: Program | Looped, arrays: tuple[str, ...], optional: int) -> str:
    """IR text: the scalar kernel `run`, the table, and `ptr @call(ptr self, ptr arguments, i64 count, ptr keywords)`."""
    (values,) = program.outputs.values()
    sizes = [program.inputs[name] for name in arrays]
    lines = [blocks.module(program, 1)]
    lines.append(f"@table = global [{len(TABLE)} x ptr] zeroinitializer")
    lines.append(f"@zeros = internal constant [{max(program.inputs.values(), default=1)} x double] zeroinitializer")
    lines.append("define ptr @call(ptr %self, ptr %arguments, i64 %count, ptr %keywords) {")
    code = _Checks(lines)
    code.require("icmp eq ptr %keywords, null")
    most, least = len(arrays), len(arrays) - optional
    code.require(f"icmp sle i64 %count, {most}")
    code.require(f"icmp sge i64 %count, {least}")
    for name in TABLE:
        lines.append(f"  %{name}.at = getelementptr ptr, ptr @table, i64 {TABLE.index(name)}")
        lines.append(f"  %{name} = load ptr, ptr %{name}.at")

    # Each argument: a plain float64 array of one dimension, or of two and with as many rows as the first.
    for k, size in enumerate(sizes):
        given = "true" if k < least else code.value(f"icmp sgt i64 %count, {k}")
        lines.append(f"  br i1 {given}, label %given{k}, label %missing{k}")
        lines.append(f"given{k}:")
        array = code.value(f"load ptr, ptr {code.value(f'getelementptr ptr, ptr %arguments, i64 {k}')}")
        code.require(f"icmp eq ptr {code.field(array, TYPE, 'ptr')}, %ndarray")
        code.require(f"icmp eq ptr {code.field(array, DESCR, 'ptr')}, %float64")
        flags = code.value(f"and i32 {code.field(array, FLAGS, 'i32')}, {PLAIN}")
        code.require(f"icmp eq i32 {flags}, {PLAIN}")
        nd, dims = code.field(array, ND, "i32"), code.field(array, DIMS, "ptr")
        code.require(f"icmp uge i32 {nd}, 1")
        code.require(f"icmp ule i32 {nd}, 2")
        last = code.value(f"sub i32 {nd}, 1")
        width = code.value(f"load i64, ptr {code.value(f'getelementptr i64, ptr {dims}, i32 {last}')}")
        code.require(f"icmp eq i64 {width}, {size}")
        flat = code.value(f"icmp eq i32 {nd}, 1")
        rows = code.value(f"select i1 {flat}, i64 1, i64 {code.value(f'load i64, ptr {dims}')}")
        if k == 0:
            first_nd, first_rows = nd, rows
        else:
            code.require(f"icmp eq i32 {nd}, {first_nd}")
            code.require(f"icmp eq i64 {rows}, {first_rows}")
        data = code.field(array, DATA, "ptr")
        lines.append(f"  br label %known{k}")
        lines.append(f"missing{k}:")
        lines.append(f"  br label %known{k}")
        lines.append(f"known{k}:")
        lines.append(f"  %data{k} = phi ptr [{data}, %{code.block}], [@zeros, %missing{k}]")
        lines.append(f"  %stride{k} = phi i64 [{size}, %{code.block}], [0, %missing{k}]")
        code.block = f"known{k}"
    code.require(f"icmp sgt i64 {first_rows}, 0")
    code.require(f"icmp sle i64 {first_rows}, {max(1, SMALL // max(1, program.length))}")

    # Few states: scalar code. More: vector code, once it is there.
    alone = code.value(f"icmp slt i64 {first_rows}, {lanes()}")
    there = code.value("icmp ne ptr %vector_run, null")
    code.require_value(code.value(f"or i1 {alone}, {there}"))
    run = code.value(f"select i1 {alone}, ptr @run, ptr %vector_run")
    lines.append("  %shape = alloca [2 x i64]")
    lines.append(f"  %two = icmp eq i32 {first_nd}, 2")
    lines.append(f"  %shape0 = select i1 %two, i64 {first_rows}, i64 {len(values)}")
    lines.append("  store i64 %shape0, ptr %shape")
    lines.append("  %shape1.at = getelementptr i64, ptr %shape, i64 1")
    lines.append(f"  store i64 {len(values)}, ptr %shape1.at")
    new = f"ptr %ndarray, i32 {first_nd}, ptr %shape, i32 {DOUBLE}, ptr null, ptr null, i32 0, i32 0, ptr null"
    lines.append(f"  %out = call ptr %array_new({new})")
    lines.append("  %failed = icmp eq ptr %out, null")
    lines.append("  br i1 %failed, label %error, label %compute")
    lines.append("compute:")
    code.block = "compute"
    result = code.field("%out", DATA, "ptr")
    pairs = {name: f"ptr %data{k}, i64 %stride{k}" for k, name in enumerate(arrays)}
    passed = [pairs.get(name, "ptr @zeros, i64 0") for name in program.inputs]
    lines.append(f"  %bad = call i64 {run}({', '.join(passed)}, ptr {result}, i64 {first_rows})")
    lines.append("  %good = icmp slt i64 %bad, 0")
    lines.append("  br i1 %good, label %done, label %discard")
    lines.append("done:")
    lines.append("  ret ptr %out")
    lines.append("error:")
    lines.append("  ret ptr null")
    lines.append("discard:")
    lines.append("  call void %decref(ptr %out)")
    lines.append("  br label %elsewhere")
    lines.append("elsewhere:")
    lines.append(f"  %vc.at = getelementptr ptr, ptr @table, i64 {TABLE.index('vectorcall')}")
    lines.append("  %vc = load ptr, ptr %vc.at")
    lines.append("  %answer = call ptr %vc(ptr %self, ptr %arguments, i64 %count, ptr %keywords)")
    lines.append("  ret ptr %answer")
    lines.append("}")
    return "\n".join(lines) + "\n"


class _Checks:
    """Conditions in a row; where one fails, the Python function takes over."""

    def __init__(self, lines: list[str]) -> None:
        self.lines, self._count, self.block = lines, 0, "entry"
        lines.append("entry:")

    def value(self, text: str) -> str:
        self._count += 1
        self.lines.append(f"  %e{self._count} = {text}")
        return f"%e{self._count}"

    def field(self, pointer: str, offset: int, kind: str) -> str:
        return self.value(f"load {kind}, ptr {self.value(f'getelementptr i8, ptr {pointer}, i64 {offset}')}")

    def require(self, condition: str) -> None:
        self.require_value(self.value(condition))

    def require_value(self, condition: str) -> None:
        self._count += 1
        self.block = f"ok{self._count}"
        self.lines += [f"  br i1 {condition}, label %{self.block}, label %elsewhere", f"{self.block}:"]
