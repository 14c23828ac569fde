"""A constant force and moment on a link."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..arithmetic import Array
from ..arithmetic.vectors import cross, joined, mul, transpose
from ..errors import InputError
from ..model import Mechanism
from .base import Load, State, numbers


@dataclass(frozen=True, eq=False)
class LinkWrench(Load):
    """`LinkWrench("tool0", force=(0, 0, -50), point=(0, 0, 0.1))`: acts at a point fixed to the link [m, link frame].

    frame="link": force [N] and moment [N m] turn with the link; frame="world": their directions stay.
    InputError where the frame is another, or a vector is not three finite numbers.
    """

    link: str
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0)
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frame: str = "world"

    def check(self, mechanism: Mechanism) -> None:
        mechanism.link_index(self.link)
        if self.frame not in ("link", "world"):
            raise InputError(f"wrench on link {self.link!r}: frame={self.frame!r} must be 'link' or 'world'")
        for what in ("force", "moment", "point"):
            x = numbers(getattr(self, what), f"wrench on link {self.link!r}: {what}")
            if x.shape != (3,) or not np.isfinite(x).all():
                raise InputError(f"wrench on link {self.link!r}: {what}={x.tolist()} must be three finite numbers")

    def link_wrenches(self, state: State) -> Mapping[int, Array]:
        link = state.mechanism.link_index(self.link)
        F, M, r = (state.constant(x) for x in (self.force, self.moment, self.point))
        if self.frame == "world":
            Rt = transpose(state.pose(link).R)
            F, M = mul(Rt, F), mul(Rt, M)
        return {link: joined(M + cross(r, F), F)}
