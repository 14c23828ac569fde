"""One state of a tree of bodies; where these are and how they move is found once, and handed on from the loads to the last sweep."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arithmetic import Array, exact, is_exact
from ..arithmetic.symbols import symbols
from ..model import Field, Mechanism, Tree
from ..system.processes import cached_property
from .kinematics import Motion, motion, world_poses
from .spatial import Pose, twist_to_child

NOTHING = np.zeros(0)


@dataclass(frozen=True, eq=False)
class State:
    """The time, the coordinates, the velocities; what the formalism works on, and all that a load may look at.

    The arrays of its methods are float64, mpmath numbers or symbols; NumPy's functions take them all, as far as `arithmetic.symbols`
    goes, and so do those of `arithmetic`. A choice is np.where, not a branch.
    """

    mechanism: Mechanism
    tree: Tree
    t: Array | float  # [s]
    q: Array  # β (..., nq) [rad, m]
    v: Array  # η (..., nv) [rad/s, m/s]
    z: Array = field(default_factory=lambda: NOTHING)  # (..., n): the loads' own states; for a load that is asked, its own alone
    _found: dict[Any, Any] = field(default_factory=dict, repr=False)

    # --- the bodies ---

    @property
    def motion(self) -> Motion:
        """Poses, motion subspaces, twists and bias accelerations of all bodies, eqs. (9) to (11)."""
        if "motion" not in self._found:
            self._found["motion"] = motion(self.tree, self.q, self.v, self.t)
        return self._found["motion"]

    @property
    def world(self) -> Field:
        """The pose of each body in the ground's frame."""
        if "world" not in self._found:
            self._found["world"] = world_poses(self.tree, self.motion.pose)
        return self._found["world"]

    def on(self, tree: Tree) -> "State":
        """The same state of another tree of the same robot; one for each tree."""
        if tree is self.tree:
            return self
        if tree not in self._found:
            self._found[tree] = replace(self, tree=tree, _found={})
        return self._found[tree]

    def of_load(self, z: Array) -> "State":
        """The state as a load sees it whose own states are z (..., n); what is found of the bodies is found for all loads."""
        return replace(self, z=z)

    # --- what loads look at ---

    def position(self, joint: int) -> Array:
        """β (..., nq_i) of a joint by its index; a mimic joint's follows its leader."""
        beta, mimic = self.q[..., self.mechanism.q_slices[joint]], self.mechanism.joints[joint].mimic
        return symbols(beta if mimic is None else mimic.ratio * beta + mimic.offset)

    def velocity(self, joint: int) -> Array:
        """η (..., nv_i) of a joint by its index."""
        eta, mimic = self.v[..., self.mechanism.v_slices[joint]], self.mechanism.joints[joint].mimic
        return symbols(eta if mimic is None else mimic.ratio * eta)

    @cached_property
    def velocities(self) -> Array:
        """The velocity (..., nu) in the direction of each joint force of u, mimic joints' included."""
        columns, ratios = self.mechanism.driven
        return ratios * self.v[..., columns]

    def constant(self, x: object) -> Array:
        """Numbers of a load, in the state's own arithmetic: sums of them must not round in float64 where the state has 50 digits."""
        return exact(x) if is_exact(self.q) else np.array(x, dtype=float)

    def placement(self, link: int) -> Pose:
        """A link's frame in its body's."""
        return Pose(self.tree.link_rotation[link], self.tree.link_translation[link])

    def pose(self, link: int) -> Pose:
        """A link's frame in the ground's, by the link's index."""
        body, X = self.tree.link_body[link], self.placement(link)
        return X if body < 0 else Pose(*map(symbols, self.world[body] @ X))

    def twist(self, link: int) -> Array:
        """A link's twist (..., 6) at its origin, resolved in it."""
        body, X = self.tree.link_body[link], self.placement(link)
        return symbols(twist_to_child(X, self.motion.twist[body])) if body >= 0 else np.zeros(6)
