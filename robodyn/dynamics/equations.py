"""The equations of a scene: robot, gravity and loads put into the formalism. Generic over the scalar, any leading dimensions.

Plain functions of arrays that are already checked (`inputs`), in whatever arithmetic the tree's constants are in (`scene`).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arithmetic import Array, dtype_of, exact, precision, zeros
from ..arithmetic.vectors import dot, homogeneous, stacked
from ..evaluation.base_parameters import reduced
from ..formalism import energy, kinematics
from ..formalism.constraints import coordinate_forces
from ..formalism.ldl import couplings, factorise
from ..formalism.nonrecursive import bias_forces, mass_matrix, nonrecursive
from ..formalism.reactions import joint_wrenches, reactions
from ..formalism.recursive import recursive
from ..formalism.saddle import saddle_body, saddle_joint
from ..formalism.solution import Solution
from ..formalism.spatial import Pose, wrench_to_parent
from ..loads import Load, State
from ..loads.answers import joint_forces, link_wrenches
from ..model import Body, Mechanism, Minimal, Tree, lump, minimal
from ..system.processes import cached_property

SWEEPS = {"nonrecursive": nonrecursive, "recursive": recursive}
SADDLES = {"saddle_joint": saddle_joint, "saddle_body": saddle_body}
FORMALISMS = ("auto", *SWEEPS, *SADDLES)


class Applied(NamedTuple):
    """Everything that acts at one state, gravity aside."""

    u: Array  # (..., nu): the joints' own forces
    tau: Array  # (..., nv): the same as coordinate forces
    wrenches: dict[int, Array]  # (..., 6) on bodies, by body index
    power: Array  # (...) [W] of the loads that have no potential


@dataclass(frozen=True, eq=False)
class Equations:
    """A robot's tree with what acts on it."""

    mechanism: Mechanism
    tree: Tree
    gravity: Array  # (3,)
    loads: Sequence[Load]
    fewest: Callable[[], Minimal | None] | None = None  # where operations count: the lumped tree with base parameters, where to use it

    @cached_property
    def minimal(self) -> Minimal | None:
        """What `nonrecursive` solves for η̇ on, where it is there."""
        return self.fewest() if self.fewest else None

    # --- what acts ---

    def applied(self, t: Array | float, q: Array, v: Array, tau: Array) -> Applied:
        """The loads at a state, and tau (..., nv) at the joints that own the coordinates."""
        mechanism, state = self.mechanism, State(self.mechanism, self.tree, t, q, v)
        batch = np.broadcast_shapes(np.shape(t), q.shape[:-1], v.shape[:-1], tau.shape[:-1])
        forces = {kind: zeros((*batch, mechanism.nu), dtype_of(q, v, tau)) for kind in (False, True)}  # conservative or not
        forces[False][..., mechanism.owned] = tau
        power = zeros(batch, forces[False].dtype)
        for load in self.loads:
            for i, force in joint_forces(load, state).items():
                forces[load.conservative][..., mechanism.u_slices[i]] += force
            for link, wrench in link_wrenches(load, state).items():
                if not load.conservative:
                    power = power + dot(wrench, state.twist(link))
        power = power + dot(forces[False], state.velocities)
        u = forces[False] + forces[True]
        return Applied(u, self._coordinate_forces(u), self.wrenches(t, q, v), power)

    def wrenches(self, t: Array | float, q: Array, v: Array) -> dict[int, Array]:
        """The loads' wrenches (..., 6) on bodies, by body index, about O_i and resolved in K_i."""
        state = State(self.mechanism, self.tree, t, q, v)
        found: dict[int, Array] = {}
        for load in self.loads:
            for link, wrench in link_wrenches(load, state).items():
                if (body := self.tree.link_body[link]) >= 0:  # what is fixed to the ground does not feel it
                    on_body = wrench_to_parent(state.placement(link), wrench)
                    found[body] = found[body] + on_body if body in found else on_body
        return found

    def _coordinate_forces(self, u: Array) -> Array:
        mechanism = self.mechanism
        tau = u[..., mechanism.owned]
        for i, joint in enumerate(mechanism.joints):
            if joint.mimic:
                tau[..., mechanism.v_slices[i]] += joint.mimic.ratio * u[..., mechanism.u_slices[i]]
        return tau

    # --- how it moves ---

    def accelerate(self, q: Array, v: Array, acts: Applied, formalism: str, *, carried: bool = False) -> Solution:
        """η̇ by the named route; the saddle-point routes have no pivots to show.

        carried: what joints carry is wanted as well, so k̂ of "nonrecursive" had better come from the bodies as they are.
        """
        if formalism == "auto":
            formalism = self.cheapest
        if formalism == "nonrecursive" and (least := self.minimal):
            if carried:
                return nonrecursive(self.tree, q, v, acts.tau, acts.wrenches, self.gravity, inertias=least.tree)
            return nonrecursive(least.tree, q, v, acts.tau, least.wrenches(acts.wrenches), self.gravity)
        if formalism in SWEEPS:
            return SWEEPS[formalism](self.tree, q, v, acts.tau, acts.wrenches, self.gravity)
        _, _, vdot = SADDLES[formalism](self.tree, q, v, acts.u, acts.wrenches, self.gravity)
        # Pivoting hides what is singular; the pivots of M̂ tell.
        M = self.mass_matrix(q)
        return Solution(vdot, stacked(factorise(M, couplings(self.tree))[1]))

    @cached_property
    def cheapest(self) -> str:
        """The route with the fewest operations here; NumPy's cost per call decides: one sweep per body against one entry per pair."""
        depth = [0]
        for body in self.tree.bodies:
            depth.append(depth[body.parent + 1] + 1)
        return "nonrecursive" if self.tree.has_mimic or sum(depth) <= 8 * len(self.tree.bodies) else "recursive"

    def rate(self, q: Array, v: Array) -> Array:
        """β̇ (..., nq)."""
        return kinematics.rate(self.tree, q, v)

    def project(self, q: Array) -> Array:
        """q with unit quaternions."""
        return kinematics.project(self.tree, q)

    def side_conditions(self, q: Array) -> list[tuple[str, Array]]:
        """Joint name and φ(β) (...) of each joint with Euler parameters."""
        return [(self.mechanism.joints[body.link].name, phi) for body, phi in kinematics.side_conditions(self.tree, q)]

    # --- what it takes and carries ---

    def inverse(self, q: Array, v: Array, vdot: Array, wrenches: dict[int, Array]) -> Array:
        """The coordinate forces (..., nv) that η̇ needs, joint loads included."""
        state = kinematics.motion(self.tree, q, v)
        f = joint_wrenches(self.tree, state, vdot, wrenches, self.gravity)
        return coordinate_forces(self.tree, state, f)

    def mass_matrix(self, q: Array) -> Array:
        """M̂ (..., nv, nv)."""
        state = kinematics.motion(self.tree, q, np.zeros(self.tree.nv))
        return mass_matrix(self.tree, state, dtype_of(q))

    def bias(self, q: Array, v: Array, wrenches: dict[int, Array]) -> Array:
        """−k̂ᶜ − k̂ᵗ (..., nv): what inverse dynamics gives at η̇ = 0."""
        return bias_forces(self.tree, kinematics.motion(self.tree, q, v), wrenches, self.gravity)

    def reactions(
        self,
        q: Array,
        v: Array,
        vdot: Array,
        u: Array,
        wrenches: dict[int, Array],
        *,
        frame: str,
        part: str,
        joints: tuple[int, ...],
        from_bias: bool = False,
    ) -> Array:
        """Wrenches (..., n, 6) of the joints with these indices at η̇ and joint forces u (..., nu); `self.tree` must be open at each."""
        state = kinematics.motion(self.tree, q, v)
        total = joint_wrenches(self.tree, state, vdot, wrenches, self.gravity, from_bias=from_bias)
        return reactions(self.tree, state, q, total, u, frame=frame, part=part, joints=joints)

    # --- energies, places ---

    def kinetic(self, q: Array, v: Array) -> Array:
        """Kinetic energy (...) [J]."""
        return energy.kinetic(self.tree, kinematics.motion(self.tree, q, v))

    def potential(self, t: Array | float, q: Array, v: Array) -> Array:
        """Potential energy (...) [J] of gravity and the conservative loads."""
        state = State(self.mechanism, self.tree, t, q, v)
        of_gravity = energy.potential(self.tree, kinematics.motion(self.tree, q, v), self.gravity)
        return of_gravity + sum(load.potential(state) for load in self.loads if load.conservative)

    def momentum(self, q: Array, v: Array) -> Array:
        """Angular momentum about the ground's origin, linear momentum (..., 6)."""
        return energy.momentum(self.tree, kinematics.motion(self.tree, q, v))

    def link_poses(self, q: Array) -> Array:
        """The pose (..., nlinks, 4, 4) of every link's frame in the ground's."""
        tree = self.tree
        world = kinematics.world_poses(tree, kinematics.poses(tree, q))
        if len(tree.bodies) < len(tree.link_body):  # some are fixed to others' bodies, or to the ground
            placed = (Pose(R, r) for R, r in zip(tree.link_rotation, tree.link_translation, strict=True))
            matrices = [homogeneous(*(world[b] @ X if b >= 0 else X)) for b, X in zip(tree.link_body, placed, strict=True)]
            shape = np.broadcast_shapes((*q.shape[:-1], 4, 4), *(T.shape for T in matrices))
            return np.stack([np.broadcast_to(T, shape) for T in matrices], axis=-3)

        def entries(_: Body, X: Pose) -> Array:
            T = homogeneous(*X)
            return T.reshape(*T.shape[:-2], 16)

        poses = tree.rows(tree.each(entries, world), tree.link_body, 16)
        return poses.reshape(*poses.shape[:-1], 4, 4)


