"""What can be asked of a scene at a state, one class per question, generic over the scalar.

A question is immutable and hashable: it is also the key under which its compiled kernel is kept.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from ..arithmetic import Array, zeros
from ..formalism.solution import Solution
from ..model import Mechanism
from .equations import Views

Shapes = dict[str, tuple[int, ...]]


class Answer(NamedTuple):
    """Arrays by name; and the solution they rest on, where accelerations were solved for."""

    values: dict[str, Array]
    solution: Solution | None = None


@dataclass(frozen=True)
class Question:
    """Base: `needs` names the arrays that `answer` takes beside the time, `shapes` what it returns for one state."""

    needs: ClassVar[tuple[str, ...]]
    admissible: ClassVar[bool] = True  # q must satisfy φ(q) = 0; the stages of an integrator are off by its error
    loaded: ClassVar[tuple[str, ...]] = ("joint_forces", "link_wrenches")  # what of the loads has a part in it

    def shapes(self, robot: Mechanism) -> Shapes:
        """Shape of each array of the answer, for one state."""
        raise NotImplementedError

    def answer(self, views: Views, t: Array | float, **arrays: Array) -> Answer:
        """The arrays at states (..., n) and time t [s], by name."""
        raise NotImplementedError


@dataclass(frozen=True)
class ForwardDynamics(Question):
    """η̇ (..., nv)."""

    formalism: str
    needs = ("q", "v", "tau")

    def shapes(self, robot: Mechanism) -> Shapes:
        return {"vdot": (robot.nv,)}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, tau: Array) -> Answer:  # type: ignore[override]
        solution = views.lumped.accelerate(q, v, views.lumped.applied(t, q, v, tau), self.formalism)
        return Answer({"vdot": solution.vdot}, solution)


@dataclass(frozen=True)
class Evolution(Question):
    """ẋ of the state x = (β, η, w), w the work of the loads: what an integrator asks."""

    formalism: str
    needs = ("q", "v", "tau")
    admissible = False

    def shapes(self, robot: Mechanism) -> Shapes:
        return {"qdot": (robot.nq,), "vdot": (robot.nv,), "power": ()}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, tau: Array) -> Answer:  # type: ignore[override]
        acts = views.lumped.applied(t, q, v, tau)
        solution = views.lumped.accelerate(q, v, acts, self.formalism)
        return Answer({"qdot": views.lumped.rate(q, v), "vdot": solution.vdot, "power": acts.power}, solution)


@dataclass(frozen=True)
class Result(Question):
    """η̇ (..., nv) and the joints' own forces u (..., nu): what a trajectory keeps of a state."""

    formalism: str
    needs = ("q", "v", "tau")

    def shapes(self, robot: Mechanism) -> Shapes:
        return {"vdot": (robot.nv,), "u": (robot.nu,)}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, tau: Array) -> Answer:  # type: ignore[override]
        acts = views.lumped.applied(t, q, v, tau)
        solution = views.lumped.accelerate(q, v, acts, self.formalism)
        return Answer({"vdot": solution.vdot, "u": acts.u}, solution)


@dataclass(frozen=True)
class InverseDynamics(Question):
    """The coordinate forces (..., nv) that the joints must supply beside the loads."""

    needs = ("q", "v", "a")

    def shapes(self, robot: Mechanism) -> Shapes:
        return {"tau": (robot.nv,)}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, a: Array) -> Answer:  # type: ignore[override]
        acts = views.lumped.applied(t, q, v, zeros((views.lumped.tree.nv,), v.dtype))
        return Answer({"tau": views.lumped.inverse(q, v, a, acts.wrenches) - acts.tau})


