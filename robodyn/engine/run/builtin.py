"""A kernel as a function of CPython's own kind, for one state or a small batch at a time.

ctypes needs longer to pass four pointers than the dynamics of an arm take. The function emitted here speaks CPython's fast calling
convention and reads NumPy arrays where their public C structure has them. Whatever is not the plain case (keywords, other types,
layouts and sizes, a result that is not trusted) goes to a Python function instead, which then says what is wrong.
"""

import ctypes
import inspect
import sys
import sysconfig
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np

from ..trace.layout import Looped
from ..trace.program import Program
from .compile import Loaded, lanes
from .kernel import WORK, Kernel, load

# Offsets in PyObject and PyArrayObject_fields (numpy/ndarraytypes.h), 64 bit.
TYPE, DATA, ND, DIMS, DESCR, FLAGS = 8, 16, 24, 32, 56, 64
PLAIN, WRITEABLE = 0x0001 | 0x0100, 0x0400  # C-contiguous, aligned
SIZE, ITEMS = 16, 24  # in PyTupleObject
NPY_DOUBLE = 12
SMALL = 50_000  # instructions times states up to which a batch is computed without letting other threads run

# What the code needs of this process, in the order of its table.
TABLE = (
    *("ndarray", "float64", "none", "one", "out", "threads"),  # objects, by their address
    *("array_new", "vectorcall", "incref", "decref", "save_thread", "restore_thread"),
    *("scalar_run", "vector_run"),  # null until there is such code
)

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
    loaded = load(module(kernel.program, tuple(arrays), optional))
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


def module(program: Program | Looped, arrays: tuple[str, ...], optional: int) -> str:
    """IR text of the table, and of `ptr @call(ptr self, ptr arguments, i64 count, ptr keywords)`."""
    (values,) = program.outputs.values()
    length, width = max(1, program.length), len(values)
    lines = [f"@table = global [{len(TABLE)} x ptr] zeroinitializer"]
    lines.append(f"@zeros = internal global [{max(program.inputs.values(), default=1)} x double] zeroinitializer")
    lines.append("define ptr @call(ptr %self, ptr %arguments, i64 %count, ptr %keywords) {")
    code = _Checks(lines)
    code.add("%shape = alloca [2 x i64]")
    for name in TABLE:
        lines.append(f"  %{name}.at = getelementptr ptr, ptr @table, i64 {TABLE.index(name)}")
        lines.append(f"  %{name} = load ptr, ptr %{name}.at")
    code.require(f"icmp sle i64 %count, {len(arrays)}")
    code.require(f"icmp sge i64 %count, {len(arrays) - optional}")
    out, threads = _keywords(code)
    places, shape = _arguments(code, [program.inputs[name] for name in arrays], optional)
    run = _code_to_run(code, shape, threads, length)
    result = _result(code, out, width, shape, places)
    by_name = dict(zip(arrays, places, strict=True))
    _evaluated(code, run, [by_name.get(name, ("@zeros", "0")) for name in program.inputs], result, shape, length)
    lines += ["error:", "  ret ptr null"]
    lines += ["discard:", f"  call void %decref(ptr {result})", "  br label %elsewhere"]
    lines += [
        "elsewhere:",
        "  %answer = call ptr %vectorcall(ptr %self, ptr %arguments, i64 %count, ptr %keywords)",
        "  ret ptr %answer",
        "}",
    ]
    return "\n".join(lines) + "\n"


Place = tuple[str, str]  # where an array's numbers are, and how many lie between its rows: 0 where one row serves all
Shape = tuple[str, str]  # an array's numbers of dimensions and of rows


def _arguments(code: "_Checks", sizes: list[int], optional: int) -> tuple[list[Place], Shape]:
    """Each argument: a plain float64 array of one dimension, or of two and with as many rows as the first; zeros for what is not given."""
    places: list[Place] = []
    shape = ("", "")
    for k, size in enumerate(sizes):
        if k < len(sizes) - optional:
            place, shape = _argument(code, k, size, shape)
            places.append((place, str(size)))
            continue
        with code.branch(code.value(f"icmp sgt i64 %count, {k}")) as merged:
            place, _ = _argument(code, k, size, shape)
        places.append((merged("ptr", place, "@zeros"), merged("i64", str(size), "0")))
    code.require(f"icmp sgt i64 {shape[1]}, 0")
    return places, shape


