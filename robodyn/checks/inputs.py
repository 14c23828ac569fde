"""The door: every array of a user passes here, and leaves as float64 or mpmath numbers of the right shape, finite and admissible."""

from collections.abc import Mapping, Sequence
from numbers import Integral

import numpy as np

from ..arithmetic import Array, exact, is_exact
from ..errors import InputError
from ..model import Mechanism

UNIT_TOLERANCE = 1e-6  # how far |quaternion|² may be from 1: room for files in single precision, none for a slip


def choice(name: str, value: str, choices: Sequence[str]) -> str:
    """`value` if it is one of `choices`; InputError where it is not."""
    if value not in choices:
        raise InputError(f"{name}={value!r} is not known: choose one of {', '.join(map(repr, choices))}")
    return value


def method(value: str, choices: Sequence[str]) -> str:
    """The one of `choices` that `value` names, in capitals or not: SciPy writes them either way."""
    return choice("method", value.lower() if isinstance(value, str) and value.lower() in choices else value, choices)


PRECISIONS = (np.dtype(np.float64), np.dtype(np.float32))


def precision(dtype: object, backend: str) -> np.dtype:
    """float64 or float32, as asked for. InputError for any other, and for float32 where 50 digits are computed."""
    try:
        found = np.dtype(dtype)  # type: ignore[call-overload]
    except TypeError:
        found = np.dtype(object)
    if found not in PRECISIONS or dtype is None:
        raise InputError(f"dtype={dtype!r} is not one to compute in: choose np.float64 or np.float32")
    if backend == "mpmath" and found != PRECISIONS[0]:
        raise InputError("dtype=np.float32 with backend='mpmath': 50 digits do not fit in float32; leave dtype out and round the answer")
    return found


def array(name: str, value: object, size: int, meaning: str, labels: Sequence[str] = (), *, objects: bool = False) -> Array:
    """`value` as a finite array (..., size), `meaning` says of what; InputError where it is none. objects: mpmath numbers may pass."""
    x = as_array(name, value)
    if x.dtype == object and objects and x.size and all(isinstance(e, (int, float)) or is_exact(np.array(e, dtype=object)) for e in x.flat):
        pass  # mpmath numbers stay what they are
    elif x.dtype.kind in "fiu" or x.size == 0:
        x = x.astype(float)
    else:
        raise InputError(f"{name} has elements of type {x.dtype}: it must be an array of real numbers")
    if x.shape[-1:] != (size,):
        raise InputError(f"{name} has the shape {x.shape}: its last dimension must be {size}, {meaning}")
    bad = np.argwhere(~np.isfinite(x.astype(float)))
    if len(bad):
        index = tuple(int(i) for i in bad[0])
        label = f" ({labels[index[-1]]})" if labels else ""
        raise InputError(f"{name}[{', '.join(map(str, index))}]{label} is {x[index]}: every number must be finite")
    return x


def rounded(name: str, x: Array, dtype: np.dtype) -> Array:
    """A finite array (..., n) rounded to a dtype, in float64; InputError where a number is beyond it."""
    with np.errstate(over="ignore"):
        y = x.astype(dtype).astype(float)
    bad = np.argwhere(~np.isfinite(y))
    if len(bad):
        index = tuple(int(i) for i in bad[0])
        raise InputError(f"{name}[{', '.join(map(str, index))}] is {x[index]}: too large for {dtype}; leave dtype out")
    return y


def as_array(name: str, value: object) -> Array:
    """`value` as an array; InputError where its rows have different lengths."""
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise InputError(f"{name} has masked entries: every number must be given; fill them first, such as by {name}.filled(0.0)")
    try:
        return np.asarray(value)
    except ValueError:
        raise InputError(f"{name} is ragged: its rows have different lengths, and no array can hold them") from None