@dataclass(frozen=True)
class Balance(Question):
    """What M̂ η̇ = k̂ leaves at accelerations a: k̂ − M̂ a (..., nv), the "residual"; and what else of a state is named in `shown`."""

    shown: tuple[str, ...]  # of "residual", "u", "qdot", "power"
    needs = ("q", "v", "a", "tau")
    admissible = False

    def shapes(self, robot: Mechanism) -> Shapes:
        shapes: Shapes = {"residual": (robot.nv,), "u": (robot.nu,), "qdot": (robot.nq,), "power": ()}
        return {name: shapes[name] for name in self.shown}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, a: Array, tau: Array) -> Answer:  # type: ignore[override]
        equations = views.lumped
        acts = equations.applied(t, q, v, tau)
        found = {"u": acts.u, "power": acts.power}
        if "residual" in self.shown:
            found["residual"] = acts.tau - equations.inverse(q, v, a, acts.wrenches)
        if "qdot" in self.shown:
            found["qdot"] = equations.rate(q, v)
        return Answer({name: found[name] for name in self.shown})


@dataclass(frozen=True)
class MassMatrix(Question):
    """M̂ (..., nv, nv)."""

    needs = ("q",)
    loaded = ()

    def shapes(self, robot: Mechanism) -> Shapes:
        return {"M": (robot.nv, robot.nv)}

    def answer(self, views: Views, t: Array | float, q: Array) -> Answer:  # type: ignore[override]
        return Answer({"M": views.lumped.mass_matrix(q)})


@dataclass(frozen=True)
class JointReactions(Question):
    """Wrenches (..., n, 6) of the joints with these indices, at the accelerations that tau causes."""

    formalism: str
    frame: str
    part: str
    joints: tuple[int, ...]
    needs = ("q", "v", "tau")

    def shapes(self, robot: Mechanism) -> Shapes:
        return {"wrenches": (len(self.joints), 6)}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, tau: Array) -> Answer:  # type: ignore[override]
        opened = views.opened_at(self.joints)
        # The minimal form finds what all bodies need at η̇ = 0 either way: then both are asked of the same bodies.
        shared = self.formalism == "nonrecursive" and opened.fewest is not None
        moving = opened if shared else views.lumped
        acts = moving.applied(t, q, v, tau)
        solution = moving.accelerate(q, v, acts, self.formalism, carried=shared)
        wrenches, shown = opened.wrenches(t, q, v), {"frame": self.frame, "part": self.part, "joints": self.joints}
        return Answer({"wrenches": opened.reactions(q, v, solution.vdot, acts.u, wrenches, from_bias=shared, **shown)}, solution)


@dataclass(frozen=True)
class KnownReactions(Question):
    """The same at known accelerations a (..., nv) and joint forces u (..., nu)."""

    frame: str
    part: str
    joints: tuple[int, ...]
    needs = ("q", "v", "a", "u")
    loaded = ("link_wrenches",)

    def shapes(self, robot: Mechanism) -> Shapes:
        return {"wrenches": (len(self.joints), 6)}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, a: Array, u: Array) -> Answer:  # type: ignore[override]
        opened, shown = views.opened_at(self.joints), {"frame": self.frame, "part": self.part, "joints": self.joints}
        return Answer({"wrenches": opened.reactions(q, v, a, u, opened.wrenches(t, q, v), **shown)})


@dataclass(frozen=True)
class Energies(Question):
    """Kinetic energy and potential energy (...) [J]."""

    needs = ("q", "v")
    loaded = ()

    def shapes(self, robot: Mechanism) -> Shapes:
        return {"kinetic": (), "potential": ()}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array) -> Answer:  # type: ignore[override]
        return Answer({"kinetic": views.lumped.kinetic(q, v), "potential": views.lumped.potential(t, q, v)})


@dataclass(frozen=True)
class Momentum(Question):
    """Angular and linear momentum (..., 6)."""

    needs = ("q", "v")
    loaded = ()

    def shapes(self, robot: Mechanism) -> Shapes:
        return {"momentum": (6,)}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array) -> Answer:  # type: ignore[override]
        return Answer({"momentum": views.lumped.momentum(q, v)})


@dataclass(frozen=True)
class LinkPoses(Question):
    """Poses (..., nlinks, 4, 4)."""

    needs = ("q",)
    loaded = ()

    def shapes(self, robot: Mechanism) -> Shapes:
        return {"poses": (len(robot.links), 4, 4)}

    def answer(self, views: Views, t: Array | float, q: Array) -> Answer:  # type: ignore[override]
        return Answer({"poses": views.placed.link_poses(q)})
