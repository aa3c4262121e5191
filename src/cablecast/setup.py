"""Setup: cable, workspace, arm and motion settings as one object, and as one lab file."""

import dataclasses
import json
import math
import os
import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

from cablecast.arm.base import Arm
from cablecast.arm.description import arm_from_dict
from cablecast.arm.robot import Point, RobotConfig, point
from cablecast.arm.ur import ArmUR
from cablecast.cable import Cable, load_cable
from cablecast.camera.settings import CameraSettings
from cablecast.errors import (
    IKError,
    InputError,
    UnknownNameError,
    check_keys,
    check_number,
    check_ranges,
)
from cablecast.files import parse_yaml, read_text, read_yaml, write_text
from cablecast.workspace import R_MAX_BOUNDS, Workspace

DEFAULT_CABLE = "cable_1"

SECTIONS = ("cable", "workspace", "arm", "motion")
"""Sections that describe a laboratory, and keys of its dictionary form."""

POLAR_SECTION = "polar"
"""Section of the settings of resets and polar casts, where they are not those for arm and cable."""

STRIKE_SECTION = "strike"
"""Section of a laboratory in which a cable is swung in the air."""

_OPTIONAL = (STRIKE_SECTION, POLAR_SECTION)

INSTRUMENTS = ("robot", "camera")
"""Sections that say how to reach what stands in the laboratory; they change no result."""


# Factor of the paper's reach, either way, up to which the paper's radii serve.
_SAME_REACH = 1.05

_NEAR_RADII = ("hang_radius", "draw_radius", "rise_radius")

# Distance of a reset's gripper from the base over r_max: the paper's, and the least at which the
# elbow is not folded.
_RESET_SHARE, _RESET_NEAREST = 0.6 / 0.94, 0.3
# Distance of the lying cable's end from the table's far edge, and of a thick cable from the table
# [m]; and of a reset's pull over the cable's length, which takes out what slack the swing left.
_LYING_MARGIN, _GRIP_CLEARANCE, _PULL_SHARE = 0.01, 0.005, 0.1


