"""Robots and scenes as JSON text and back, to the last bit, without ever running what a file says."""

import dataclasses
import json
from typing import Any

import numpy as np

from .. import model
from ..errors import FileError, RobodynError
from ..joints import JOINT_TYPES
from ..loads import LOADS
from ..robot import Robot
from ..scene import Scene

_MODEL = (
    model.Box,
    model.Cylinder,
    model.Sphere,
    model.Mesh,
    model.Visual,
    model.Inertia,
    model.Link,
    model.Limits,
    model.Joint,
    model.Mimic,
)
_CLASSES: dict[str, type] = {cls.__name__: cls for cls in (*_MODEL, model.Mechanism, Robot, Scene)}


def _class(name: str) -> type | None:
    """The class that a record names. Loads and joint types are looked up when asked for: one may have been added since."""
    return _CLASSES.get(name) or LOADS.get(name) or next((cls for cls in JOINT_TYPES.values() if cls.__name__ == name), None)


def to_json(value: object) -> str:
    """JSON text of a robot, a scene, or anything they are made of. TypeError for what no text can hold (a function)."""
    return json.dumps(_encode(value), separators=(",", ":"))


def from_json(text: str) -> Any:
    """What `to_json` wrote. FileError where the text is damaged."""
    try:
        return _decode(json.loads(text))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, RobodynError) as error:
        raise FileError(f"the record of the scene is damaged: {error}") from error


def _encode(value: object) -> object:
    if _class(type(value).__name__) is type(value):
        assert dataclasses.is_dataclass(value)
        fields = {f.name: _encode(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"class": type(value).__name__, "fields": fields}
    if isinstance(value, np.ndarray):
        return {"array": value.tolist(), "shape": value.shape}
    if isinstance(value, dict):
        return {"dict": [[_encode(k), _encode(v)] for k, v in value.items()]}
    if isinstance(value, (tuple, list)):
        return [_encode(v) for v in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"{value!r} is a {type(value).__name__} and cannot be written to a file")


def _decode(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_decode(v) for v in value)
    if not isinstance(value, dict):
        return value
    if "class" in value:
        cls = _class(value["class"])
        if cls is None:
            raise KeyError(value["class"])
        return cls(**{name: _decode(v) for name, v in value["fields"].items()})
    if "dict" in value:
        return {_decode(k): _decode(v) for k, v in value["dict"]}
    array = np.array(value["array"], dtype=float).reshape(value["shape"])
    array.flags.writeable = False
    return array
