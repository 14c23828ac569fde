"""What a native integrator calls: ẋ, and the projection back on the side conditions, traced."""

from typing import Any

import numpy as np

from ..checks.motion import refuse_impossible
from ..dynamics.questions import Evolution
from ..dynamics.state_vector import StateVector
from ..engine.trace.layout import Looped
from ..engine.trace.program import Program
from ..system.processes import without_collections
from .laws import Unchanged
from .routes import Routes
from .tracing import Tracing, finished


class IntegratorPrograms:
    """Those of one robot under one gravity and its loads."""

    def __init__(self, vector: StateVector, tracing: Tracing, routes: Routes, laws: Unchanged) -> None:
        self._vector, self._tracing, self._routes, self._laws = vector, tracing, routes, laws
        self.compiled: dict[tuple, Any] = {}  # step loops, by what `simulation.native` compiles them for

    @without_collections
    def evolution(self, formalism: str, *, semi_implicit: bool = False, held: bool = False) -> Program | Looped:
        """dx = ẋ at ("t", 1), ("x", size), as `StateVector` has it.

        semi_implicit: β̇ belongs to the velocity after a step of ("h", 1), so that Euler's explicit step becomes the semi-implicit one.
        held: joint forces ("held", nv) act beside the loads.
        """
        vector = self._vector
        formalism = self._routes.cheapest if formalism == "auto" else formalism
        question = Evolution(formalism)
        graph, views = self._tracing.symbolic(looped=self._routes.looped(question))
        refuse_impossible(self._tracing.robot, views.lumped.tree)
        self._laws.confirm(compiling=True)
        sizes = {"t": 1, "x": vector.size} | ({"h": 1} if semi_implicit else {}) | ({"held": vector.nv} if held else {})
        arrays = {name: graph.inputs(name, (n,)) for name, n in sizes.items()}
        x, tau = vector.split(arrays["x"]), arrays.get("held", np.zeros(vector.nv))
        with np.errstate(all="ignore"):  # as in `Tracing.program`
            answer = question.answer(views, arrays["t"][0], x.q, x.v, tau, x.z)
        rates = answer.values
        qdot = views.lumped.rate(x.q, x.v + rates["vdot"] * arrays["h"]) if semi_implicit else rates["qdot"]
        dx = vector.join(qdot, rates["vdot"], rates.get("zdot", x.z), rates["power"])
        return finished(graph, sizes, {"dx": dx}, self._tracing.guards(views, answer, None))

    def projection(self) -> Program | Looped | None:
        """x with its Euler parameters at unit length; None where there are none."""
        graph, views = self._tracing.symbolic(looped=self._routes.loops)
        if not views.lumped.tree.rated:
            return None
        x = graph.inputs("x", (self._vector.size,))
        parts = self._vector.split(x)
        return finished(graph, {"x": len(x)}, {"x": self._vector.join(views.lumped.project(parts.q), *parts[1:])}, [])
