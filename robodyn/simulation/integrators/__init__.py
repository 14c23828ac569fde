"""One file per integrator; `METHODS` maps the name of each to what makes its steps. `contract` says what that is."""

from . import bdf, dop853, lsoda, radau, rk4, rk45, semi_implicit_euler
from .contract import Integrator, Outcome, Problem, Step
from .equal_steps import EqualSteps

METHODS: dict[str, Integrator] = {
    "dop853": dop853.method,
    "rk45": rk45.method,
    "rk4": rk4.method,
    "semi_implicit_euler": semi_implicit_euler.method,
    "radau": radau.method,
    "bdf": bdf.method,
    "lsoda": lsoda.method,
}

__all__ = ["METHODS", "EqualSteps", "Integrator", "Outcome", "Problem", "Step"]
