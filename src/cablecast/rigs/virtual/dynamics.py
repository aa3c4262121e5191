"""The arm as rigid bodies on a stand that sways, gears that rub, torques with limits.

Each joint has a position loop with a velocity loop within, as one controller

    torque = kp (q_set - q) + ki integral (q_set - q) dt + kv (share qd_set - qd),

clipped to what the joint has. The gains are set for the arm at one stretch and without its
neighbours, so the response changes with the pose and with what the other joints do. The controller
holds up the arm's weight. MuJoCo computes it all; the pull of the cable, of newtons, is left out.
Encoders sit on the joints, and do not see the stand sway.

Masses, centres and largest torques are the maker's ("DH parameters for calculations of kinematics
and dynamics", "Max. joint torques"); links are cylinders as in his ROS description
(Universal_Robots_ROS2_Description, physical_parameters.yaml). Rotors weigh what MuJoCo Menagerie's
UR5e gives them.
"""

import math
from typing import Any, TypeGuard

import numpy as np

from cablecast.arm.base import Arm
from cablecast.arm.ur import JOINT_NAMES, LINKS, ArmUR
from cablecast.conventions import Array, tangent
from cablecast.rigs.virtual._hidden import HiddenArm

JOINT_COUNT = len(JOINT_NAMES)
_MASSES = {
    "ur3": (2.0, 3.42, 1.26, 0.8, 0.8, 0.35),
    "ur3e": (1.98, 3.4445, 1.437, 0.871, 0.805, 0.261),
    "ur5": (3.7, 8.393, 2.33, 1.219, 1.219, 0.1879),
    "ur5e": (3.761, 8.058, 2.846, 1.37, 1.3, 0.365),
    "ur10": (7.1, 12.7, 4.27, 2.0, 2.0, 0.365),
    "ur10e": (7.369, 13.051, 3.989, 2.1, 1.98, 0.615),
}
"""Masses of the links [kg]."""
_TORQUES = {"ur3": (56.0, 56.0, 28.0, 12.0), "ur5": (150.0,) * 3 + (28.0,)}
_TORQUES["ur10"] = (330.0, 330.0, 150.0, 56.0)
"""Largest torques of base, shoulder, elbow and each wrist joint [N·m]."""
# Centres of mass of a UR5's links in their DH frames [m]; those of others lie in proportion.
_CENTRES = np.array(
    [
        [0.0, -0.02561, 0.00193],
        [0.2125, 0.0, 0.11336],
        [0.15, 0.0, 0.0265],
        [0.0, -0.0018, 0.01634],
        [0.0, 0.0018, 0.01634],
        [0.0, 0.0, -0.001159],
    ]
)
_RADIUS = 0.06
"""Radius of a UR5's links [m]."""
_WRIST_LENGTH = 0.1
_ROTOR_INERTIA = 0.1
"""Inertia of a rotor as its joint feels it [kg·m²]."""
_TUNED_POSE = np.array([0.0, -1.2, 1.8, -2.1, -math.pi / 2, 0.0])
"""Pose for which the gains are set, the arm half stretched [rad]."""
_DAMPING_RATIO = 0.8
_DT_MAX = 1e-3


