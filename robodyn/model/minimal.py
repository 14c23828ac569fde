"""The tree with the fewest numbers that moves alike: what forward dynamics needs of a robot, and no more.

Coordinates, M̂ and k̂ are those of the tree it is made from; the bodies are not. Origins slide along their joints' axes until the
vectors between them have the most zeros, and from the leaves to the root every inertia that moves alike on the parent goes to the
parent: what stays are the base inertial parameters (Gautier, Khalil, Direct calculation of minimum set of inertial parameters of
serial robots, IEEE Trans. Robotics and Automation 6, 1990). On arms of revolute joints no body keeps its mass, and the products with it
fold away when the equations are traced.

M̂ is made of the same sums as before in another order, so it is rounded alike. Articulated inertias are not: elimination would have to
subtract again what was moved to the root only to save operations. So `nonrecursive` alone runs on this tree.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..arithmetic import Array
from ..arithmetic.vectors import cross, frozen, joined
from .inertia import Inertia
from .tree import Body, Tree


@dataclass(frozen=True, eq=False)
class Minimal:
    """The tree, and where its origins are."""

    tree: Tree
    slides: tuple[Array, ...]  # (3,) [m]: of each body's new O in its frame, from its old O

    def wrenches(self, wrenches: Mapping[int, Array]) -> dict[int, Array]:
        """Wrenches (..., 6) on bodies, about the old origins, about the new ones."""
        return {
            i: joined(f[..., :3] - cross(self.slides[i], f[..., 3:]), f[..., 3:]) if self.slides[i].any() else f
            for i, f in wrenches.items()
        }


def minimal(tree: Tree) -> Minimal:
    """The tree (float64) with slid origins and base inertial parameters. Its poses, twists and wrenches mean nothing outside."""
    bodies = list(tree.bodies)

    # From the root: each origin to where the way from its parent's has the most zeros.
    slides: list[Array] = []
    for i, body in enumerate(bodies):
        r = body.translation - slides[body.parent] if body.parent >= 0 else body.translation
        slides.append(slide := _slide(r, body))
        r = np.where(body.rotation @ slide, 0.0, r)
        inertia = body.inertia.seen_from(np.eye(3), -slide) if slide.any() else body.inertia
        bodies[i] = replace(body, translation=frozen(r), inertia=inertia)

    # From the leaves: what moves alike on the parent goes there; the ground does not move.
    for i in reversed(range(len(bodies))):
        body = bodies[i]
        moved = body.joint.indifferent(body.inertia.mass, body.inertia.moment, body.inertia.tensor)
        if moved is None:
            continue
        passed = Inertia(*moved)
        bodies[i] = replace(body, inertia=body.inertia - passed)
        if body.parent >= 0:
            parent = bodies[body.parent]
            bodies[body.parent] = replace(parent, inertia=parent.inertia + passed.seen_from(body.rotation, body.translation))
    return Minimal(replace(tree, bodies=tuple(bodies)), tuple(slides))


def _slide(r: Array, body: Body) -> Array:
    """How far (3,) [m] the origin of a body, at r (3,) of its parent's, slides in its own frame.

    Only along coordinate axes of both frames: one coordinate of r becomes zero, no other changes, and no origin gets farther from
    its parent's. Slides in other directions save products too, and cost digits where a robot is long against the size of its links.
    """
    e = body.joint.line
    if e is None or np.count_nonzero(e) != 1 or np.count_nonzero(a := body.rotation @ e) != 1:
        return np.zeros(3)
    return -(a @ r) * e
