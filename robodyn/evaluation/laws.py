"""Whether code of the user's own, in control laws and loads, still computes what kernels were compiled from."""

from collections.abc import Sequence

import numpy as np

from ..engine.trace.graph import Graph
from ..errors import InputError
from ..loads import ControlLaw, Load, State
from ..loads.checked import joint_forces, link_wrenches, state_rates
from ..model import Mechanism, Tree

# What a load answers, by what `Question.loaded` calls it.
ANSWERS = {
    "joint_forces": joint_forces,
    "link_wrenches": link_wrenches,
    "state_rate": lambda load, state: {0: state_rates(load, state)},
    "potential": lambda load, state: {0: load.potential(state)},
}


class Unchanged:
    """The loads of a scene as they were when the first kernel was made of them; gains may have changed since.

    Of a control law, and of every other load whose code is the user's own: not of `large` robots, where to follow it from link to link
    takes as long as a run.
    """

    def __init__(self, robot: Mechanism, tree: Tree, loads: Sequence[Load], *, large: bool) -> None:
        self._robot, self._tree = robot, tree
        self._own = [load for load in loads if isinstance(load, ControlLaw) or (_is_foreign(load) and not large)]
        self._compiled: dict[str, list[str]] = {}  # by kind of answer, per load

    def confirm(self, kinds: Sequence[str] = tuple(ANSWERS), *, compiling: bool = False) -> None:
        """InputError where a load computes something else than before.

        kinds: what is asked of the loads. compiling: a kernel is about to be made; elsewhere only what kernels were made of is looked at.
        """
        for kind in kinds:
            if not self._own or not (compiling or kind in self._compiled):
                continue
            now = [self._written_down(load, kind) for load in self._own]
            for load, text, before in zip(self._own, now, self._compiled.get(kind, now), strict=True):
                if text != before:
                    raise InputError(
                        f"the load {type(load).__name__} gives other forces than when it was compiled for this scene: what it reads beside "
                        "time and state is fixed then. Make a new rd.Scene with it as it is now; for results of before, put it back"
                    )
            self._compiled[kind] = now

    def _written_down(self, load: Load, kind: str) -> str:
        """What a load computes, in operations on symbols."""
        graph = Graph()
        sizes = {"t": 1, "q": self._robot.nq, "v": self._robot.nv, "z": len(load.initial_state(self._robot))}
        (t,), q, v, z = (graph.inputs(name, (n,)) for name, n in sizes.items())
        with np.errstate(all="ignore"):  # a division by a constant zero is no matter before there are numbers
            forces = ANSWERS[kind](load, State(self._robot, self._tree, t, q, v, z))
        return repr((graph.nodes, {i: [getattr(x, "number", x) for x in np.ravel(f)] for i, f in forces.items()}))


def _is_foreign(load: Load) -> bool:
    return type(load).__module__.partition(".")[0] != "robodyn"