def _code_to_run(code: "_Checks", shape: Shape, threads: str, length: int) -> str:
    """Few states: scalar code. More: vector code, once it is there."""
    _, rows = shape
    # Work for several threads is the fallback's, unless it may have one only.
    alone = code.value(f"icmp slt i64 {rows}, {(2 * WORK - 1) // length + 1}")
    code.require_value(code.value(f"or i1 {alone}, {code.value(f'icmp eq ptr {threads}, %one')}"))
    few = code.value(f"icmp slt i64 {rows}, {lanes()}")
    run = code.value(f"select i1 {few}, ptr %scalar_run, ptr %vector_run")
    code.require(f"icmp ne ptr {run}, null")
    return run


def _result(code: "_Checks", out: str, width: int, shape: Shape, places: list[Place]) -> str:
    """The array of the result, counted once more: a given one apart from the arguments, or a new one."""
    nd, rows = shape
    with code.branch(code.value(f"icmp ne ptr {out}, null")):
        code.plain(out, PLAIN | WRITEABLE)
        code.extent(out, width, shape)
        start = code.field(out, DATA, "ptr")
        end = code.after(start, code.value(f"mul i64 {rows}, {width}"))
        for place, stride in places:
            stop = code.after(place, code.value(f"mul i64 {rows}, {stride}"))
            before, behind = code.value(f"icmp ule ptr {end}, {place}"), code.value(f"icmp ule ptr {stop}, {start}")
            code.require_value(code.value(f"or i1 {before}, {behind}"))
        code.add(f"call void %incref(ptr {out})")
    flat = code.value(f"icmp eq i32 {nd}, 1")
    code.add(f"store i64 {code.value(f'select i1 {flat}, i64 {width}, i64 {rows}')}, ptr %shape")
    code.add(f"store i64 {width}, ptr {code.value('getelementptr i64, ptr %shape, i64 1')}")
    with code.branch(code.value(f"icmp eq ptr {out}, null")) as merged:
        arguments = f"ptr %ndarray, i32 {nd}, ptr %shape, i32 {NPY_DOUBLE}, ptr null, ptr null, i32 0, i32 0, ptr null"
        new = code.value(f"call ptr %array_new({arguments})")
        code.require(f"icmp ne ptr {new}, null", otherwise="error")
    return merged("ptr", new, out)


def _evaluated(code: "_Checks", run: str, inputs: list[Place], result: str, shape: Shape, length: int) -> None:
    """Fill the result and return it. Long work lets other Python threads run."""
    _, rows = shape
    passed = ", ".join(f"ptr {place}, i64 {stride}" for place, stride in inputs)
    arguments = f"{passed}, ptr {code.field(result, DATA, 'ptr')}, i64 {rows}"
    with code.branch(code.value(f"icmp sgt i64 {rows}, {SMALL // length}")) as merged:
        state = code.value("call ptr %save_thread()")
    state = merged("ptr", state, "null")
    bad = code.value(f"call i64 {run}({arguments})")
    with code.branch(code.value(f"icmp ne ptr {state}, null")):
        code.add(f"call void %restore_thread(ptr {state})")
    code.require(f"icmp slt i64 {bad}, 0", otherwise="discard")
    code.add(f"ret ptr {result}")


def _argument(code: "_Checks", k: int, size: int, first: Shape) -> tuple[str, Shape]:
    """Where the numbers of argument k are, and its shape, which is the first one's."""
    array = code.value(f"load ptr, ptr {code.value(f'getelementptr ptr, ptr %arguments, i64 {k}')}")
    code.plain(array, PLAIN)
    extent = code.extent(array, size, first)
    return code.field(array, DATA, "ptr"), extent


