"""Casting motion: grip paths from actions (paper, section V-B).

The motion is planned in polar coordinates about an origin r0 behind the reset position. theta moves
from 0 to theta1 and on to theta2; both are jerk-limited maximum-velocity moves from rest to rest.
Meanwhile the radius follows one cubic from r0 to r2. During the second arc the wrist turns the
cable by psi - theta2.
"""

import dataclasses
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import ActionError
from cablecast.motion.action import (
    ACTION_NAMES,
    ACTION_SIZE,
    action_numbers,
    check_action_values,
)
from cablecast.motion.grip_path import GripPath, Profiles, plan_profiles
from cablecast.motion.trajectory import JointPath, follow
from cablecast.setup import Setup

# Longest quintic pieces that follow the polar path to within 1e-6 m at a radius of 0.8 m. At
# constant rate the limits are the swept angle [rad] and the share of the radial cubic [-]. While
# the rate changes, the limit is in units of the profile's time scale, jerk^(-1/3). The error grows
# with the radius and the sixth power of the length (measured in tests/motion/test_cast.py).
CRUISE_ANGLE = 0.46
CRUISE_SHARE = 0.11
RAMP_SCALE = 0.37
ACCURATE_RADIUS = 0.8
# Closer knots are merged [s]: a profile without a cruise phase switches twice at the same time.
KNOT_GAP = 1e-9
# Actions per chunk: limits the intermediate arrays to about 10 MB.
CHUNK = 2048


