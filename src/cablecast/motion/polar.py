"""Polar casting and the reset: lift, swing in a vertical plane, and slow pull.

Polar casting is the paper's baseline (section VI-A) and the last step of its reset (section V-A).
From any pose, the gripper lifts the cable until the free end hangs clear of the table, and waits
until it is at rest. A swing forward lays the cable out straight along the azimuth of the target.
The gripper then drags it towards the robot until the endpoint is as far from the base as the
target.

A reset does the same straight ahead. It brings the cable from wherever a cast left it to the
initial state of every cast: in front of the robot, at rest, without torsion.
"""

import contextlib
import dataclasses
import functools
import itertools
from collections.abc import Callable
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.conventions import GRAVITY, Array, polar_to_xy, xy_to_polar
from cablecast.errors import (
    CablecastError,
    InputError,
    JointLimitError,
    TargetError,
    check_number,
)
from cablecast.motion.grip_path import SMOOTH, GripPath, PlanePath
from cablecast.motion.limits import check_grip_paths
from cablecast.motion.trajectory import JointPath, Trajectory, follow
from cablecast.setup import PolarCastConfig, Setup
from cablecast.workspace import Workspace

_PLACES = sorted(
    itertools.product((1.0, 1.15, 1.3, 0.85, 0.7, 0.55), (1.0, 0.85, 0.7, 0.55), (1.0, 0.9, 0.8)),
    key=lambda change: float(np.abs(np.log(change)) @ (1.0, 3.0, 2.0)),
)
"""Factors of the radii near the base, of the hanging height and of the farthest radius that are
tried where the arm cannot follow a reset, the least change first."""

_LIFT_HEIGHTS, _LIFT_RADII, _LIFT_TIMES = 5, (1.0, 0.85, 1.15, 0.7, 1.3, 0.55), (1.0, 1.4, 2.0)
"""Heights of a lift between the whole cable and what serves the paper's, factors of the radii near
the base, and of the times of the lift, that are tried in this order."""

_TIMES = ((1.0, 1.0), (2.0, 1.0), (1.0, 1.2), (2.0, 1.2))
"""Factors of the times of the lift and of the swing that are tried at each of these."""

_VERY_SLOW = 4.0
"""Times as slow as which only places limit an arm."""

_SLOWDOWNS = (1.0, 1.05, 1.1, 1.15, 1.2, 1.3)
"""Multiples of a reset's times that are tried, until the arm can follow: swings up to 1.3 times as
slow still lay the cable out, and one of 1.5 leaves it slack (fast engine, both ropes)."""


SWING_PACE_BOUNDS = (0.5, 1.2)
"""Paces of the swing of a polar cast [-]."""

CAST_PACE = 0.9
"""Pace of most polar casts with the standard swing, which the arm is to follow with the settings of
a set-up [-]. In seven pairs of a laboratory and a cable, swings at 0.9 erred by 0.5 to 14 %; at 1.0
a light cable was left in a heap, and at 0.83 a stiff one after a short pull."""

_ARC_MIN = 0.01
"""Least radius of the arc about the free end [m]: a stiff cable may bend down from the gripper
farther than it is long."""

_PULL_POINTS = 24
"""Points of a pull aside that the path goes through."""

_GRID_COUNT, _GRID_CLOSE, _NEWTON_STEPS = 121, 0.02, 12
"""Casts of the grid that a search for one starts from along each axis, the distance from the place
within which it starts [m], and its steps."""


def cast_paces(setup: Setup) -> tuple[float, ...]:
    """Return paces of the swing of polar casts in the order in which they are tried [-].

    A set-up's own swing was found at a pace of 1.
    """
    return (CAST_PACE, 0.8, 1.0) if setup.polar is None else (1.0, CAST_PACE, 0.8)


