"""A compiled program, called on arrays: one state through scalar code, many through SIMD lanes and threads."""

import ctypes
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from ...arithmetic import Array
from ...system import cache as disk
from ...system.processes import cores, lock, together
from ..emit import blocks, parts
from ..trace.layout import Looped
from ..trace.program import Program
from .compile import OPTIONS, Loaded, cpu, lanes, object_code, version

DOUBLE, SINGLE = np.dtype(np.float64), np.dtype(np.float32)
SCALARS = {DOUBLE: "double", SINGLE: "float"}  # what LLVM calls them
NOTHING: Mapping[str, Array] = MappingProxyType({})
WORK = 5_000_000  # instructions times rows that a thread should have to do, about 0.2 ms: handing work over costs a tenth of it


class Kernel:
    """Machine code of a program in float64 or float32, compiled when first called and kept on disk.

    The same bits come out whatever the batch, the lanes and the threads: scalar and SIMD code round alike (see `program`).
    """

    def __init__(self, program: Program | Looped, dtype: np.dtype = DOUBLE) -> None:
        self.program, self.dtype = program, np.dtype(dtype)
        self._listeners: list[Callable[[int, Any], None]] = []
        self._functions: dict[int, Any] = {}
        self._lock = lock()

    def __call__(
        self, batch: tuple[int, ...], arrays: Mapping[str, Array], threads: int | None = None, out: Mapping[str, Array] = NOTHING
    ) -> tuple[dict[str, Array], int]:
        """Outputs (*batch, size) by name, and the first row of a block in which something was not finite or a guard failed; −1: none.

        arrays: one per input, converted to the kernel's dtype, (*batch, size) or with leading dimensions that broadcast to the batch.
        out: arrays of the dtype without gaps to write outputs into; new ones are made for the others.
        """
        n = math.prod(batch)
        rows = [_rows(arrays[name], batch, size, self.dtype) for name, size in self.program.inputs.items()]
        sizes = {name: len(values) for name, values in self.program.outputs.items()}
        outputs = {name: out[name] if name in out else np.empty((*batch, size), self.dtype) for name, size in sizes.items()}
        width = lanes() * DOUBLE.itemsize // self.dtype.itemsize
        width = width if n >= width else 1
        run = self._functions.get(width) or self._compiled(width)
        ins = [(x.ctypes.data, stride) for x, stride in rows]
        outs = [(outputs[name].ctypes.data, size) for name, size in sizes.items()]
        item = self.dtype.itemsize

        def part(first: int, last: int, _: object = (rows, outputs)) -> int:
            # Holds the arrays: an interrupted call must not take them away from threads that still read and write them.
            arguments = [a for pointer, stride in ins for a in (pointer + item * stride * first, stride)]
            bad = run(*arguments, *(pointer + item * size * first for pointer, size in outs), last - first)
            return first + bad if bad >= 0 else -1

        workers = n * self.program.length // WORK if n >= 2 * width and threads != 1 else 1
        workers = min(workers, threads or cores()) if workers > 1 else 1
        if workers <= 1:
            return outputs, part(0, n)
        # Chunks are whole blocks of lanes; the last takes what is left over.
        size = n // (workers * width) * width
        ends = [*range(0, size * workers, size), n]
        parts = together(lambda k: part(ends[k], ends[k + 1]), workers)
        return outputs, min((b for b in parts if b >= 0), default=-1)

    def on_code(self, listener: Callable[[int, Any], None]) -> None:
        """Be told of each machine function and its lanes: now, or as soon as it is there."""
        with self._lock:
            self._listeners.append(listener)
            for width, function in self._functions.items():
                listener(width, function)

    def _compiled(self, width: int) -> Any:
        with self._lock:
            if width not in self._functions:
                code = blocks.module(self.program, width, SCALARS[self.dtype])
                self._functions[width] = self._function(load(code, parts.tables(**{blocks.NAME: self.program})))
                for listener in self._listeners:
                    listener(width, self._functions[width])
        return self._functions[width]

    def _function(self, loaded: Loaded) -> Any:
        types = [ctypes.c_void_p, ctypes.c_int64] * len(self.program.inputs) + [ctypes.c_void_p] * len(self.program.outputs)
        function = loaded.function("run", *types, ctypes.c_int64)
        function.owner = loaded  # the code lives as long as the function
        return function

    def __getstate__(self) -> dict:
        return {"program": self.program, "dtype": self.dtype}

    def __setstate__(self, state: dict) -> None:
        self.__init__(state["program"], state["dtype"])


def load(ir: str, tables: Mapping[str, Array] = MappingProxyType({})) -> Loaded:
    """Machine code of a module, from the cache where it is there, its pointers set to the tables of their names."""
    name = disk.key(ir, *version(), *cpu(), OPTIONS)
    code = disk.get(name)
    if code is None:
        code = object_code(ir)
        disk.put(name, code)
    return Loaded(code, tables)


def _rows(x: Array, batch: tuple[int, ...], size: int, dtype: np.dtype) -> tuple[Array, int]:
    """x as rows without gaps, and how many numbers lie between them: 0 where one row serves all."""
    stride = size
    if x.shape != (*batch, size):
        if x.size == size:
            stride = 0
        else:
            x = np.broadcast_to(x, (*batch, size))
    if dtype == DOUBLE:
        return np.ascontiguousarray(x, dtype=dtype), stride
    with np.errstate(over="ignore"):  # what is too large for float32 is ∞, and found so
        return np.ascontiguousarray(x, dtype=dtype), stride
