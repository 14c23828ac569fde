"""What concerns the whole process: its cores and threads, locks that a forked child finds free, and Python's search for garbage."""

import gc
import os
import threading
import weakref
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache, wraps
from typing import Any, Generic, TypeVar, overload

Owner = TypeVar("Owner")
Value = TypeVar("Value")

_locks: "weakref.WeakSet[threading.Lock]" = weakref.WeakSet()
_paused = False
MOST_THREADS = 256


def cores() -> int:
    """Cores that this process may use: a container or `taskset` may leave it fewer than there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def together(work: Callable[[int], Value], n: int, stop: Callable[[], object] = lambda: None) -> list[Value]:
    """work(0) … work(n − 1) at a time, the first in this thread: native code, which lets other threads run. Returns when all have.

    stop: called as soon as one raises, or Ctrl-C comes, for the others to give up; what was raised is raised again.
    """
    futures: list[Future[Value]] = []
    try:
        for k in range(1, n):
            futures.append(_pool().submit(work, k))
            futures[-1].add_done_callback(lambda future: future.exception() and stop())
        return [work(0), *(future.result() for future in futures)]
    except BaseException:
        stop()
        raise
    finally:
        wait(futures)


@cache
def _pool() -> ThreadPoolExecutor:
    """Threads for everyone: as many as work at a time."""
    return ThreadPoolExecutor(MOST_THREADS, thread_name_prefix="robodyn")


def lock() -> threading.Lock:
    """A lock that is free in a forked child, whichever thread held it: that thread does not live there, and would never release it."""
    made = threading.Lock()
    _locks.add(made)
    return made


class cached_property(Generic[Owner, Value]):
    """As functools.cached_property, without the lock that it has before Python 3.12.

    That is one for all objects of a class: threads with different robots wait for each other, and a child forked meanwhile for ever.
    """

    def __init__(self, function: Callable[[Owner], Value]) -> None:
        self._function, self.__doc__ = function, function.__doc__

    def __set_name__(self, kind: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, owner: None, kind: type) -> "cached_property[Owner, Value]": ...
    @overload
    def __get__(self, owner: Owner, kind: type) -> Value: ...
    def __get__(self, owner: Any, kind: type) -> Any:
        if owner is None:
            return self
        value = owner.__dict__[self._name] = self._function(owner)
        return value


def without_collections(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, run while Python does not look for garbage: a trace makes many objects, all in use, and would wait for it."""

    @wraps(function)
    def running(*arguments: Any, **options: Any) -> Any:
        global _paused
        if not gc.isenabled():
            return function(*arguments, **options)
        _paused = True
        gc.disable()
        try:
            return function(*arguments, **options)
        finally:
            gc.enable()
            _paused = False

    return running


def _in_child() -> None:
    _pool.cache_clear()  # a child has no threads of its parent's
    for held in list(_locks):
        held._at_fork_reinit()  # type: ignore[attr-defined]  # as Python's own modules do
    if _paused:
        gc.enable()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)
