"""The operations of the engine, one record each: what an operation is to NumPy, to mpmath, to a traced graph and to machine code.

Whoever has to know something of an operation takes it from here. The leaves of a graph, constants and inputs, are no operations.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .numbers import mpmath


@dataclass(frozen=True, kw_only=True)
class Operation:
    """One operation. In machine code it is an instruction, an intrinsic, a function of the C library, or the emitter's own."""

    name: str
    arity: int = 1
    called: str = ""  # the name of NumPy's ufunc, of the function in `arithmetic` and of the method; empty where Python has an operator
    meaning: str = ""  # in words, for whom `called` has a name
    on_floats: Callable[..., Any] | None = None  # folds constants
    on_exact: Callable[..., Any] | str = ""  # computes with mpmath's numbers: a function, or the name of mpmath's
    odd: bool = False  # f(−x) = −f(x)
    even: bool = False  # f(−x) = f(x)
    commutative: bool = False  # of numbers, so that a constant may stand on either side
    idempotent: bool = False  # f(x, x) = x
    passed_on: int = 0  # the result is not finite where one of so many first operands is not
    flops: int = 0
    condition: bool = False  # what it gives is no number
    instruction: str = ""  # LLVM's
    intrinsic: str = ""  # LLVM's, without its prefix and type
    library: bool = False  # C has a function of this name
    writer: bool = False  # `engine.emit.elementary` has a writer of this name
    # (f, *operands) → ∂/∂operand of each, in any arithmetic, f being the module `arithmetic`; none of what steps or compares: it is zero.
    derivative: Callable[..., tuple[Any, ...]] | None = None

    def exact(self, *xs: Any) -> Any:
        """The operation on mpmath's numbers."""
        return (getattr(mpmath(), self.on_exact) if isinstance(self.on_exact, str) else self.on_exact)(*xs)


def _function(name: str, meaning: str, called: str = "", on_exact: Callable[..., Any] | None = None, **known: Any) -> Operation:
    """The record of a function that NumPy calls `called`, C and mpmath `name`."""
    called = called or name
    known.setdefault("on_floats", getattr(np, called))
    return Operation(name=name, called=called, meaning=meaning, on_exact=on_exact or name, **known)