def number(name: str, value: object) -> float:
    """A finite number; InputError where it is none."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InputError(f"{name}={value!r} must be a number") from None
    if not np.isfinite(number):
        raise InputError(f"{name}={number} must be finite")
    return number


def thread_count(value: object) -> int | None:
    """How many threads may share the work; None: one per core. InputError where it is no whole number of at least 1."""
    if value is not None and (isinstance(value, bool) or not isinstance(value, Integral) or value < 1):
        raise InputError(f"threads={value!r} must be a whole number of at least 1, or None for all cores")
    return None if value is None else int(value)


def vector3(name: str, value: object) -> Array:
    """`value` as three finite numbers (3,); InputError where it is not that."""
    x = array(name, value, 3, "x, y and z")
    if x.ndim != 1:
        raise InputError(f"{name} has the shape {x.shape}: it must be (3,)")
    return x


def size(robot: Mechanism, name: str, nz: int = 0) -> int:
    """Length of the array that goes by a name: q, u, z of the loads, or v, a, tau."""
    return {"q": robot.nq, "q0": robot.nq, "u": robot.nu, "z": nz}.get(name, robot.nv)


def checked(robot: Mechanism, arrays: Mapping[str, object], *, nz: int = 0, objects: bool = False) -> dict[str, Array]:
    """The arrays of a question, finite and with the same leading dimensions; None becomes zeros."""
    q_labels, v_labels = ([name for name, _ in table] for table in robot.coordinate_names())
    found = {}
    for name, value in arrays.items():
        _given(robot, name, value)
        n, meaning = size(robot, name, nz), {"q": "nq", "q0": "nq", "u": "nu", "z": "nz"}.get(name, "nv")
        labels = {"q": q_labels, "q0": q_labels, "u": (), "z": ()}.get(name, v_labels)
        found[name] = array(name, np.zeros(n) if value is None else value, n, f"{meaning} of {robot.name!r}", labels, objects=objects)
    batch = broadcast(**found)
    return {name: np.broadcast_to(x, (*batch, x.shape[-1])) for name, x in found.items()}


def _given(robot: Mechanism, name: str, value: object) -> None:
    """InputError for coordinates that are not there: velocities and forces may be left out, for zeros."""
    if value is None and name == "q":
        raise InputError(f"q is None: give the joint coordinates (..., {robot.nq}), such as robot.neutral()")


def quick(robot: Mechanism, arrays: Mapping[str, object], nz: int = 0) -> tuple[tuple[int, ...], dict[str, Array]]:
    """The leading dimensions and the arrays of a question, checked but for their values: the kernel looks at those."""
    found, batches = {}, set()
    for name, value in arrays.items():
        n = size(robot, name, nz)
        _given(robot, name, value)
        x = np.zeros(n) if value is None else as_array(name, value)
        if x.dtype.kind not in "fiu" or x.shape[-1:] != (n,):
            checked(robot, arrays, nz=nz)  # says what is wrong
        found[name] = x
        batches.add(x.shape[:-1])
    return batches.pop() if len(batches) == 1 else broadcast(**found), found


def target(out: object, shape: tuple[int, ...], arrays: Mapping[str, object], dtype: np.dtype) -> Array:
    """`out`; InputError where a result of this shape and dtype cannot be written into it while the arrays are read."""
    if not isinstance(out, np.ndarray) or out.dtype != dtype:
        kind = f"an array of {out.dtype}" if isinstance(out, np.ndarray) else repr(out)
        raise InputError(f"out is {kind}: it must be an array of {dtype}, such as np.empty({shape}, np.{dtype})")
    if out.shape != shape:
        raise InputError(f"out has the shape {out.shape}: the result has {shape}")
    if not (out.flags.c_contiguous and out.flags.aligned and out.flags.writeable):
        lacks = "read-only" if not out.flags.writeable else "not C-contiguous and aligned"
        raise InputError(f"out is {lacks}: give an array of its own, such as np.empty({shape})")
    for name, x in arrays.items():
        if isinstance(x, np.ndarray) and np.may_share_memory(out, x):
            raise InputError(f"out overlaps {name}, which is still read when results are written: give another array")
    return out


def broadcast(**arrays: Array) -> tuple[int, ...]:
    """The common leading dimensions of the arrays; InputError where they have none."""
    try:
        return np.broadcast_shapes(*(x.shape[:-1] for x in arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {x.shape}" for name, x in arrays.items())
        raise InputError(f"the leading dimensions do not fit together: {shapes}") from None


def unit_quaternions(name: str, conditions: Sequence[tuple[str, Array]]) -> None:
    """InputError where φ(β) = |p|² − 1 of an argument is not zero within `UNIT_TOLERANCE`."""
    for joint, phi in conditions:
        phi = np.asarray(phi, dtype=float)
        bad = np.argwhere(abs(phi) > UNIT_TOLERANCE)
        if len(bad):
            index = tuple(int(i) for i in bad[0])
            where = f"{name}[{', '.join(map(str, index))}]" if index else name
            length = float(np.sqrt(phi[index] + 1))
            raise InputError(f"{where}: the quaternion (w, x, y, z) of joint {joint!r} has the length {length:.9g}: normalise it to 1")


def as_exact(x: Array) -> Array:
    """The same numbers for mpmath: floats bit for bit, mpmath numbers as they are."""
    return x if x.dtype == object else exact(x)
