"""What a forward route returns: η̇, and the pivots it divided by."""

from typing import NamedTuple

from ..arithmetic import Array
from ..model import Field


class Solution(NamedTuple):
    """η̇ with the inertia that each freedom showed while all later ones were free."""

    vdot: Array  # η̇ (..., nv)
    pivots: Array  # (..., nv): D of M̂ = LᵀDL, sᵀAs of the articulated inertias
    moved: Array | None = None  # (..., nv): the inertias that the pivots are left over from, where the route knows them
    resting: Field | None = None  # f̌ᵏ_i (..., 6) of the bodies at η̇ = 0, where the route has found them