class RigidArm:
    """An arm that follows set points, many trials at once.

    Args:
        arm: Geometry of the arm.
        truth: True values of the arm.
        dt: Step [s].
    """

    def __init__(self, arm: ArmUR, truth: HiddenArm, dt: float):
        from mujoco import MjModel  # pyright: ignore[reportAttributeAccessIssue]

        self._arm, self._truth = arm, truth
        # A stand that does not sway has no joints.
        self._first = 3 if all(truth.stand_stiffness) else 0
        self._split = math.ceil(dt / _DT_MAX - 1e-9)
        series = arm.model.removesuffix("e")
        large = _TORQUES[series]
        self._torques = np.array([*large[:3], *[large[3]] * 3])
        self._gears = self._torques / np.array([150.0] * 3 + [28.0] * 3)
        free = MjModel.from_xml_string(self._mjcf(dt / self._split, np.zeros((3, JOINT_COUNT))))
        omega = 2 * math.pi * np.array(truth.bandwidth)
        stiffness = self._inertias(free) * omega**2
        damping = 2 * _DAMPING_RATIO * stiffness / omega
        gains = np.stack([stiffness, truth.integral * stiffness, damping])
        self.model = MjModel.from_xml_string(self._mjcf(dt / self._split, gains))

    @staticmethod
    def knows(arm: Arm) -> TypeGuard[ArmUR]:
        """Return whether the maker's masses of an arm are known here."""
        return isinstance(arm, ArmUR) and arm.model in _MASSES

    def follow(
        self, set_points: Array, set_rates: Array, friction: Array, torque: Array
    ) -> tuple[Array, Array, Array]:
        """Return how the arm moves that starts at rest at its first set points.

        Args:
            set_points: Angles as they reach the servos [rad], shape [row, step + 1, 6].
            set_rates: Their rates [rad/s], same shape.
            friction: Factor of each gear's friction [-], shape [row, 6].
            torque: Factor of the torque of each base joint [-], shape [row].

        Returns:
            Angles [rad] and rates [rad/s] of the joints, and poses of the grip: x, y, z [m], yaw,
            pitch [rad]; shapes [row, step + 1, 6], the same, and [row, step + 1, 5].
        """
        from mujoco.batch import Batch

        count, steps = set_points.shape[0], set_points.shape[1] - 1
        batch: Any = Batch(self.model, count, 1)  # pyright: ignore[reportCallIssue]
        qpos = batch.bind("qpos")
        joints = slice(self._first, self._first + JOINT_COUNT)
        qpos[:, joints] = set_points[:, 0]
        for name in ("dof_frictionloss", "dof_damping"):
            batch.expand(name)[:, joints] *= friction
        if self._truth.torque_share:
            batch.expand("actuator_forcerange")[:, 0] *= torque[:, None]
        share = self._truth.feedforward
        control = np.stack([set_points[:, 1:], share * set_rates[:, 1:]], axis=-1)
        control = np.repeat(control.reshape(count, steps, -1), self._split, axis=1)
        found = batch.rollout(steps * self._split, control=control, record=("qpos", "qvel"))
        paths = []
        for name, start in (("qpos", set_points[:, :1]), ("qvel", 0.0 * set_points[:, :1])):
            values = np.asarray(found[name])[:, self._split - 1 :: self._split]
            paths.append(np.concatenate([start, values[..., joints]], axis=1))
            if name == "qpos":
                sway = np.pad(values[..., :3], ((0, 0), (1, 0), (0, 0)))
        q, qd = paths
        poses = self._arm.grip_pose(q)
        return q, qd, _swayed(poses, sway) if self._first else poses

    def _inertias(self, model: Any) -> Array:
        """Return what each joint alone moves at the pose of the tuning [kg·m²], shape [6]."""
        import mujoco

        data: Any = mujoco.MjData(model)  # pyright: ignore[reportAttributeAccessIssue]
        data.qpos[self._first :] = _TUNED_POSE
        mujoco.mj_forward(model, data)  # pyright: ignore[reportAttributeAccessIssue]
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)  # pyright: ignore[reportAttributeAccessIssue]
        return np.diag(mass)[self._first :].copy()

    def _mjcf(self, dt: float, gains: Array) -> str:
        """Return the arm as XML, with gains kp, ki and kv of its servos, shape [3, 6]."""
        arm, truth, links = self._arm, self._truth, LINKS[self._arm.model]
        ur5 = LINKS["ur5"]
        lengths = np.array([0.0, links.upper_arm, links.forearm, 0.0, 0.0, 0.0])
        scales = [1.0, links.upper_arm / ur5.upper_arm, links.forearm / ur5.forearm, 1, 1, 1]
        alphas = np.array([1, 0, 0, 1, -1, 0]) * math.pi / 2
        heights = (links.d1, 0.0, 0.0, links.d4, links.d5, links.d6)
        masses = truth.inertia_factor * np.array(_MASSES[arm.model])
        radius = _RADIUS * links.girth
        inside = ""
        for joint in reversed(range(JOINT_COUNT)):
            mass, length = masses[joint], lengths[joint] or _WRIST_LENGTH * links.girth
            ahead = np.array([-lengths[joint], 0.0, heights[joint]])
            c, s = math.cos(alphas[joint]), math.sin(alphas[joint])
            x, y, z = _CENTRES[joint] * scales[joint]
            centre = ahead + [x, c * y - s * z, s * y + c * z]
            across = mass * (3 * radius**2 + length**2) / 12
            inertia = [across, across, across]
            # Long links lie along x; wrists are about as long as thick.
            inertia[0] = mass * radius**2 / 2 if lengths[joint] else across
            tool = ""
            if joint == JOINT_COUNT - 1:
                place = np.array([0.0, 0.0, arm.gripper_length / 2])
                tool = f'<body gravcomp="1">{_mass(truth.payload, place)}</body>'
            turned = (
                f'quat="{math.cos(alphas[joint] / 2):.9g} {math.sin(alphas[joint] / 2):.9g} 0 0"'
            )
            gear = self._gears[joint]
            inside = (
                f'<body gravcomp="1">'
                f'<joint name="joint_{joint}" axis="0 0 1" armature="{_ROTOR_INERTIA * gear:.9g}" '
                f'damping="{gear * truth.viscous[joint]:.9g}" '
                f'frictionloss="{gear * truth.coulomb[joint]:.9g}"/>'
                f'<inertial pos="{_text(centre)}" mass="{mass:.9g}" '
                f'diaginertia="{_text(inertia)}"/>'
                f'<body pos="{_text(ahead)}" {turned}>{tool}{inside}</body></body>'
            )
        stand, sway = "", truth.stand_stiffness if self._first else ()
        for axis, stiffness in zip(("1 0 0", "0 1 0", "0 0 1"), sway, strict=False):
            period = math.sqrt(_STAND_INERTIA / stiffness)
            stand += (
                f'<joint axis="{axis}" stiffness="{stiffness:.9g}" '
                f'damping="{2 * truth.stand_damping * stiffness * period:.9g}"/>'
            )
        limits = ""
        servos = []
        for joint, (kp, ki, kv) in enumerate(gains.T):
            if truth.torque_share:
                largest = truth.torque_share * self._torques[joint]
                limits = f'forcerange="{-largest:.9g} {largest:.9g}"'
            servos.append(
                f'<pid joint="joint_{joint}" kp="{kp:.9g}" ki="{ki:.9g}" kv="{kv:.9g}" {limits}/>'
            )
        T = arm.frames(np.zeros(JOINT_COUNT))[0]
        x_axis, y_axis = T[:3, 0], T[:3, 1]
        return f"""<mujoco model="cablecast arm">
<option integrator="implicitfast" timestep="{dt:.9g}"><flag autoreset="disable"/></option>
<compiler autolimits="true"/>
<worldbody><body>{stand}{_mass(_STAND_MASS, np.zeros(3), _STAND_INERTIA / 4)}
<body pos="{_text(T[:3, 3])}" xyaxes="{_text(x_axis)} {_text(y_axis)}">{inside}</body>
</body></worldbody>
<actuator>{"".join(servos)}</actuator>
</mujoco>"""


