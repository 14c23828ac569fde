"""What can be asked of a scene at a state, one class per question, generic over the scalar.

A question is immutable and hashable: it is also the key under which its compiled kernel is kept.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from ..arithmetic import Array, zeros
from ..formalism import energy
from ..formalism.solution import Solution
from ..formalism.state import NOTHING
from ..model import Mechanism
from .views import Views

Shapes = dict[str, tuple[int, ...]]
LOADS = ("joint_forces", "link_wrenches")  # what loads answer, by the names of their methods


class Answer(NamedTuple):
    """Arrays by name; and the solution they rest on, where accelerations were solved for."""

    values: dict[str, Array]
    solution: Solution | None = None


@dataclass(frozen=True)
class Question:
    """Base: `needs` names the arrays that `answer` takes beside the time and the loads' own states z, `shapes` what it returns."""

    needs: ClassVar[tuple[str, ...]]
    admissible: ClassVar[bool] = True  # q must satisfy φ(q) = 0; the stages of an integrator are off by its error
    loaded: ClassVar[tuple[str, ...]] = LOADS  # what of the loads has a part in it

    def shapes(self, robot: Mechanism, nz: int = 0) -> Shapes:
        """Shape of each array of the answer, for one state of a robot whose loads have nz states of their own."""
        raise NotImplementedError

    def answer(self, views: Views, t: Array | float, **arrays: Array) -> Answer:
        """The arrays at states (..., n) and time t [s], by name."""
        raise NotImplementedError


@dataclass(frozen=True)
class Solved(Question):
    """A question about accelerations that have to be solved for, by a route: "auto", or a name in `equations.FORMALISMS`."""

    formalism: str
    beside: ClassVar[tuple[str, ...] | None] = None  # what of a `Balance` the answer needs beside η̇; None: it cannot be composed of one

    def by(self, formalism: str) -> Self:
        """The same question by another route."""
        return replace(self, formalism=formalism)


@dataclass(frozen=True)
class ForwardDynamics(Solved):
    """η̇ (..., nv)."""

    needs = ("q", "v", "tau")
    beside = ()

    def shapes(self, robot: Mechanism, nz: int = 0) -> Shapes:
        return {"vdot": (robot.nv,)}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, tau: Array, z: Array = NOTHING) -> Answer:  # type: ignore[override]
        equations = views.lumped
        state = equations.state(t, q, v, z)
        solution = equations.accelerate(state, equations.applied(state, tau), self.formalism)
        return Answer({"vdot": solution.vdot}, solution)


@dataclass(frozen=True)
class Evolution(Solved):
    """ẋ of the state x = (β, η, z, w), w the work of the loads: what an integrator asks."""

    needs = ("q", "v", "tau")
    admissible = False
    loaded = (*LOADS, "state_rate")
    beside = ("qdot", "zdot", "power")

    def shapes(self, robot: Mechanism, nz: int = 0) -> Shapes:
        return {"qdot": (robot.nq,), "vdot": (robot.nv,), "power": ()} | ({"zdot": (nz,)} if nz else {})

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, tau: Array, z: Array = NOTHING) -> Answer:  # type: ignore[override]
        equations = views.lumped
        state = equations.state(t, q, v, z)
        acts = equations.applied(state, tau)
        solution = equations.accelerate(state, acts, self.formalism)
        rates = {"qdot": equations.rate(q, v), "vdot": solution.vdot, "power": acts.power}
        return Answer(rates | ({"zdot": equations.state_rate(state)} if z.shape[-1] else {}), solution)


@dataclass(frozen=True)
class Result(Solved):
    """η̇ (..., nv) and the joints' own forces u (..., nu): what a trajectory keeps of a state."""

    needs = ("q", "v", "tau")
    beside = ("u",)

    def shapes(self, robot: Mechanism, nz: int = 0) -> Shapes:
        return {"vdot": (robot.nv,), "u": (robot.nu,)}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, tau: Array, z: Array = NOTHING) -> Answer:  # type: ignore[override]
        equations = views.lumped
        state = equations.state(t, q, v, z)
        acts = equations.applied(state, tau)
        solution = equations.accelerate(state, acts, self.formalism)
        return Answer({"vdot": solution.vdot, "u": acts.u}, solution)


@dataclass(frozen=True)
class InverseDynamics(Question):
    """The coordinate forces (..., nv) that the joints must supply beside the loads."""

    needs = ("q", "v", "a")

    def shapes(self, robot: Mechanism, nz: int = 0) -> Shapes:
        return {"tau": (robot.nv,)}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, a: Array, z: Array = NOTHING) -> Answer:  # type: ignore[override]
        equations = views.lumped
        state = equations.state(t, q, v, z)
        acts = equations.applied(state, zeros((equations.tree.nv,), v.dtype))
        return Answer({"tau": equations.inverse(state, a, acts.wrenches) - acts.tau})