@dataclasses.dataclass(frozen=True)
class Action:
    """One sweep, the casting motion of the paper (section V-B).

    Attributes:
        theta1: End of the first arc and start of the second [rad].
        theta2: End of the second arc, on the other side of the workspace axis [rad].
        r2: Final radius about the polar origin [m].
        psi: Final heading of the cable at the gripper [rad]; theta2 if None (action set A1).
        pace: Speed over that of the paper's motion along the same path [-].
    """

    theta1: float
    theta2: float
    r2: float
    psi: float | None = None
    pace: float = 1.0

    family: ClassVar[str] = "sweep"
    parameters: ClassVar[tuple[str, ...]] = ACTION_NAMES

    def __post_init__(self):
        check_action_values(self.to_array()[None])

    def to_array(self) -> NDArray[np.float64]:
        """Return (theta1, theta2, r2, psi, pace), shape [5]."""
        psi = self.theta2 if self.psi is None else self.psi
        try:
            return np.array([self.theta1, self.theta2, self.r2, psi, self.pace], dtype=float)
        except (TypeError, ValueError):
            raise ActionError(f"{self!r} holds a value that is not a number") from None

    @classmethod
    def from_array(cls, values: ArrayLike) -> "Action":
        """Make an action from (theta1, theta2, r2), with psi, or with psi and pace."""
        values = action_numbers(values)
        if values.shape not in ((3,), (4,), (ACTION_SIZE,)):
            raise ActionError(f"an action has shape {values.shape}: it must be [3], [4] or [5]")
        return cls(*(float(value) for value in values))

    def mirrored(self) -> "Action":
        """Return the action that lands mirrored about the workspace axis (section V-B)."""
        psi = None if self.psi is None else -self.psi
        return dataclasses.replace(self, theta1=-self.theta1, theta2=-self.theta2, psi=psi)

    def grip_path(self, setup: Setup) -> GripPath:
        """Return the path of the gripper, one row."""
        return cast_grip_paths(self.to_array()[None], setup)

    def set_points(self, grip_path: GripPath, setup: Setup) -> JointPath:
        """Return the set points of the joints that follow the path of the gripper."""
        return follow(grip_path, setup, str(self), casting=True)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SweepPaths:
    """Exact casting motions in polar coordinates, one per row.

    Attributes:
        origin_y: y of the polar origin, on the workspace axis [m].
        r0: Initial radius [m].
        r2: Final radius [m], shape [action].
        first: theta from 0 to theta1.
        second: theta from theta1 to theta2, relative to theta1.
        wrist: Turn of the wrist, which starts with the second arc.
    """

    origin_y: float
    r0: float
    r2: NDArray[np.float64]
    first: Profiles
    second: Profiles
    wrist: Profiles

    @property
    def arc_duration(self) -> NDArray[np.float64]:
        """Time at which theta and the radius come to rest [s], shape [action]."""
        return self.first.duration + self.second.duration

    @property
    def duration(self) -> NDArray[np.float64]:
        """Time at which the whole motion, wrist included, is at rest [s], shape [action]."""
        return self.first.duration + np.maximum(self.second.duration, self.wrist.duration)

    def radius(self, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return the radius and its derivatives.

        Args:
            times: Times since the start of the motion [s], shape [action, step].

        Returns:
            r [m], its rate [m/s], its second derivative [m/s²] and the left limit of that, which
            differs at the end of the arcs, where it jumps; each of shape [action, step].
        """
        end = self.arc_duration[:, None]
        reach = (self.r2 - self.r0)[:, None]
        u = np.clip(times / end, 0.0, 1.0)
        bend = reach * (6.0 - 12.0 * u) / end**2
        return (
            self.r0 + reach * u**2 * (3.0 - 2.0 * u),
            reach * 6.0 * u * (1.0 - u) / end,
            np.where(times < end, bend, 0.0),
            np.where(times <= end, bend, 0.0),
        )

    def angles(
        self, times: NDArray[np.float64]
    ) -> tuple[tuple[NDArray[np.float64], ...], tuple[NDArray[np.float64], ...]]:
        """Return theta and yaw [rad], each with its first two derivatives, at times as `radius`."""
        since = times - self.first.duration[:, None]
        arcs = zip(self.first.evaluate(times), self.second.evaluate(since), strict=True)
        theta = tuple(first + second for first, second in arcs)
        wrist = self.wrist.evaluate(since)
        return theta, tuple(t + w for t, w in zip(theta, wrist, strict=True))

    def motion(
        self, times: NDArray[np.float64]
    ) -> tuple[tuple[NDArray[np.float64], ...], tuple[NDArray[np.float64], ...]]:
        """Return position and yaw of the grip in the base frame, with their derivatives.

        Returns:
            Position [m], velocity [m/s], acceleration [m/s²] and the left limit of the acceleration
            (see `radius`), each of shape [action, step, 2]; yaw [rad], its rate and its
            acceleration, each of shape [action, step].
        """
        r, dr, *bends = self.radius(times)
        (theta, dtheta, ddtheta), yaw = self.angles(times)
        sine, cosine = np.sin(theta), np.cos(theta)
        radial = np.stack([sine, cosine], axis=-1)
        across = np.stack([cosine, -sine], axis=-1)
        turning = (r * ddtheta + 2.0 * dr * dtheta)[..., None] * across
        origin = np.array([0.0, self.origin_y])
        position = origin + r[..., None] * radial
        velocity = dr[..., None] * radial + (r * dtheta)[..., None] * across
        accelerations = [(ddr - r * dtheta**2)[..., None] * radial + turning for ddr in bends]
        return (position, velocity, *accelerations), yaw


def plan_sweeps(actions: ArrayLike, setup: Setup) -> SweepPaths:
    """Plan casting motions of actions, shape [action, 5], in polar coordinates.

    The limits of angular velocity and jerk are v_max and jerk divided by the largest radius. The
    radial motion adds to the speed. Where the sum could exceed v_max, the whole motion is slowed
    down by the factor that keeps it below, and then by the pace.
    """
    actions, config = check_action_values(actions), setup.motion
    theta1, theta2, r2, psi, pace = actions.T
    r_large = np.maximum(config.r0, r2)
    speed, jerk = config.v_max / r_large, config.jerk / r_large
    first = plan_profiles(theta1, speed, jerk)
    second = plan_profiles(theta2 - theta1, speed, jerk)
    turn = psi - theta2
    # Rounding in a grid may make psi differ from theta2 where no turn is intended.
    turn = np.where(np.abs(turn) < 1e-9, 0.0, turn)
    wrist = plan_profiles(
        turn, np.full_like(turn, config.wrist_velocity), np.full_like(turn, config.wrist_jerk)
    )
    # The cubic's rate peaks at 1.5 times its mean. Both peaks combined at the largest radius are an
    # upper bound of the linear speed.
    radial_peak = 1.5 * np.abs(r2 - config.r0) / (first.duration + second.duration)
    angular_peak = np.maximum(first.peak_velocity, second.peak_velocity)
    factor = np.maximum(np.hypot(r_large * angular_peak, radial_peak) / config.v_max, 1.0) / pace
    return SweepPaths(
        origin_y=setup.workspace.reset_y - config.r0,
        r0=config.r0,
        r2=r2,
        first=first.dilated(factor),
        second=second.dilated(factor),
        wrist=wrist.dilated(factor),
    )


def cast_grip_paths(actions: ArrayLike, setup: Setup) -> GripPath:
    """Return the grip paths of casting motions, one world per action.

    Knots lie at every jerk switch, and between them where the path curves. The pieces match
    position, velocity and acceleration of the polar path at each knot and stay within 1e-6 m of it.
    The height is the workspace's grip height, and the pitch is 0.

    Args:
        actions: theta1, theta2 [rad], r2 [m], psi [rad], pace [-], shape [action, 5].
        setup: Workspace and motion settings.

    Raises:
        ActionError: An action is not a casting motion; see `check_action_values`.
    """
    actions = check_action_values(actions)
    chunks = [
        _sweep_grip_paths(
            plan_sweeps(actions[start : start + CHUNK], setup), setup.workspace.grip_height
        )
        for start in range(0, len(actions), CHUNK)
    ]
    return GripPath.stack(chunks)


def _sweep_grip_paths(paths: SweepPaths, height: float) -> GripPath:
    knots = _knots(paths)
    (xy, dxy, ddxy, ddxy_before), (yaw, dyaw, ddyaw) = paths.motion(knots)
    poses, velocities, after, before = np.zeros((4, *knots.shape, 5))
    poses[..., :2], velocities[..., :2], after[..., :2] = xy, dxy, ddxy
    before[..., :2] = ddxy_before
    poses[..., 3], velocities[..., 3], after[..., 3], before[..., 3] = yaw, dyaw, ddyaw, ddyaw
    poses[..., 2] = height
    accelerations = np.stack([after[:, :-1], before[:, 1:]], axis=2)
    return GripPath.from_hermite(knots, poses, velocities, accelerations)


def _knots(paths: SweepPaths) -> NDArray[np.float64]:
    """Return the jerk switches and the knots needed between them [s], shape [action, knot]."""
    turning = paths.first.duration[:, None]
    switches = np.concatenate(
        [paths.first.knots, turning + paths.second.knots, turning + paths.wrist.knots], axis=1
    )
    switches.sort(axis=1)
    length = np.diff(switches, axis=1)
    (_, rate, acceleration), _ = paths.angles(switches)
    rate, acceleration = (
        np.maximum(np.abs(values[:, :-1]), np.abs(values[:, 1:])) for values in (rate, acceleration)
    )
    large = np.maximum(paths.r0, paths.r2)[:, None] / ACCURATE_RADIUS
    jerk = np.max(np.abs(paths.first.jerks), axis=1, keepdims=True)
    longest = np.where(
        acceleration > 1e-6,
        RAMP_SCALE * jerk ** (-1 / 3),
        np.minimum(
            CRUISE_ANGLE / np.maximum(rate, 1e-3), CRUISE_SHARE * paths.arc_duration[:, None]
        ),
    ) / np.maximum(large, 1.0) ** (1 / 6)
    parts = np.ceil(length / longest).astype(np.intp)
    parts[length < KNOT_GAP] = 0
    # Concatenate the parts of all intervals of a row. Part k of an interval starts k part lengths
    # after the interval. Unused entries repeat the end of the motion.
    count = parts.sum(axis=1)
    row, interval = np.nonzero(parts)
    repeats = parts[row, interval]
    first_place = (np.cumsum(parts, axis=1) - parts)[row, interval]
    part = np.arange(repeats.sum()) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    row, interval = np.repeat(row, repeats), np.repeat(interval, repeats)
    knots = np.repeat(paths.duration[:, None], count.max() + 1, axis=1)
    step = length[row, interval] / parts[row, interval]
    knots[row, np.repeat(first_place, repeats) + part] = switches[row, interval] + part * step
    return knots
