"""EnginePybullet: the paper's simulator, a string of capsules with springs between them at 1/480 s.

The paper joins capsules by Bullet's 6-DOF spring constraints, which its Python API does not offer.
The nearest is one articulated body: capsules on spherical joints, so that lengths are exact, with
spring torques that we compute and apply before each step. The hand is five driven joints.

Mapping of the ten parameters, and differences from `EngineWarp`:

- bend_stiffness, twist_stiffness: torques EI phi / l and GJ tau / l at each joint, twice that at
  the grip, explicit in time. A joint stiffer than the step can take is softened to m l^2 / (24
  dt^2); a segment too light for its twist gets a larger moment of inertia about its axis.
- mass, endpoint_mass: uniform capsules, and a point at the end of the last one.
- lateral_friction, worksurface_friction: Bullet's own; it multiplies them, as we do. A capsule
  touches the table at two points, and friction is a pyramid, regularised by Bullet's solver.
- spinning_friction, rolling_friction: Bullet multiplies them by the other body's lateral friction,
  which we divide out. They act on a capsule as a whole.
- linear_damping, angular_damping: Bullet's own for articulated bodies, c (1 + |v|) v per mass and
  c (1 + |w|) w per moment of inertia, scaled to be right at 1 m/s and at 10 rad/s: too weak for a
  slower motion, too strong for a faster one.

At 1/480 s about one in fifteen random casts of `cable_1` gains energy where the cable whips, and
leaves the table or sinks into it by more than 5 mm. More damping in the joints makes that worse.
"""

import dataclasses
import functools
import math
import os
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import PARAMS, Cable, CableParams
from cablecast.conventions import tangent
from cablecast.engines.base import GRAVITY, CableState, Rollout, one_cable, plan_rollout
from cablecast.errors import MissingExtraError, check_count, check_number
from cablecast.motion.grip_path import GripPath
from cablecast.workspace import Workspace


def load_pybullet() -> Any:
    """Return the module, and swallow the build time that it prints on standard error."""
    if (library := sys.modules.get("pybullet")) is not None:
        return library
    sys.stderr.flush()
    saved, silent = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(silent, 2)
        import pybullet
    except ModuleNotFoundError:
        raise MissingExtraError("pybullet", "pybullet", "EnginePybullet") from None
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(silent)
    return pybullet


class BulletClient:
    """PyBullet's functions with a client of our own: its default one belongs to the user."""

    def __init__(self):
        self._library = load_pybullet()
        self._id = self._library.connect(self._library.DIRECT)

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._library, name)
        if callable(value):
            value = functools.partial(value, physicsClientId=self._id)
        setattr(self, name, value)
        return value


_HAND_DOF_COUNT = 5
# A hand not much heavier than the cable keeps Bullet's iterative solver well conditioned.
_HAND_MASS = 1.0
_HAND_INERTIA = 1e-2
_HAND_FORCE = 1e5
_BROKEN_DISTANCE = 50.0
"""Distance of a node from the base [m] beyond which its world has blown up."""
_REST_TIME, _REST_DISTANCE = 0.1, 1e-4
"""A cable rests when no node moves farther [m] in this time [s] after the end of all motions."""
_FOLDED = 0.3
"""Bound of 1 + cos(phi); below it a joint counts as folded, and its twist acts no more strongly."""
_LINEAR_SPEED = 1.0
_ANGULAR_SPEED = 10.0
"""Speeds at which Bullet's damping, linear plus quadratic, is made equal to ours [m/s, rad/s]."""
_SPEED_MAX = 2e3
_AXIS = np.array([0.0, 1.0, 0.0])
"""Direction of a segment in its own frame."""


