"""What an integrator is: `init` makes a memory of the first state, `step` makes a step from it and says what came of it.

Problem, result and integrator are immutable; what a method remembers from step to step is handed from one call to the next.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

from ...arithmetic import Array
from ...engine.emit.stepper import Stepper
from ...engine.emit.tableau import Tableau
from ...errors import SimulationError

RightHandSide = Callable[[float, Array], Array]  # ẋ (nx,) = Ψ(x, t)
Projection = Callable[[Array], Array]  # x (nx,) with its Euler parameters at unit length


class Outcome(Enum):
    """What came of a step; of a failure, what is said of it."""

    OK = "it arrived"
    STEP_TOO_SMALL = (
        "the step size went to zero at t={t:.9g} s{reason}: the motion is too stiff or has a jump there. "
        "Loosen rtol or atol, soften the load, or use method='radau' or 'rk4' with a small dt"
    )
    NOT_CONVERGED = "the equations of the step from t={t:.9g} s have no solution near its start{reason}: reduce dt"
    NOT_FINITE = (
        "after t={t:.9g} s the state stopped being finite{reason}, or a joint showed no inertia within the next step: "
        "reduce dt, or look for loads that grow without bound"
    )

    def told(self, t: float, reason: str | None = None) -> str:
        """The message of a failure at time t [s], with a method's own words where it has some."""
        return self.value.format(t=t, reason=f" ({reason})" if reason else "")


@dataclass(frozen=True, eq=False)
class Problem:
    """ẋ = f(t, x) up to t_end [s]: a span of time without a break.

    f may raise: a ModelError that names the joint says more than any result code, and passes through every method.
    """

    f: RightHandSide
    t_end: float
    project: Projection
    rtol: float = 1e-9  # of adaptive methods: the error of a step is at most atol + rtol |x|
    atol: float = 1e-9
    dt: float = 1e-3  # of others: no step is longer [s]


@dataclass(frozen=True, eq=False)
class Step:
    """The result of a step from t_old to t [s], arriving at x; or why there is none, and then t and x are those of its start."""

    t_old: float
    t: float
    x: Array  # (nx,), projected
    between: Callable[[Array], Array]  # times (k,) within the step → states (k, nx)
    h: float | None = None  # the step [s] that error control would take next, whatever the end of the span; None: start anew
    error: float | None = None  # the estimated error in units of the tolerance; None: there is no estimate, or SciPy keeps it
    outcome: Outcome = Outcome.OK
    reason: str | None = None  # for a failure, in the method's own words


class Integrator(ABC):
    """A method: how its steps are made in Python, and what native code needs in order to make the same ones."""

    adaptive = True  # its error control chooses the steps; else they are equal, of at most dt
    semi_implicit = False  # β̇ is to belong to the velocity after the step: its right-hand side knows the step
    native = False  # native code makes the steps, by the `tableau`; else Python does, on a right-hand side of either backend

    def tableau(self) -> Tableau | Stepper:
        """How native code makes the steps, of a method that is `native`: its coefficients, or a class of its own that writes them."""
        raise NotImplementedError

    @abstractmethod
    def init(self, problem: Problem, t: float, x: Array, first_step: float | None = None) -> Any:
        """The memory from which the first `step` starts: at time t [s] and state x (nx,).

        first_step [s]: the `h` that the last step before left; None: the method finds one.
        """

    @abstractmethod
    def step(self, problem: Problem, memory: Any) -> tuple[Step, Any]:
        """One step that does not go beyond the problem's t_end, and the memory from which the next one starts."""

    def steps(
        self,
        f: RightHandSide,
        t0: float,
        x0: Array,
        t_end: float,
        project: Projection,
        *,
        first_step: float | None = None,
        **settings: float,
    ) -> Iterator[Step]:
        """The steps from t0 to t_end [s], from x0 (nx,), one after the other; settings: rtol, atol, dt as in `Problem`.

        SimulationError where one fails.
        """
        problem = Problem(f, t_end, project, **settings)
        t, memory = t0, self.init(problem, t0, x0, first_step)
        while t < t_end:
            step, memory = self.step(problem, memory)
            if step.outcome is not Outcome.OK:
                raise SimulationError(step.outcome.told(step.t, step.reason))
            yield step
            t = step.t
