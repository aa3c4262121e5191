"""The arm as it really moves: set points that arrive late, and joints that follow them.

An arm whose masses are known is made of rigid bodies (dynamics.py). In every other arm, and in the
twin, each joint is the textbook servo, a second-order system behind a dead time,

    qdd = omega^2 (q_set - q) + 2 zeta omega (share qd_set - qd),

whose acceleration cannot exceed what the motor's torque at its present speed gives the arm at its
present stretch. A motion that stays far from that limit is followed alike in every trial; one close
to it is cut by an amount that changes with the motor's temperature.

`move_arm` follows whole motions, `LiveArm` one set point after another. Only the former knows the
commanded rates and can delay each set point by itself; the servos are the same.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from cablecast.arm.base import Arm
from cablecast.conventions import Array
from cablecast.motion.grip_path import CHANNELS
from cablecast.motion.trajectory import JointPath, Trajectory
from cablecast.rigs.virtual._hidden import HiddenArm, effect_strengths, hidden_arm
from cablecast.rigs.virtual.dynamics import RigidArm
from cablecast.rigs.virtual.trials import Trial
from cablecast.setup import Setup

REPORT_DT = 1 / 125
"""Time between reports of the joints, the control cycle of the arm [s]."""
REST_SPEED = 0.01
"""Joint speed below which the arm rests [rad/s]."""
_SETTLE_TIME = 0.4
"""Time from the end of the command to the last report [s]."""
_HISTORY_TIME = 0.1
"""Time for which set points are kept: longer than any dead time [s]."""
_STILL_ERROR, _STILL_SPEED = 1e-7, 1e-6
"""Distance from its set point [rad], and speed [rad/s], below which a joint is put to rest."""
_CARRIERS = (0, 0, 0, 5, 5)
"""A gripper without joints is carried by the base joint and turned by the last wrist joint."""


def _joints(count: int) -> tuple[int, ...]:
    """Return which of the six servos each joint has: the first and the last three have their own.

    >>> _joints(6), _joints(7)
    ((0, 1, 2, 3, 4, 5), (0, 1, 2, 2, 3, 4, 5))
    """
    return tuple(range(6)) if count == 6 else (*range(3), *(2,) * (count - 6), *range(3, 6))[:count]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArmMotion:
    """Motion of the arm in one trial.

    Attributes:
        poses: Pose of the gripped end: x, y, z [m], yaw, pitch [rad], shape [step + 1, 5].
        joint_path: Joints as the arm reported them; None for a motion without joints.
        q: Joints as they really are [rad], shape [step + 1, joint]; None likewise.
    """

    poses: Array
    joint_path: JointPath | None
    q: Array | None = None


def move_arm(
    trajectories: Sequence[Trajectory],
    trials: Sequence[Trial],
    arm: Arm,
    servos: HiddenArm,
    dt: float,
    step_count: int,
) -> list[ArmMotion]:
    """Return the motions of an arm with its true servos that follows commanded ones.

    Without a joint path, the gripper itself follows its path as the joints would. Steps of dt [s]
    are counted from the start of the motion.
    """
    rigid = RigidArm(arm, servos, dt) if servos.is_rigid_body and RigidArm.knows(arm) else None
    motions: dict[int, ArmMotion] = {}
    for jointed in (True, False):
        rows = [i for i, t in enumerate(trajectories) if (t.joint_path is not None) is jointed]
        if not rows:
            continue
        cases = [(trajectories[i], trials[i]) for i in rows]
        commands = [_command(*case, servos, dt, step_count) for case in cases]
        set_points, set_rates = (np.stack(values) for values in zip(*commands, strict=True))
        joints = _joints(set_points.shape[-1]) if jointed else _CARRIERS
        factors = np.stack([trial.servo_factor(len(joints)) for _, trial in cases])
        if jointed and rigid is not None:
            torques = np.array([trial.torque_factor for _, trial in cases])
            followed = rigid.follow(set_points, set_rates, factors, torques)
        else:
            q, qd = _follow(
                servos,
                joints,
                factors,
                np.stack([set_points[:, 0], np.zeros_like(set_points[:, 0])]),
                (set_points[:, 1:], set_rates[:, 1:]),
                _strength(cases, servos, dt, step_count) if jointed else None,
                dt,
            )
            followed = q, qd, arm.grip_pose(q) if jointed else q
        for row, q, qd, poses in zip(rows, *followed, strict=True):
            # The angle of a pose jumps where the gripper turns through half a turn.
            poses[:, 3] = np.unwrap(poses[:, 3])
            report = _report(q, qd, trajectories[row], trials[row], dt) if jointed else None
            motions[row] = ArmMotion(poses=poses, joint_path=report, q=q if jointed else None)
    return [motions[row] for row in range(len(trajectories))]


def _command(
    trajectory: Trajectory, trial: Trial, servos: HiddenArm, dt: float, step_count: int
) -> tuple[Array, Array]:
    """Return set points and rates as they reach each servo, each of shape [step + 1, channel]."""
    now = np.arange(step_count + 1) * dt
    path = trajectory.joint_path
    if path is None:
        times = np.arange(int(np.ceil(trajectory.duration / REPORT_DT)) + 1) * REPORT_DT
        values, rates = (trajectory.grip_path.evaluate(times, order)[0] for order in (0, 1))
        delays = np.full(len(CHANNELS), servos.delay[0])
    else:
        times, values, rates = path.times, path.q, path.qd
        delays = np.array(servos.delay)[list(_joints(values.shape[1]))]
    # A set point acts when it arrives, and none overtakes another.
    arrival = np.maximum.accumulate(times + trial.latencies(len(times)))
    arrival += 1e-9 * np.arange(len(times))
    set_points = np.empty((len(now), values.shape[1]))
    set_rates = np.empty_like(set_points)
    for channel, delay in enumerate(delays):
        sent = np.interp(now - delay, arrival, times)
        set_points[:, channel] = np.interp(sent, times, values[:, channel])
        set_rates[:, channel] = np.interp(sent, times, rates[:, channel])
        # Before the first set point the arm stands.
        set_rates[(sent <= times[0]) | (sent >= times[-1]), channel] = 0.0
    return set_points, set_rates


def _strength(
    cases: Sequence[tuple[Trajectory, Trial]], servos: HiddenArm, dt: float, step_count: int
) -> Array:
    """Return the acceleration that the standing base joint can give [rad/s²], [row, step]."""
    now = np.arange(step_count) * dt
    strength = np.empty((len(cases), step_count))
    for row, (trajectory, trial) in enumerate(cases):
        poses = trajectory.grip_path.evaluate(now)[0]
        inertia = servos.inertia + servos.stretch_mass * (poses[:, 0] ** 2 + poses[:, 1] ** 2)
        strength[row] = servos.torque * trial.torque_factor / inertia
    return strength


def _follow(
    servos: HiddenArm,
    joints: Sequence[int],
    factor: Array,
    start: Array,
    command: tuple[Array, Array],
    strength: Array | None,
    dt: float,
) -> Array:
    """Return angles [rad] and rates [rad/s] of servos that follow set points.

    Only sums and products of single elements: a row's result does not depend on its neighbours.
    The start has shape [2, row, channel], the command as set points and rates [row, step, channel],
    and the strength of the first joint's motor [rad/s²] shape [row, step]; None is without limits.
    The result is that at the start and after each step, shape [2, row, step + 1, channel].
    """
    pick = list(joints)
    omega = 2 * np.pi * np.array(servos.frequency)[pick] * factor
    stiffness, drag = omega * omega, 2 * np.array(servos.damping_ratio)[pick] * omega
    set_points, set_rates = command
    step_count = set_points.shape[1]
    path = np.empty((*start.shape[:2], step_count + 1, start.shape[2]))
    path[:, :, 0] = start
    q, qd = start
    for step in range(step_count):
        share = servos.feedforward * set_rates[:, step]
        acceleration = stiffness * (set_points[:, step] - q) + drag * (share - qd)
        if strength is not None:
            # The motor gives less the faster it runs, but not in braking.
            limit = strength[:, step]
            rate = qd[:, 0]
            left = limit * np.maximum(1.0 - np.abs(rate) / servos.free_speed, 0.0)
            ahead, back = np.where(rate > 0, left, limit), np.where(rate < 0, left, limit)
            acceleration[:, 0] = np.clip(acceleration[:, 0], -back, ahead)
        qd = qd + dt * acceleration
        q = q + dt * qd
        path[0, :, step + 1], path[1, :, step + 1] = q, qd
    return path


def _report(q: Array, qd: Array, trajectory: Trajectory, trial: Trial, dt: float) -> JointPath:
    """Return the joints as the arm reports them, by its own clock and with noisy encoders."""
    last = min(trajectory.duration + _SETTLE_TIME, (len(q) - 1) * dt)
    times = REPORT_DT * np.arange(int(last / REPORT_DT) + 1, dtype=np.float64)
    now = np.arange(len(q)) * dt
    read, rates = (
        np.stack([np.interp(times, now, values[:, joint]) for joint in range(q.shape[1])], axis=1)
        for values in (q, qd)
    )
    noise = trial.encoder_errors(*read.shape)
    return JointPath(times=times, q=read + noise[0], qd=rates + noise[1])


class LiveArm:
    """Joints that follow one set point after another.

    Args:
        setup: Gives the arm.
        q: Joint angles at rest [rad], shape [joint].
        dt: Step of the servos [s].
    """

    def __init__(self, setup: Setup, q: ArrayLike, dt: float = 1e-3):
        self.arm = setup.arm
        self.dt = dt
        self._servos: HiddenArm = hidden_arm(0, effect_strengths(0, ("arm",)))
        self.q = np.array(q, dtype=float)
        self.qd = np.zeros(self.arm.joint_count)
        self.time = 0.0
        self._factor = np.ones(self.arm.joint_count)
        self._torque_factor = 1.0
        self._times = [-1.0, 0.0]
        self._set_points = [self.q.copy(), self.q.copy()]
        self._yaw = float(self.arm.grip_pose(self.q)[3])

    def prepare(self, trial: Trial) -> None:
        """Let the servos respond as in a trial."""
        self._factor = trial.servo_factor(self.arm.joint_count)
        self._torque_factor = trial.torque_factor

    def command(self, q: ArrayLike) -> None:
        """Give a set point that holds from now on [rad], shape [joint]."""
        q = np.array(q, dtype=float)
        last, before = self._set_points[-1], self._set_points[-2]
        if np.array_equal(q, last) and np.array_equal(last, before):
            # It holds on; the next one is a step from here.
            self._times[-1] = self.time
            return
        self._times.append(self.time)
        self._set_points.append(q)
        while len(self._times) > 3 and self._times[1] < self.time - _HISTORY_TIME:
            del self._times[0], self._set_points[0]

    def freeze(self) -> None:
        """Put on the brakes: the joints stop at once and stay."""
        self.qd[:] = 0.0
        self._times = [self.time - 1.0, self.time]
        self._set_points = [self.q.copy(), self.q.copy()]

    def advance(self, step_count: int) -> Array:
        """Move on, and return x, y, z [m], yaw, pitch [rad] of the grip, shape [step, 5]."""
        if self._is_still():
            self.time += step_count * self.dt
            return np.repeat(self._poses(self.q[None]), step_count, axis=0)
        servos = self._servos
        times, points = np.array(self._times), np.stack(self._set_points)
        now = self.time + self.dt * np.arange(1, step_count + 1)
        set_points = np.empty((1, step_count, self.arm.joint_count))
        set_rates = np.empty_like(set_points)
        joints = _joints(self.arm.joint_count)
        for joint, servo in enumerate(joints):
            late = now - servos.delay[servo]
            set_points[0, :, joint] = np.interp(late, times, points[:, joint])
            segment = np.clip(np.searchsorted(times, late, "right"), 1, len(times) - 1)
            rise = points[segment, joint] - points[segment - 1, joint]
            set_rates[0, :, joint] = rise / np.maximum(times[segment] - times[segment - 1], 1e-4)
            set_rates[0, late >= times[-1], joint] = 0.0
        x, y = self.arm.grip_pose(points[-1])[:2]
        inertia = servos.inertia + servos.stretch_mass * (x * x + y * y)
        strength = np.full((1, step_count), servos.torque * self._torque_factor / inertia)
        start, command = np.stack([self.q, self.qd])[:, None], (set_points, set_rates)
        path = _follow(servos, joints, self._factor[None], start, command, strength, self.dt)
        self.q, self.qd = path[:, 0, -1].copy()
        self.time += step_count * self.dt
        return self._poses(path[0, 0, 1:])

    def _poses(self, q: Array) -> Array:
        """Return the poses of the grip, whose yaw goes on from the last one, shape [step, 5]."""
        poses = self.arm.grip_pose(q)
        poses[:, 3] = np.unwrap([self._yaw, *poses[:, 3]])[1:]
        self._yaw = float(poses[-1, 3])
        return poses

    def _is_still(self) -> bool:
        """Put the joints to rest where they have reached a set point that holds."""
        last = self._set_points[-1]
        held = self._times[-2] <= self.time - _HISTORY_TIME
        if not (held and np.array_equal(last, self._set_points[-2])):
            return False
        if np.abs(self.q - last).max() > _STILL_ERROR or np.abs(self.qd).max() > _STILL_SPEED:
            return False
        self.q, self.qd = last.copy(), np.zeros(self.arm.joint_count)
        return True
