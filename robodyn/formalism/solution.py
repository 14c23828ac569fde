"""What a forward route returns: η̇, and how far each pivot stood from nothing."""

from typing import NamedTuple, Self

import numpy as np

from ..algebra import frozen
from ..arithmetic import Array


class Solution(NamedTuple):
    """η̇ with the inertia that each freedom showed while all later ones were free."""

    vdot: Array  # η̇ (..., nv)
    pivots: Array  # (..., nv): D of M̂ = LᵀDL, sᵀAs of the articulated inertias
    scales: Array  # (..., nv): the sums those pivots were left over from; pivots ≤ rounding of these mean nothing

    @classmethod
    def stack(cls, vdot: list[Array], pivots: list[Array], scales: list[Array]) -> Self:
        """From one array (...) per coordinate."""
        if not vdot:
            return cls(*(frozen(np.zeros(0)) for _ in range(3)))
        columns = (np.broadcast_arrays(*(np.asarray(x) for x in xs)) for xs in (vdot, pivots, scales))
        return cls(*(np.stack(xs, axis=-1) for xs in columns))
