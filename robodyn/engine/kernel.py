"""A compiled program, called on arrays: one state through scalar code, many through SIMD lanes and threads."""

import ctypes
import math
import os
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from types import MappingProxyType
from typing import Any

import numpy as np

from ..arithmetic import Array
from . import cache, emit
from .compile import OPTIONS, Loaded, cpu, lanes, llvm, object_code
from .program import Program
from .sweeps import Looped

WORK = 5_000_000  # instructions times rows that a thread should have to do, about 0.2 ms: handing work over costs a tenth of it


class Kernel:
    """Machine code of a program, compiled when first called and kept on disk.

    The same bits come out whatever the batch, the lanes and the threads: scalar and SIMD code round alike (see `program`).
    """

    def __init__(self, program: Program | Looped) -> None:
        self.program = program
        self._listeners: list[Callable[[Any], None]] = []
        self._functions: dict[int, Any] = {}
        self._lock = threading.Lock()

    def __call__(self, batch: tuple[int, ...], arrays: Mapping[str, Array], threads: int | None = None) -> tuple[dict[str, Array], int]:
        """Outputs (*batch, size) by name, and the first row of a block in which something was not finite or a guard failed; −1: none.

        arrays: float64, one per input, (*batch, size) or with leading dimensions that broadcast to the batch.
        """
        n = math.prod(batch)
        rows = [_rows(arrays[name], batch, size) for name, size in self.program.inputs.items()]
        outputs = {name: np.empty((*batch, len(values))) for name, values in self.program.outputs.items()}
        width = lanes() if n >= lanes() else 1
        run = self._functions.get(width) or self._compiled(width)
        ins = [(x.ctypes.data, stride) for x, stride in rows]
        outs = [(out.ctypes.data, out.shape[-1]) for out in outputs.values()]

        def part(first: int, last: int) -> int:
            arguments = [a for pointer, stride in ins for a in (pointer + 8 * stride * first, stride)]
            bad = run(*arguments, *(pointer + 8 * size * first for pointer, size in outs), last - first)
            return first + bad if bad >= 0 else -1

        workers = min(threads or os.cpu_count() or 1, n * self.program.length // WORK) if n >= 2 * width else 1
        if workers <= 1:
            return outputs, part(0, n)
        # Chunks are whole blocks of lanes; the last takes what is left over.
        size = n // (workers * width) * width
        ends = [*range(size, size * workers, size), n]
        parts = _pool(workers).map(part, range(0, size * workers, size), ends)
        return outputs, min((b for b in parts if b >= 0), default=-1)

    def on_vector_code(self, listener: Callable[[Any], None]) -> None:
        """Be told of the SIMD function: now, or as soon as it is there."""
        self._listeners.append(listener)
        for width, function in self._functions.items():
            if width > 1:
                listener(function)

    def adopt(self, loaded: Loaded) -> None:
        """Use the scalar `run` of a module that has it already."""
        self._functions.setdefault(1, self._function(loaded))

    def _compiled(self, width: int) -> Any:
        with self._lock:
            if width not in self._functions:
                self._functions[width] = self._function(load(emit.module(self.program, width), emit.tables(**{emit.RUN: self.program})))
                for listener in self._listeners if width > 1 else ():
                    listener(self._functions[width])
        return self._functions[width]

    def _function(self, loaded: Loaded) -> Any:
        types = [ctypes.c_void_p, ctypes.c_int64] * len(self.program.inputs) + [ctypes.c_void_p] * len(self.program.outputs)
        function = loaded.function("run", *types, ctypes.c_int64)
        function.owner = loaded  # the code lives as long as the function
        return function

    def __getstate__(self) -> dict:
        return {"program": self.program}

    def __setstate__(self, state: dict) -> None:
        self.__init__(state["program"])


def load(ir: str, tables: Mapping[str, Array] = MappingProxyType({})) -> Loaded:
    """Machine code of a module, from the cache where it is there, its pointers set to the tables of their names."""
    version = ".".join(map(str, llvm().llvm_version_info))
    name = cache.key(ir, version, *cpu(), OPTIONS)
    code = cache.get(name)
    if code is None:
        code = object_code(ir)
        cache.put(name, code)
    return Loaded(code, tables)


def _rows(x: Array, batch: tuple[int, ...], size: int) -> tuple[Array, int]:
    """x as rows without gaps, and how many doubles lie between them: 0 where one row serves all."""
    if x.shape != (*batch, size):
        if x.size == size:
            return np.ascontiguousarray(x, dtype=float), 0
        x = np.broadcast_to(x, (*batch, size))
    return np.ascontiguousarray(x, dtype=float), size


_pools: dict[int, ThreadPoolExecutor] = {}


def _pool(workers: int) -> ThreadPoolExecutor:
    if workers not in _pools:
        _pools[workers] = ThreadPoolExecutor(workers, thread_name_prefix="robodyn")
    return _pools[workers]


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pools.clear)  # a child has no threads of its parent's