@dataclasses.dataclass(frozen=True, kw_only=True)
class MotionConfig:
    """System parameters, fixed before data is collected (paper, section V-E).

    Attributes:
        r0: Distance of the reset position from the polar origin [m]. At the workspace's reset_y
            the origin is the robot's base and theta is the angle of its first joint (section V-B);
            a set-up without motion settings has that.
        v_max: Largest linear speed of the gripped end [m/s] (section V-E).
        jerk: Linear jerk of the gripped end along the arcs [m/s³]. At v_max = 1.5 m/s, full speed
            is reached in 0.32 s and the acceleration peaks at sqrt(jerk v_max) = 9.5 m/s². At 0.6 m
            that is 16 rad/s², which takes half of the 150 N·m of a UR5's base joint.
        wrist_velocity: Largest rate of the wrist turn [rad/s]: 90 % of the joint's 180 deg/s, since
            the wrist joint also compensates the base rotation in excess of theta.
        wrist_jerk: Jerk of the wrist profile [rad/s³], about that of theta at the radius r0.
        control_dt: Control cycle of the arm [s]; 125 Hz on a UR5.
    """

    r0: float = 0.6
    v_max: float = 1.5
    jerk: float = 60.0
    wrist_velocity: float = 2.8
    wrist_jerk: float = 100.0
    control_dt: float = 1 / 125

    def __post_init__(self):
        check_ranges(
            self,
            {
                "r0": (0.1, 5.0, "m"),
                "v_max": (0.05, 5.0, "m/s"),
                "jerk": (0.1, 1e4, "m/s³"),
                "wrist_velocity": (0.1, 20.0, "rad/s"),
                "wrist_jerk": (1.0, 1e4, "rad/s³"),
                "control_dt": (1e-4, 0.1, "s"),
            },
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Swing:
    """Casting motion in the vertical plane, given by three via points.

    The gripper draws back, moves fast forward and up, tips up, follows the flying cable downwards,
    and comes down. Heights run from 0 where it comes down to 1 where the cable hangs; radii run
    from 0 at the hanging cable to 1 at `cast_radius`, where the gripper comes down at most. On a
    table that is short for the cable it comes down nearer, after the same swing.

    The default via points were optimised with the fast engine for the cable to land taut and
    straight. The search covered the three presets, perturbed masses, stiffnesses and frictions,
    lagging servos, swings up to 4 % faster or slower, and the slight swinging that a lift leaves
    behind. A cable that lands slack folds to one side and amplifies its earlier sideways swing.
    `tune_swing` finds via points for another arm, cable and table.

    Attributes:
        durations: Durations between the points [s]: from the hanging cable to the first point, to
            the second, to the third, and to rest.
        draw_back: Distance that the gripper is drawn back at the first point [m].
        radii: Share of the way out at the second and the third point [-].
        heights: Share of the hanging height at the three points [-].
        pitches: Pitch of the gripper at the three points [rad]; it is level at both ends.
    """

    durations: tuple[float, float, float, float] = (0.809, 0.213, 0.497, 0.569)
    draw_back: float = 0.072
    radii: tuple[float, float] = (0.371, 1.129)
    heights: tuple[float, float, float] = (1.207, 0.996, 0.929)
    pitches: tuple[float, float, float] = (0.560, 0.511, 0.996)

    def __post_init__(self):
        bounds = {
            # A swing may be slowed down.
            "durations": (4, 0.01, 100.0, "s"),
            "radii": (2, -5.0, 5.0, ""),
            "heights": (3, 0.0, 3.0, ""),
            "pitches": (3, -1.5, 1.5, "rad"),
        }
        for name, (count, low, high, unit) in bounds.items():
            values, what = getattr(self, name), f"{POLAR_SECTION} swing {name}"
            if not isinstance(values, (list, tuple)) or len(values) != count:
                raise InputError(f"{what} = {str(values)[:60]} must be a list of {count} numbers")
            checked = [check_number(what, value, low, high, unit) for value in values]
            object.__setattr__(self, name, tuple(checked))
        check_ranges(self, {"draw_back": (-1.0, 1.0, "m")}, f"{POLAR_SECTION} swing")

    def slowed(self, factor: float) -> "Swing":
        """Return the same swing that takes so many times as long."""
        return dataclasses.replace(
            self, durations=tuple(factor * duration for duration in self.durations)
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolarCastConfig:
    """Settings of the lift, the swing and the pull.

    The lift keeps the free end on the table as long as possible (section V-A). A cable that leaves
    the table at an angle swings like a pendulum, and three seconds do not damp it out. The gripper
    drags the cable near the base and rises until the free end is below the hanging point. It then
    follows an arc about the free end, slightly smaller than the cable's length, and goes straight
    up. The last rise is slow where the free end leaves the table: at a lower speed, the end has
    slid closer to the plumb line by then. The defaults were optimised with the fast engine after 10
    casts, with perturbed masses, stiffnesses and frictions, for the least swing of the hanging
    cable.

    Attributes:
        hang_radius: Distance of the hanging cable from the base axis [m].
        clearance: Height of the lowest point above the table for a cable that hangs straight [m];
            the bend at the gripper adds about 10 mm.
        hang_height_max: Largest height of the lift [m]; a longer cable keeps its end on the table.
            The default swing rises a fifth higher, where a UR5 can follow it up to 0.71 m.
        carry_height: Height at which the cable is carried in front of the base [m].
        carry_radius: Radius to which it is carried [m].
        carry_speed: Mean speed of the carry [m/s].
        carry_time_min: Shortest duration of the carry and of the rise before it [s]; a faster rise
            near the base demands too much of the wrist.
        draw_radius: Radius to which the cable is dragged at that height [m].
        rise_radius: Radius of the gripper while it rises [m].
        arc_share: Final radius of the arc about the free end, as a share of the cable's length [-].
        bend_out_share, bend_up_share: Shares of the bend at the gripper by which the place of the
            free end and the cable's length are corrected [-].
        draw_time, rise_time, arc_time, lift_time: Durations of these moves and of the final,
            straight lift [s].
        cast_rise_time: Duration of the rise of a polar cast [s], in place of `rise_time`. The cable
            was dragged aside and lies askew of the plane; with a faster rise its free end swings in
            over the base.
        hang_time: Time for the hanging cable to come to rest [s] (section V-A).
        swing: Casting motion.
        cast_radius: Largest radius at which the gripper comes down [m]. It leaves room below r_max
            for the gripper to swing out beyond it and for the elbow to stay bent.
        reach_margin: Distance of the swing's outermost point within r_max [m]; the spline
            overshoots this point by slightly less.
        table_margin: Smallest distance of the landed endpoint from the table's edges [m].
        settle_time: Pause between the swing and the pull [s].
        pull_speed: Mean speed of the slow pull [m/s].
        pull_time_min: Shortest duration of the pull [s].
    """

    hang_radius: float = 0.483
    clearance: float = 0.005
    hang_height_max: float = 0.70
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
    cast_rise_time: float = 3.0
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
        radius, time, speed = (0.05, 5.0, "m"), (0.01, 120.0, "s"), (1e-3, 5.0, "m/s")
        share, length = (0.0, 2.0, ""), (0.0, 1.0, "m")
        bounds = {
            **dict.fromkeys((*_NEAR_RADII, "carry_radius", "cast_radius"), radius),
            **dict.fromkeys(("clearance", "reach_margin", "table_margin"), length),
            **dict.fromkeys(("hang_height_max", "carry_height"), (0.02, 5.0, "m")),
            **dict.fromkeys(("bend_out_share", "bend_up_share"), share),
            "arc_share": (0.5, 2.0, ""),
            **dict.fromkeys(("carry_speed", "pull_speed"), speed),
            **dict.fromkeys(("carry_time_min", "pull_time_min", "draw_time", "rise_time"), time),
            **dict.fromkeys(("cast_rise_time", "arc_time", "lift_time"), time),
            **dict.fromkeys(("hang_time", "settle_time"), (0.0, 120.0, "s")),
        }
        check_ranges(self, bounds, POLAR_SECTION)

    @classmethod
    def of_reach(cls, workspace: Workspace) -> "PolarCastConfig":
        """Return the settings for an arm's reach.

        All radii of a longer arm grow with its reach: so near to its base as the paper's, its
        joints would have to turn faster than they can. A shorter arm cannot go out as far.
        """
        config, share = cls(), workspace.r_max / Workspace().r_max
        if 1.0 / _SAME_REACH <= share <= _SAME_REACH:
            return config
        near = (*_NEAR_RADII, "hang_height_max") if share > 1.0 else ()
        names = ("carry_radius", "cast_radius", *near)
        return dataclasses.replace(config, **{n: share * getattr(config, n) for n in names})

    def moved(self, near: float, height: float, cast: float) -> "PolarCastConfig":
        """Return the settings with radii near the base, height and `cast_radius` multiplied."""
        return dataclasses.replace(
            self,
            hang_height_max=height * self.hang_height_max,
            cast_radius=cast * self.cast_radius,
            **{name: near * getattr(self, name) for name in _NEAR_RADII},
        )

    def paced(self, lift: float, swing: float) -> "PolarCastConfig":
        """Return the settings whose lift and swing take so many times as long."""
        slow = dataclasses.replace(self.slowed(lift), cast_rise_time=lift * self.cast_rise_time)
        return dataclasses.replace(slow, swing=self.swing.slowed(swing))

    def slowed(self, factor: float) -> "PolarCastConfig":
        """Return the same moves, each so many times as long."""
        names = ("carry_time_min", "draw_time", "rise_time", "arc_time", "lift_time")
        return dataclasses.replace(
            self,
            carry_speed=self.carry_speed / factor,
            swing=self.swing.slowed(factor),
            **{name: factor * getattr(self, name) for name in names},
        )

    def hang_height(self, cable: Cable) -> float:
        """Height of the gripper above the table while the cable hangs [m]."""
        height = cable.length + cable.attachment_length + self.clearance
        return min(height, self.hang_height_max)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for a lab file."""
        return json.loads(json.dumps(dataclasses.asdict(self)))

    @classmethod
    def from_dict(cls, values: Any, workspace: Workspace) -> "PolarCastConfig":
        """Make the settings from plain values; missing keys take those for an arm's reach."""
        known = {field.name for field in dataclasses.fields(cls)}
        values = dict(check_keys(values, known, POLAR_SECTION))
        if "swing" in values:
            what = f"{POLAR_SECTION} swing"
            known = {field.name for field in dataclasses.fields(Swing)}
            values["swing"] = swing = Swing(**check_keys(values["swing"], known, what))
            for duration in swing.durations:
                check_number(f"{what} durations", duration, 0.1, 10.0, "s")
        return dataclasses.replace(cls.of_reach(workspace), **values)


_Pair = tuple[float, float]


@dataclasses.dataclass(frozen=True, kw_only=True)
class StrikeConfig:
    """A stick on the flange, from whose end a cable hangs, and the joint moves that swing it.

    The arm stands where the cable can hang and swing: on a post, or at the edge of a table. Heights
    are those of the base frame, as everywhere.

    Attributes:
        stick_length: Distance along the flange's z from the flange to the cable's root [m].
        stick_radius: Half the diameter of the stick [m].
        start_deg: Joint angles at the start of each swing [deg], shape [joint]. The default is that
            of a UR whose stick points down.
        joints: Names of the joints that move. Their axes are parallel, so that the cable swings in
            one plane.
        speed: Least and largest speed of the joint that moves most [rad/s].
        turns_deg: Turn of each of them from the start, at both ends of its range [deg], shape
            [joint that moves, 2].
        ramp_time: Duration of speeding up and of slowing down [s].
        watch_time: Time from the start for which a swing is watched [s].
        floor: Height of the floor [m].
        clear_low: Corner of the box in which neither people nor things are, in the base frame:
            smallest x, y, z [m]. A real arm swings only where the cable can never leave it.
        clear_high: Opposite corner [m].
    """

    stick_length: float = 0.5
    stick_radius: float = 0.01
    start_deg: tuple[float, ...] = (0.0, -70.0, 150.0, -170.0, -90.0, 0.0)
    joints: tuple[str, ...] = ("elbow", "wrist_1")
    speed: _Pair = (1.0, 3.0)
    turns_deg: tuple[_Pair, ...] = ((-60.0, -180.0), (60.0, -120.0))
    ramp_time: float = 0.2
    watch_time: float = 2.5
    floor: float = -1.2
    clear_low: Point | None = None
    clear_high: Point | None = None

    def __post_init__(self):
        bounds = {
            "stick_length": (0.0, 2.0, "m"),
            "stick_radius": (1e-3, 0.1, "m"),
            "ramp_time": (0.05, 10.0, "s"),
            "watch_time": (0.5, 20.0, "s"),
            "floor": (-10.0, 2.0, "m"),
        }
        check_ranges(self, bounds, "strike")
        for name in ("clear_low", "clear_high"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, point(f"strike {name}", getattr(self, name)))
        if (self.clear_low is None) != (self.clear_high is None):
            raise InputError("strike needs both clear_low and clear_high, or neither")
        object.__setattr__(self, "joints", _row("joints", self.joints))
        for name, unit, bound in (("start_deg", "deg", 720.0), ("speed", "rad/s", 40.0)):
            values = [
                check_number(f"strike {name}", value, -bound, bound, unit)
                for value in _row(name, getattr(self, name))
            ]
            object.__setattr__(self, name, tuple(values))
        turns = [_row("turns_deg", pair) for pair in _row("turns_deg", self.turns_deg)]
        if len(self.speed) != 2 or not 1e-3 <= self.speed[0] <= self.speed[1]:
            raise InputError(f"strike speed = {list(self.speed)} must be a least and a largest one")
        if len(turns) != len(self.joints) or any(len(pair) != 2 for pair in turns):
            raise InputError(
                f"strike turns_deg must be two angles for each of the {len(self.joints)} joints"
            )
        checked = [
            tuple(check_number("strike turns_deg", value, -720.0, 720.0, "deg") for value in pair)
            for pair in turns
        ]
        object.__setattr__(self, "turns_deg", tuple(checked))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for a lab file."""
        values = json.loads(json.dumps(dataclasses.asdict(self)))
        return {name: value for name, value in values.items() if value is not None}

    @classmethod
    def from_dict(cls, values: Any) -> "StrikeConfig":
        """Make the settings from plain values; missing keys take their defaults."""
        known = {field.name for field in dataclasses.fields(cls)}
        return cls(**check_keys({} if values is None else values, known, STRIKE_SECTION))


def _row(name: str, values: Any) -> tuple[Any, ...]:
    if not isinstance(values, (list, tuple)):
        raise InputError(f"strike {name} = {str(values)[:60]!r} must be a list")
    return tuple(values)


@dataclasses.dataclass(frozen=True, kw_only=True, init=False)
class Setup:
    """Set-up of a laboratory: cable, table, arm and motion settings.

    Attributes:
        cable: Cable in the gripper.
        workspace: Table, reach, reset pose and grip height.
        arm: Robot arm, its mounting and its gripper.
        motion: System parameters of the casting motions.
        robot: Controller of the real arm, and the bounds of its motion; None where there is none.
        camera: Camera above the table; None where there is none.
        strike: Stick and joint moves of a laboratory in which the cable is swung in the air; None
            where it is cast onto a table.
        polar: Lift, swing and pull of resets and polar casts; None for those that `polar_config`
            finds for the arm.
    """

    cable: Cable
    workspace: Workspace
    arm: Arm
    motion: MotionConfig
    robot: RobotConfig | None
    camera: CameraSettings | None
    strike: StrikeConfig | None
    polar: PolarCastConfig | None

    def __init__(
        self,
        *,
        cable: Cable | str | os.PathLike[str] = DEFAULT_CABLE,
        workspace: Workspace | None = None,
        arm: Arm | None = None,
        motion: MotionConfig | None = None,
        robot: RobotConfig | None = None,
        camera: CameraSettings | None = None,
        strike: StrikeConfig | None = None,
        polar: PolarCastConfig | None = None,
    ):
        """Make a set-up; parts that are not given are the paper's, for its arm and cable.

        A cable may be given by the name of a preset, or by the path of a YAML file. A workspace
        that is not given has the reach of the arm; see `fitting_workspace`.

        Raises:
            InputError: The parts do not fit together: the cable is too long for the table or too
                thick for the grip height.
            UnknownNameError: There is no such cable.
        """
        cable = cable if isinstance(cable, Cable) else load_cable(cable)
        arm = ArmUR() if arm is None else arm
        if workspace is None:
            workspace = fitting_workspace(cable, arm, {})
        parts = {
            "cable": cable,
            "workspace": workspace,
            "arm": arm,
            "motion": motion or MotionConfig(r0=workspace.reset_y),
            "robot": robot,
            "camera": camera,
            "strike": strike,
            "polar": polar,
        }
        for name, part in parts.items():
            object.__setattr__(self, name, part)
        if strike is not None:
            # No cable lies on a table.
            _check_hanging(strike, arm)
            return
        end = workspace.reset_y + cable.length
        if workspace.reset_y < workspace.y_min:
            raise InputError(
                f"workspace reset_y = {workspace.reset_y:g} m lies before the table's near edge at "
                f"y = {workspace.y_min:g} m: the gripper would lay the cable down beside the table"
            )
        if end > workspace.y_max:
            raise InputError(
                f"after a reset the cable lies from y = {workspace.reset_y:g} to {end:g} m, beyond "
                f"the table's edge: the table reaches from {workspace.y_min:g} to "
                f"{workspace.y_max:g} m, so {_nearer_hint(workspace, cable)}the cable may be at "
                f"most {workspace.y_max - workspace.reset_y:g} m long{_turned_hint(workspace, end)}"
            )
        if workspace.grip_height < cable.radius:
            raise InputError(
                f"workspace grip_height = {workspace.grip_height:g} m is below the axis of the "
                f"lying cable at {cable.radius:g} m"
            )

    def with_cable(self, cable: Cable | str | os.PathLike[str]) -> "Setup":
        """Return the set-up with another cable, for which its own swing does not count."""
        cable = cable if isinstance(cable, Cable) else load_cable(cable)
        polar = self.polar if cable == self.cable else None
        return dataclasses.replace(self, cable=cable, polar=polar)

    def with_motion(self, **changes: float) -> "Setup":
        """Return the set-up with other values of `MotionConfig`.

        >>> Setup().with_motion(v_max=1.2).motion.v_max
        1.2
        """
        return dataclasses.replace(self, motion=dataclasses.replace(self.motion, **changes))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values by section, which `from_dict` reads."""
        values = {
            "cable": self.cable.to_dict(),
            "workspace": self.workspace.to_dict(),
            "arm": self.arm.to_dict(),
            "motion": dataclasses.asdict(self.motion),
        }
        if self.robot is not None:
            values["robot"] = self.robot.to_dict()
        if self.camera is not None:
            values["camera"] = self.camera.to_dict()
        if self.strike is not None:
            values[STRIKE_SECTION] = self.strike.to_dict()
        if self.polar is not None:
            values[POLAR_SECTION] = self.polar.to_dict()
        return values

    @property
    def strike_section(self) -> StrikeConfig:
        """Stick and joint moves.

        Raises:
            InputError: The set-up has no strike section.
        """
        if self.strike is None:
            raise InputError("the lab file has no strike section: a swing in the air needs one")
        return self.strike

    def to_settings(self) -> dict[str, Any]:
        """Return the plain values that affect results.

        These are all but `measured` of the arm and the sections of `INSTRUMENTS`: a dataset
        resumes after a change of the camera's exposure.
        """
        values = self.to_dict()
        del values["arm"]["measured"]
        return laboratory_sections(values)

    @classmethod
    def from_dict(
        cls, values: Mapping[str, Any], folder: str | os.PathLike[str] | None = None
    ) -> "Setup":
        """Make a set-up from plain values; missing sections and keys take their defaults.

        Args:
            values: Sections by name; `cable` may be a mapping, the name of a preset, or a path.
            folder: Folder to which paths of cable, arm, tags and videos are relative.

        Raises:
            InputError: A key is unknown, or a value out of bounds.
            UnknownNameError: There is no such cable or arm model.
        """
        if isinstance(values, Mapping) and {"length", "diameter"} <= set(values):
            raise InputError(
                "this is a cable, not a laboratory: pass a cable file as --cable, or indent its "
                "lines below `cable:`"
            )
        values = check_keys(values, {*SECTIONS, *INSTRUMENTS, *_OPTIONAL}, "the set-up")
        robot, camera = values.get("robot"), values.get("camera")
        known = {field.name for field in dataclasses.fields(MotionConfig)}
        cable = _cable_of(values, folder)
        arm = arm_from_dict(values.get("arm", {}), folder)
        workspace = fitting_workspace(cable, arm, values.get("workspace", {}))
        motion = check_keys(values.get("motion", {}), known, "motion")
        return cls(
            cable=cable,
            workspace=workspace,
            arm=arm,
            # The arcs are about the robot's base, unless the file says otherwise.
            motion=MotionConfig(**{"r0": workspace.reset_y, **motion}),
            robot=None if robot is None else RobotConfig.from_dict(robot),
            camera=None if camera is None else CameraSettings.from_dict(camera, folder),
            strike=StrikeConfig.from_dict(values[STRIKE_SECTION])
            if STRIKE_SECTION in values
            else None,
            polar=PolarCastConfig.from_dict(values[POLAR_SECTION], workspace)
            if values.get(POLAR_SECTION) is not None
            else None,
        )


def _cable_of(values: Mapping[str, Any], folder: str | os.PathLike[str] | None) -> Cable:
    """Return the cable of a lab file, given by its name, a path or its keys."""
    cable = values.get("cable", DEFAULT_CABLE)
    if not isinstance(cable, str):
        return Cable.from_dict(cable)
    local = pathlib.Path(folder or ".") / cable
    return load_cable(local if local.is_file() else cable)


def laboratory_sections(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the sections of some settings that describe a laboratory."""
    names = (*SECTIONS, *(name for name in _OPTIONAL if name in values))
    return {name: values[name] for name in names}


def _check_hanging(strike: StrikeConfig, arm: Arm) -> None:
    """Refuse a strike of other joints than the arm's."""
    if len(strike.start_deg) != arm.joint_count:
        raise InputError(
            f"strike start_deg has {len(strike.start_deg)} angles, {arm.model} {arm.joint_count} "
            "joints"
        )
    for name in strike.joints:
        if name not in arm.joint_names:
            known = ", ".join(arm.joint_names)
            raise InputError(f"strike joint {str(name)[:40]!r} is none of the arm's: {known}")


def _nearer_hint(workspace: Workspace, cable: Cable) -> str:
    """Return that the cable fits after a nearer reset; empty if it does not."""
    farthest = math.floor(100 * (workspace.y_max - cable.length - _LYING_MARGIN)) / 100
    if farthest < max(workspace.y_min, _RESET_NEAREST * workspace.r_max):
        return ""
    return f"leave reset_y out, or set it to {farthest:g} m at most; with this reset_y "


def _turned_hint(workspace: Workspace, end: float) -> str:
    """Return that a turned table would hold a cable that ends at a y [m]; empty if it would not."""
    turned = dataclasses.replace(workspace, table_yaw_deg=(workspace.table_yaw_deg + 90.0) % 180.0)
    yaw_deg, depth = turned.table_yaw_deg, turned.y_max - turned.y_min
    hint = f"; with table_yaw_deg = {yaw_deg:g} the table is {depth:g} m deep, and the cable fits"
    return hint if end <= turned.y_max else ""


def fitting_workspace(cable: Cable, arm: Arm, given: Mapping[str, Any]) -> Workspace:
    """Return a workspace whose missing values follow from the arm, the table and the cable.

    The grip lies at the paper's height, or as high above the table as a thicker cable needs. r_max
    is what the arm reaches at that height. After a reset the gripper is at the paper's share of
    r_max, or nearer where the cable, and a pull of a tenth of its length, would reach beyond the
    table's far edge.

    Args:
        cable: Cable.
        arm: Arm.
        given: Values that are known, by name.

    Raises:
        InputError: A key is unknown, a value out of bounds, or the arm holds its gripper down
            nowhere.
    """
    # What follows from the rest is out of the way of what is given.
    farthest = R_MAX_BOUNDS[1]
    out_of_the_way = {"r_max": farthest, "reset_y": given.get("r_max", farthest)}
    known = Workspace.from_dict({**out_of_the_way, **given})
    values = dict(given)
    if "grip_height" not in values:
        values["grip_height"] = max(known.grip_height, cable.radius + _GRIP_CLEARANCE)
    if "r_max" not in values:
        reset_y = given.get("reset_y", Workspace.reset_y)
        pose = np.array([0.0, reset_y, values["grip_height"], 0.0, 0.0])
        try:
            reach = float(arm.inverse_motion(pose, 0.0 * pose, 0.0 * pose).radius_max)
        except IKError as error:
            raise InputError(f"{error}, or state workspace r_max") from None
        values["r_max"] = min(math.floor(100 * (reach + arm.grip_offset)) / 100, 2.0)
        if values["r_max"] < R_MAX_BOUNDS[0]:
            raise InputError(
                f"the arm {arm.model} holds its gripper straight down nowhere at grip_height = "
                f"{pose[2]:g} m: check base_height = {arm.base_height:g} m and gripper_length = "
                f"{arm.gripper_length:g} m"
            )
    if "reset_y" not in values:
        far = known.y_max - (1.0 + _PULL_SHARE) * cable.length - _LYING_MARGIN
        near = max(known.y_min, _RESET_NEAREST * values["r_max"])
        ahead = min(max(_RESET_SHARE * values["r_max"], known.y_min), max(far, near))
        values["reset_y"] = math.floor(100 * ahead + 1e-6) / 100
    return Workspace.from_dict(values)


def load_setup(path: str | os.PathLike[str], cable: Cable | None = None) -> Setup:
    """Return the set-up that a lab file describes.

    Args:
        path: YAML file with the sections of `SECTIONS` and `INSTRUMENTS`, all optional.
        cable: Cable in place of the file's. The section `polar`, which is for the file's, does not
            count for another one.

    Raises:
        UnknownNameError: There is no such file, cable or arm model.
        InputError: The file does not describe a set-up.
    """
    path = pathlib.Path(path)
    try:
        values = read_yaml(path)
        if cable is not None:
            if values.get(POLAR_SECTION) is not None and cable != _cable_of(values, path.parent):
                values = {**values, POLAR_SECTION: None}
            values = {**values, "cable": cable.to_dict()}
        return Setup.from_dict(values, path.parent)
    except FileNotFoundError:
        raise UnknownNameError(f"there is no lab file {path}") from None
    except (InputError, UnknownNameError) as error:
        text = str(error)
        kind = InputError if isinstance(error, InputError) else UnknownNameError
        raise kind(text if str(path) in text else f"{path}: {text}") from None


def save_setup(setup: Setup, path: str | os.PathLike[str]) -> None:
    """Write a set-up as a lab file that `load_setup` reads."""
    text = yaml.safe_dump(setup.to_dict(), sort_keys=False, allow_unicode=True)
    write_text(pathlib.Path(path), text)


def update_lab_file(path: pathlib.Path, changes: Mapping[str, Mapping[str, Any]]) -> None:
    """Set keys of a lab file, and keep every other character of it.

    Args:
        path: Lab file.
        changes: New values by section and key.
    """
    try:
        text = read_text(path)
    except FileNotFoundError as error:
        raise InputError(str(error)) from None
    values = parse_yaml(text, str(path))
    for name, section in changes.items():
        old = values.get(name) or {}
        if not isinstance(old, Mapping):
            raise InputError(f"section `{name}` of {path} must be a mapping to be changed")
        values[name] = {**old, **section}
    try:
        for name, section in changes.items():
            for key, value in section.items():
                text = _with_value(text, name, key, value)
        written = parse_yaml(text, str(path))
    except (InputError, yaml.YAMLError):
        written = None
    if written != values:
        raise InputError(f"{path} cannot be changed: write each section on lines of its own")
    Setup.from_dict(values, path.parent)
    write_text(path, text)


def _with_value(text: str, name: str, key: str, value: Any) -> str:
    """Return the text of a lab file with one key of a section set.

    Libraries that write YAML back, such as ruamel.yaml, indent and align a whole file anew. The
    parser says where each value stands, so that only its characters are replaced.
    """
    root = yaml.compose(text, yaml.SafeLoader)
    section = _entry(root, name)
    if section is None:
        return text.rstrip("\n") + f"\n{name}:\n  {key}:{_written(value, 2)}\n"
    if not isinstance(section, yaml.MappingNode):
        return _replaced(text, section, f"\n  {key}:{_written(value, 2)}")
    if section.flow_style:
        if (old := _entry(section, key)) is not None:
            return _replaced(text, old, _flow(value))
        end = section.end_mark.index - 1
        comma = ", " if section.value else ""
        return f"{text[:end].rstrip()}{comma}{key}: {_flow(value)}{text[end:]}"
    indent = section.start_mark.column
    new = _written(value, indent)
    if (old := _entry(section, key)) is None:
        end = text.find("\n", _end(section))
        end = len(text) if end < 0 else end
        return f"{text[:end]}\n{' ' * indent}{key}:{new}{text[end:]}"
    if isinstance(old, yaml.CollectionNode) and not old.flow_style:
        # It starts on a line of its own, maybe after a comment.
        new = _written(value, indent, old.start_mark.column).lstrip()
    elif not new.startswith("\n"):
        new = new.lstrip()
    return _replaced(text, old, new)


def _entry(mapping: yaml.Node | None, name: str) -> yaml.Node | None:
    """Return the value of a key, None where there is none."""
    pairs = mapping.value if isinstance(mapping, yaml.MappingNode) else []
    return next((value for key, value in pairs if key.value == name), None)


def _replaced(text: str, node: yaml.Node, new: str) -> str:
    return text[: node.start_mark.index] + new + text[_end(node) :]


def _end(node: yaml.Node) -> int:
    """Return where the last character of a node stands, before the comments that follow it."""
    while isinstance(node, yaml.CollectionNode) and not node.flow_style:
        last = node.value[-1]
        node = last[1] if isinstance(last, tuple) else last
    return node.end_mark.index


def _written(value: Any, indent: int, column: int | None = None) -> str:
    """Return a value as it follows the colon of its key: on the same line, or in a block below.

    The key stands in column `indent`, a block two columns right of it where `column` is None.
    """
    start = "\n" + " " * (indent + 2 if column is None else column)
    if isinstance(value, Mapping) and value:
        return start + start.join(f"{key}: {_flow(item)}" for key, item in value.items())
    if isinstance(value, list | tuple) and any(isinstance(item, Mapping) for item in value):
        return start + start.join(f"- {_flow(item)}" for item in value)
    return f" {_flow(value)}"


def _flow(value: Any) -> str:
    """Return a value on one line."""
    text = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, allow_unicode=True, width=1e9
    )
    return text.removesuffix("...\n").strip()