def _keywords(code: "_Checks") -> tuple[str, str]:
    """out and threads, null where they are not given; nothing else may be."""
    found = {"out": "null", "threads": "null"}
    with code.branch(code.value("icmp ne ptr %keywords, null")) as merged:
        names = code.field("%keywords", SIZE, "i64")
        code.require(f"icmp sle i64 {names}, {len(found)}")
        for k in range(len(found)):
            with code.branch(code.value(f"icmp sgt i64 {names}, {k}")) as further:
                name = code.field("%keywords", ITEMS + 8 * k, "ptr")
                at = code.value(f"getelementptr ptr, ptr %arguments, i64 {code.value(f'add i64 %count, {k}')}")
                value = code.value(f"load ptr, ptr {at}")
                matches = {key: code.value(f"icmp eq ptr {name}, %{key}") for key in found}
                code.require_value(code.value(f"or i1 {matches['out']}, {matches['threads']}"))
                chosen = {key: code.value(f"select i1 {matches[key]}, ptr {value}, ptr {found[key]}") for key in found}
            found = {key: further("ptr", chosen[key], found[key]) for key in found}
        # None is as good as nothing.
        found = {key: code.value(f"select i1 {code.value(f'icmp eq ptr {x}, %none')}, ptr null, ptr {x}") for key, x in found.items()}
    out, threads = (merged("ptr", found[key], "null") for key in ("out", "threads"))
    nothing, one = code.value(f"icmp eq ptr {threads}, null"), code.value(f"icmp eq ptr {threads}, %one")
    code.require_value(code.value(f"or i1 {nothing}, {one}"))
    return out, threads


class _Checks:
    """Conditions in a row; where one fails, the Python function takes over."""

    def __init__(self, lines: list[str]) -> None:
        self.lines, self._count, self._block = lines, 0, "entry"
        lines.append("entry:")

    def add(self, text: str) -> None:
        self.lines.append("  " + text)

    def value(self, text: str) -> str:
        self._count += 1
        self.lines.append(f"  %e{self._count} = {text}")
        return f"%e{self._count}"

    def field(self, pointer: str, offset: int, kind: str) -> str:
        return self.value(f"load {kind}, ptr {self.value(f'getelementptr i8, ptr {pointer}, i64 {offset}')}")

    def after(self, pointer: str, count: str) -> str:
        """The address behind so many doubles."""
        return self.value(f"getelementptr double, ptr {pointer}, i64 {count}")

    def require(self, condition: str, otherwise: str = "elsewhere") -> None:
        self.require_value(self.value(condition), otherwise)

    def require_value(self, condition: str, otherwise: str = "elsewhere") -> None:
        block = self._fresh()
        self.lines += [f"  br i1 {condition}, label %{block}, label %{otherwise}", f"{block}:"]
        self._block = block

    def plain(self, array: str, flags: int) -> None:
        """It is an array of float64 with these flags, and of one or two dimensions."""
        self.require(f"icmp eq ptr {self.field(array, TYPE, 'ptr')}, %ndarray")
        self.require(f"icmp eq ptr {self.field(array, DESCR, 'ptr')}, %float64")
        found = self.value(f"and i32 {self.field(array, FLAGS, 'i32')}, {flags}")
        self.require(f"icmp eq i32 {found}, {flags}")
        nd = self.field(array, ND, "i32")
        self.require(f"icmp uge i32 {nd}, 1")
        self.require(f"icmp ule i32 {nd}, 2")

    def extent(self, array: str, width: int, first: Shape) -> Shape:
        """Its numbers of dimensions and of rows, which are those of the first array, if there is one; its rows are of this width."""
        nd, dims = self.field(array, ND, "i32"), self.field(array, DIMS, "ptr")
        last = self.value(f"sub i32 {nd}, 1")
        columns = self.value(f"load i64, ptr {self.value(f'getelementptr i64, ptr {dims}, i32 {last}')}")
        self.require(f"icmp eq i64 {columns}, {width}")
        flat = self.value(f"icmp eq i32 {nd}, 1")
        rows = self.value(f"select i1 {flat}, i64 1, i64 {self.value(f'load i64, ptr {dims}')}")
        if all(first):
            self.require(f"icmp eq i32 {nd}, {first[0]}")
            self.require(f"icmp eq i64 {rows}, {first[1]}")
        return nd, rows

    @contextmanager
    def branch(self, condition: str) -> Iterator[Callable[[str, str, str], str]]:
        """What follows, only where the condition holds; yields merged(type, value there, value elsewhere), for afterwards."""
        before, inside, done = self._block, self._fresh(), self._fresh()
        self.lines += [f"  br i1 {condition}, label %{inside}, label %{done}", f"{inside}:"]
        self._block, ends = inside, []
        yield lambda kind, there, elsewhere: self.value(f"phi {kind} [{there}, %{ends[0]}], [{elsewhere}, %{before}]")
        ends.append(self._block)
        self.lines += [f"  br label %{done}", f"{done}:"]
        self._block = done

    def _fresh(self) -> str:
        self._count += 1
        return f"b{self._count}"
