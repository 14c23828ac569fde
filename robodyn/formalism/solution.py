"""What a forward route returns: η̇, and the pivots it divided by."""

from typing import NamedTuple, Self

import numpy as np

from ..arithmetic import Array


class Solution(NamedTuple):
    """η̇ with the inertia that each freedom showed while all later ones were free."""

    vdot: Array  # η̇ (..., nv)
    pivots: Array  # (..., nv): D of M̂ = LᵀDL, sᵀAs of the articulated inertias

    @classmethod
    def stack(cls, vdot: list[Array], pivots: list[Array]) -> Self:
        """From one array (...) per coordinate."""
        if not vdot:
            return cls(np.zeros(0), np.zeros(0))
        return cls(*(np.stack(np.broadcast_arrays(*(np.asarray(x) for x in xs)), axis=-1) for xs in (vdot, pivots)))