_STAND_MASS = 20.0
_STAND_INERTIA = 8.0
"""Inertia of stand and folded arm about the foot, for the damping of its sway [kg·m²]."""


def _mass(mass: float, place: Array, inertia: float = 1e-3) -> str:
    return (
        f'<inertial pos="{_text(place)}" mass="{mass:.9g}" diaginertia="{_text([inertia] * 3)}"/>'
    )


def _swayed(poses: Array, sway: Array) -> Array:
    """Return poses of the grip on a stand that turned by small angles about x, y and z [rad]."""
    x, y, z = np.moveaxis(poses[..., :3], -1, 0)
    ahead = tangent(poses[..., 3], poses[..., 4])
    a, b, c = np.moveaxis(sway, -1, 0)
    turned = np.empty_like(poses)
    turned[..., 0] = x + b * z - c * y
    turned[..., 1] = y + c * x - a * z
    turned[..., 2] = z + a * y - b * x
    along = ahead + np.stack(
        [
            b * ahead[..., 2] - c * ahead[..., 1],
            c * ahead[..., 0] - a * ahead[..., 2],
            a * ahead[..., 1] - b * ahead[..., 0],
        ],
        axis=-1,
    )
    # The yaw may have gone round: only its change is taken from the turned direction.
    yaw = np.arctan2(along[..., 0], along[..., 1])
    change = np.angle(np.exp(1j * (yaw - poses[..., 3])))
    turned[..., 3] = poses[..., 3] + change
    turned[..., 4] = np.arcsin(np.clip(along[..., 2], -1.0, 1.0))
    return turned


def _text(values: Any) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)
