"""The tree of bodies K_1 … K_n that the formalism works on: links that no freedom separates, lumped into one body."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arithmetic import Array
from ..arithmetic.vectors import frozen, orthonormal, snapped, stacked
from ..joints import JointType
from ..system.processes import cached_property
from .inertia import Inertia
from .mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class Body:
    """Body K_i with the joint that carries it. Its frame is that of the link whose joint it is, its O that link's origin."""

    joint: JointType
    parent: int  # index of the parent body; −1: the ground
    rotation: Array  # (3, 3): of the joint's frame in the parent body's
    translation: Array  # (3,) [m]
    inertia: Inertia
    link: int  # index of that link, and so of the joint, in the mechanism
    q: slice  # where β_i stands in q
    v: slice  # where η_i stands in v: the columns of C
    u: slice  # where the joint's own forces stand in u
    ratio: float = 1.0  # of a mimic joint; 1 elsewhere
    offset: float = 0.0


Field = Any  # a sequence of one record per body: of arrays, or of named tuples of arrays


@dataclass(frozen=True, eq=False)
class Tree:
    """Bodies, a parent before its children; and where each link of the mechanism sits on its body.

    What the formalism does at every body it does by the sweeps below, so that whoever traces it can run one body's step in a loop instead.
    M̂ and the matrices of the saddle-point routes, whose size grows faster than the tree's, go over pairs of bodies by themselves.
    """

    bodies: tuple[Body, ...]
    nq: int
    nv: int
    nu: int
    link_body: tuple[int, ...]  # the body that each link belongs to; −1: the ground
    link_rotation: tuple[Array, ...]  # (3, 3) of each link's frame in its body's
    link_translation: tuple[Array, ...]  # (3,) [m]

    # --- sweeps ---

    def each(self, step: Callable[..., Any], *fields: Field) -> Field:
        """step(body, *its records) of every body."""
        return [step(body, *records) for body, *records in zip(self.bodies, *fields, strict=True)]

    def outward(self, step: Callable[..., tuple[Any, Any]], root: Any, *fields: Field) -> Field:
        """From the root to the leaves: step(body, what its parent passed on, *its records) → (what it passes on, what is kept)."""
        passed, kept = [], []
        for body, *records in zip(self.bodies, *fields, strict=True):
            on, keep = step(body, passed[body.parent] if body.parent >= 0 else root, *records)
            passed.append(on)
            kept.append(keep)
        return kept

    def inward(self, step: Callable[..., tuple[Any, Any]], *fields: Field) -> Field:
        """From the leaves to the root: step(body, what arrived, *its records) → (what it sends to its parent, what is kept).

        What arrived is a list; its entries count by their sum alone.
        """
        arrived: list[list[Any]] = [[] for _ in self.bodies]
        kept: list[Any] = [None] * len(self.bodies)
        for i in reversed(range(len(self.bodies))):
            sent, kept[i] = step(self.bodies[i], arrived[i], *(field[i] for field in fields))
            if (parent := self.bodies[i].parent) >= 0:
                arrived[parent].append(sent)
        return kept

    def total(self, step: Callable[..., Any], *fields: Field) -> Any:
        """The sum of step(body, *its records) over all bodies; zero where there is none."""
        return sum(self.each(step, *fields), start=np.zeros(()))

    def unzip(self, records: Field, count: int) -> tuple[Field, ...]:
        """Records of `count` entries as as many fields."""
        return tuple([record[k] for record in records] for k in range(count))

    def split(self, x: Array, kind: str) -> Field:
        """The part of each body's joint of a vector q (..., nq), v (..., nv) or u (..., nu), as `kind` says."""
        return [x[..., getattr(body, kind)] for body in self.bodies]

    def everywhere(self, x: Array) -> Field:
        """The same array (...) for every body."""
        return [x] * len(self.bodies)

    def on_bodies(self, values: Mapping[int, Array]) -> Field:
        """Arrays given by body index; None for all others."""
        return [values.get(i) for i in range(len(self.bodies))]

    def gathered(self, parts: Field) -> Array:
        """The vector (..., nv) of one array (..., nv_i) per body; where bodies share a column (mimic), their sum."""
        columns: list[Any] = [None] * self.nv
        for body, part in zip(self.bodies, parts, strict=True):
            for k in range(body.joint.nv):
                c, x = body.v.start + k, part[..., k]
                columns[c] = x if columns[c] is None else columns[c] + x
        return stacked(columns)

    def coordinates(self, parts: Field) -> Array:
        """The vector (..., nq) of one array (..., nq_i) per body; where bodies share coordinates (mimic), the first one's."""
        columns: list[Any] = [None] * self.nq
        for body, part in zip(self.bodies, parts, strict=True):
            for k in range(body.joint.nq):
                columns[body.q.start + k] = part[..., k] if columns[body.q.start + k] is None else columns[body.q.start + k]
        return stacked(columns)

    def rows(self, parts: Field, bodies: Sequence[int], size: int) -> Array:
        """The arrays (..., size) of these bodies as rows (..., n, size)."""
        rows = [np.zeros((0, size)), *(parts[i][..., None, :] for i in bodies)]
        batch = np.broadcast_shapes(*(x.shape[:-2] for x in rows))
        return np.concatenate([np.broadcast_to(x, batch + x.shape[-2:]) for x in rows], axis=-2)

    # --- what is known of it ---

    @cached_property
    def has_mimic(self) -> bool:
        """Whether several joints share a coordinate."""
        columns = [body.v.start for body in self.bodies if body.joint.nv]
        return len(set(columns)) < len(columns)

    @cached_property
    def rheonomic(self) -> bool:
        """Whether a joint moves by the time as well."""
        return any(body.joint.rheonomic for body in self.bodies)

    @cached_property
    def rated(self) -> tuple[int, ...]:
        """Bodies on joints with β̇ ≠ η: those with Euler parameters."""
        return tuple(i for i, body in enumerate(self.bodies) if body.joint.rated)

    @cached_property
    def pivot_scales(self) -> Array:
        """Per coordinate, an upper bound (nv,) of the inertia that it can have to move, in any position.

        √(second moment) about a point at the distance d grows by at most √m d (Minkowski); joints that slide count as 1 m long.
        """
        moments = [float(np.trace(body.inertia.tensor)) for body in self.bodies]
        masses = [float(body.inertia.mass) for body in self.bodies]
        scales = np.zeros(self.nv)
        for i in reversed(range(len(self.bodies))):
            body = self.bodies[i]
            S = np.asarray(body.joint.motion(body.joint.neutral()), dtype=float) * body.ratio
            turning, sliding = (S[:3] ** 2).sum(0), (S[3:] ** 2).sum(0)
            scales[body.v] += abs(moments[i]) * turning + abs(masses[i]) * sliding
            if body.parent >= 0:
                length = np.linalg.norm(body.translation.astype(float)) + float(sliding.any())
                moments[body.parent] += (np.sqrt(abs(moments[i])) + np.sqrt(abs(masses[i])) * length) ** 2
                masses[body.parent] += masses[i]
        return scales


