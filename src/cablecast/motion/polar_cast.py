"""Polar casting: swing the hanging cable out in a vertical plane, then pull it back slowly.

The paper's baseline (section VI-A) and the last step of its reset (section V-A). From wherever the
gripper is, it lifts the cable until its free end hangs clear of the table, lets it come to rest,
swings it forward so that it is laid out straight along the azimuth of the target, and drags it
towards the robot until its endpoint is as far from the base as the target.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.ur5 import ArmUR5
from cablecast.cable import Cable
from cablecast.conventions import GRAVITY, polar_to_xy, xy_to_polar
from cablecast.errors import InputError, JointLimitError
from cablecast.motion.action import MotionConfig
from cablecast.motion.feasibility import check_grip_paths
from cablecast.motion.grip_path import GripPath
from cablecast.motion.joint_path import joint_path
from cablecast.motion.plane_path import PlanePath
from cablecast.motion.trajectory import Trajectory
from cablecast.workspace import Workspace

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Swing:
    """The fixed casting motion in the vertical plane, by the points it passes.

    It draws the gripper back, throws it forward and up, tips it up and lowers it behind the cable
    that flies out, and sets it down. Heights run from 0 where the gripper comes down to 1 where the
    cable hangs, radii likewise, so that one swing serves every cable and every landing.

    The points were searched with the fast engine over the three presets, with cables of other mass,
    stiffness and friction than believed, with servos that lag behind and with swings up to 4 %
    faster or slower, from the states in which lifts left the cable swinging a little: for the cable
    to come down taut and straight. A cable that lands slack folds to one side, and magnifies how it
    swung aside before.

    Attributes:
        durations: From each point to the next [s]; the first from the hanging cable to the first
            point, the last to the gripper's rest.
        draw_back: How far the gripper is drawn back at the first point [m].
        radii: Share of the way out at the second and the third point [-].
        heights: Share of the hanging height at the three points [-].
        pitches: Pitch of the gripper at the three points [rad]; it is level at both ends.
    """

    durations: tuple[float, float, float, float] = (0.809, 0.213, 0.497, 0.569)
    draw_back: float = 0.072
    radii: tuple[float, float] = (0.371, 1.129)
    heights: tuple[float, float, float] = (1.207, 0.996, 0.929)
    pitches: tuple[float, float, float] = (0.560, 0.511, 0.996)

    @property
    def duration(self) -> float:
        """Time from the hanging cable to the gripper's rest [s]."""
        return sum(self.durations)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolarCastConfig:
    """Settings of the lift, the swing and the pull.

    The lift keeps the free end on the table for as long as it can (section V-A), for a cable that
    comes off the table aslant swings like a pendulum, which three seconds do not still: the gripper
    drags the cable near the base, rises until the free end must be where the cable shall hang,
    follows an arc about it, a little inside the cable's length, and goes straight up from there.
    The last rise is slow where the free end leaves the table: the lower the speed, the nearer to
    the plumb line the table has let it slide by then. The defaults were searched with the fast
    engine after 10 casts, with cables of other mass, stiffness and friction than believed, for the
    hanging cable to swing the least.

    Attributes:
        hang_radius: Where the cable hangs, from the base axis [m].
        clearance: How far the hanging cable's lowest point would keep above the table if it hung
            straight [m]; its bend at the gripper lifts it by some 10 mm more.
        hang_height_max: How high the arm lifts at most [m]; a longer cable keeps its end on the
            table.
        carry_height: Height at which the cable is carried in front of the base [m].
        carry_radius: Where it is carried to [m].
        carry_speed: Mean speed of that [m/s].
        carry_time_min: It takes at least this long, and so does the rise before it: a faster rise
            near the base asks too much of the wrist [s].
        draw_radius: Where it is dragged to at that height [m].
        rise_radius: Where the gripper is while it rises [m].
        arc_share: Share of the cable's length at which the arc about the free end closes [-].
        bend_out_share, bend_up_share: Shares of `bend_offsets` that the place of the free end and
            the cable's length allow for [-].
        draw_time, rise_time, arc_time, lift_time: How long these moves and the last, straight lift
            take [s].
        hang_time: How long the cable hangs to come to rest [s] (section V-A).
        swing: The casting motion.
        cast_radius: Where the gripper comes down at most [m]: so far short of r_max that it can
            swing out beyond, and that the elbow is not stretched.
        reach_margin: The swing's outermost point keeps this far within r_max [m]: the spline
            through it goes on by a little less.
        table_margin: How far inside the table's edges the cable's endpoint lands at least [m].
        settle_time: From the end of the swing to the pull [s].
        pull_speed: Mean speed of the slow pull [m/s].
        pull_time_min: It takes at least this long [s].
    """

    hang_radius: float = 0.483
    clearance: float = 0.005
    hang_height_max: float = 0.73
    carry_height: float = 0.19
    carry_radius: float = 0.784
    carry_speed: float = 0.50
    carry_time_min: float = 0.7
    draw_radius: float = 0.359
    rise_radius: float = 0.265
    arc_share: float = 0.981
    bend_out_share: float = 0.379
    bend_up_share: float = 0.593
    draw_time: float = 0.919
    rise_time: float = 1.293
    arc_time: float = 1.505
    lift_time: float = 3.727
    hang_time: float = 3.0
    swing: Swing = dataclasses.field(default_factory=Swing)
    cast_radius: float = 0.88
    reach_margin: float = 0.01
    table_margin: float = 0.01
    settle_time: float = 0.5
    pull_speed: float = 0.12
    pull_time_min: float = 0.5

    def __post_init__(self):
        for name, low, high in (
            ("hang_radius", 0.2, 0.9),
            ("carry_radius", 0.2, 0.9),
            ("draw_radius", 0.2, 0.9),
            ("rise_radius", 0.1, 0.9),
            ("arc_share", 0.5, 1.0),
            ("bend_out_share", 0.0, 2.0),
            ("bend_up_share", 0.0, 2.0),
            ("draw_time", 0.2, 30.0),
            ("rise_time", 0.2, 30.0),
            ("arc_time", 0.2, 30.0),
            ("clearance", 0.0, 0.3),
            ("hang_height_max", 0.1, 2.0),
            ("carry_height", 0.02, 0.5),
            ("carry_speed", 0.01, 1.0),
            ("carry_time_min", 0.1, 10.0),
            ("lift_time", 0.2, 30.0),
            ("hang_time", 0.1, 30.0),
            ("cast_radius", 0.3, 1.5),
            ("reach_margin", 0.0, 0.3),
            ("table_margin", 0.0, 0.5),
            ("settle_time", 0.0, 10.0),
            ("pull_speed", 0.01, 1.0),
            ("pull_time_min", 0.1, 10.0),
        ):
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and low <= value <= high):
                raise InputError(f"polar casting {name} = {value} is outside [{low:g}, {high:g}]")

    def hang_height(self, cable: Cable) -> float:
        """Height of the gripper above the table while the cable hangs [m]."""
        height = cable.length + cable.attachment_length + self.clearance
        return min(height, self.hang_height_max)


