"""A robot in Pinocchio and in robodyn, and the maps between their coordinates: the peer of benchmarks and the oracle of tests.

Pinocchio orders joints by name, stacks six-vectors linear first, stores quaternions (x, y, z, w) and continuous joints as
(cos, sin), and gives mimic joints coordinates of their own: a mimic robot's motion is Pinocchio's with η = G η_own.
"""

import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pinocchio

from ...errors import ModelError
from ...model import Mechanism

pin: Any = pinocchio  # its stubs lack most of it
NAME = f"Pinocchio {pinocchio.__version__}"


def swap(f):
    """Linear-first six-vectors as angular-first ones, and back."""
    return np.concatenate([f[..., 3:], f[..., :3]], axis=-1)


class Pair:
    """One robot in both libraries. `locked` is what the robot was loaded with."""

    def __init__(self, robot: Mechanism, path: str | os.PathLike[str], locked: Mapping[str, Any] | None = None) -> None:
        self.robot = robot
        root = (pin.JointModelFreeFlyer(),) if robot.joints[0].type.nv else ()
        self.model = _locked(pin.buildModelFromUrdf(os.fspath(path), *root), robot, locked or {})
        self.model.gravity.linear = np.array([0.0, 0.0, -9.81])
        self.data = self.model.createData()

        # v_pin = G v, block by block.
        self.G = np.zeros((self.model.nv, robot.nv))
        for i, joint in enumerate(robot.joints):
            if joint.type.nv:
                rows, ratio = self._columns(self._pin(joint.name)), joint.mimic.ratio if joint.mimic else 1.0
                block = np.eye(joint.type.nv) if joint.type.nv != 6 else np.roll(np.eye(6), 3, axis=0)
                self.G[rows, robot.v_slices[i]] = ratio * block

    @property
    def is_identity(self) -> bool:
        """Whether both libraries use the same coordinates in the same order."""
        return self.model.nq == self.robot.nq and np.array_equal(self.G, np.eye(self.robot.nv))

    @property
    def has_mimic(self) -> bool:
        """Whether Pinocchio has joints of its own where the robot's mimic others."""
        return self.robot.nu > self.robot.nv

    def _pin(self, name: str) -> int:
        return self.model.getJointId("root_joint" if name == "ground" else name)

    def _columns(self, joint: int) -> slice:
        start = self.model.joints[joint].idx_v
        return slice(start, start + self.model.joints[joint].nv)

    def q(self, q):
        """robodyn's q (nq,) as Pinocchio's."""
        out = pin.neutral(self.model)
        for i, joint in enumerate(self.robot.joints):
            if not joint.type.nv:
                continue
            there = self.model.joints[self._pin(joint.name)]
            value = q[self.robot.q_slices[i]]
            if joint.mimic:
                value = joint.mimic.ratio * value + joint.mimic.offset
            if joint.type.nv == 6:
                value = np.concatenate([value[:3], value[4:], value[3:4]])
            elif there.nq == 2:
                value = np.array([np.cos(value[0]), np.sin(value[0])])
            out[there.idx_q : there.idx_q + there.nq] = value
        return out

    def mass_matrix(self, q):
        """M̂ (nv, nv) in robodyn's coordinates."""
        M = pin.crba(self.model, self.data, self.q(q))
        M = np.triu(M) + np.triu(M, 1).T
        return self.G.T @ M @ self.G

    def inverse_dynamics(self, q, v, a):
        """tau (nv,) in robodyn's coordinates."""
        return self.G.T @ pin.rnea(self.model, self.data, self.q(q), self.G @ v, self.G @ a)

    def forward_dynamics(self, q, v, tau):
        """η̇ (nv,): by ABA where every joint owns its coordinate, by M̂ η̇ = τ − h where some mimic."""
        if not self.has_mimic:
            return self.G.T @ pin.aba(self.model, self.data, self.q(q), self.G @ v, self.G @ tau)
        return np.linalg.solve(self.mass_matrix(q), tau - self.inverse_dynamics(q, v, 0 * v))

    def rate(self) -> Callable[[float, Any], Any]:
        """ẋ of x = (q, v) without joint forces, for integrators in Python: around pin.aba, and nothing else where coordinates agree.

        ModelError where the coordinates' rates are not the velocities.
        """
        model, data, n, zero = self.model, self.data, self.robot.nv, np.zeros(self.robot.nv)
        if self.robot.nq != n:
            raise ModelError("the peer's trajectories are integrated only for robots whose coordinates' rates are their velocities")

        def plain(t: float, x):
            v = x[n:]
            return np.concatenate((v, pin.aba(model, data, x[:n], v, zero)))

        def mapped(t: float, x):
            return np.concatenate((x[n:], self.forward_dynamics(x[:n], x[n:], zero)))

        return plain if self.is_identity else mapped

    def joint_wrenches(self, q, v, a):
        """The whole wrench (6,) through each moving joint, by name, on the child, about its origin, in the child's frame."""
        pin.rnea(self.model, self.data, self.q(q), self.G @ v, self.G @ a)
        names = [joint.name for joint in self.robot.joints if joint.type.nv]
        return {name: swap(self.data.f[self._pin(name)].vector) for name in names}


def _locked(model: Any, robot: Mechanism, locked: Mapping[str, Any]) -> Any:
    """The model without the joints that do not move in the robot."""
    moving = {joint.name for joint in robot.joints if joint.type.nv}
    held = [name for name in list(model.names)[1:] if name not in moving and name != "root_joint"]
    if not held:
        return model
    q = pin.neutral(model)
    for name in held:
        joint = model.joints[model.getJointId(name)]
        if name not in locked or joint.nv != 1:
            raise ModelError(f"joint {name!r} moves in Pinocchio and not here: lock it by name too, with --lock {name}=VALUE")
        value = float(np.ravel(locked[name])[0])
        q[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
    return pin.buildReducedModel(model, [model.getJointId(name) for name in held], q)


def chain_model(robot: Mechanism) -> Any:
    """The Pinocchio model of a robot that has no file: every link on a revolute joint about any axis, or fixed to the ground."""
    model = pin.Model()
    numbers = {0: 0}
    for i, (link, joint) in enumerate(zip(robot.links, robot.joints, strict=True)):
        if joint.parent < 0:
            continue
        place = pin.SE3(np.array(joint.rotation), np.array(joint.translation))
        kind = pin.JointModelRevoluteUnaligned(np.array(joint.type.axis))  # type: ignore[attr-defined]
        numbers[i] = model.addJoint(numbers[joint.parent], kind, place, joint.name)
        inertia = pin.Inertia(float(link.inertia.mass), np.array(link.inertia.centre), np.array(link.inertia.about_own_centre))
        model.appendBodyToJoint(numbers[i], inertia, pin.SE3.Identity())
    return model