def lump(mechanism: Mechanism, cut: Collection[int] = ()) -> Tree:
    """The bodies of a mechanism: links on fixed joints become part of the body that carries them.

    `cut` names joints (by index) that stay open although they are fixed, so that their reaction appears.
    """
    bodies: list[Body] = []
    places: list[tuple[int, Array, Array]] = []  # body, rotation and translation of each link
    for i, (link, joint) in enumerate(zip(mechanism.links, mechanism.joints, strict=True)):
        # The joint's frame, seen from the body (or ground) that carries the parent link.
        if joint.parent < 0:
            parent, R, r = -1, joint.rotation, joint.translation
        else:
            parent, Rp, rp = places[joint.parent]
            R, r = Rp @ joint.rotation, Rp @ joint.translation + rp
        R, r = frozen(orthonormal(R if R.dtype == object else snapped(R))), frozen(r)

        # A link that cannot move adds its inertia to that body; what is fixed to the ground has none to add.
        if joint.type.rigid and i not in cut:
            if parent >= 0:
                bodies[parent] = replace(bodies[parent], inertia=bodies[parent].inertia + link.inertia.seen_from(R, r))
            places.append((parent, R, r))
            continue

        ratio, offset = (joint.mimic.ratio, joint.mimic.offset) if joint.mimic else (1.0, 0.0)
        where = {"q": mechanism.q_slices[i], "v": mechanism.v_slices[i], "u": mechanism.u_slices[i]}
        bodies.append(Body(joint.type, parent, R, r, link.inertia, i, **where, ratio=ratio, offset=offset))
        places.append((len(bodies) - 1, frozen(np.eye(3)), frozen(np.zeros(3))))
    link_body, link_rotation, link_translation = zip(*places, strict=True)
    return Tree(tuple(bodies), mechanism.nq, mechanism.nv, mechanism.nu, link_body, link_rotation, link_translation)