@dataclass(frozen=True)
class Balance(Question):
    """What M̂ η̇ = k̂ leaves at accelerations a: k̂ − M̂ a (..., nv), the "residual"; and what else of a state is named in `shown`."""

    shown: tuple[str, ...]  # of "residual", "u", "qdot", "zdot", "power"
    needs = ("q", "v", "a", "tau")
    admissible = False

    def shapes(self, robot: Mechanism, nz: int = 0) -> Shapes:
        shapes: Shapes = {"residual": (robot.nv,), "u": (robot.nu,), "qdot": (robot.nq,), "zdot": (nz,), "power": ()}
        return {name: shapes[name] for name in self.shown}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, a: Array, tau: Array, z: Array = NOTHING) -> Answer:  # type: ignore[override]
        equations = views.lumped
        state = equations.state(t, q, v, z)
        acts = equations.applied(state, tau)
        found = {"u": acts.u, "power": acts.power}
        if "residual" in self.shown:
            found["residual"] = acts.tau - equations.inverse(state, a, acts.wrenches)
        if "qdot" in self.shown:
            found["qdot"] = equations.rate(q, v)
        if "zdot" in self.shown:
            found["zdot"] = equations.state_rate(state)
        return Answer({name: found[name] for name in self.shown})


@dataclass(frozen=True)
class MassMatrix(Question):
    """M̂ (..., nv, nv)."""

    needs = ("q",)
    loaded = ()

    def shapes(self, robot: Mechanism, nz: int = 0) -> Shapes:
        return {"M": (robot.nv, robot.nv)}

    def answer(self, views: Views, t: Array | float, q: Array) -> Answer:  # type: ignore[override]
        equations = views.lumped
        return Answer({"M": equations.mass_matrix(equations.state(t, q, np.zeros(equations.tree.nv)))})


@dataclass(frozen=True)
class JointReactions(Solved):
    """Wrenches (..., n, 6) of the joints with these indices, at the accelerations that tau causes."""

    frame: str
    part: str
    joints: tuple[int, ...]
    needs = ("q", "v", "tau")
    beside = ("u",)

    def shapes(self, robot: Mechanism, nz: int = 0) -> Shapes:
        return {"wrenches": (len(self.joints), 6)}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, tau: Array, z: Array = NOTHING) -> Answer:  # type: ignore[override]
        opened = views.opened_at(self.joints)
        # Where it is a minimal tree that moves, f̌ᵏ at η̇ = 0 is found of the opened one, for k̂ and for what joints carry.
        resting = self.formalism == "nonrecursive" and opened.fewest is not None
        moving = opened if resting else views.lumped
        state = moving.state(t, q, v, z)
        acts = moving.applied(state, tau)
        solution = moving.accelerate(state, acts, self.formalism, resting=resting)
        seen = state.on(opened.tree)
        found = {"resting": solution.resting if resting else None, "wrenches": acts.wrenches if resting else opened.wrenches(seen)}
        return Answer({"wrenches": opened.reactions(seen, solution.vdot, acts.u, **found, **_shown(self))}, solution)


@dataclass(frozen=True)
class KnownReactions(Question):
    """The same at known accelerations a (..., nv) and joint forces u (..., nu)."""

    frame: str
    part: str
    joints: tuple[int, ...]
    needs = ("q", "v", "a", "u")
    loaded = ("link_wrenches",)

    def shapes(self, robot: Mechanism, nz: int = 0) -> Shapes:
        return {"wrenches": (len(self.joints), 6)}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, a: Array, u: Array, z: Array = NOTHING) -> Answer:  # type: ignore[override]
        opened = views.opened_at(self.joints)
        state = opened.state(t, q, v, z)
        return Answer({"wrenches": opened.reactions(state, a, u, wrenches=opened.wrenches(state), **_shown(self))})


def _shown(question: JointReactions | KnownReactions) -> dict[str, Any]:
    return {"frame": question.frame, "part": question.part, "joints": question.joints}


@dataclass(frozen=True)
class Energies(Question):
    """Kinetic energy and potential energy (...) [J]."""

    needs = ("q", "v")
    loaded = ("potential",)

    def shapes(self, robot: Mechanism, nz: int = 0) -> Shapes:
        return {"kinetic": (), "potential": ()}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array, z: Array = NOTHING) -> Answer:  # type: ignore[override]
        state = views.lumped.state(t, q, v, z)
        return Answer({"kinetic": energy.kinetic(state), "potential": views.lumped.potential(state)})


@dataclass(frozen=True)
class Momentum(Question):
    """Angular and linear momentum (..., 6)."""

    needs = ("q", "v")
    loaded = ()

    def shapes(self, robot: Mechanism, nz: int = 0) -> Shapes:
        return {"momentum": (6,)}

    def answer(self, views: Views, t: Array | float, q: Array, v: Array) -> Answer:  # type: ignore[override]
        return Answer({"momentum": energy.momentum(views.lumped.state(t, q, v))})


@dataclass(frozen=True)
class LinkPoses(Question):
    """Poses (..., nlinks, 4, 4)."""

    needs = ("q",)
    loaded = ()

    def shapes(self, robot: Mechanism, nz: int = 0) -> Shapes:
        return {"poses": (len(robot.links), 4, 4)}

    def answer(self, views: Views, t: Array | float, q: Array) -> Answer:  # type: ignore[override]
        return Answer({"poses": views.placed.link_poses(q, t)})
