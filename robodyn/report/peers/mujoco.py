"""A robot in MuJoCo: the peer that makes time steps in C.

MuJoCo's own URDF compiler is not asked: it merges links, drops what it has no word for, changes inertias that it finds odd and adds
collision shapes. The model is built body by body from the tree that robodyn read from the same file, with the links on fixed joints
lumped, so MuJoCo has no body more than it needs. Joint frames, axes, masses and inertia tensors are handed over as they are; there are no
geometries, limits, dampers, springs, armatures or actuators, and everything beyond smooth dynamics is switched off, which saves MuJoCo
time. Whoever compares first calls `disagreement`.
"""

from collections.abc import Callable, Sequence
from typing import Any

import mujoco as library
import numpy as np
from mujoco import rollout

from ...arithmetic import Array
from ...errors import ModelError
from ...joints import Prismatic, Revolute
from ...model import Mechanism, lump

mujoco: Any = library  # its stubs lack most of it
NAME = f"MuJoCo {mujoco.__version__}"
OFF = ("CONSTRAINT", "CONTACT", "EQUALITY", "LIMIT", "FRICTIONLOSS", "SPRING", "DAMPER", "ACTUATION", "CLAMPCTRL", "SENSOR", "WARMSTART")
OFF += ("ISLAND", "MIDPHASE", "AUTORESET", "EULERDAMP", "REFSAFE", "FILTERPARENT")


class Twin:
    """The same robot, under the same gravity, stepped by MuJoCo's RK4 with steps of dt [s].

    ModelError where a joint mimics another, or is neither revolute nor prismatic.
    """

    def __init__(self, robot: Mechanism, dt: float, gravity: Sequence[float]) -> None:
        tree, spec = lump(robot), mujoco.MjSpec()
        if tree.has_mimic:
            raise ModelError("MuJoCo has no rigid mimic joint, only a soft constraint: lock the leader with --lock to compare")
        spec.compiler.degree = False
        bodies = []
        for i, body in enumerate(tree.bodies):
            if not isinstance(body.joint, Revolute | Prismatic):
                raise ModelError(
                    f"trajectories are compared for revolute and prismatic joints; {robot.joints[body.link].name!r} is another"
                )
            parent = bodies[body.parent] if body.parent >= 0 else spec.worldbody
            quaternion = np.zeros(4)
            mujoco.mju_mat2Quat(quaternion, np.ravel(body.rotation))
            there = parent.add_body(name=f"body_{i}", pos=body.translation, quat=quaternion)
            I = body.inertia.about_own_centre
            there.explicitinertial, there.mass, there.ipos = True, body.inertia.mass, body.inertia.centre
            there.fullinertia = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]
            kind = mujoco.mjtJoint.mjJNT_HINGE if isinstance(body.joint, Revolute) else mujoco.mjtJoint.mjJNT_SLIDE
            there.add_joint(name=f"joint_{i}", type=kind, axis=body.joint.axis)
            bodies.append(there)
        spec.option.timestep, spec.option.gravity = dt, gravity
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
        for flag in OFF:
            spec.option.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}", 0))
        try:
            self.model = spec.compile()
        except ValueError as error:
            raise ModelError(f"MuJoCo refuses this robot: {str(error).strip().splitlines()[0]}") from error
        self.data = mujoco.MjData(self.model)
        # qpos_mujoco[i] = q[self._order[i]]; both hold one number per joint.
        self._order = np.zeros(robot.nv, dtype=int)
        for i, body in enumerate(tree.bodies):
            self._order[self.model.joint(f"joint_{i}").qposadr[0]] = body.v.start
        self._back = np.argsort(self._order)

    def forward_dynamics(self, q: Array, v: Array, tau: Array) -> Array:
        """η̇ (nv,)."""
        self._put(q, v)
        self.data.qfrc_applied[:] = tau[self._order]
        mujoco.mj_forward(self.model, self.data)
        self.data.qfrc_applied[:] = 0.0
        return self.data.qacc[self._back]

    def run(self, q: Array, v: Array, steps: int) -> Array:
        """The state (2 nv,) after that many steps: one call, the loop is MuJoCo's own."""
        self._put(q, v)
        mujoco.mj_step(self.model, self.data, nstep=steps)
        return np.concatenate([self.data.qpos[self._back], self.data.qvel[self._back]])

    def crowd(self, q: Array, v: Array, steps: int, threads: int) -> Callable[[], Array]:
        """What runs trajectories from q, v (N, nv) by `mujoco.rollout` and returns their last states (N, 2 nv).

        The pool of threads and the arrays, MuJoCo's costs of a first call, are made here. MuJoCo always records every step.
        """
        data = [mujoco.MjData(self.model) for _ in range(threads)]
        start = np.hstack([np.zeros((len(q), 1)), q[:, self._order], v[:, self._order]])  # a leading time
        state, pool = np.empty((len(q), steps, start.shape[1])), rollout.Rollout(nthread=threads if threads > 1 else 0)
        columns = np.concatenate([1 + self._back, 1 + len(self._back) + self._back])

        def run() -> Array:
            pool.rollout(self.model, data, start, nstep=steps, state=state)
            return state[:, -1, columns]

        return run

    def _put(self, q: Array, v: Array) -> None:
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = q[self._order], v[self._order]
