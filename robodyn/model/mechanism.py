"""The robot as data: links, joints and the tree they form. Immutable; no algorithms."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Self

import numpy as np

from ..arithmetic import Array, exact
from ..arithmetic.vectors import frozen, orthonormal
from ..errors import ModelError, UnknownNameError
from ..joints import JointType
from ..system.processes import cached_property
from .geometry import Visual
from .inertia import Inertia

GROUND = "ground"  # the name of the joint that carries the root link


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid part of the robot, as the file names it."""

    name: str
    inertia: Inertia = field(default_factory=Inertia.zero)
    visuals: tuple[Visual, ...] = ()


@dataclass(frozen=True)
class Limits:
    """What the file declares; nothing is enforced by the equations."""

    lower: float = -np.inf  # [rad] or [m]
    upper: float = np.inf
    velocity: float = np.inf  # [rad/s] or [m/s]
    effort: float = np.inf  # [N m] or [N]


@dataclass(frozen=True)
class Mimic:
    """β = ratio · β_leader + offset: the joint owns no coordinate; its column of C is the leader's, times the ratio."""

    leader: int  # index of a joint that owns its coordinate
    ratio: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Joint:
    """How a link hangs on its parent. The joint's frame is the child link's frame at β = 0."""

    name: str
    type: JointType
    parent: int  # index of the parent link; −1: the ground
    rotation: Array = field(default_factory=lambda: frozen(np.eye(3)))  # (3, 3): of the joint's frame in the parent link's
    translation: Array = field(default_factory=lambda: frozen(np.zeros(3)))  # (3,) [m]
    limits: Limits = Limits()
    damping: float = 0.0  # viscous, [N m s/rad] or [N s/m]
    friction: float = 0.0  # Coulomb, [N m] or [N]
    mimic: Mimic | None = None


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Links and joints of a robot. Joint i carries link i; a parent stands before its children (depth first).

    joints[0] is the joint to ground, named `ground`: fixed, or free for a floating base.
    ModelError where links and joints are no such tree, the leader of a mimic joint owns no coordinate, or a name stands twice.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    source: str | None = None  # the file it was read from
    ledger: tuple[tuple[str, str, str], ...] = ()  # (element, "honoured" | "ignored", reason): what each tag became

    def __post_init__(self) -> None:
        if len(self.links) != len(self.joints) or not self.links:
            raise ModelError(f"robot {self.name!r} needs one joint per link: {len(self.links)} links, {len(self.joints)} joints")
        for i, joint in enumerate(self.joints):
            if not (-1 <= joint.parent < i):
                raise ModelError(f"joint {joint.name!r} (number {i}) must come after its parent link (number {joint.parent})")
            if joint.mimic and not (0 <= joint.mimic.leader < len(self.joints) and self.joints[joint.mimic.leader].mimic is None):
                raise ModelError(f"joint {joint.name!r} mimics joint number {joint.mimic.leader}, which does not own its coordinate")
        for kind, names in (("link", [a.name for a in self.links]), ("joint", [a.name for a in self.joints])):
            if len(set(names)) < len(names):
                twice = sorted({n for n in names if names.count(n) > 1})
                raise ModelError(f"robot {self.name!r} has more than one {kind} named {twice}: rename all but one")

    # --- sizes and where each joint's numbers stand ---

    @cached_property
    def owners(self) -> tuple[int, ...]:
        """Joints that own coordinates, in the order of q and v."""
        return tuple(i for i, joint in enumerate(self.joints) if joint.type.nv and joint.mimic is None)

    def _slices(self, sizes: Iterable[int]) -> tuple[slice, ...]:
        ends = np.cumsum([0, *sizes]).tolist()
        return tuple(slice(a, b) for a, b in pairwise(ends))

    def _shared(self, sizes: list[int]) -> tuple[slice, ...]:
        own = self._slices(0 if joint.mimic else n for joint, n in zip(self.joints, sizes, strict=True))
        return tuple(own[joint.mimic.leader] if joint.mimic else s for joint, s in zip(self.joints, own, strict=True))

    @cached_property
    def q_slices(self) -> tuple[slice, ...]:
        """Where each joint's β stands in q; a mimic joint's is its leader's."""
        return self._shared([joint.type.nq for joint in self.joints])

    @cached_property
    def v_slices(self) -> tuple[slice, ...]:
        """Where each joint's η stands in v; a mimic joint's is its leader's."""
        return self._shared([joint.type.nv for joint in self.joints])

    @cached_property
    def u_slices(self) -> tuple[slice, ...]:
        """Where each joint's own forces stand in the joint forces u (…, nu): like v, but mimic joints have their own."""
        return self._slices(joint.type.nv for joint in self.joints)

    @cached_property
    def driven(self) -> tuple[Array, Array]:
        """For each joint force of u the entry of v that it works on, and that velocity's ratio (nu,): 1 but for mimic joints."""
        moving = [(i, joint) for i, joint in enumerate(self.joints) if joint.type.nv]
        columns = [k for i, _ in moving for k in range(self.v_slices[i].start, self.v_slices[i].stop)]
        ratios = [joint.mimic.ratio if joint.mimic else 1.0 for _, joint in moving for _ in range(joint.type.nv)]
        return np.array(columns, dtype=np.int64), np.array(ratios)

    @cached_property
    def owned(self) -> Array:
        """Where the joint forces of those that own coordinates stand in u: (nv,) indices, in the order of v."""
        slices = [self.u_slices[i] for i in self.owners]
        return np.array([k for s in slices for k in range(s.start, s.stop)], dtype=np.int64)

    @cached_property
    def nq(self) -> int:
        """Number of joint coordinates."""
        return sum(self.joints[i].type.nq for i in self.owners)

    @cached_property
    def nv(self) -> int:
        """Number of degrees of freedom."""
        return sum(self.joints[i].type.nv for i in self.owners)

    @cached_property
    def nu(self) -> int:
        """Number of joint forces: nv plus the freedoms of mimic joints."""
        return sum(joint.type.nv for joint in self.joints)

    # --- names ---

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """All links, in the order of `link_poses`."""
        return tuple(link.name for link in self.links)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Moving joints that own coordinates, in the order of q and v."""
        return tuple(self.joints[i].name for i in self.owners)

    @cached_property
    def all_joint_names(self) -> tuple[str, ...]:
        """Every joint, `ground`, fixed and mimic joints included, in the order of `reactions`."""
        return tuple(joint.name for joint in self.joints)

    def link_index(self, name: str) -> int:
        """Number of a link; ModelError where there is none of that name."""
        return self._index("link", self.link_names, name)

    def joint_index(self, name: str) -> int:
        """Number of a joint; ModelError where there is none of that name."""
        return self._index("joint", self.all_joint_names, name)

    @cached_property
    def _numbers(self) -> dict[str, dict[str, int]]:
        tables = {"link": self.link_names, "joint": self.all_joint_names}
        return {kind: {name: i for i, name in enumerate(names)} for kind, names in tables.items()}

    def _index(self, kind: str, names: tuple[str, ...], name: str) -> int:
        numbers = self._numbers[kind]
        if name not in numbers:
            from difflib import get_close_matches

            close = get_close_matches(str(name), names, n=3)
            hint = (
                f"did you mean {' or '.join(map(repr, close))}?"
                if close
                else f"it has {', '.join(names[:12])}{', …' if len(names) > 12 else ''}"
            )
            raise UnknownNameError(f"robot {self.name!r} has no {kind} named {name!r}: {hint}")
        return numbers[name]

    def coordinate_names(self) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
        """Names and units of the entries of q and of v: `elbow_joint`, or `ground.qw` where a joint has several."""

        def named(table: str) -> list[tuple[str, str]]:
            entries = [(self.joints[i].name, entry) for i in self.owners for entry in getattr(self.joints[i].type, table)]
            return [(f"{joint}.{name}" if name else joint, unit) for joint, (name, unit) in entries]

        return named("coordinates"), named("velocities")

    # --- numbers ---

    def exact(self) -> Self:
        """The same robot with mpmath numbers; rotations and axes are made orthonormal to the last digit."""

        def joint(j: Joint) -> Joint:
            return replace(j, type=j.type.exact(), rotation=orthonormal(exact(j.rotation)), translation=exact(j.translation))

        def link(x: Link) -> Link:
            return replace(x, inertia=Inertia(exact(x.inertia.mass), exact(x.inertia.moment), exact(x.inertia.tensor)))

        return replace(self, links=tuple(map(link, self.links)), joints=tuple(map(joint, self.joints)))

    # --- states ---

    def neutral(self) -> Array:
        """q (nq,) with every joint at its zero: angles and displacements 0, quaternions (1, 0, 0, 0)."""
        return np.concatenate([np.zeros(0), *(self.joints[i].type.neutral() for i in self.owners)])

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """A random q (nq,), within the limits where the file declares both, and v (nv,), uniform in ±1."""
        q = [np.zeros(0)]
        for i in self.owners:
            joint = self.joints[i]
            bounded = joint.type.bounded and np.isfinite([joint.limits.lower, joint.limits.upper]).all()
            q.append(rng.uniform(joint.limits.lower, joint.limits.upper, 1) if bounded else joint.type.random(rng))
        return np.concatenate(q), rng.uniform(-1.0, 1.0, self.nv)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name!r}: {len(self.links)} links, nq={self.nq}, nv={self.nv}>"
