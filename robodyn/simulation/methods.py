"""The integrators by name."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ..engine.emit.stepper import Stepper
from ..engine.emit.tableau import Tableau
from . import dop853, rk4, rk45, semi_implicit_euler, stiff
from .step import Step


@dataclass(frozen=True)
class Integrator:
    """How a method is run."""

    steps: Callable[..., Iterator[Step]]  # in Python, on any right-hand side
    tableau: Callable[[], Tableau | Stepper] | None = (
        None  # for the native step loop; None: Python makes the steps on a native right-hand side
    )
    adaptive: bool = True
    semi_implicit: bool = False


METHODS: dict[str, Integrator] = {
    "dop853": Integrator(dop853.steps, dop853.tableau),
    "rk45": Integrator(rk45.steps, rk45.tableau),
    "rk4": Integrator(rk4.steps, rk4.tableau, adaptive=False),
    "semi_implicit_euler": Integrator(semi_implicit_euler.steps, semi_implicit_euler.tableau, adaptive=False, semi_implicit=True),
    "radau": Integrator(stiff.radau),
    "bdf": Integrator(stiff.bdf),
    "lsoda": Integrator(stiff.lsoda),
}
