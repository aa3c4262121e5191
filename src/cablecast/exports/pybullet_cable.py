"""Code of the script that loads an exported cable into PyBullet, on its own."""

import math
import pathlib
from typing import Any

import numpy as np

VALUES: dict[str, Any] = {}


class Cable:
    """The cable of a URDF file in PyBullet: load it, then `place` and `step`.

    Bullet has no springs between the links of one body, so that `step` computes the moments of
    bending and twist, and applies them as torques.

    Args:
        client: pybullet_utils.bullet_client.BulletClient, or the module pybullet itself.
        urdf: File; the one next to this script by default.
    """

    def __init__(self, client: Any, urdf: pathlib.Path | str | None = None):
        self.client, v = client, VALUES
        self.dt: float = v["dt"]
        client.setPhysicsEngineParameter(fixedTimeStep=self.dt, numSubSteps=0)
        client.setGravity(0.0, 0.0, -v["gravity"])
        self.body = client.loadURDF(
            str(urdf or pathlib.Path(__file__).with_name(v["urdf"])),
            useFixedBase=True,
            flags=client.URDF_USE_INERTIA_FROM_FILE,
        )
        names = {
            client.getJointInfo(self.body, joint)[1].decode(): joint
            for joint in range(client.getNumJoints(self.body))
        }
        self.grip = [names[f"grip_{axis}"] for axis in ("x", "y", "z", "yaw", "pitch")]
        self.joints = [names[f"joint_{index}"] for index in range(len(v["bend"]))]
        self.bend, self.twist = np.array(v["bend"]), np.array(v["twist"])
        self.rest = np.array(v["rest"])[:, None] * [0.0, 1.0]
        self.bends = np.zeros_like(self.rest)
        # Bullet's dampings are c (1 + |v|) v: they are right at 1 m/s and at 10 rad/s.
        client.changeDynamics(
            self.body,
            -1,
            linearDamping=v["linear_damping"] / 2.0,
            angularDamping=v["angular_damping"] / 11.0,
            maxJointVelocity=2e3,
        )
        for joint, friction in zip(self.joints, v["friction"], strict=True):
            # Bullet multiplies each by the lateral friction of the table, which is to be 1.
            client.changeDynamics(
                self.body,
                joint,
                lateralFriction=friction,
                anisotropicFriction=[1.0, v["friction_ratio"], 1.0],
                spinningFriction=v["spinning_friction"],
                rollingFriction=v["rolling_friction"],
                restitution=0.0,
                jointDamping=0.0,
                maxJointVelocity=2e3,
            )
        # Bullet starts every joint with a motor that brakes it.
        client.setJointMotorControlMultiDofArray(
            self.body,
            self.joints,
            client.POSITION_CONTROL,
            targetPositions=[[0.0, 0.0, 0.0, 1.0]] * len(self.joints),
            positionGains=[0.0] * len(self.joints),
            velocityGains=[0.0] * len(self.joints),
            forces=[[0.0, 0.0, 0.0]] * len(self.joints),
        )

    def add_table(self) -> int:
        """Add a level table at z = 0 whose friction is in the cable's, and return its body."""
        shape = self.client.createCollisionShape(self.client.GEOM_PLANE)
        table = self.client.createMultiBody(baseMass=0.0, baseCollisionShapeIndex=shape)
        self.client.changeDynamics(
            table, -1, lateralFriction=1.0, spinningFriction=0.0, rollingFriction=0.0
        )
        return table

    def place(self, grip: Any, turns: Any) -> None:
        """Put the cable down at rest.

        Args:
            grip: x, y, z [m], yaw from the y axis to the right, and pitch [rad] of the grip.
            turns: Rotation of each segment against that before it, as quaternions x, y, z, w.
        """
        for joint, value in zip(self.grip, grip, strict=True):
            self.client.resetJointState(self.body, joint, value, 0.0)
        for joint, turn in zip(self.joints, turns, strict=True):
            self.client.resetJointStateMultiDof(self.body, joint, list(turn), [0.0, 0.0, 0.0])
        self.bends = self._bends(np.array(turns, dtype=float))[0]

    def step(self, grip: Any) -> None:
        """Move the grip to a pose, x, y, z, yaw and pitch, within one step."""
        client = self.client
        now = [state[0] for state in client.getJointStates(self.body, self.grip)]
        client.setJointMotorControlArray(
            self.body,
            self.grip,
            client.VELOCITY_CONTROL,
            targetVelocities=[(a - b) / self.dt for a, b in zip(grip, now, strict=True)],
            forces=[1e5] * len(self.grip),
        )
        states = client.getJointStatesMultiDof(self.body, self.joints)
        torques = self._torques(np.array([state[0] for state in states]))
        client.setJointMotorControlMultiDofArray(
            self.body, self.joints, client.TORQUE_CONTROL, forces=torques.tolist()
        )
        client.stepSimulation()

    def end(self) -> np.ndarray:
        """Return the cable's free end [m]."""
        index = VALUES["segment_count"] - 1
        state = self.client.getLinkState(
            self.body, self.joints[index], computeForwardKinematics=True
        )
        matrix = np.reshape(self.client.getMatrixFromQuaternion(state[5]), (3, 3))
        return np.array(state[4]) + VALUES["segment_length"] * matrix[:, 1]

    def _bends(self, quats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return bends about x and z [rad], and directions of the segments before."""
        x, y, z, w = quats.T
        before = np.stack(
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=1
        )
        sine = np.hypot(before[:, 0], before[:, 2])
        share = np.arctan2(sine, before[:, 1]) / np.maximum(sine, 1e-12)
        return share[:, None] * np.stack([-before[:, 2], before[:, 0]], axis=1), before

    def _torques(self, quats: np.ndarray) -> np.ndarray:
        """Return the moments on the segments in their own frames [N m], y along each."""
        v = VALUES
        bends, before = self._bends(quats)
        elastic = bends - self.rest
        if v["yield_angle"]:
            # Beyond the yield curvature a bend goes over into the cable's shape.
            size = np.linalg.norm(elastic, axis=1, keepdims=True)
            excess = np.maximum(size - np.array(v["yield_angle"])[:, None], 0.0)
            share = 1.0 - math.exp(-self.dt / v["yield_time"]) if v["yield_time"] else 1.0
            self.rest = self.rest + share * excess * elastic / np.maximum(size, 1e-12)
            elastic = bends - self.rest
        rate = (bends - self.bends) / self.dt
        self.bends = bends
        moment = -self.bend[:, None] * (elastic + v["damping_time"] * rate)
        tau = 2.0 * np.arctan2(quats[:, 1], quats[:, 3])
        tau -= 2.0 * np.pi * np.round(tau / (2.0 * np.pi))
        torques = np.stack([moment[:, 0], 0.0 * tau, moment[:, 1]], axis=1)
        # The gradient of the twist with respect to a turn of the segment; a fold is cut off.
        mean = (before + [0.0, 1.0, 0.0]) / np.maximum(1.0 + before[:, 1], 0.3)[:, None]
        return torques - (self.twist * tau)[:, None] * mean
