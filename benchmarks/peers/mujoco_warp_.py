"""MuJoCo Warp: the rod of EngineMujoco, stepped by Warp's kernels; they are made for GPUs."""

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.base import Peer
from cablecast.cable import Cable, CableParams
from cablecast.conventions import GRAVITY
from cablecast.engines.mujoco_ import HAND_DOF_COUNT, SERVO_OMEGA, rod_model

TOLERANCE = 1e-10
"""Tolerance of the solver: single precision does not reach EngineMujoco's."""

DEPTH = 5.0
"""Depth of the table where motions are in the air [m]."""


class PeerMujocoWarp(Peer):
    """MuJoCo Warp, all worlds at once; its segments roll where there is a table."""

    name = "MuJoCo Warp"

    def start(self, cable: Cable, params: CableParams, nodes: NDArray, rotations: NDArray) -> None:
        import mujoco
        import mujoco_warp

        library: object = mujoco
        model = self._model(library, cable, params)
        data = mujoco.MjData(model)  # pyright: ignore[reportAttributeAccessIssue]
        self.step = mujoco_warp.step
        self.model = mujoco_warp.put_model(model)
        self.data = mujoco_warp.put_data(model, data, nworld=len(nodes))
        count = self.segment_count
        self.rest = np.zeros((count, 3))
        self.rest[:, 1] = np.arange(1, count + 1) * cable.length / count
        self.slides = slice(HAND_DOF_COUNT, HAND_DOF_COUNT + 3 * count)
        self.driven = _hand(nodes[:, 1], rotations[:, 0])
        self.speed = np.zeros_like(self.driven)
        positions = self.data.qpos.numpy()
        positions[:, :HAND_DOF_COUNT] = self.driven
        positions[:, self.slides] = (nodes[:, 2:] - self.rest).reshape(len(nodes), -1)

    def _model(self, mujoco, cable: Cable, params: CableParams):
        """Compile EngineMujoco's model with these parameters and the options known to Warp."""
        bend, twist, mass, end_mass, friction = (
            float(np.asarray(value))
            for value in (
                params.bend_stiffness,
                params.twist_stiffness,
                params.mass,
                params.endpoint_mass,
                params.friction,
            )
        )
        second_moment = np.pi * cable.radius**4 / 4
        xml = rod_model(cable, self.segment_count, self.dt, GRAVITY, held=False)
        for word, unit, value in (("young", 1.0, bend), ("shear", 0.5, twist)):
            placeholder = f'{word}="{unit / second_moment:.17g}"'
            xml = xml.replace(placeholder, f'{word}="{value * unit / second_moment:.17g}"')
        model = mujoco.MjModel.from_xml_string(xml)
        count = self.segment_count
        model.body_mass[2 : 2 + count] = mass / count
        model.body_mass[1 + count] = 0.5 * mass / count + end_mass
        model.body_inertia[2 + count :] = 0.5 * mass / count * cable.radius**2
        model.dof_damping[:] = 0.0
        model.tendon_damping[:] = 0.0
        model.flex_friction[:] = (friction, 0.0, 0.0)
        if not self.table:
            model.geom_pos[:, 2] = -DEPTH
        # Warp's version knows neither this flag nor Newton's method for a rod on a hand.
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        model.opt.solver = mujoco.mjtSolver.mjSOL_CG
        model.opt.tolerance = TOLERANCE
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def advance(self, times: NDArray, grips: NDArray, rotations: NDArray) -> None:
        for step in range(len(times)):
            pose = _hand(grips[step], rotations[step])
            speed = (pose - self.driven) / self.dt
            acceleration = (speed - self.speed) / self.dt
            self.driven, self.speed = pose, speed
            control = pose + 2.0 * speed / SERVO_OMEGA + acceleration / SERVO_OMEGA**2
            self.data.ctrl.numpy()[:] = control
            self.step(self.model, self.data)

    def endpoints(self) -> NDArray[np.float64]:
        last = slice(self.slides.stop - 3, self.slides.stop)
        return self.data.qpos.numpy()[:, last].astype(float) + self.rest[-1]


def _hand(grips: NDArray, rotations: NDArray) -> NDArray[np.float64]:
    """Return the hand's joints: x, y, z [m], yaw and pitch [rad], shape [world, 5]."""
    along = rotations[..., 2]
    yaw = np.arctan2(along[..., 0], along[..., 1])
    pitch = np.arcsin(np.clip(along[..., 2], -1.0, 1.0))
    return np.concatenate([grips, yaw[..., None], pitch[..., None]], axis=-1)
