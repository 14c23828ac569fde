"""What several tests share: seeded random trees, error measures, and differences in 50 digits."""

from dataclasses import dataclass

import numpy as np

import robodyn as rd

EPS = np.finfo(float).eps
SEEDS = range(50)
ROUTES = ("recursive", "nonrecursive", "saddle_joint", "saddle_body")


@dataclass(frozen=True)
class Case:
    """A random robot at a random state under random forces."""

    robot: rd.Robot
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    a: np.ndarray
    seed: int

    @property
    def reference(self) -> "Reference":
        """The robot, answering by the readable reference: compiling kernels for every tree would take minutes."""
        return Reference(self.robot)

    def __repr__(self) -> str:
        return f"Case(seed={self.seed}, {self.robot!r})"


class Reference:
    """A robot whose methods run on NumPy unless told otherwise; all else is the robot's."""

    def __init__(self, robot: rd.Robot) -> None:
        self._robot = robot

    def __getattr__(self, name: str):
        found = getattr(self._robot, name)
        if name.endswith(("_dynamics", "_forces", "_matrix", "_energy", "_poses")) or name in ("reactions", "momentum"):
            return lambda *arrays, backend="numpy", **options: found(*arrays, backend=backend, **options)
        return found


def case(seed: int, *, n: int | None = None, **options) -> Case:
    """Serial, mixed and bushy trees of 2 to 8 links, every third with a free base, every joint type, generic inertias, O ≠ S."""
    rng = np.random.default_rng([2026, seed])
    n = int(rng.integers(2, 9)) if n is None else n
    options = {"branching": (0.0, 0.5, 1.0)[seed % 3], "floating_base": seed % 4 == 3, **options}
    robot = rd.random_robot(rng, n, **options)
    while not robot.nv:  # all joints drawn fixed: draw again
        robot = rd.random_robot(rng, n, **options)
    q, v = robot.random_state(rng)
    return Case(robot, q, v, rng.normal(size=robot.nv), rng.normal(size=robot.nv), seed)


def error(x, reference) -> float:
    """The largest deviation, relative to the largest entry of the reference."""
    x, reference = np.asarray(x, dtype=object), np.asarray(reference, dtype=object)
    scale = abs(reference).max() if reference.size else 1.0
    return float(abs(x - reference).max() / (scale or 1.0)) if x.size else 0.0


def condition(robot: rd.Robot, q: np.ndarray) -> float:
    """κ of the mass matrix, which carries errors of forces into accelerations."""
    return float(np.linalg.cond(robot.mass_matrix(q, backend="numpy"))) if robot.nv else 1.0


def derivative(function, x, direction):
    """d/dh function(x + h · direction) at h = 0 in 50 digits: a central difference, truncation 1e-36, rounding 1e-32."""
    import mpmath

    with mpmath.workdps(50):
        h = mpmath.mpf(10) ** -18
        step = np.asarray(direction, dtype=object) * h
        return (function(x + step) - function(x - step)) / (2 * h)


def many_digits(x) -> np.ndarray:
    """The same numbers for mpmath."""
    import mpmath

    return np.frompyfunc(lambda e: mpmath.mpf(float(e)), 1, 1)(np.asarray(x, dtype=float))
