"""What loads and laws answer, checked: real numbers of the right shape, for joints and links that are there."""

from collections.abc import Callable, Mapping, Sequence
from numbers import Real

import numpy as np

from ..arithmetic import Array
from ..arithmetic.symbols import Symbolic
from ..errors import InputError
from ..model import Mechanism
from .base import Load, State


def joint_forces(load: Load, state: State) -> dict[int, Array]:
    """The load's forces (..., nv_i) in joints, by joint index. InputError where they are no such thing, or the load divides by zero."""
    joints = state.mechanism.joints
    return _checked(load, load.joint_forces, state, "joint", [joint.name for joint in joints], [joint.type.nv for joint in joints])


def link_wrenches(load: Load, state: State) -> dict[int, Array]:
    """The load's wrenches (..., 6) on links, by link index; errors as in `joint_forces`."""
    names = state.mechanism.link_names
    return _checked(load, load.link_wrenches, state, "link", names, [6] * len(names))


def state_rates(load: Load, state: State) -> Array:
    """ż (..., n) of the load's own states, as many as `state.z` has; InputError where they are no such numbers."""
    rates, n = load.state_rate(state), state.z.shape[-1]
    try:
        x = _real(rates)
    except _NotReal as error:
        raise InputError(f"{type(load).__name__}.state_rate returned {error}: it must be {n} real numbers{error.remedy}") from None
    if x.shape[-1:] != (n,):
        raise InputError(f"{type(load).__name__}.state_rate returned an array of shape {x.shape}: initial_state gave {n} numbers")
    return x


def law_forces(answer: object, mechanism: Mechanism, law: str, t: float | None = None) -> Array:
    """The answer of a control law as an array (nv,), float64 or of symbols; InputError where it is none. law: what the user calls it."""
    try:
        tau = _real(answer)
        if tau.shape != (mechanism.nv,):
            raise _NotReal(f"an array of shape {tau.shape}")
    except _NotReal as error:
        k, names = error.index, mechanism.coordinate_names()[1]
        where = f" for {names[k[0]][0]!r}" if k is not None and len(k) == 1 and k[0] < len(names) else ""
        when = "" if t is None else f" at t={t:.9g} s"
        must = f"it must be an array ({mechanism.nv},) of real numbers{error.remedy}"
        raise InputError(f"the {law} returned {error}{where}{when}: {must}") from None
    return tau


class _NotReal(Exception):
    """What an answer is instead of real numbers, where in it, and what helps."""

    def __init__(self, what: object, index: tuple[int, ...] | None = None) -> None:
        strange = isinstance(what, complex)
        super().__init__(f"the complex number {what:.6g}" if strange else what)
        self.index, self.remedy = index, "; np.real takes that part of it" if strange else ""


def _real(value: object) -> Array:
    """`value` as an array of real numbers: floats, or objects where some are mpmath's or not known yet."""
    try:
        x = np.asarray(value)
    except ValueError:
        raise _NotReal(f"{value!r}, whose rows have different lengths") from None
    if x.dtype.kind in "biuf":
        return x.astype(float, copy=False)
    if x.dtype.kind not in "cO" or (x.shape == () and not isinstance(x[()], (complex, Real, Symbolic))):
        raise _NotReal(repr(value))
    if x.dtype.kind == "c" and x.size:
        index = tuple(int(i) for i in np.unravel_index(np.argmax(np.imag(x) != 0), x.shape))
        raise _NotReal(complex(x[index]), index)
    for index, entry in np.ndenumerate(x):
        if not isinstance(entry, (Real, Symbolic)):
            raise _NotReal(entry if isinstance(entry, complex) else repr(entry), index)
    return x


def _checked(
    load: Load, method: Callable[[State], Mapping[int, Array]], state: State, kind: str, names: Sequence[str], sizes: Sequence[int]
) -> dict[int, Array]:
    what, traced = type(load).__name__, state.q.dtype == object
    when = f" at t={state.t:.9g} s" if isinstance(state.t, float) else ""
    try:
        answer = method(state)
    except TypeError as error:
        if not traced:
            raise
        raise InputError(f"{what} cannot be compiled: {error}. Run it with backend='numpy'") from error
    except (ArithmeticError, np.linalg.LinAlgError) as error:  # not to be taken for those of the equations
        if traced:
            raise
        raise InputError(f"{what} raised {type(error).__name__}{when}: {error}. It must answer at every state") from error
    if not isinstance(answer, Mapping):
        raise InputError(
            f"{what}.{method.__name__} returned {answer!r}: it must be a dictionary, {{state.mechanism.{kind}_index(name): numbers}}"
        )
    batch, found = np.broadcast_shapes(np.shape(state.t), state.q.shape[:-1], state.v.shape[:-1]), {}
    for i, value in answer.items():
        try:
            name, shape = names[i], (*batch, sizes[i])
        except (IndexError, TypeError):
            raise InputError(f"{what} gives forces to the {kind} {i!r}: name it by its index, state.mechanism.{kind}_index(name)") from None
        place = f"as the {'force of joint' if kind == 'joint' else 'wrench on link'} {name!r}{when}"
        must = f"{place}: it must be real numbers of the shape {shape}"
        try:
            x = _real(value)
        except _NotReal as error:
            raise InputError(f"{what} returned {error} {must}{error.remedy}") from None
        if x.shape == () and kind == "joint" and sizes[i]:  # one number for every freedom
            x = np.broadcast_to(x, (sizes[i],))
        if not _fits(x.shape, shape):
            raise InputError(f"{what} returned an array of shape {x.shape} {must}")
        found[i] = x if traced else x.astype(float, copy=False)
    return found


def _fits(shape: tuple[int, ...], whole: tuple[int, ...]) -> bool:
    """Whether an array has the last dimension of the whole, and leading ones that broadcast to its."""
    try:
        return shape[-1:] == whole[-1:] and np.broadcast_shapes(shape, whole) == whole
    except ValueError:
        return False