_RECORDS = (
    Operation(name="add", arity=2, commutative=True, passed_on=2, flops=1, instruction="fadd", derivative=lambda f, x, y: (1.0, 1.0)),
    Operation(name="sub", arity=2, passed_on=2, flops=1, instruction="fsub", derivative=lambda f, x, y: (1.0, -1.0)),
    Operation(name="mul", arity=2, commutative=True, passed_on=2, flops=1, instruction="fmul", derivative=lambda f, x, y: (y, x)),
    Operation(name="div", arity=2, passed_on=1, flops=1, instruction="fdiv", derivative=lambda f, x, y: (1.0 / y, -x / (y * y))),
    Operation(name="neg", passed_on=1, derivative=lambda f, x: (-1.0,)),
    Operation(name="fma", arity=3, passed_on=3, flops=2),  # a·b + c
    Operation(name="fms", arity=3, passed_on=3, flops=2),  # a·b − c
    Operation(name="fnma", arity=3, passed_on=3, flops=2),  # c − a·b
    Operation(name="pow", arity=2, writer=True, derivative=lambda f, x, y: (y * x ** (y - 1.0), f.log(x) * x**y)),
    Operation(name="abs", on_floats=np.abs, even=True, intrinsic="fabs", derivative=lambda f, x: (f.sign(x),)),
    Operation(name="select", arity=3),  # of a condition and two numbers
    Operation(name="true", arity=0, condition=True),
    Operation(name="false", arity=0, condition=True),
    Operation(name="lt", arity=2, condition=True, instruction="fcmp olt"),
    Operation(name="le", arity=2, condition=True, instruction="fcmp ole"),
    Operation(name="eq", arity=2, condition=True, commutative=True, instruction="fcmp oeq"),
    Operation(name="and", arity=2, condition=True, instruction="and"),
    Operation(name="or", arity=2, condition=True, instruction="or"),
    Operation(name="not", condition=True, instruction="xor"),
    _function("sin", "sin x.", odd=True, passed_on=1, derivative=lambda f, x: (f.cos(x),)),
    _function("cos", "cos x.", even=True, passed_on=1, derivative=lambda f, x: (-f.sin(x),)),
    _function("tan", "tan x.", odd=True, library=True, derivative=lambda f, x: (1.0 + f.tan(x) * f.tan(x),)),
    _function(
        "asin",
        "The angle in [−π/2, π/2] with this sine.",
        "arcsin",
        odd=True,
        library=True,
        derivative=lambda f, x: (1.0 / f.sqrt(1.0 - x * x),),
    ),
    _function(
        "acos", "The angle in [0, π] with this cosine.", "arccos", library=True, derivative=lambda f, x: (-1.0 / f.sqrt(1.0 - x * x),)
    ),
    _function(
        "atan",
        "The angle in [−π/2, π/2] with this tangent.",
        "arctan",
        odd=True,
        library=True,
        derivative=lambda f, x: (1.0 / (1.0 + x * x),),
    ),
    _function(
        "atan2",
        "The angle of the point (x, y), self being y, in [−π, π].",
        "arctan2",
        arity=2,
        on_floats=math.atan2,
        library=True,
        derivative=lambda f, y, x: (x / (x * x + y * y), -y / (x * x + y * y)),
    ),
    _function("sqrt", "√x.", intrinsic="sqrt", derivative=lambda f, x: (0.5 / f.sqrt(x),)),
    _function("exp", "eˣ.", writer=True, derivative=lambda f, x: (f.exp(x),)),
    _function("log", "The natural logarithm.", writer=True, derivative=lambda f, x: (1.0 / x,)),
    _function("expm1", "eˣ − 1.", library=True, derivative=lambda f, x: (f.exp(x),)),
    _function("log1p", "log(1 + x).", library=True, derivative=lambda f, x: (1.0 / (1.0 + x),)),
    _function("sinh", "sinh x.", odd=True, library=True, derivative=lambda f, x: (f.cosh(x),)),
    _function("cosh", "cosh x.", even=True, library=True, derivative=lambda f, x: (f.sinh(x),)),
    _function("tanh", "tanh x.", odd=True, writer=True, derivative=lambda f, x: (1.0 - f.tanh(x) * f.tanh(x),)),
    _function(
        "cbrt",
        "The real cube root.",
        on_exact=lambda x: mpmath().sign(x) * mpmath().cbrt(abs(x)),
        odd=True,
        library=True,
        derivative=lambda f, x: (f.cbrt(x) / (3.0 * x),),
    ),
    _function(
        "hypot",
        "√(x² + y²), without overflow on the way.",
        arity=2,
        library=True,
        derivative=lambda f, x, y: (x / f.hypot(x, y), y / f.hypot(x, y)),
    ),
    _function("floor", "The largest whole number that is not above x.", intrinsic="floor"),
    _function("ceil", "The smallest whole number that is not below x.", intrinsic="ceil"),
    _function(
        "trunc",
        "x without what is behind the point.",
        on_exact=lambda x: mpmath().sign(x) * mpmath().floor(abs(x)),
        odd=True,
        intrinsic="trunc",
    ),
    _function("rint", "The nearest whole number, the even one of two.", on_exact=lambda x: mpmath().nint(x), odd=True, intrinsic="rint"),
    _function(
        "fmod",
        "x − trunc(x/y) y without rounding, of the sign of x.",
        on_exact=lambda x, y: mpmath().sign(x) * mpmath().fmod(abs(x), abs(y)),
        arity=2,
        library=True,
        derivative=lambda f, x, y: (1.0, -f.trunc(x / y)),
    ),
    _function(
        "copysign",
        "The size of x with the sign of y, be it that of −0.",
        on_exact=lambda x, y: abs(x) if y >= 0 else -abs(x),  # mpmath has no −0
        arity=2,
        intrinsic="copysign",
        derivative=lambda f, x, y: (f.sign(x) * f.sign(y), 0.0),
    ),
    _function(
        "min",
        "The smaller; NaN where one is NaN, as np.minimum; −0 is smaller than 0.",
        "minimum",
        lambda x, y: x if x != x or x < y else y,
        arity=2,
        commutative=True,
        idempotent=True,
        intrinsic="minimum",
        derivative=lambda f, x, y: (f.where(f.less(x, y), 1.0, 0.0), f.where(f.less(x, y), 0.0, 1.0)),
    ),
    _function(
        "max",
        "The larger; NaN where one is NaN, as np.maximum; 0 is larger than −0.",
        "maximum",
        lambda x, y: x if x != x or x > y else y,
        arity=2,
        commutative=True,
        idempotent=True,
        intrinsic="maximum",
        derivative=lambda f, x, y: (f.where(f.less(x, y), 0.0, 1.0), f.where(f.less(x, y), 1.0, 0.0)),
    ),
)
OPERATIONS = {operation.name: operation for operation in _RECORDS}
FUNCTIONS = tuple(operation for operation in _RECORDS if operation.called)  # those with a name in NumPy
