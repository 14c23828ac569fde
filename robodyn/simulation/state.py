"""The state x = (β, η, z, w) of a scene under way: its layout, its start, and z as an argument of a question."""

from typing import Any

import numpy as np

from ..arithmetic import Array
from ..dynamics.state_vector import StateVector
from ..scene import Scene


def state_vector(scene: Scene) -> StateVector:
    """The layout of x."""
    return StateVector(scene.robot.nq, scene.robot.nv)


def initial_z(scene: Scene) -> Array:
    """z (nz,) at the start."""
    return np.zeros(state_vector(scene).nz)


def initial_state(scene: Scene, q: Array, v: Array) -> Array:
    """x (..., nx) at q (..., nq), with its Euler parameters at unit length, and v (..., nv), where no work is done yet."""
    return state_vector(scene).join(scene.equations().project(q), v, initial_z(scene), 0.0)


def given(z: Array) -> dict[str, Any]:
    """z (..., nz) as an argument of a question; none where no load has a state of its own."""
    return {"z": z} if z.shape[-1] else {}
