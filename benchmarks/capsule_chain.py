"""A cable as others model one: a chain of capsules on ball joints in MuJoCo, with its fluid model.

Beside the engine that learns it has another bending law, contact with elliptic cones at two ends of
each capsule, damping in the joints, and MuJoCo's drag of ellipsoids; twist is as stiff as bending.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable
from cablecast.engines.base import CableState
from cablecast.motion.grip_path import GripPath

AIR_DENSITY, AIR_VISCOSITY = 1.2, 1.8e-5
DAMPING_TIME = 0.01
"""Damping of a joint over its stiffness [s]."""

REST_SPEED = 0.02
"""Largest speed of a joint at which the chain rests [m/s, rad/s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ChainTrack:
    """Path of the free end.

    Attributes:
        times: Times [s], shape [step].
        endpoint_xy: Positions [m], shape [1, step, 2].
    """

    times: NDArray[np.float64]
    endpoint_xy: NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class CapsuleChain:
    """Simulator of one cable.

    Attributes:
        segment_count: Number of capsules.
        dt: Step [s].
    """

    segment_count: int = 24
    dt: float = 0.001

    def rollout(
        self,
        cable: Cable,
        path: GripPath,
        state: CableState,
        *,
        duration: float,
        sample_dt: float,
    ) -> ChainTrack:
        """Simulate one motion; every capsule starts where the state has its segment."""
        import mujoco

        model = mujoco.MjModel.from_xml_string(self._model(cable))
        data = mujoco.MjData(model)
        steps = np.diff(state.positions[0], axis=0)
        yaw, pitch = _angles(steps)
        poses = path.evaluate(np.arange(0.0, duration + self.dt, self.dt))[0]
        quats = _quats(poses[:, 3], poses[:, 4])
        data.qpos[:3], data.qpos[3:7] = state.positions[0, 0], _quats(yaw[:1], pitch[:1])[0]
        before = data.qpos[3:7].copy()
        for joint, quat in enumerate(_quats(yaw, pitch)[1:], start=1):
            inverse, turn = np.empty(4), np.empty(4)
            mujoco.mju_negQuat(inverse, before)
            mujoco.mju_mulQuat(turn, inverse, quat)
            data.qpos[4 * joint + 3 : 4 * joint + 7] = turn
            before = quat
        every = round(sample_dt / self.dt)
        moving = float(path.duration[0]) / self.dt
        samples = []
        for step, pose in enumerate(poses):
            data.mocap_pos[0], data.mocap_quat[0] = pose[:3], quats[step]
            if step % every == 0:
                mujoco.mj_kinematics(model, data)
                samples.append(data.site_xpos[0, :2].copy())
                if step > moving and np.abs(data.qvel).max() < REST_SPEED:
                    break
            mujoco.mj_step(model, data)
        times = self.dt * every * np.arange(len(samples))
        return ChainTrack(times=times, endpoint_xy=np.array(samples)[None])

    def _model(self, cable: Cable) -> str:
        """Return the model; a capsule lies along y of its own frame."""
        params, count = cable.params, self.segment_count
        length, radius = cable.length / count, 0.5 * cable.diameter
        stiffness = float(params.bend_stiffness) / length
        friction = float(params.lateral_friction) * float(params.worksurface_friction)
        mass = float(params.mass) / count
        joint = (
            f'<joint type="ball" stiffness="{stiffness}" damping="{stiffness * DAMPING_TIME}"'
            f' armature="{mass * radius**2}"/>'
        )
        geom = (
            f'<geom type="capsule" size="{radius}" fromto="0 0 0 0 {length} 0" mass="{mass}"'
            f' friction="{friction} {float(params.spinning_friction)}'
            f' {float(params.rolling_friction)}" fluidshape="ellipsoid"/>'
        )
        tip = (
            f'<site name="tip" pos="0 {length} 0"/><body pos="0 {length} 0"><geom type="sphere"'
            f' size="{1.1 * radius}" mass="{float(params.endpoint_mass)}" friction="{friction}"/>'
            "</body>"
        )
        body = tip
        for _ in range(count - 1):
            body = f'<body pos="0 {length} 0">{joint}{geom}{body}</body>'
        return f"""<mujoco>
          <option timestep="{self.dt}" integrator="implicitfast" cone="elliptic" impratio="5"
            density="{AIR_DENSITY}" viscosity="{AIR_VISCOSITY}"/>
          <default><geom condim="6" solref="0.004 1" contype="1" conaffinity="2"/></default>
          <worldbody>
            <geom type="plane" size="5 5 1" contype="2" conaffinity="1" pos="0 0 0"
              friction="{friction} {float(params.spinning_friction)}
              {float(params.rolling_friction)}"/>
            <body name="hand" mocap="true"/>
            <body name="grip"><freejoint/>{geom}{body}</body>
          </worldbody>
          <equality><weld body1="hand" body2="grip" relpose="0 0 0 1 0 0 0" solref="0.002 1"
            solimp="0.99 0.999 0.001"/></equality>
        </mujoco>"""


def _angles(steps: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return yaw and pitch of directions, as a grip path has them, shape [segment]."""
    level = np.hypot(steps[:, 0], steps[:, 1])
    return np.arctan2(steps[:, 0], steps[:, 1]), np.arctan2(steps[:, 2], level)


def _quats(yaw: NDArray[np.float64], pitch: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quaternions (w first) that turn y into directions, shape [pose, 4]."""
    half, tilt = -0.5 * yaw, 0.5 * pitch
    return np.stack(
        [
            np.cos(half) * np.cos(tilt),
            np.cos(half) * np.sin(tilt),
            np.sin(half) * np.sin(tilt),
            np.sin(half) * np.cos(tilt),
        ],
        axis=1,
    )
