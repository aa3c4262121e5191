"""RobotConfig: where the real arm is, what it carries, and within which bounds it may move."""

import dataclasses
import ipaddress
import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from cablecast.errors import InputError, check_count, check_keys, check_number, check_ranges

Point = tuple[float, float, float]

_HOST_NAME = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,250}[A-Za-z0-9])?")
_OBSTACLE_COUNT_MAX = 20


@dataclasses.dataclass(frozen=True, kw_only=True)
class Obstacle:
    """A capsule that the arm must not touch, such as the post of the camera.

    Attributes:
        start: One end of its axis in the base frame [m].
        end: Other end of its axis in the base frame [m].
        radius: Radius [m].
    """

    start: Point
    end: Point
    radius: float

    def __post_init__(self):
        for name in ("start", "end"):
            object.__setattr__(self, name, _point(f"obstacle {name}", getattr(self, name)))
        check_ranges(self, {"radius": (0.001, 2.0, "m")}, "obstacle")


@dataclasses.dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """The controller of a UR arm, and the bounds that the lab file sets to its motion.

    Address, payload and box have no defaults: nobody but the person at the robot knows them.

    Attributes:
        address: Name or address of the controller.
        payload_mass: Mass of gripper and cable, as it is set on the controller [kg].
        payload_cog: Centre of that mass in the flange frame, as set on the controller [m].
        box_low: Corner of the box that the gripped end and the flange must stay in, in the base
            frame: smallest x, y, z [m].
        box_high: Opposite corner: largest x, y, z [m].
        tool_radius: Radius of a capsule around gripper and cable grip [m].
        obstacles: Capsules that no part of the arm may touch, such as the camera's post.
        clearance: Smallest distance between the arm and the table, an obstacle or itself [m].
        position_margin: Distance that every joint keeps from its limit of position [rad].
        seen_safe: Whether the person has seen casts of this lab file and found them safe. Until
            then the first casts of a session are rehearsed at a quarter of their speed.
        lookahead: Lookahead time of servoj [s].
        gain: Gain of servoj [-].
        watchdog: Longest silence of this computer before the controller stops the arm [s]. Braking
            takes another 0.2 s at most.
        silence_max: Longest time without a report of the controller before the connection counts
            as lost [s]. A twin that draws for its camera may need longer.
        lag_max: Largest distance of a joint from its set point, before the cast is aborted [rad].
        settle_time: Time from the end of a cast to the end of its trial [s].
        input_register: First of three integer registers of the controller that this computer
            writes, 0 to 45. Fieldbuses own those below 24.
        output_register: First of three integer registers that our programs write, likewise.
    """

    address: str
    payload_mass: float
    payload_cog: Point
    box_low: Point
    box_high: Point
    tool_radius: float = 0.04
    obstacles: tuple[Obstacle, ...] = ()
    clearance: float = 0.01
    position_margin: float = 0.05
    seen_safe: bool = False
    lookahead: float = 0.03
    gain: float = 1000.0
    watchdog: float = 0.2
    silence_max: float = 1.0
    lag_max: float = 0.6
    settle_time: float = 2.5
    input_register: int = 24
    output_register: int = 36

    def __post_init__(self):
        if not isinstance(self.address, str) or not _HOST_NAME.fullmatch(self.address):
            raise InputError(
                f"robot address = {str(self.address)[:60]!r} is neither a host name nor an address"
            )
        for name in ("payload_cog", "box_low", "box_high"):
            object.__setattr__(self, name, _point(f"robot {name}", getattr(self, name)))
        check_ranges(
            self,
            {
                "payload_mass": (0.0, 20.0, "kg"),
                "tool_radius": (0.005, 0.3, "m"),
                "clearance": (0.0, 0.5, "m"),
                "position_margin": (0.0, 1.0, "rad"),
                "lookahead": (0.03, 0.2, "s"),
                "gain": (100.0, 2000.0, ""),
                "watchdog": (0.04, 1.0, "s"),
                "silence_max": (0.1, 120.0, "s"),
                "lag_max": (0.01, 2.0, "rad"),
                "settle_time": (0.1, 60.0, "s"),
            },
            "robot",
        )
        check_count("robot input_register", self.input_register, 0, 45)
        check_count("robot output_register", self.output_register, 0, 45)
        if np.any(np.asarray(self.box_low) >= np.asarray(self.box_high)):
            raise InputError(
                f"robot box_low = {list(self.box_low)} must be below box_high = "
                f"{list(self.box_high)} on each axis"
            )
        if not isinstance(self.seen_safe, bool):
            raise InputError(f"robot seen_safe = {self.seen_safe!r} must be true or false")
        if len(self.obstacles) > _OBSTACLE_COUNT_MAX or not all(
            isinstance(obstacle, Obstacle) for obstacle in self.obstacles
        ):
            raise InputError(f"robot obstacles must be at most {_OBSTACLE_COUNT_MAX} capsules")

    @property
    def is_loopback(self) -> bool:
        """True where the controller runs on this computer: it is a twin, and no arm."""
        try:
            return ipaddress.ip_address(self.address).is_loopback
        except ValueError:
            return self.address == "localhost"

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for a lab file."""
        return json.loads(json.dumps(dataclasses.asdict(self)))

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "RobotConfig":
        """Make the settings from plain values."""
        fields = dataclasses.fields(cls)
        required = {f.name for f in fields if f.default is dataclasses.MISSING}
        values = check_keys(values, {f.name for f in fields}, "robot", required=required)
        obstacles = values.get("obstacles", ())
        if not isinstance(obstacles, (list, tuple)):
            raise InputError(f"robot obstacles must be a list, not {str(obstacles)[:40]!r}")
        keys = {"start", "end", "radius"}
        values["obstacles"] = tuple(
            Obstacle(**check_keys(obstacle, keys, "robot obstacle", required=keys))
            for obstacle in obstacles
        )
        return cls(**values)


def _point(name: str, values: Any) -> Point:
    """Return three coordinates within 10 m."""
    if not isinstance(values, (list, tuple)) or len(values) != 3:
        raise InputError(f"{name} = {str(values)[:60]} must be three numbers: x, y, z")
    x, y, z = (check_number(name, value, -10.0, 10.0, "m") for value in values)
    return x, y, z
