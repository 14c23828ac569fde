"""Random robots: seeded trees with generic inertias, for tests and reports."""

from collections.abc import Sequence

import numpy as np

from .arithmetic.vectors import frozen, normalised, orthonormal, rotation_from_quaternion
from .errors import InputError
from .joints import JOINT_TYPES, Fixed, Free
from .model import GROUND, Inertia, Joint, Link
from .robot import Robot

MIXED = ("revolute", "continuous", "prismatic", "planar", "spherical", "floating", "fixed")


def random_robot(
    rng: np.random.Generator,
    n: int,
    *,
    branching: float = 0.5,
    joint_types: Sequence[str] = MIXED,
    floating_base: bool = False,
    fixed: float | None = None,
) -> Robot:
    """A robot of n links beyond its root, each on a joint drawn from `joint_types`.

    branching: 0 gives a chain, 1 attaches every link to any earlier one. fixed: the share of fixed joints, where it is given.
    Inertias are generic: three different principal moments that satisfy the triangle inequality, about axes askew to the link's,
    and a centre of mass away from the origin. Lengths are about 0.3 m, masses 0.5 to 3 kg.
    InputError where a number is out of its range, a joint type unknown, or none is left to draw.
    """
    if n < 0 or not 0 <= branching <= 1 or not 0 <= (fixed or 0) <= 1:
        raise InputError(f"random_robot needs n ≥ 0, 0 ≤ branching ≤ 1 and 0 ≤ fixed ≤ 1, not n={n}, branching={branching}, fixed={fixed}")
    if unknown := set(joint_types) - set(JOINT_TYPES):
        raise InputError(f"joint_types names {sorted(unknown)}: known are {', '.join(JOINT_TYPES)}")
    if not joint_types or (fixed is not None and fixed < 1 and set(joint_types) == {"fixed"}):
        raise InputError(f"joint_types={joint_types!r} leaves nothing to draw: name at least one joint type that moves")
    moving = [kind for kind in joint_types if kind != "fixed"]
    links, joints = [Link("link_0", _inertia(rng))], [Joint(GROUND, Free() if floating_base else Fixed(), -1)]
    parents, children = [-1], [[] for _ in range(n + 1)]
    for i in range(1, n + 1):
        parents.append(int(rng.integers(i)) if rng.random() < branching else i - 1)
        children[parents[i]].append(i)

    # Depth first, as a file would be read.
    number, todo = {0: 0}, children[0][::-1]
    while todo:
        i = todo.pop()
        number[i] = len(links)
        drop_freedom = rng.random() < fixed if fixed is not None else False
        kinds = ["fixed"] if drop_freedom else (moving if fixed is not None else list(joint_types))
        kind = JOINT_TYPES[kinds[rng.integers(len(kinds))]].from_axis(normalised(rng.normal(size=3)))
        placement = frozen(_rotation(rng)), frozen(rng.uniform(-0.3, 0.3, 3))
        links.append(Link(f"link_{number[i]}", _inertia(rng)))
        joints.append(Joint(f"joint_{number[i]}", kind, number[parents[i]], *placement))
        todo += children[i][::-1]
    return Robot(name=f"random_{n}", links=tuple(links), joints=tuple(joints))


def _rotation(rng: np.random.Generator):
    return orthonormal(rotation_from_quaternion(normalised(rng.normal(size=4))))


def _inertia(rng: np.random.Generator) -> Inertia:
    """A random solid: second moments along three axes (any positive numbers) guarantee the triangle inequality."""
    mass, second = rng.uniform(0.5, 3.0), rng.uniform(0.02, 0.15, 3) ** 2
    R = _rotation(rng)
    tensor = R @ np.diag(second.sum() - second) @ R.T * mass
    return Inertia.about_centre(mass, rng.uniform(-0.15, 0.15, 3), (tensor + tensor.T) / 2)