def lift(path: PlanePath, cable: Cable, config: PolarCastConfig, azimuth: float = 0.0) -> PlanePath:
    """Append: from anywhere low to the cable hanging in the plane at an azimuth [rad]."""
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
    # The free end is dragged to below the place where it shall hang, and there it stays.
    bend_out, bend_up = bend_offsets(cable)
    end_radius = config.hang_radius + config.bend_out_share * bend_out
    length = cable.length + cable.attachment_length - config.bend_up_share * bend_up
    length = min(length, hang_height / config.arc_share)
    aside = end_radius - config.rise_radius
    path.move(
        config.rise_time,
        radius=config.rise_radius,
        height=float(np.sqrt(max(length**2 - aside**2, config.carry_height**2))),
    )
    share = np.linspace(0.0, 1.0, 7)[1:]
    first, last = (
        float(np.arcsin(min(way / length, 1.0))) for way in (aside, end_radius - config.hang_radius)
    )
    angle = first + (last - first) * share
    reach = length * (1.0 - (1.0 - config.arc_share) * share)
    path.through(
        (config.arc_time * share).tolist(),
        radius=(end_radius - reach * np.sin(angle)).tolist(),
        height=(reach * np.cos(angle)).tolist(),
    )
    return path.move(config.lift_time, radius=config.hang_radius, height=hang_height)


def bend_offsets(cable: Cable) -> tuple[float, float]:
    """How far a cable that leaves the gripper level hangs in front of it, and how much higher.

    The elastica that turns from level to straight down under a tension T, which is the weight of
    the cable and its attachment at the bend: with b = sqrt(E I / T) it ends sqrt(2) b in front of
    its clamp, and (2 - sqrt(2)) b less far down than its length.

    Args:
        cable: Its parameters are what is believed of it.

    Returns:
        Both lengths [m].
    """
    params = cable.params
    tension = GRAVITY * (float(params.mass) + float(params.endpoint_mass))
    bend = float(np.sqrt(float(params.bend_stiffness) / tension))
    return float(np.sqrt(2.0)) * bend, (2.0 - float(np.sqrt(2.0))) * bend


