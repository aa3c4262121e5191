"""RobotConfig: the bounds of the real arm's motion, and the driver that moves it."""

import dataclasses
import json
import pkgutil
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from cablecast.errors import InputError, check_keys, check_number, check_ranges

Point = tuple[float, float, float]

DRIVERS = {
    "ur": ("cablecast.rigs.ur.config:RobotUR", "cablecast.rigs.ur.driver:DriverUR"),
}
"""Drivers of arms by name: the class of its section of a lab file, and that of the driver."""

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
            object.__setattr__(self, name, point(f"obstacle {name}", getattr(self, name)))
        check_ranges(self, {"radius": (0.001, 2.0, "m")}, "obstacle")


@dataclasses.dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """Bounds that the lab file sets to the motion of a robot; drivers add settings of their own.

    The box has no default: nobody but the person at the robot knows it.

    Attributes:
        driver: Name of the driver in `DRIVERS`.
        box_low: Corner of the box that the gripped end and the flange must stay in, in the base
            frame: smallest x, y, z [m].
        box_high: Opposite corner: largest x, y, z [m].
        tool_radius: Radius of a capsule around gripper and cable grip [m].
        obstacles: Capsules that no part of the arm may touch, such as the camera's post.
        clearance: Smallest distance between the arm and the table, an obstacle or itself [m].
        position_margin: Distance that every joint keeps from its limit of position [rad].
        seen_safe: Whether the person has seen casts of this lab file and found them safe. Until
            then the first casts of a session are rehearsed at a quarter of their speed.
        settle_time: Time from the end of a cast to the end of its trial [s].
    """

    driver: ClassVar[str]
    box_low: Point
    box_high: Point
    tool_radius: float = 0.04
    obstacles: tuple[Obstacle, ...] = ()
    clearance: float = 0.01
    position_margin: float = 0.05
    seen_safe: bool = False
    settle_time: float = 2.5

    def __post_init__(self):
        for name in ("box_low", "box_high"):
            object.__setattr__(self, name, point(f"robot {name}", getattr(self, name)))
        check_ranges(
            self,
            {
                "tool_radius": (0.005, 0.3, "m"),
                "clearance": (0.0, 0.5, "m"),
                "position_margin": (0.0, 1.0, "rad"),
                "settle_time": (0.1, 60.0, "s"),
            },
            "robot",
        )
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

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for a lab file."""
        return {"driver": self.driver, **json.loads(json.dumps(dataclasses.asdict(self)))}

    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> "RobotConfig":
        """Make the settings from plain values, as their `driver` reads them; the default is ur.

        Raises:
            InputError: There is no such driver, a key is unknown, or a value out of bounds.
        """
        driver = values.get("driver", "ur") if isinstance(values, Mapping) else "ur"
        if not isinstance(driver, str) or driver not in DRIVERS:
            raise InputError(
                f"unknown robot driver {str(driver)[:40]!r}: one of {', '.join(DRIVERS)}"
            )
        kind = pkgutil.resolve_name(DRIVERS[driver][0])
        fields = dataclasses.fields(kind)
        required = {f.name for f in fields if f.default is dataclasses.MISSING}
        known = {"driver", *(f.name for f in fields)}
        values = check_keys(values, known, "robot", required=required)
        values.pop("driver", None)
        obstacles = values.get("obstacles", ())
        if not isinstance(obstacles, (list, tuple)):
            raise InputError(f"robot obstacles must be a list, not {str(obstacles)[:40]!r}")
        keys = {"start", "end", "radius"}
        values["obstacles"] = tuple(
            Obstacle(**check_keys(obstacle, keys, "robot obstacle", required=keys))
            for obstacle in obstacles
        )
        return kind(**values)


def point(name: str, values: Any) -> Point:
    """Return three coordinates within 10 m."""
    if not isinstance(values, (list, tuple)) or len(values) != 3:
        raise InputError(f"{name} = {str(values)[:60]} must be three numbers: x, y, z")
    x, y, z = (check_number(name, value, -10.0, 10.0, "m") for value in values)
    return x, y, z
