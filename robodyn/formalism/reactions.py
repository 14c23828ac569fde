"""Joint wrenches: f̌ᵏ = Mǎ − f̌ᶜ − f̌ᵗ, then f̌ᵖ = B⁻ᵀ f̌ᵏ, eq. (8), by one sweep from the leaves to the root.

The sign convention stands here: the wrench ON the child body, FROM its parent, about the joint's origin O_i (the child
link's origin), resolved in the child link's frame unless another frame is asked for.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from ..arithmetic import Array
from ..arithmetic.vectors import joined, mul
from ..errors import UnknownNameError
from ..model import Body, Field, Tree
from .kinematics import Motion, accelerations, falling_ground, joint_position
from .newton_euler import Wrenches, added_resultants, resultants
from .spatial import Pose, angular, linear, wrench_to_parent
from .state import State

FRAMES = ("child", "parent", "world")
PARTS = ("constraint", "total")


@dataclass(frozen=True, eq=False)
class Reactions(Mapping[str, Array]):
    """The wrench [M, F] (..., 6) in [N m, N] of each joint, by name: `reactions["elbow_joint"]`.

    UnknownNameError, a ModelError and a KeyError, for a joint that was not asked for.
    """

    joint_names: tuple[str, ...]
    array: Array  # (..., njoints, 6)
    frame: str = "child"
    part: str = "constraint"

    def __getitem__(self, name: str) -> Array:
        if name not in self.joint_names:
            raise UnknownNameError(f"there is no reaction of a joint named {name!r} here: there are {', '.join(self.joint_names)}")
        return self.array[..., self.joint_names.index(name), :]

    def __iter__(self):  # type: ignore[override]
        return iter(self.joint_names)

    def __len__(self) -> int:
        return len(self.joint_names)

    def __repr__(self) -> str:
        return f"<Reactions of {len(self)} joints, {self.part} part in the {self.frame} frame, array {self.array.shape}>"


def inward(tree: Tree, motion: Motion, f: Field) -> Field:
    """B⁻ᵀ f̌ (..., 6 each): what each joint carries when f̌ is needed on each body."""

    def step(_: Body, arrived: list[Array], X: Pose, needed: Array) -> tuple[Array, Array]:
        carried = sum(arrived, start=needed)
        return wrench_to_parent(X, carried), carried

    return tree.inward(step, motion.pose, f)


def joint_wrenches(tree: Tree, motion: Motion, vdot: Array, wrenches: Wrenches, gravity: Array, *, resting: Field | None = None) -> Field:
    """The whole wrench (..., 6) through each joint at η̇: reaction and joint forces together.

    resting: f̌ᵏ at η̇ = 0 where a route has found it on this tree: then M J η̇ is all that has to be added.
    """
    if resting is not None:
        change = added_resultants(tree, motion, vdot)
        return inward(tree, motion, tree.each(lambda _, f, more: f + more, resting, change))
    a = accelerations(tree, motion, falling_ground(gravity), vdot)
    return inward(tree, motion, resultants(tree, motion, a, wrenches))


def reactions(state: State, total: Field, u: Array, *, frame: str, part: str, joints: tuple[int, ...]) -> Array:
    """The wrenches (..., n, 6) of the joints with these indices, from the whole wrench through every joint.

    The state's tree is open at each of them. u (..., nu): the joints' own forces.
    """

    def shown(body: Body, f: Array, R: Array, beta: Array, own: Array) -> Array:
        if part == "constraint" and body.joint.nv:
            f = f - mul(body.joint.actuation(joint_position(body, beta)), own)
        return f if frame == "child" else turned(R, f)

    tree, X = state.tree, state.world if frame == "world" else state.motion.pose
    R = tree.each(lambda _, pose: pose.R, X)
    found = tree.each(shown, total, R, tree.split(state.q, "q"), tree.split(u, "u"))
    return tree.rows(found, [tree.link_body[link] for link in joints], 6)


def turned(R: Array, f: Array) -> Array:
    """A wrench (..., 6) resolved in a frame in which its own has the rotation R; the point stays."""
    return joined(mul(R, angular(f)), mul(R, linear(f)))