def polar_config(setup: Setup, *, casts: bool = False) -> PolarCastConfig:
    """Return the settings of resets and polar casts for a set-up: its own, or found ones.

    Where the arm cannot follow a reset with those for its reach, even slowed down, these are the
    nearest ones with which it can: lower, farther out, shorter, or slower. Those for polar casts
    are such that it follows a cast straight ahead, too, which is not slowed down. Where there are
    none, those for its reach; so, too, of an arm whose joints are searched for, as each height
    would take it seconds.
    """
    if setup.polar is not None:
        return setup.polar
    if not setup.arm.solves_exactly:
        return PolarCastConfig.of_reach(setup.workspace)
    return _followed(setup, casts)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolarReach:
    """Region in which polar casting can lay the endpoint of a cable.

    The cast lays the endpoint at most cast_radius + r_c from the base, and inside the table. The
    pull ends where the gripper would run into the robot's own table, at y = 0.466 m. Straight
    ahead, y of the endpoint is therefore at least 0.466 m + r_c, the limit that the paper states.
    To the side the cable lies at an angle, and the endpoint may be nearer. The paper's errors of
    polar casting (median 43 %, third quartile 76 %, largest 106 % of the cable's length) match the
    distances of its targets from this region (44, 76, 105 %), not from the half plane beyond
    0.466 m + r_c (63, 97, 118 %).

    Attributes:
        cable_length: Cable length r_c [m].
        cast_radius: Largest radius at which the gripper comes down [m].
        grip_y_min: Smallest y of the gripper, at the robot's own table [m].
        half_width: Largest |x| of an endpoint [m].
        y_max: Largest y of an endpoint [m].
    """

    cable_length: float
    cast_radius: float
    grip_y_min: float
    half_width: float
    y_max: float

    @classmethod
    def of(cls, setup: Setup, config: PolarCastConfig | None = None) -> "PolarReach":
        """Return the region for the cable and table of a set-up."""
        cable = setup.cable
        reach = cls._anywhere(setup, config or polar_config(setup, casts=True))
        if reach.landing_radius(0.0) <= reach.pulled_radius(0.0):
            raise InputError(
                f"polar casting reaches nothing with a cable of {cable.length} m: straight ahead "
                f"its endpoint lands at {reach.landing_radius(0.0):.3f} m and can be pulled no "
                f"nearer than {reach.pulled_radius(0.0):.3f} m"
            )
        return reach

    @classmethod
    def _anywhere(cls, setup: Setup, config: PolarCastConfig) -> "PolarReach":
        """Return the region, which may be empty."""
        workspace = setup.workspace
        return cls(
            cable_length=setup.cable.length,
            cast_radius=min(config.cast_radius, workspace.r_max),
            grip_y_min=workspace.support_depth,
            half_width=workspace.half_width - config.table_margin,
            y_max=workspace.y_max - config.table_margin,
        )

    @classmethod
    def reset_radius(cls, setup: Setup, config: PolarCastConfig) -> float:
        """Return the radius at which the gripper of a reset comes down [m].

        A cable that is long for the table is laid no nearer than the reset pose.
        """
        radius = float(cls._anywhere(setup, config).landing_radius(0.0)) - setup.cable.length
        return max(radius, setup.workspace.reset_y)

    @property
    def radius(self) -> float:
        """Largest distance of an endpoint from the base, table edges ignored [m]."""
        return self.cast_radius + self.cable_length

    def contains(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """Return which points [m] lie in the region, shape [...], for points of shape [..., 2]."""
        xy = np.asarray(xy, dtype=float)
        r, theta = np.moveaxis(xy_to_polar(xy), -1, 0)
        inside = (r <= self.radius) & (np.abs(xy[..., 0]) <= self.half_width)
        inside &= (xy[..., 1] <= self.y_max) & (np.abs(theta) < np.pi / 2)
        return inside & ((r - self.cable_length) * np.cos(theta) >= self.grip_y_min)

    def landing_radius(self, theta: ArrayLike) -> Array:
        """Return the distance at which the endpoint lands at azimuths [rad], before the pull."""
        with np.errstate(divide="ignore"):
            side = self.half_width / np.abs(np.sin(theta))
        return np.minimum(self.radius, np.minimum(side, self.y_max / np.cos(theta)))

    def pulled_radius(self, theta: ArrayLike) -> Array:
        """Return the smallest distances to which the endpoint can be pulled at azimuths [rad]."""
        return self.grip_y_min / np.cos(theta) + self.cable_length

    @property
    def theta_max(self) -> float:
        """Largest azimuth at which the cable can be cast and pulled [rad]."""
        low, high = 0.0, float(np.pi / 2)
        for _ in range(60):
            middle = (low + high) / 2
            reached = self.landing_radius(middle) > self.pulled_radius(middle)
            low, high = (middle, high) if reached else (low, middle)
        return low

    def outline(self, count: int = 200) -> Array:
        """Return points from the right end along the far bound and back [m], shape [2 count, 2]."""
        theta = np.linspace(self.theta_max, -self.theta_max, count)
        radius = [self.landing_radius(theta), self.pulled_radius(theta)[::-1]]
        angles = np.concatenate([theta, theta[::-1]])
        return polar_to_xy(np.stack([np.concatenate(radius), angles], axis=-1))

    def nearest(self, xy: ArrayLike) -> Array:
        """Return the point of the region nearest to each point [m], shape [..., 2]."""
        xy = np.asarray(xy, dtype=float)
        near = xy.reshape(-1, 2).copy()
        # Project onto every edge of a fine outline; its chords are within 1 um of the curves.
        start = self.outline(1000)
        edge = np.roll(start, -1, axis=0) - start
        length2 = np.maximum(np.sum(edge**2, axis=1), 1e-30)
        for row in np.flatnonzero(~self.contains(near)):
            share = np.clip(np.sum((near[row] - start) * edge, axis=1) / length2, 0.0, 1.0)
            places = start + share[:, None] * edge
            near[row] = places[np.argmin(np.sum((places - near[row]) ** 2, axis=1))]
        return near.reshape(xy.shape)


def _lift(
    path: PlanePath, cable: Cable, config: PolarCastConfig, azimuth: float = 0.0
) -> PlanePath:
    """Append the lift, from any low pose to the cable hanging in the plane at an azimuth [rad]."""
    place = path.place
    rise = abs(config.carry_height - place["height"])
    path.move(max(config.carry_time_min, rise / config.carry_speed), height=config.carry_height)
    turned = config.carry_radius * (abs(azimuth - place["azimuth"]) + abs(place["turn"]) / 2)
    way = float(np.hypot(config.carry_radius - place["radius"], turned))
    path.move(
        max(config.carry_time_min, way / config.carry_speed),
        azimuth=azimuth,
        radius=config.carry_radius,
        turn=0.0,
    )
    path.move(config.draw_time, radius=config.draw_radius)
    hang_height = config.hang_height(cable)
    # The free end is dragged to the point below which it will hang, and stays there.
    bend_out, bend_up = _bend_offsets(cable)
    end_radius = config.hang_radius + config.bend_out_share * bend_out
    length = cable.length + cable.attachment_length - config.bend_up_share * bend_up
    length = max(min(length, hang_height / config.arc_share), _ARC_MIN)
    aside = end_radius - config.rise_radius
    path.move(
        config.rise_time,
        radius=config.rise_radius,
        height=float(np.sqrt(max(length**2 - aside**2, config.carry_height**2))),
    )
    share = np.linspace(0.0, 1.0, 7)[1:]
    first, last = (
        float(np.arcsin(np.clip(way / length, -1.0, 1.0)))
        for way in (aside, end_radius - config.hang_radius)
    )
    angle = first + (last - first) * share
    reach = length * (1.0 - (1.0 - config.arc_share) * share)
    path.through(
        (config.arc_time * share).tolist(),
        radius=(end_radius - reach * np.sin(angle)).tolist(),
        height=(reach * np.cos(angle)).tolist(),
    )
    return path.move(config.lift_time, radius=config.hang_radius, height=hang_height)


def _bend_offsets(cable: Cable) -> tuple[float, float]:
    """Return the forward and upward shift [m] of the free end due to the bend at the gripper.

    The gripper clamps the cable level. The cable is an elastica that turns from level to straight
    down under a tension T, the weight of the cable and its attachment. With b = sqrt(E I / T), its
    end hangs sqrt(2) b in front of the clamp and (2 - sqrt(2)) b higher than without a bend.
    """
    params = cable.params
    tension = GRAVITY * (float(params.mass) + float(params.endpoint_mass))
    bend = float(np.sqrt(float(params.bend_stiffness) / tension))
    return float(np.sqrt(2.0)) * bend, (2.0 - float(np.sqrt(2.0))) * bend


def _swing_out(
    path: PlanePath, radius: float, workspace: Workspace, config: PolarCastConfig
) -> PlanePath:
    """Append the swing: the gripper comes down at a radius [m], then the cable settles."""
    swing, place = config.swing, path.place
    low, near = workspace.grip_height, place["radius"]
    # For the cable to land taut, the gripper swings out beyond the radius where it comes down, but
    # stays within the arm's reach.
    farthest = max(radius, workspace.r_max - config.reach_margin)
    span = config.cast_radius - near
    outer = [min(near + share * span, farthest) for share in swing.radii]
    path.through(
        np.cumsum(swing.durations).tolist(),
        radius=[near - swing.draw_back, *outer, radius],
        height=[low + s * (place["height"] - low) for s in (*swing.heights, 0.0)],
        pitch=[*swing.pitches, 0.0],
    )
    return path.hold(config.settle_time)


def _pull_back(path: PlanePath, radius: float, config: PolarCastConfig) -> PlanePath:
    """Append the slow pull along the table until the gripper is at a radius [m]."""
    way = abs(radius - path.place["radius"])
    if way < 1e-6:
        return path
    return path.move(max(config.pull_time_min, way / config.pull_speed), radius=radius)


def reset_pose(workspace: Workspace) -> Array:
    """Return x, y, z [m], yaw, pitch [rad] of the gripper after a reset, shape [5]."""
    return np.array([0.0, workspace.reset_y, workspace.grip_height, 0.0, 0.0])


def check_finite(name: str, values: ArrayLike, count: int) -> Array:
    """Return so many finite numbers, shape [count].

    Raises:
        TargetError: They are others; names them.
    """
    found = np.asarray(values, dtype=float)
    if found.shape != (count,) or not np.isfinite(found).all():
        shown = ", ".join(f"{value:g}" for value in found.ravel()[: count + 1])
        raise TargetError(f"{name} ({shown}) must be {count} finite numbers")
    return found


@dataclasses.dataclass(frozen=True)
class PolarCast:
    """One polar cast: a swing out along an azimuth, and a straight pull along the table.

    In the paper the pull goes back along the azimuth. In any other direction the free end follows
    as a tractrix, and comes to places that are too near to the robot for a pull straight back.

    Attributes:
        azimuth: Azimuth of the swing, from straight ahead, positive to the robot's right [rad].
        x, y: Place of the gripper at the end of the pull [m].
        pace: Pace of the swing, that of the reset is 1 [-]. A light cable, which the air holds
            back, is laid out by a slower one.
    """

    azimuth: float
    x: float
    y: float
    pace: float = 1.0

    family: ClassVar[str] = "polar"
    parameters: ClassVar[tuple[str, ...]] = ("polar_azimuth", "polar_x", "polar_y", "polar_pace")

    def __post_init__(self):
        check_finite("polar cast", self.to_array(), len(self.parameters))
        check_number("pace of a polar cast", self.pace, *SWING_PACE_BOUNDS)

    def __str__(self) -> str:
        return (
            f"the polar cast at {np.degrees(self.azimuth):z.1f} deg and pace {self.pace:.2f}, "
            f"pulled to x = {self.x:z.3f} m, y = {self.y:z.3f} m"
        )

    @classmethod
    def back_to(cls, endpoint_xy: ArrayLike, reach: PolarReach, pace: float = 1.0) -> "PolarCast":
        """Return the cast of the paper that brings the endpoint to a point of its reach.

        Raises:
            InputError: The point lies elsewhere.
        """
        endpoint_xy = check_finite("target", endpoint_xy, 2)
        # Rounding may put a point of the outline outside.
        if np.max(np.abs(reach.nearest(endpoint_xy) - endpoint_xy)) > 1e-6:
            x, y = endpoint_xy.tolist()
            raise InputError(
                f"polar casting does not reach ({x:.3f}, {y:.3f}) m: r must be at most "
                f"{reach.radius:.3f} m, and the gripper's y at least {reach.grip_y_min:.3f} m, on "
                "the table"
            )
        r, theta = xy_to_polar(endpoint_xy).tolist()
        return cls(theta, *polar_to_xy([r - reach.cable_length, theta]).tolist(), pace=pace)

    def to_array(self) -> Array:
        """Return the azimuth [rad], x and y [m], and the pace, shape [4]."""
        return np.array([self.azimuth, self.x, self.y, self.pace], dtype=float)

    @classmethod
    def from_array(cls, values: ArrayLike) -> "PolarCast":
        """Make a cast from its azimuth [rad], x and y [m], and pace."""
        return cls(*check_finite("polar cast", values, len(cls.parameters)).tolist())

    def mirrored(self) -> "PolarCast":
        """Return the cast that lands mirrored about the workspace axis."""
        return dataclasses.replace(self, azimuth=-self.azimuth, x=-self.x)

    def grip_path(self, setup: Setup) -> GripPath:
        """Return the path of the gripper from the reset pose, one row."""
        return _cast_path(self, setup, polar_config(setup, casts=True))

    def set_points(self, grip_path: GripPath, setup: Setup) -> JointPath:
        """Return the set points of the joints that follow the path of the gripper."""
        return follow(grip_path, setup, str(self))


def _cast_path(cast: PolarCast, setup: Setup, config: PolarCastConfig) -> GripPath:
    """Return the path of the gripper in a polar cast from the reset pose, one row."""
    cable, workspace = setup.cable, setup.workspace
    radius = float(PolarReach.of(setup, config).landing_radius(cast.azimuth)) - cable.length
    path = PlanePath(reset_pose(workspace))
    slow = dataclasses.replace(config, rise_time=config.cast_rise_time)
    _lift(path, cable, slow, cast.azimuth).hold(config.hang_time)
    swing = config.swing.slowed(1.0 / cast.pace)
    _swing_out(path, radius, workspace, dataclasses.replace(config, swing=swing))
    end = np.array([cast.x, cast.y])
    if abs(xy_to_polar(end)[1] - cast.azimuth) < 1e-9:
        return _pull_back(path, float(np.hypot(*end)), config).grip_path()
    return _pull_aside(path, end, cable, config).grip_path()


def _pull_aside(path: PlanePath, end: Array, cable: Cable, config: PolarCastConfig) -> PlanePath:
    """Append the slow straight pull to a place [m], with the gripper along the cable."""
    place = path.place
    start = polar_to_xy([place["radius"], place["azimuth"]])
    way = float(np.linalg.norm(end - start))
    time = np.linspace(0.0, 1.0, _PULL_POINTS + 1)[1:]
    share = SMOOTH(time)
    xy = start + share[:, None] * (end - start)
    heading = trailing_heading(place["azimuth"], end - start, share * way / cable.length)
    azimuth = xy_to_polar(xy)[:, 1]
    duration = max(config.pull_time_min, way / config.pull_speed)
    return path.through(
        (duration * time).tolist(),
        azimuth=azimuth.tolist(),
        radius=np.hypot(*xy.T).tolist(),
        turn=(heading - azimuth).tolist(),
    )


def trailing_heading(heading: ArrayLike, direction: ArrayLike, ways: ArrayLike) -> Array:
    """Return the heading of a straight cable that is pulled straight, its end trailing [rad].

    The end of a cable that does not slip sideways moves along the cable, on a tractrix: the angle a
    between the cable and the line of the pull obeys tan(a / 2) = tan(a0 / 2) exp(-s / L), with s
    the way and L the length of the cable.

    Args:
        heading: Heading from the gripper to the end before the pull [rad], shape [...].
        direction: Direction of the pull, of any length, shape [..., 2].
        ways: s / L [-], shape [...].
    """
    direction = np.asarray(direction, dtype=float)
    behind = np.arctan2(-direction[..., 0], -direction[..., 1])
    angle = (np.asarray(heading) - behind + np.pi) % (2.0 * np.pi) - np.pi
    return behind + 2.0 * np.arctan(np.tan(angle / 2.0) * np.exp(-np.asarray(ways)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class PullReach:
    """Places to which a swing and a pull in any direction bring the end of a straight cable.

    A place that the paper's polar cast reaches is reached by it. For others the pull ends at the
    robot's own table, of all that lead there the one that turns the least from the swing.

    Attributes:
        back: Region of the paper's polar casts.
        end_x_max: Largest |x| of the gripper at the end of a pull [m].
    """

    back: PolarReach
    end_x_max: float

    @classmethod
    def of(cls, setup: Setup) -> "PullReach":
        """Return the places for the cable, the table and the arm of a set-up.

        Raises:
            InputError: Polar casting reaches nothing.
        """
        back = PolarReach.of(setup)
        far = float(np.sqrt(max(back.cast_radius**2 - back.grip_y_min**2, 0.0)))
        return cls(back=back, end_x_max=min(far, back.half_width))

    def end_xy(self, casts: ArrayLike) -> Array:
        """Return where casts bring the end of a straight cable [m], shape [..., 2].

        `casts` are their azimuths [rad], x and y [m], shape [..., 3]; more is not looked at.
        """
        casts = np.asarray(casts, dtype=float)
        azimuth, end = casts[..., 0], casts[..., 1:3]
        start = self._start(azimuth)
        way = np.linalg.norm(end - start, axis=-1)
        length = self.back.cable_length
        heading = trailing_heading(azimuth, end - start, way / length)
        return end + polar_to_xy(np.stack([np.full_like(heading, length), heading], axis=-1))

    def ahead(self, pace: float) -> PolarCast:
        """Return the cast straight ahead with a middling pull."""
        radius = 0.5 * float(self.back.landing_radius(0.0) + self.back.pulled_radius(0.0))
        return PolarCast.back_to([0.0, radius], self.back, pace)

    def way(self, cast: PolarCast) -> float:
        """Return the length of the pull of a cast [m]."""
        return float(np.linalg.norm(cast.to_array()[1:3] - self._start(cast.azimuth)))

    def axes(self, cast: PolarCast) -> Array:
        """Return the unit vectors along the resting cable and across it, to its right, [2, 2]."""
        values = cast.to_array()
        along = (self.end_xy(values) - values[1:3]) / self.back.cable_length
        return np.stack([along, np.array([along[1], -along[0]])])

    def turn(self, cast: PolarCast) -> float:
        """Return the angle by which the pull turns the cable, positive to the right [rad]."""
        return float(np.arctan2(*self.axes(cast)[0])) - cast.azimuth

    def cast_to(self, xy: Array, pace: float = 1.0) -> PolarCast | None:
        """Return the cast that brings the end of a straight cable to a place [m], shape [2]."""
        if self.back.contains(xy):
            return PolarCast.back_to(xy, self.back, pace)
        grid, ends, turns = self._grid
        near = np.linalg.norm(ends - xy, axis=-1)
        close = near < _GRID_CLOSE
        if not close.any():
            return None
        values = grid[np.argmin(np.where(close, turns, np.inf))]
        for _ in range(_NEWTON_STEPS):
            offset = xy - self.end_xy(values)
            if np.linalg.norm(offset) < 1e-6:
                break
            steps = np.array([[1e-5, 0.0, 0.0], [0.0, 1e-5, 0.0]])
            slopes = (self.end_xy(values + steps) - self.end_xy(values - steps)).T / 2e-5
            values = values + np.append(np.linalg.lstsq(slopes, offset, rcond=None)[0], 0.0)
        inside = abs(values[0]) <= self.back.theta_max and abs(values[1]) <= self.end_x_max
        if not inside or np.linalg.norm(xy - self.end_xy(values)) > 1e-4:
            return None
        return PolarCast(*values.tolist(), pace=pace)

    def _start(self, azimuth: ArrayLike) -> Array:
        """Return where the gripper comes down at azimuths [m], shape [..., 2]."""
        radius = self.back.landing_radius(azimuth) - self.back.cable_length
        return polar_to_xy(np.stack([radius, np.asarray(azimuth, dtype=float)], axis=-1))

    @functools.cached_property
    def _grid(self) -> tuple[Array, Array, Array]:
        """Casts that end at the robot's own table, where they bring the end, and their turn."""
        limit = self.back.theta_max
        azimuth, x = np.meshgrid(
            np.linspace(-limit, limit, _GRID_COUNT),
            np.linspace(-self.end_x_max, self.end_x_max, _GRID_COUNT),
            indexing="ij",
        )
        casts = np.stack([azimuth, x, np.full_like(x, self.back.grip_y_min)], axis=-1)
        casts = casts.reshape(-1, 3)
        back = np.arctan2(*(self._start(casts[:, 0]) - casts[:, 1:]).T)
        return casts, self.end_xy(casts), np.abs(back - casts[:, 0])


def lift_path(start: ArrayLike, setup: Setup, config: PolarCastConfig) -> GripPath:
    """Return the gripper path of the lift from x, y, z [m], yaw, pitch [rad], until it may swing.

    The cable then hangs straight ahead.
    """
    path = PlanePath(check_finite("start", start, 5))
    return _lift(path, setup.cable, config).hold(config.hang_time).grip_path()


def swing_path(radius: float, rest: float, setup: Setup, config: PolarCastConfig) -> GripPath:
    """Return the gripper path from the hanging cable on, straight ahead.

    Args:
        radius: Distance at which the gripper comes down [m].
        rest: Distance to which it is pulled back [m].
        setup: Cable and workspace.
        config: Settings of the swing and the pull.
    """
    path = PlanePath([0.0, config.hang_radius, config.hang_height(setup.cable), 0.0, 0.0])
    _swing_out(path, radius, setup.workspace, config)
    return _pull_back(path, rest, config).grip_path()


def highest_lift(
    setup: Setup, starts: Array, allowed: Callable[[GripPath], bool]
) -> PolarCastConfig | None:
    """Return settings with which an arm lifts the cable from some poses as high as it can.

    The whole cable hangs free, if the arm reaches so high; else as much as can. None where the arm
    can follow no lift that was tried.

    Args:
        setup: Cable, workspace and arm.
        starts: Poses x, y, z [m], yaw, pitch [rad], shape [start, 5].
        allowed: Whether an arm that can follow a lift may make it.
    """
    config, cable = PolarCastConfig.of_reach(setup.workspace), setup.cable
    whole = cable.length + cable.attachment_length + config.clearance
    low = min(whole, config.hang_height_max)
    highest = np.linspace(whole, low, _LIFT_HEIGHTS) if whole > low else [low]
    lower = low * np.array([0.85, 0.7, 0.55, 0.4])
    for height, near, time in itertools.product([*highest, *lower], _LIFT_RADII, _LIFT_TIMES):
        one = config.moved(near, 1.0, 1.0).paced(time, 1.0)
        with contextlib.suppress(CablecastError):
            one = dataclasses.replace(one, hang_height_max=round(float(height), 4))
            paths = [lift_path(start, setup, one) for start in starts]
            follows = check_grip_paths(GripPath.stack(paths), setup).mask.all()
            if follows and all(allowed(path) for path in paths):
                return one
    return None


def reset_path(start: ArrayLike, setup: Setup, config: PolarCastConfig | None = None) -> GripPath:
    """Return the gripper path of a reset from x, y, z [m], yaw, pitch [rad], shape [5]."""
    config, cable = config or polar_config(setup), setup.cable
    path = PlanePath(check_finite("start", start, 5))
    _lift(path, cable, config).hold(config.hang_time)
    _swing_out(path, PolarReach.reset_radius(setup, config), setup.workspace, config)
    return _pull_back(path, float(reset_pose(setup.workspace)[1]), config).grip_path()


@functools.lru_cache(maxsize=64)
def _followed(setup: Setup, for_casts: bool) -> PolarCastConfig:
    """Return the settings for an arm's reach, or those nearest to them that it can follow."""
    config, pose = PolarCastConfig.of_reach(setup.workspace), reset_pose(setup.workspace)
    y = setup.workspace.support_depth

    def follows(path_of: Callable[..., GripPath], *arguments: object) -> bool:
        with contextlib.suppress(CablecastError):
            return bool(check_grip_paths(path_of(*arguments), setup).mask.all())
        return False

    def resets(settings: PolarCastConfig) -> bool:
        return any(follows(reset_path, pose, setup, settings.slowed(t)) for t in _SLOWDOWNS)

    def casts(settings: PolarCastConfig) -> bool:
        return follows(_cast_path, PolarCast(0.0, 0.0, y, CAST_PACE), setup, settings)

    found = config if resets(config) else None
    if found and (not for_casts or casts(config)):
        return config
    for place in _PLACES:
        moved = config.moved(*place)
        if not casts(moved.paced(_VERY_SLOW, _VERY_SLOW)):
            continue
        for settings in (moved.paced(*times) for times in _TIMES):
            if not resets(settings):
                continue
            if not for_casts or casts(settings):
                return settings
            found = found or settings
    return found or config


def plan_reset(start: ArrayLike, setup: Setup, config: PolarCastConfig | None = None) -> Trajectory:
    """Plan one reset down to joint set points; see `reset_path`.

    It is as quick as the settings say, or as slow as the limits of the arm's joints demand.

    Raises:
        JointLimitError: The arm cannot follow; the message names each limit with its value.
    """
    config = config or polar_config(setup)
    *quicker, slowest = _SLOWDOWNS

    def planned(times: float, what: str) -> Trajectory:
        path = reset_path(start, setup, config.slowed(times))
        return Trajectory(action=None, grip_path=path, joint_path=follow(path, setup, what))

    for times in quicker:
        with contextlib.suppress(JointLimitError):
            return planned(times, "this reset")
    return planned(slowest, f"this reset, even {slowest:g} times as slow")
