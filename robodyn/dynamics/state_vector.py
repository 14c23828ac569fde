"""The state of a scene as one vector x = (β, η, z, w): where its parts stand. Nobody else cuts x."""

from typing import NamedTuple

import numpy as np

from ..arithmetic import Array


class Parts(NamedTuple):
    """The parts of x, or of ẋ."""

    q: Array  # β (..., nq)
    v: Array  # η (..., nv)
    z: Array  # (..., nz): the loads' own states
    work: Array  # w (...) [J]: what the loads without a potential have put in


class StateVector(NamedTuple):
    """The sizes of x = (β, η, z, w) of a scene."""

    nq: int
    nv: int
    nz: int = 0

    @property
    def size(self) -> int:
        """Entries of x."""
        return self.nq + self.nv + self.nz + 1

    def split(self, x: Array) -> Parts:
        """The parts of x (..., size), as views."""
        a, b, c = self.nq, self.nq + self.nv, self.nq + self.nv + self.nz
        return Parts(x[..., :a], x[..., a:b], x[..., b:c], x[..., c])

    def join(self, q: Array, v: Array, z: Array, work: Array | float) -> Array:
        """x (..., size) of its parts; leading dimensions broadcast."""
        parts = [np.asarray(q), np.asarray(v), np.asarray(z), np.asarray(work)[..., None]]
        if len(batches := {part.shape[:-1] for part in parts}) > 1:
            parts = [np.broadcast_to(part, (*np.broadcast_shapes(*batches), part.shape[-1])) for part in parts]
        return np.concatenate(parts, axis=-1)
