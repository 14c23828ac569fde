"""From LLVM IR to machine code in this process, for the CPU at hand."""

import ctypes
import os
import threading
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

from ...arithmetic import Array
from ...errors import MissingPackageError

_lock = threading.RLock()  # LLVM's context is one for the process
_held: list[Any] = []  # llvmlite's own lock, once it is there: every call, and every object's end, takes that; it has no public name


@cache
def llvm() -> Any:
    """llvmlite's binding, imported and initialised when first used. MissingPackageError where it is not installed."""
    with _lock:
        try:
            import llvmlite.binding as binding
        except ImportError as error:
            need = "backend='native' needs the package llvmlite: pip install llvmlite, or use backend='numpy'"
            raise MissingPackageError(need) from error
        binding.initialize_native_target()
        binding.initialize_native_asmprinter()
        _held[:] = [binding.ffi.lib._lock]
        return binding


def _before_fork() -> None:
    _lock.acquire()
    for lock in _held:
        lock.__enter__()


def _after_fork() -> None:
    for lock in _held:
        lock.__exit__(None, None, None)
    _lock.release()


if hasattr(os, "register_at_fork"):  # a child that was born while another thread imported, compiled or loaded would wait for it for ever
    os.register_at_fork(before=_before_fork, after_in_parent=_after_fork, after_in_child=_after_fork)


@cache
def version() -> tuple[str, str]:
    """LLVM's version and the triple that it compiles for."""
    return ".".join(map(str, llvm().llvm_version_info)), llvm().get_default_triple()


@cache
def cpu() -> tuple[str, str]:
    """Name and features of this CPU."""
    return llvm().get_host_cpu_name(), llvm().get_host_cpu_features().flatten()


@cache
def lanes() -> int:
    """Doubles in the widest vector registers here."""
    features = cpu()[1].split(",")
    return 8 if "+avx512f" in features else 4 if "+avx2" in features else 2


OPTIONS = "opt 2, pic, no vectorizers, no unrolling"  # part of the cache key: change it with what `object_code` does


def object_code(ir: str) -> bytes:
    """The object file of a module."""
    with _lock:
        module, machine = _optimised(ir)
        return machine.emit_object(module)


def assembly(ir: str) -> str:
    """The same, to read."""
    with _lock:
        module, machine = _optimised(ir)
        return machine.emit_assembly(module)


def _optimised(ir: str) -> tuple[Any, Any]:
    binding = llvm()
    module = binding.parse_assembly(ir)
    name, features = cpu()
    target = binding.Target.from_default_triple()
    machine = target.create_target_machine(cpu=name, features=features, opt=2, reloc="pic", codemodel="jitdefault")
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    options = binding.create_pipeline_tuning_options(speed_level=2)
    options.slp_vectorization = options.loop_vectorization = options.loop_unrolling = False
    passes = binding.create_pass_builder(machine, options)
    passes.getModulePassManager().run(module, passes)
    return module, machine


class Loaded:
    """An object file, loaded: machine code that can be called as long as this lives."""

    def __init__(self, code: bytes, tables: Mapping[str, Array] = MappingProxyType({})) -> None:
        binding = llvm()
        with _lock:
            module = binding.parse_assembly("")
            machine = binding.Target.from_default_triple().create_target_machine(cpu=cpu()[0], features=cpu()[1], codemodel="jitdefault")
            self._engine = binding.create_mcjit_compiler(module, machine)
            self._engine.add_object_file(binding.object_file.ObjectFileRef.from_data(code))
            self._engine.finalize_object()
        self._tables = tables
        for name, table in tables.items():
            ctypes.c_void_p.from_address(self.address(name)).value = table.ctypes.data

    def function(self, name: str, *types: Any, result: Any = ctypes.c_int64) -> Any:
        """A C function of the object file."""
        return ctypes.CFUNCTYPE(result, *types)(self._engine.get_function_address(name))

    def address(self, name: str) -> int:
        """Where a function or a global variable lies."""
        return self._engine.get_function_address(name) or self._engine.get_global_value_address(name)
