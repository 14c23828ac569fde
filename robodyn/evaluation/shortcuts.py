"""Built-in functions that answer plain calls with the least that CPython asks for; whatever else is asked goes the usual way."""

import math
from collections.abc import Callable, Mapping
from types import FunctionType, MethodType
from typing import Any

import numpy as np

from ..arithmetic import Array
from ..dynamics.questions import Question
from ..engine.run import builtin
from ..engine.run.kernel import Kernel
from ..model import Mechanism
from ..system.processes import lock


class Shortcuts:
    """Those of one robot under one gravity and its loads."""

    def __init__(self, robot: Mechanism) -> None:
        self._robot, self._lock = robot, lock()
        self._known: dict[Question, tuple[Any, str, tuple[int, ...]]] = {}  # a built-in function, its array's name and shape

    def answer(
        self, question: Question, kernel: Kernel | None, threads: int | None, out: Array | None, arrays: Mapping[str, object]
    ) -> dict[str, Array] | None:
        """A built-in function's answer in float64 at time 0, from the second time that a question is asked; None where it has none."""
        if question not in self._known:
            self._prepare(question, kernel)
            return None
        function, name, shape = self._known[question]
        given = [arrays[name] for name in question.needs]
        while given and given[-1] is None:
            given.pop()
        if function is None:
            return None
        flat = out
        if out is not None:
            if type(out) is not np.ndarray or out.shape[-len(shape) :] != shape or not out.flags.c_contiguous:
                return None
            flat = out.reshape(*out.shape[: -len(shape)], math.prod(shape))
        found = function(*given, threads=threads, out=flat)
        return None if found is None else {name: out if out is not None else found.reshape(found.shape[:-1] + shape)}

    def _prepare(self, question: Question, kernel: Kernel | None) -> None:
        """Put a built-in function for a question in place, if its kernel is there already and has one array as its answer."""
        if kernel is None or not builtin.supported():
            return
        with self._lock:
            if question in self._known:
                return
            shapes = question.shapes(self._robot)
            function, (name, shape) = None, next(iter(shapes.items()))
            if len(shapes) == 1 and shape:
                function = builtin.bind(kernel, question.needs, _none, optional=len(question.needs) - 1)
            self._known[question] = function, name, shape

    def hasten(self, owner: object, method: FunctionType, question: Question, kernel: Callable[[], Kernel]) -> None:
        """From now on, answer an object's plain calls of a method by a built-in function: its attribute stands before the class's.

        The method's first arguments are what the question needs; any call that gives it more than `threads` and `out` beside goes to the
        method as before. Not where a subclass has a method of its own: that one is to be called.
        """
        name = method.__name__
        if name in owner.__dict__ or getattr(type(owner), name) is not method or not builtin.supported():
            return
        found = kernel()
        with self._lock:
            if name not in owner.__dict__:  # another thread may have been first: what it put there may be running already
                optional = len(method.__defaults__ or ())
                owner.__dict__[name] = builtin.bind(found, question.needs, MethodType(method, owner), optional=optional)


def _none(*_: object, **__: object) -> None:
    """What a built-in function is told by where it cannot answer."""