class Views:
    """A scene's equations in one arithmetic, made when first asked for.

    backend: "numpy" and "mpmath" take the robot as it is; "native", which is float64 too, has a minimal tree for η̇: with reduce=None
    where that costs no digits, with True or False in any case or never.
    """

    def __init__(self, robot: Mechanism, gravity: Array, loads: Sequence[Load], backend: str, *, reduce: bool | None = None) -> None:
        self._robot, self._gravity, self._loads, self._backend = robot, gravity, loads, backend
        self._reduce = reduce
        self._cut: dict[frozenset[int], Equations] = {}

    def opened_at(self, joints: Iterable[int]) -> Equations:
        """Cut open at these joints (by index) where they are fixed, so that their reactions appear; lumped elsewhere."""
        fixed = frozenset(i for i in joints if not self._robot.joints[i].type.nv)
        if fixed not in self._cut:
            with precision(self._backend):
                robot, gravity = (self._robot.exact(), exact(self._gravity)) if self._backend == "mpmath" else (self._robot, self._gravity)
                tree = lump(robot, cut=fixed)
            # Cut open or not, it moves alike.
            fewest = (lambda: self.lumped.minimal) if fixed else (lambda: self._fewest(tree))
            self._cut[fixed] = Equations(self._robot, tree, gravity, self._loads, fewest if self._backend == "native" else None)
        return self._cut[fixed]

    def _fewest(self, tree: Tree) -> Minimal | None:
        if self._reduce is None:
            return reduced(self._robot, tree)
        return minimal(tree) if self._reduce else None

    @property
    def lumped(self) -> Equations:
        """On the bodies that move; links on fixed joints are lumped."""
        return self.opened_at(())

    @property
    def placed(self) -> Equations:
        """Those that place links with the fewest operations."""
        return self.lumped

    @property
    def opened(self) -> Equations:
        """Cut open at every joint, fixed ones and the joint to ground included."""
        return self.opened_at(range(len(self._robot.joints)))
