"""The numbers that make a body, in a row; and a body of the same kind made from other such numbers."""

from collections.abc import Hashable, Sequence
from dataclasses import fields, replace
from numbers import Real
from typing import Any

import numpy as np

from ..arithmetic import Array
from .inertia import Inertia
from .tree import Body

_UPPER = np.triu_indices(3)


def constants(body: Body) -> Array:
    """Its joint's numbers, its place, its inertia, how it follows a leader: (n,), of float64."""
    joint, inertia = body.joint, body.inertia
    parts = [
        *(np.ravel(getattr(joint, name)) for name in _numbers(joint)),
        body.rotation.ravel(),
        body.translation,
        [inertia.mass],
        inertia.moment,
        inertia.tensor[_UPPER],
        [body.ratio, body.offset],
    ]
    return np.concatenate([np.asarray(x, dtype=float) for x in parts])


def likeness(body: Body) -> Hashable:
    """What bodies of one kind have in common beside the number of their constants: the type of their joint, and what in it is no number."""
    others = [f.name for f in fields(body.joint) if f.name not in _numbers(body.joint)]
    return (type(body.joint), *(getattr(body.joint, name) for name in others))


def with_constants(body: Body, values: Sequence[Any]) -> Body:
    """The body with other numbers, or symbols, in the places that they have in `constants`."""
    rest = list(values)

    def take(shape: tuple[int, ...]) -> Array:
        n = int(np.prod(shape, dtype=int))
        taken, rest[:] = rest[:n], rest[n:]
        x = np.empty(n, dtype=object)
        x[:] = taken
        return x.reshape(shape)

    joint = replace(body.joint, **{name: take(np.shape(getattr(body.joint, name))) for name in _numbers(body.joint)})
    rotation, translation, (mass,), moment, upper = take((3, 3)), take((3,)), take((1,)), take((3,)), take((6,))
    ratio, offset = take((2,))
    tensor = np.empty((3, 3), dtype=object)
    tensor[_UPPER] = upper
    tensor.T[_UPPER] = upper
    return replace(
        body, joint=joint, rotation=rotation, translation=translation, inertia=Inertia(mass, moment, tensor), ratio=ratio, offset=offset
    )


def _numbers(joint: Any) -> list[str]:
    """The fields of a joint type that hold numbers."""
    return [f.name for f in fields(joint) if isinstance(getattr(joint, f.name), (Real, np.ndarray))]
