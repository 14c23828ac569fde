"""The equations of a scene: robot, gravity and loads put into the formalism. Generic over the scalar, any leading dimensions.

Plain functions of arrays that are already checked (`checks.inputs`), in whatever arithmetic the tree's constants are in (`views`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..arithmetic import Array, dtype_of, zeros
from ..arithmetic.vectors import dot, homogeneous, joined, stacked
from ..formalism import energy, kinematics
from ..formalism.constraints import coordinate_forces
from ..formalism.ldl import couplings, factorise
from ..formalism.nonrecursive import mass_matrix, nonrecursive
from ..formalism.reactions import joint_wrenches, reactions
from ..formalism.recursive import recursive
from ..formalism.saddle import saddle_body, saddle_joint
from ..formalism.solution import Solution
from ..formalism.spatial import Pose, wrench_to_parent
from ..formalism.state import NOTHING, State
from ..loads import Load
from ..loads.checked import joint_forces, link_wrenches, state_rates
from ..model import Body, Field, Mechanism, Minimal, Tree
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

    def state(self, t: Array | float, q: Array, v: Array, z: Array = NOTHING) -> State:
        """The state of these equations' tree at time t [s], coordinates q (..., nq), velocities v (..., nv), loads' states z (..., nz)."""
        return State(self.mechanism, self.tree, t, q, v, z)

    # --- what acts ---

    @cached_property
    def initial_state(self) -> Array:
        """z (nz,) of all loads at the start of a motion, one load's behind the other's."""
        return joined(NOTHING, *(np.asarray(load.initial_state(self.mechanism), dtype=float) for load in self.loads))

    def seen(self, state: State) -> list[tuple[Load, State]]:
        """The loads, and the state as each sees it: z is its own."""
        if not state.z.shape[-1]:
            return [(load, state) for load in self.loads]
        ends = np.cumsum([0, *(len(load.initial_state(self.mechanism)) for load in self.loads)]).tolist()
        return [(load, state.of_load(state.z[..., a:b])) for load, (a, b) in zip(self.loads, pairwise(ends), strict=True)]

    def applied(self, state: State, tau: Array) -> Applied:
        """The loads at a state, and tau (..., nv) at the joints that own the coordinates."""
        mechanism, q, v = self.mechanism, state.q, state.v
        batch = np.broadcast_shapes(np.shape(state.t), q.shape[:-1], v.shape[:-1], tau.shape[:-1], state.z.shape[:-1])
        forces = {kind: zeros((*batch, mechanism.nu), dtype_of(q, v, tau)) for kind in (False, True)}  # conservative or not
        forces[False][..., mechanism.owned] = tau
        power = zeros(batch, forces[False].dtype)
        on_links = []
        for load, seen in self.seen(state):
            for i, force in joint_forces(load, seen).items():
                forces[load.conservative][..., mechanism.u_slices[i]] += force
            on_links.append(link_wrenches(load, seen))
            for link, wrench in on_links[-1].items():
                if not load.conservative:
                    power = power + dot(wrench, state.twist(link))
        power = power + dot(forces[False], state.velocities)
        u = forces[False] + forces[True]
        return Applied(u, self._coordinate_forces(u), self._on_bodies(state, on_links), power)

    def state_rate(self, state: State) -> Array:
        """ż (..., nz) of all loads."""
        return joined(NOTHING, *(state_rates(load, seen) for load, seen in self.seen(state)))

    def wrenches(self, state: State) -> dict[int, Array]:
        """The loads' wrenches (..., 6) on bodies, by body index, about O_i and resolved in K_i."""
        return self._on_bodies(state, [link_wrenches(load, seen) for load, seen in self.seen(state)])

    def _on_bodies(self, state: State, on_links: list[dict[int, Array]]) -> dict[int, Array]:
        """Wrenches that loads exert on links, about the links' origins, as wrenches on the bodies that these belong to."""
        found: dict[int, Array] = {}
        for link, wrench in (item for wrenches in on_links for item in wrenches.items()):
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

    def accelerate(self, state: State, acts: Applied, formalism: str, *, resting: bool = False) -> Solution:
        """η̇ by the named route; the saddle-point routes have no pivots to show.

        resting: f̌ᵏ of the bodies as they are at η̇ = 0 is wanted as well, for what joints carry: "nonrecursive" then takes k̂ from those.
        """
        if formalism == "nonrecursive" and (least := self.minimal):
            if resting:
                return nonrecursive(state, acts.tau, acts.wrenches, self.gravity, inertias=least.tree)
            return nonrecursive(state.on(least.tree), acts.tau, least.wrenches(acts.wrenches), self.gravity)
        if formalism in SWEEPS:
            return SWEEPS[formalism](state, acts.tau, acts.wrenches, self.gravity)
        _, _, vdot = SADDLES[formalism](state, acts.u, acts.wrenches, self.gravity)
        # Pivoting hides what is singular; the pivots of M̂ tell.
        M = mass_matrix(self.tree, state.motion, dtype_of(state.q))
        return Solution(vdot, stacked(factorise(M, couplings(self.tree))[1]))

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

    def inverse(self, state: State, vdot: Array, wrenches: dict[int, Array]) -> Array:
        """The coordinate forces (..., nv) that η̇ needs, joint loads included."""
        f = joint_wrenches(self.tree, state.motion, vdot, wrenches, self.gravity)
        return coordinate_forces(self.tree, state.motion, f)

    def mass_matrix(self, state: State) -> Array:
        """M̂ (..., nv, nv)."""
        return mass_matrix(self.tree, state.motion, dtype_of(state.q))

    def reactions(
        self,
        state: State,
        vdot: Array,
        u: Array,
        *,
        wrenches: dict[int, Array],
        frame: str,
        part: str,
        joints: tuple[int, ...],
        resting: Field | None = None,
    ) -> Array:
        """Wrenches (..., n, 6) of the joints with these indices at η̇ and joint forces u (..., nu); `self.tree` must be open at each.

        wrenches: of the loads, on bodies. resting: f̌ᵏ of this tree at η̇ = 0, where it has been found.
        """
        total = joint_wrenches(self.tree, state.motion, vdot, wrenches, self.gravity, resting=resting)
        return reactions(state, total, u, frame=frame, part=part, joints=joints)

    # --- energies, places ---

    def potential(self, state: State) -> Array:
        """Potential energy (...) [J] of gravity and the conservative loads."""
        of_gravity = energy.potential(state, self.gravity)
        return of_gravity + sum(load.potential(seen) for load, seen in self.seen(state) if load.conservative)

    def link_poses(self, q: Array, t: Array | float = 0.0) -> Array:
        """The pose (..., nlinks, 4, 4) of every link's frame in the ground's."""
        tree = self.tree
        world = kinematics.world_poses(tree, kinematics.poses(tree, q, t))
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