class BulletWorld:
    """One cable on one table.

    Args:
        cable: Geometry.
        params: Parameters of this world.
        path: Path of the gripper, one row.
        far_path: Path of the far end, one row; free if None.
        segment_count: Number of capsules.
        dt: Step [s].
        gravity: Acceleration of free fall [m/s²].
    """

    def __init__(
        self,
        cable: Cable,
        params: CableParams,
        path: GripPath,
        far_path: GripPath | None,
        *,
        segment_count: int,
        dt: float,
        gravity: float,
    ):
        self.dt = dt
        self.count = segment_count
        self.length = cable.length / segment_count
        self.path = path
        self.far_path = far_path
        self.client = BulletClient()
        self.client.setPhysicsEngineParameter(
            fixedTimeStep=dt, numSubSteps=0, deterministicOverlappingPairs=1
        )
        self.client.setGravity(0.0, 0.0, -gravity)
        self.hand = list(range(_HAND_DOF_COUNT))
        self.links = list(range(_HAND_DOF_COUNT, _HAND_DOF_COUNT + self.count))
        self.body = self._build(cable, float(params.mass), float(params.endpoint_mass))
        self._set_params(cable, params)
        self.hold = None

    def _build(self, cable: Cable, mass: float, endpoint_mass: float) -> int:
        client, count, length = self.client, self.count, self.length
        capsule = client.createCollisionShape(
            client.GEOM_CAPSULE,
            radius=cable.radius,
            height=length,
            collisionFramePosition=[0.0, length / 2, 0.0],
            # Bullet's capsules lie along z; turn them into the y of the segment.
            collisionFrameOrientation=[math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)],
        )
        no_turn = [0.0, 0.0, 0.0, 1.0]
        prismatic, revolute = client.JOINT_PRISMATIC, client.JOINT_REVOLUTE
        has_weight = endpoint_mass > 0
        weights = int(has_weight)
        total = _HAND_DOF_COUNT + count + weights
        positions = [[0.0, 0.0, 0.0]] * (_HAND_DOF_COUNT + 1)
        positions += [[0.0, length, 0.0]] * (count - 1 + weights)
        return client.createMultiBody(
            baseMass=0.0,
            baseCollisionShapeIndex=-1,
            linkMasses=[_HAND_MASS] * _HAND_DOF_COUNT
            + [mass / count] * count
            + [endpoint_mass] * weights,
            linkCollisionShapeIndices=[-1] * _HAND_DOF_COUNT + [capsule] * count + [-1] * weights,
            linkVisualShapeIndices=[-1] * total,
            linkPositions=positions,
            linkOrientations=[no_turn] * total,
            linkInertialFramePositions=[[0.0, 0.0, 0.0]] * _HAND_DOF_COUNT
            + [[0.0, length / 2, 0.0]] * count
            + [[0.0, 0.0, 0.0]] * weights,
            linkInertialFrameOrientations=[no_turn] * total,
            linkParentIndices=list(range(total)),
            linkJointTypes=[prismatic] * 3
            + [revolute] * 2
            + [client.JOINT_SPHERICAL] * count
            + [client.JOINT_FIXED] * weights,
            linkJointAxis=[[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1], [1, 0, 0]]
            + [[0, 1, 0]] * (count + weights),
        )

    def _set_params(self, cable: Cable, params: CableParams) -> None:
        client, dt, length = self.client, self.dt, self.length
        segment_mass = float(params.mass) / self.count
        bend = float(params.bend_stiffness) / length
        self.bend = np.full(self.count, min(bend, segment_mass * length**2 / (24.0 * dt**2)))
        self.twist = np.full(self.count, float(params.twist_stiffness) / length)
        across = segment_mass * length**2 / 12.0
        along = max(0.5 * segment_mass * cable.radius**2, 2.0 * self.twist[0] * dt**2)
        # Half a cell lies between the clamp and the middle of the first segment.
        self.bend[0] *= 2.0
        self.twist[0] *= 2.0
        client.changeDynamics(
            self.body,
            -1,
            linearDamping=float(params.linear_damping) / (1.0 + _LINEAR_SPEED),
            angularDamping=float(params.angular_damping) / (1.0 + _ANGULAR_SPEED),
            maxJointVelocity=_SPEED_MAX,
        )
        for link in range(client.getNumJoints(self.body)):
            inertia = [_HAND_INERTIA] * 3 if link in self.hand else [across, along, across]
            if link > self.links[-1]:
                inertia = [1e-9] * 3
            client.changeDynamics(
                self.body,
                link,
                localInertiaDiagonal=inertia,
                maxJointVelocity=_SPEED_MAX,
                jointDamping=0.0,
            )
        surface = float(params.worksurface_friction)
        plane = client.createCollisionShape(client.GEOM_PLANE)
        table = client.createMultiBody(baseMass=0.0, baseCollisionShapeIndex=plane)
        client.changeDynamics(
            table, -1, lateralFriction=surface, spinningFriction=0.0, rollingFriction=0.0
        )
        share = 1.0 / surface if surface > 0 else 0.0
        for link in self.links:
            client.changeDynamics(
                self.body,
                link,
                lateralFriction=float(params.lateral_friction),
                spinningFriction=share * float(params.spinning_friction),
                rollingFriction=share * float(params.rolling_friction),
                restitution=0.0,
            )
        # Bullet starts every joint with a motor that brakes it.
        client.setJointMotorControlMultiDofArray(
            self.body,
            self.links,
            client.POSITION_CONTROL,
            targetPositions=[[0.0, 0.0, 0.0, 1.0]] * self.count,
            positionGains=[0.0] * self.count,
            velocityGains=[0.0] * self.count,
            forces=[[0.0, 0.0, 0.0]] * self.count,
        )

    def start(self, state: dict[str, NDArray[np.float64]]) -> None:
        """Put the cable into the state of one world; motion that stretches a segment is lost."""
        client = self.client
        pose = self.path.evaluate(np.zeros(1))[0, 0]
        speed = self.path.evaluate(np.zeros(1), 1)[0, 0]
        for joint in self.hand:
            client.resetJointState(self.body, joint, pose[joint], speed[joint])
        frames = _frames(state["positions"], pose, state["roll"])
        relative = np.einsum("nji,njk->nik", frames[:-1], frames[1:])
        direction = frames[1:, :, 1]
        difference = np.diff(state["velocities"], axis=0)
        spin = np.cross(direction, difference) / self.length
        spin += state["roll_rate"][:, None] * direction
        hand_spin = -speed[3] * np.array([0.0, 0.0, 1.0]) + speed[4] * frames[0, :, 0]
        change = np.diff(np.concatenate([hand_spin[None], spin]), axis=0)
        rate = np.einsum("nji,nj->ni", frames[1:], change)
        for index, link in enumerate(self.links):
            client.resetJointStateMultiDof(
                self.body, link, _quaternion(relative[index]).tolist(), rate[index].tolist()
            )
        if self.far_path is not None:
            far = self.far_path.evaluate(np.zeros(1))[0, 0, :3]
            tip = [0.0, self.length / 2, 0.0]
            self.hold = client.createConstraint(
                self.body, self.links[-1], -1, -1, client.JOINT_POINT2POINT, [0, 0, 0], tip, far
            )

    def run(self, nodes: NDArray[np.float64], steps_per_sample: int) -> bool:
        """Simulate, and return True if the cable stayed finite.

        Nodes are filled with its shapes at the sample times [m], shape [step, node, 3].
        """
        nodes[0] = self._kinematics()[0]
        paths = [self.path] if self.far_path is None else [self.path, self.far_path]
        motion_end = max(float(path.duration.max()) for path in paths)
        back = math.ceil(_REST_TIME / (steps_per_sample * self.dt))
        for sample in range(1, len(nodes)):
            steps = np.arange((sample - 1) * steps_per_sample, sample * steps_per_sample) + 1
            poses = self.path.evaluate(steps * self.dt)[0]
            far = None
            if self.far_path is not None:
                far = self.far_path.evaluate(steps * self.dt)[0, :, :3]
            for k in range(steps_per_sample):
                if far is not None:
                    self.client.changeConstraint(self.hold, far[k].tolist(), maxForce=_HAND_FORCE)
                if not self._step(poses[k]):
                    return False
            now = self._kinematics()[0]
            if not np.abs(now).max() < _BROKEN_DISTANCE:
                return False
            nodes[sample] = now
            is_over = (sample - back) * steps_per_sample * self.dt > motion_end
            if is_over and np.abs(now - nodes[sample - back]).max() < _REST_DISTANCE:
                nodes[sample + 1 :] = now
                return True
        return True

    def _step(self, pose: NDArray[np.float64]) -> bool:
        """Make one step that drives the hand to a pose; return False if the springs broke."""
        client = self.client
        now = [state[0] for state in client.getJointStates(self.body, self.hand)]
        client.setJointMotorControlArray(
            self.body,
            self.hand,
            client.VELOCITY_CONTROL,
            targetVelocities=((pose - now) / self.dt).tolist(),
            forces=[_HAND_FORCE] * _HAND_DOF_COUNT,
        )
        states = client.getJointStatesMultiDof(self.body, self.links)
        torque = self._torques(np.array([state[0] for state in states]))
        if not np.isfinite(torque).all():
            return False
        client.setJointMotorControlMultiDofArray(
            self.body, self.links, client.TORQUE_CONTROL, forces=torque.tolist()
        )
        client.stepSimulation()
        return True

    def _torques(self, quat_xyzw: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the spring torques in the segments' own frames [N·m], shape [segment, 3].

        Bending turns the segment's direction towards that of the segment before with EI phi / l;
        twist, the rotation about the direction, gives GJ tau / l.
        """
        x, y, z, w = quat_xyzw.T
        # The direction of the segment before, seen from this one, crossed with our own.
        before = np.stack(
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=1
        )
        cosine, cross_x, cross_z = before[:, 1], before[:, 2], -before[:, 0]
        sine = np.hypot(cross_x, cross_z)
        moment = self.bend * np.arctan2(sine, cosine) / np.maximum(sine, 1e-12)
        tau = 2.0 * np.arctan2(y, w)
        tau -= 2.0 * np.pi * np.round(tau / (2.0 * np.pi))
        torque = np.stack([moment * cross_x, 0.0 * x, moment * cross_z], axis=1)
        # The gradient of the twist with respect to a turn of this segment.
        mean = (before + _AXIS) / np.maximum(1.0 + cosine, _FOLDED)[:, None]
        return torque - (self.twist * tau)[:, None] * mean

    def _kinematics(self):
        """Return nodes [m], velocities [m/s], segments' frames, and their rates [rad/s]."""
        links = self.client.getLinkStates(
            self.body, self.links, computeLinkVelocity=1, computeForwardKinematics=1
        )
        nodes = np.empty((self.count + 1, 3))
        nodes[:-1] = [link[4] for link in links]
        frames = _matrices(np.array([link[5] for link in links]))
        arms = self.length * frames[:, :, 1]
        nodes[-1] = nodes[-2] + arms[-1]
        spin = np.array([link[7] for link in links])
        velocities = np.empty_like(nodes)
        centre = np.array([link[6] for link in links])
        velocities[:-1] = centre - np.cross(spin, arms / 2)
        velocities[-1] = centre[-1] + np.cross(spin[-1], arms[-1] / 2)
        return nodes, velocities, frames, spin

    def state(self) -> dict[str, NDArray[np.float64]]:
        """Return the present state in the fields of `CableState`."""
        nodes, velocities, frames, spin = self._kinematics()
        pose = np.array([s[0] for s in self.client.getJointStates(self.body, self.hand)])
        plain = _frames(nodes, pose, np.zeros(self.count))[1:]
        # Angle of each segment from the frame carried along the cable without twist.
        x = np.einsum("ni,ni->n", frames[:, :, 0], plain[:, :, 0])
        z = np.einsum("ni,ni->n", frames[:, :, 0], plain[:, :, 2])
        roll = np.unwrap(np.arctan2(-z, x))
        rate = np.einsum("ni,ni->n", spin, frames[:, :, 1])
        state = {"positions": nodes, "velocities": velocities, "roll": roll, "roll_rate": rate}
        return state | {"far_roll": np.zeros(())}

    def close(self) -> None:
        """Free the memory of this world."""
        self.client.disconnect()


def _frames(
    nodes: NDArray[np.float64], pose: NDArray[np.float64], roll: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return rotations of the hand and of each segment, whose second column is its direction.

    The frame of the hand is carried along the cable without twist, then turned by the roll.

    Returns:
        Shape [segment + 1, 3, 3].
    """
    yaw, pitch = pose[3], pose[4]
    side = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    before = np.asarray(tangent(yaw, pitch))
    up = np.cross(side, before)
    frames = [np.stack([side, before, up], axis=1)]
    for index, step in enumerate(np.diff(nodes, axis=0)):
        direction = step / np.linalg.norm(step)
        # The smallest rotation from one direction to the next.
        axis = np.cross(before, direction)
        cosine = float(before @ direction)
        side = side + np.cross(axis, side) + np.cross(axis, np.cross(axis, side)) / (1.0 + cosine)
        side -= direction * (side @ direction)
        side /= np.linalg.norm(side)
        up = np.cross(side, direction)
        c, s = np.cos(roll[index]), np.sin(roll[index])
        frames.append(np.stack([c * side - s * up, direction, s * side + c * up], axis=1))
        before = direction
    return np.array(frames)


def _quaternion(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a rotation as the quaternion (x, y, z, w)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(matrix).as_quat()


def _matrices(quat_xyzw: NDArray[np.float64]) -> NDArray[np.float64]:
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(quat_xyzw).as_matrix()


DEFAULT_SEGMENT_COUNT = 18
DEFAULT_DT = 1.0 / 480.0


class EnginePybullet:
    """Bullet's articulated body: one world after the other, on one core, until it rests.

    More than nine tenths of the time is Bullet's own step of one articulated body, so several
    bodies in one client are no faster. `engines.spread` takes every core.

    Args:
        segment_count: Number of capsules, at least 2.
        dt: Step [s]; the paper's is 1/480 s.
        gravity: Acceleration of free fall [m/s²].

    Raises:
        InputError: A count or step out of bounds.
        MissingExtraError: PyBullet is not installed.
    """

    uses_one_core = True

    def __init__(
        self,
        segment_count: int = DEFAULT_SEGMENT_COUNT,
        dt: float = DEFAULT_DT,
        gravity: float = GRAVITY,
    ):
        # Bullet packs the links of one body into messages of a fixed size.
        segment_count = check_count("segment_count", segment_count, 2, 100)
        dt = check_number("dt", dt, 1e-6, 1e-2, "s")
        load_pybullet()
        self.segment_count = segment_count
        self.dt = dt
        self.gravity = gravity

    def spec(self) -> tuple[type, dict[str, Any]]:
        """Return the class and the arguments that make this engine anew in another process."""
        return type(self), dict(vars(self))

    def rollout(
        self,
        cable: Cable | Sequence[Cable],
        grip_path: GripPath,
        initial_state: CableState | None = None,
        duration: float | None = None,
        sample_dt: float = 0.1,
        *,
        far_path: GripPath | None = None,
        edges: Workspace | None = None,
        record_nodes: bool = False,
    ) -> Rollout:
        """Simulate a batch; see `Engine.rollout`."""
        cable = one_cable(cable)
        plan = plan_rollout(self, cable, grip_path, initial_state, duration, sample_dt, far_path)
        values = np.broadcast_to(cable.params.to_array(), (plan.world_count, len(PARAMS)))
        nodes = np.full((plan.world_count, plan.sample_count, self.segment_count + 1, 3), np.nan)
        final = CableState.at_rest(np.full((plan.world_count, self.segment_count + 1, 3), np.nan))
        finite = np.zeros(plan.world_count, dtype=bool)
        for index in range(plan.world_count):
            state = _row(plan.initial_state, index)
            nodes[index, 0] = state["positions"]
            for field in dataclasses.fields(CableState):
                getattr(final, field.name)[index] = np.nan
            if not all(np.isfinite(value).all() for value in state.values()):
                nodes[index, 0] = np.nan
                continue
            path = grip_path[min(index, len(grip_path) - 1)]
            far = None if far_path is None else far_path[min(index, len(far_path) - 1)]
            row = CableParams.from_array(values[index])
            world = BulletWorld(
                cable,
                row,
                path,
                far,
                segment_count=self.segment_count,
                dt=self.dt,
                gravity=self.gravity,
            )
            try:
                world.start(state)
                finite[index] = world.run(nodes[index], plan.steps_per_sample)
                if finite[index]:
                    for name, value in world.state().items():
                        getattr(final, name)[index] = value
            finally:
                world.close()
        return Rollout(
            times=np.arange(plan.sample_count, dtype=float) * (plan.steps_per_sample * self.dt),
            endpoint_xyz=nodes[:, :, -1].copy(),
            final_state=final,
            finite=finite,
            nodes=nodes if record_nodes else None,
        )


def _row(state: CableState, index: int) -> dict[str, NDArray[np.float64]]:
    index = min(index, state.world_count - 1)
    return {f.name: getattr(state, f.name)[index] for f in dataclasses.fields(CableState)}
