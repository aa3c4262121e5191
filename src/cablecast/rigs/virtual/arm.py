"""The arm as it really moves: set points that arrive late, and joints that follow like springs.

Each joint is the textbook servo, a second-order system behind a dead time,

    qdd = omega^2 (q_set - q) + 2 zeta omega (share qd_set - qd),

whose acceleration cannot exceed what the motor's torque at its present speed gives the arm at its
present stretch. A motion that stays far from that limit is followed alike in every trial; one close
to it is cut by an amount that changes with the motor's temperature.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.ur import JOINT_COUNT, ArmUR
from cablecast.motion.grip_path import CHANNELS
from cablecast.motion.trajectory import JointPath, Trajectory
from cablecast.rigs.virtual._hidden import HiddenArm
from cablecast.rigs.virtual.trials import Trial

REPORT_DT = 1 / 125
"""Time between reports of the joints, the control cycle of the arm [s]."""
_SETTLE_TIME = 0.4
"""Time from the end of the command to the last report [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArmMotion:
    """Motion of the arm in one trial.

    Attributes:
        poses: Pose of the gripped end: x, y, z [m], yaw, pitch [rad], shape [step + 1, 5].
        joint_path: Joints as the arm reported them; None for a motion without joints.
    """

    poses: NDArray[np.float64]
    joint_path: JointPath | None


def move_arm(
    trajectories: Sequence[Trajectory],
    trials: Sequence[Trial],
    arm: ArmUR,
    servos: HiddenArm,
    dt: float,
    step_count: int,
) -> list[ArmMotion]:
    """Return the motions of an arm that follows commanded ones.

    Args:
        trajectories: Commanded motion of each trial. Without a joint path, the gripper itself
            follows its path as the joints would.
        trials: Draw of each trial.
        arm: Geometry of the arm.
        servos: True servos of its joints.
        dt: Step [s].
        step_count: Number of steps from the beginning of the motion.
    """
    motions: list[ArmMotion | None] = [None] * len(trajectories)
    for jointed in (True, False):
        rows = [i for i, t in enumerate(trajectories) if (t.joint_path is not None) is jointed]
        if not rows:
            continue
        commands = [_command(trajectories[i], trials[i], servos, dt, step_count) for i in rows]
        followed = _follow(
            np.stack([command[0] for command in commands]),
            np.stack([command[1] for command in commands]),
            _channels(servos, jointed),
            servos,
            _strength(trajectories, trials, rows, servos, dt, step_count) if jointed else None,
            np.stack([trials[i].servo_factor(_channel_count(jointed)) for i in rows]),
            dt,
        )
        for row, (q, qd) in zip(rows, zip(*followed, strict=True), strict=True):
            if jointed:
                report = _report(q, qd, trajectories[row], trials[row], dt)
                motions[row] = ArmMotion(poses=arm.grip_pose(q), joint_path=report)
            else:
                motions[row] = ArmMotion(poses=q, joint_path=None)
    return [motion for motion in motions if motion is not None]


def _channel_count(jointed: bool) -> int:
    return JOINT_COUNT if jointed else len(CHANNELS)


def _channels(servos: HiddenArm, jointed: bool) -> NDArray[np.float64]:
    """Return angular frequency [rad/s] and damping ratio of each channel, shape [2, channel]."""
    # A gripper without joints is carried by the base joint and turned by the last wrist joint.
    pick = list(range(JOINT_COUNT)) if jointed else [0, 0, 0, 5, 5]
    frequency = 2 * np.pi * np.array(servos.frequency)[pick]
    return np.stack([frequency, np.array(servos.damping_ratio)[pick]])


def _command(
    trajectory: Trajectory, trial: Trial, servos: HiddenArm, dt: float, step_count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return set points and rates as they reach each servo, each of shape [step + 1, channel]."""
    now = np.arange(step_count + 1) * dt
    path = trajectory.joint_path
    if path is None:
        times = np.arange(int(np.ceil(trajectory.duration / REPORT_DT)) + 1) * REPORT_DT
        values, rates = (trajectory.grip_path.evaluate(times, order)[0] for order in (0, 1))
        delays = np.full(len(CHANNELS), servos.delay[0])
    else:
        times, values, rates = path.times, path.q, path.qd
        delays = np.array(servos.delay)
    # A set point acts when it arrives, and none overtakes another.
    arrival = np.maximum.accumulate(times + trial.latencies(len(times)))
    arrival += 1e-9 * np.arange(len(times))
    set_points = np.empty((len(now), values.shape[1]))
    set_rates = np.empty_like(set_points)
    for channel, delay in enumerate(delays):
        sent = np.interp(now - delay, arrival, times)
        set_points[:, channel] = np.interp(sent, times, values[:, channel])
        set_rates[:, channel] = np.interp(sent, times, rates[:, channel])
        # Before the first set point the arm is told to stand.
        set_rates[(sent <= times[0]) | (sent >= times[-1]), channel] = 0.0
    return set_points, set_rates


def _strength(
    trajectories: Sequence[Trajectory],
    trials: Sequence[Trial],
    rows: Sequence[int],
    servos: HiddenArm,
    dt: float,
    step_count: int,
) -> NDArray[np.float64]:
    """Return the acceleration that the standing base joint can give [rad/s²], [row, step]."""
    now = np.arange(step_count) * dt
    strength = np.empty((len(rows), step_count))
    for row, index in enumerate(rows):
        poses = trajectories[index].grip_path.evaluate(now)[0]
        inertia = servos.inertia + servos.stretch_mass * (poses[:, 0] ** 2 + poses[:, 1] ** 2)
        strength[row] = servos.torque * trials[index].torque_factor / inertia
    return strength


def _follow(
    set_points: NDArray[np.float64],
    set_rates: NDArray[np.float64],
    channels: NDArray[np.float64],
    servos: HiddenArm,
    strength: NDArray[np.float64] | None,
    factor: NDArray[np.float64],
    dt: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return angles and rates of the servos from rest, each of shape [row, step + 1, channel].

    Only sums and products of single elements: a row's result does not depend on its neighbours.
    """
    omega = channels[0] * factor
    stiffness, drag = omega * omega, 2 * channels[1] * omega
    q = np.empty_like(set_points)
    qd = np.zeros_like(set_points)
    q[:, 0] = set_points[:, 0]
    here, rate = q[:, 0].copy(), qd[:, 0].copy()
    for step in range(set_points.shape[1] - 1):
        error = set_points[:, step + 1] - here
        share = servos.feedforward * set_rates[:, step + 1]
        acceleration = stiffness * error + drag * (share - rate)
        if strength is not None:
            acceleration[:, 0] = within_torque(
                acceleration[:, 0], rate[:, 0], strength[:, step], servos.free_speed
            )
        rate = rate + dt * acceleration
        here = here + dt * rate
        q[:, step + 1], qd[:, step + 1] = here, rate
    return q, qd


def within_torque(
    acceleration: NDArray[np.float64],
    rate: NDArray[np.float64],
    strength: NDArray[np.float64],
    free_speed: float,
) -> NDArray[np.float64]:
    """Limit accelerations to what a motor gives: less the faster it runs, but not in braking."""
    left = strength * np.maximum(1.0 - np.abs(rate) / free_speed, 0.0)
    ahead = np.where(rate > 0, left, strength)
    back = np.where(rate < 0, left, strength)
    return np.clip(acceleration, -back, ahead)


def _report(
    q: NDArray[np.float64],
    qd: NDArray[np.float64],
    trajectory: Trajectory,
    trial: Trial,
    dt: float,
) -> JointPath:
    """Return the joints as the arm reports them, by its own clock and with noisy encoders."""
    last = min(trajectory.duration + _SETTLE_TIME, (len(q) - 1) * dt)
    times = REPORT_DT * np.arange(int(last / REPORT_DT) + 1, dtype=np.float64)
    now = np.arange(len(q)) * dt
    noise = trial.encoder_errors(len(times))
    read = np.stack([np.interp(times, now, q[:, joint]) for joint in range(JOINT_COUNT)], axis=1)
    rates = np.stack([np.interp(times, now, qd[:, joint]) for joint in range(JOINT_COUNT)], axis=1)
    return JointPath(times=times, q=read + noise[0], qd=rates + noise[1])