def swing_out(
    path: PlanePath, radius: float, workspace: Workspace, config: PolarCastConfig
) -> PlanePath:
    """Append the swing: the gripper comes down at a radius [m], then the cable settles."""
    swing, place = config.swing, path.place
    low, near = workspace.grip_height, place["radius"]
    # The gripper swings out beyond where it comes down, so that the cable lands taut; but not
    # beyond the arm's reach.
    farthest = max(radius, workspace.r_max - config.reach_margin)
    outer = [min(near + share * (radius - near), farthest) for share in swing.radii]
    path.through(
        np.cumsum(swing.durations).tolist(),
        radius=[near - swing.draw_back, *outer, radius],
        height=[low + s * (place["height"] - low) for s in (*swing.heights, 0.0)],
        pitch=[*swing.pitches, 0.0],
    )
    return path.hold(config.settle_time) if config.settle_time > 0 else path


def pull_back(path: PlanePath, radius: float, config: PolarCastConfig) -> PlanePath:
    """Append the slow pull along the table until the gripper is at a radius [m]."""
    way = abs(radius - path.place["radius"])
    if way < 1e-6:
        return path
    return path.move(max(config.pull_time_min, way / config.pull_speed), radius=radius)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolarReach:
    """Where polar casting can bring the endpoint of a cable.

    The cast lays the endpoint at most cast_radius + r_c from the base, and inside the table. The
    pull ends where the gripper would run into the table that the robot stands on, at y = 0.466 m,
    so that straight ahead the endpoint is at y = 0.466 m + r_c at least, the limit that the paper
    states. Aside of that the cable lies aslant, and its endpoint may be nearer: the paper's errors
    of polar casting (median 43 %, third quartile 76 %, largest 106 % of the cable's length) are the
    distances of its targets from this region (44, 76, 105 %), not from the half plane beyond
    0.466 m + r_c (63, 97, 118 %).

    Attributes:
        cable_length: r_c [m].
        cast_radius: Where the gripper comes down at most [m].
        grip_y_min: How near to the robot's own table the gripper may come [m].
        half_width: Largest |x| of an endpoint [m].
        y_max: Its largest y [m].
    """

    cable_length: float
    cast_radius: float
    grip_y_min: float
    half_width: float
    y_max: float

    @classmethod
    def of(
        cls, cable: Cable, workspace: Workspace, config: PolarCastConfig | None = None
    ) -> "PolarReach":
        """The region for a cable on a table.

        Raises:
            InputError: It is empty: the cable is too long for the table.
        """
        config = config or PolarCastConfig()
        reach = cls(
            cable_length=cable.length,
            cast_radius=min(config.cast_radius, workspace.r_max),
            grip_y_min=workspace.support_depth,
            half_width=workspace.table_width / 2 - config.table_margin,
            y_max=workspace.table_depth - config.table_margin,
        )
        if reach.landing_radius(0.0) <= reach.pulled_radius(0.0):
            raise InputError(
                f"polar casting reaches nothing with a cable of {cable.length} m: straight ahead "
                f"its endpoint lands at {reach.landing_radius(0.0):.3f} m and can be pulled no "
                f"nearer than {reach.pulled_radius(0.0):.3f} m"
            )
        return reach

    @property
    def radius(self) -> float:
        """Farthest endpoint from the base where no edge of the table is in the way [m]."""
        return self.cast_radius + self.cable_length

    @property
    def area(self) -> float:
        """Of the region [m²]."""
        x, y = self.outline(2000).T
        return float(0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))))

    def contains(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """Which points lie in the region.

        Args:
            xy: Points [m], shape [..., 2].
        """
        xy = np.asarray(xy, dtype=float)
        r, theta = np.moveaxis(xy_to_polar(xy), -1, 0)
        inside = (r <= self.radius) & (np.abs(xy[..., 0]) <= self.half_width)
        inside &= (xy[..., 1] <= self.y_max) & (np.abs(theta) < np.pi / 2)
        return inside & ((r - self.cable_length) * np.cos(theta) >= self.grip_y_min)

    def landing_radius(self, theta: float) -> float:
        """How far from the base the cast lays the endpoint, before the pull [m].

        Args:
            theta: Azimuth [rad].
        """
        sin, cos = abs(np.sin(theta)), np.cos(theta)
        edges = [self.half_width / sin if sin > 0 else np.inf, self.y_max / cos]
        return float(min(self.radius, *edges))

    def pulled_radius(self, theta: float) -> float:
        """How near to the base the endpoint can be pulled [m].

        Args:
            theta: Azimuth [rad].
        """
        return float(self.grip_y_min / np.cos(theta) + self.cable_length)

    @property
    def theta_max(self) -> float:
        """The azimuth up to which the cable can be cast and pulled [rad]."""
        low, high = 0.0, float(np.pi / 2)
        for _ in range(60):
            middle = (low + high) / 2
            reached = self.landing_radius(middle) > self.pulled_radius(middle)
            low, high = (middle, high) if reached else (low, middle)
        return low

    def outline(self, count: int = 200) -> Array:
        """Points all around the region, from the right end along the far bound and back.

        Args:
            count: How many on each bound.

        Returns:
            x, y [m], shape [2 count, 2].
        """
        theta = np.linspace(self.theta_max, -self.theta_max, count)
        bounds = [
            polar_to_xy(np.stack([[radius(t) for t in angles], angles], axis=-1))
            for radius, angles in (
                (self.landing_radius, theta),
                (self.pulled_radius, theta[::-1]),
            )
        ]
        return np.concatenate(bounds)

    def nearest(self, xy: ArrayLike) -> Array:
        """The points of the region that come nearest to some points.

        Args:
            xy: Points [m], shape [..., 2].
        """
        xy = np.asarray(xy, dtype=float)
        near = xy.reshape(-1, 2).copy()
        # Project on every edge of a fine outline; its chords leave the curves by less than 1 um.
        start = self.outline(1000)
        edge = np.roll(start, -1, axis=0) - start
        length2 = np.maximum(np.sum(edge**2, axis=1), 1e-30)
        for row in np.flatnonzero(~self.contains(near)):
            share = np.clip(np.sum((near[row] - start) * edge, axis=1) / length2, 0.0, 1.0)
            places = start + share[:, None] * edge
            near[row] = places[np.argmin(np.sum((places - near[row]) ** 2, axis=1))]
        return near.reshape(xy.shape)


def polar_cast_path(
    endpoint_xy: ArrayLike,
    cable: Cable,
    workspace: Workspace,
    config: PolarCastConfig | None = None,
    start: ArrayLike | None = None,
) -> GripPath:
    """The whole motion that brings the endpoint to a place within `PolarReach`.

    Args:
        endpoint_xy: Where the endpoint shall come to rest [m], shape [2].
        cable: Gives the lengths.
        workspace: Table and arm.
        config: Settings.
        start: Pose that the motion starts from (x, y, z, yaw, pitch); the reset pose where None.

    Raises:
        InputError: The place lies outside the region.
    """
    config = config or PolarCastConfig()
    reach = PolarReach.of(cable, workspace, config)
    endpoint_xy = np.asarray(endpoint_xy, dtype=float)
    # A point on the outline may lie outside by rounding.
    if np.max(np.abs(reach.nearest(endpoint_xy) - endpoint_xy)) > 1e-6:
        x, y = endpoint_xy.tolist()
        raise InputError(
            f"polar casting does not reach ({x:.3f}, {y:.3f}) m: r must be at most "
            f"{reach.radius:.3f} m, and the gripper's y at least {reach.grip_y_min:.3f} m, on the "
            "table"
        )
    r, theta = xy_to_polar(endpoint_xy).tolist()
    path = PlanePath(reset_pose(workspace) if start is None else start)
    lift(path, cable, config, theta).hold(config.hang_time)
    swing_out(path, reach.landing_radius(theta) - cable.length, workspace, config)
    return pull_back(path, r - cable.length, config).grip_path()


def reset_pose(workspace: Workspace) -> Array:
    """x, y, z, yaw, pitch of the gripper after a reset [m], [rad], shape [5]."""
    return np.array([0.0, workspace.reset_y, workspace.grip_height, 0.0, 0.0])


def plan_polar_cast(
    endpoint_xy: ArrayLike,
    cable: Cable,
    workspace: Workspace,
    config: PolarCastConfig | None = None,
    motion: MotionConfig | None = None,
    arm: ArmUR5 | None = None,
) -> Trajectory:
    """Like `polar_cast_path`, down to joint set points.

    Raises:
        InputError: The place lies outside the region.
        JointLimitError: The arm cannot follow; the message names each limit with its value.
    """
    grip_path = polar_cast_path(endpoint_xy, cable, workspace, config)
    return follow(grip_path, workspace, motion, arm, "polar casting")


def follow(
    grip_path: GripPath,
    workspace: Workspace,
    motion: MotionConfig | None,
    arm: ArmUR5 | None,
    what: str,
) -> Trajectory:
    """A path with the joint set points that follow it.

    Raises:
        JointLimitError: The arm cannot follow; the message names each limit with its value.
    """
    feasibility = check_grip_paths(grip_path, workspace, arm)
    if not feasibility.mask[0]:
        raise JointLimitError(f"the arm cannot follow this {what}: {feasibility.describe(0)}")
    return Trajectory(
        action=None,
        grip_path=grip_path,
        joint_path=joint_path(grip_path, workspace, motion or MotionConfig(), arm),
    )
