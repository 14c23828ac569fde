"""A compiled program, called on arrays: one state through scalar code, many through SIMD lanes and threads."""

import ctypes
import math
import os
import threading
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from ..arithmetic import Array
from . import cache, emit
from .compile import OPTIONS, Loaded, cpu, lanes, llvm, object_code
from .program import Program

CHUNK = 2048  # rows a thread takes at a time, at least


class Kernel:
    """Machine code of a program, compiled when first called and kept on disk.

    The same bits come out whatever the batch, the lanes and the threads: scalar and SIMD code round alike (see `program`).
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self._functions: dict[int, Any] = {}
        self._lock = threading.Lock()

    def __call__(self, batch: tuple[int, ...], arrays: Mapping[str, Array], threads: int | None = None) -> tuple[dict[str, Array], int]:
        """Outputs (*batch, size) by name, and the first row of a block in which something was not finite or a guard failed; −1: none.

        arrays: float64, one per input, (*batch, size) or with leading dimensions that broadcast to the batch.
        """
        n = math.prod(batch)
        rows = {name: _rows(np.asarray(arrays[name], dtype=float), batch, size) for name, size in self.program.inputs.items()}
        outputs = {name: np.empty((n, len(values))) for name, values in self.program.outputs.items()}
        width = 1 if n == 1 else lanes()
        run = self._function(width)

        def part(first: int, last: int) -> int:
            arguments = []
            for x, stride in rows.values():
                arguments += [x.ctypes.data + 8 * stride * first, stride]
            arguments += [out.ctypes.data + 8 * out.shape[1] * first for out in outputs.values()]
            bad = run(*arguments, last - first)
            return first + bad if bad >= 0 else -1

        workers = min(threads or os.cpu_count() or 1, max(1, n // CHUNK))
        if workers == 1:
            bad = part(0, n)
        else:
            # Chunks are whole blocks of lanes, so that the last block of each is not computed twice.
            size = -(-n // (workers * width)) * width
            parts = _pool(workers).map(part, range(0, n, size), [min(k + size, n) for k in range(0, n, size)])
            bad = min((b for b in parts if b >= 0), default=-1)
        return {name: out.reshape(*batch, out.shape[1]) for name, out in outputs.items()}, bad

    def _function(self, width: int):
        if width not in self._functions:
            with self._lock:
                if width not in self._functions:
                    types = [ctypes.c_void_p, ctypes.c_int64] * len(self.program.inputs) + [ctypes.c_void_p] * len(self.program.outputs)
                    loaded = load(emit.module(self.program, width))
                    function = loaded.function("run", *types, ctypes.c_int64)
                    function.owner = loaded  # the code lives as long as the function
                    self._functions[width] = function
        return self._functions[width]

    def __getstate__(self) -> dict:
        return {"program": self.program}

    def __setstate__(self, state: dict) -> None:
        self.__init__(state["program"])


def load(ir: str) -> Loaded:
    """Machine code of a module, from the cache where it is there."""
    version = ".".join(map(str, llvm().llvm_version_info))
    name = cache.key(ir, version, *cpu(), OPTIONS)
    code = cache.get(name)
    if code is None:
        code = object_code(ir)
        cache.put(name, code)
    return Loaded(code)


def _rows(x: Array, batch: tuple[int, ...], size: int) -> tuple[Array, int]:
    """x as rows without gaps, and how many doubles lie between them: 0 where one row serves all."""
    if x.size == size:
        return np.ascontiguousarray(x.reshape(size)), 0
    return np.ascontiguousarray(np.broadcast_to(x, (*batch, size))).reshape(-1, size), size


_pools: dict[int, ThreadPoolExecutor] = {}


def _pool(workers: int) -> ThreadPoolExecutor:
    if workers not in _pools:
        _pools[workers] = ThreadPoolExecutor(workers, thread_name_prefix="robodyn")
    return _pools[workers]


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pools.clear)  # a child has no threads of its parent's
