"""RobotUR: the robot section of a lab file for a UR controller."""

import dataclasses
import ipaddress
import re

from cablecast.arm.robot import Point, RobotConfig, point
from cablecast.errors import InputError, check_count, check_ranges

_HOST_NAME = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,250}[A-Za-z0-9])?")


@dataclasses.dataclass(frozen=True, kw_only=True)
class RobotUR(RobotConfig):
    """The controller of a UR arm, and the bounds that the lab file sets to its motion.

    Address, payload and box have no defaults: nobody but the person at the robot knows them.

    Attributes:
        address: Name or address of the controller.
        payload_mass: Mass of gripper and cable, as it is set on the controller [kg].
        payload_cog: Centre of that mass in the flange frame, as set on the controller [m].
        lookahead: Lookahead time of servoj [s].
        gain: Gain of servoj [-].
        watchdog: Longest silence of this computer before the controller stops the arm [s]. Braking
            takes another 0.2 s at most.
        silence_max: Longest time without a report of the controller before the connection counts
            as lost [s]. A twin that draws for its camera may need longer.
        lag_max: Largest distance of a joint from its set point, before the cast is aborted [rad].
        input_register: First of three integer registers of the controller that this computer
            writes, 0 to 45. Fieldbuses own those below 24.
        output_register: First of three integer registers that our programs write, likewise.
    """

    driver = "ur"
    address: str
    payload_mass: float
    payload_cog: Point
    lookahead: float = 0.03
    gain: float = 1000.0
    watchdog: float = 0.2
    silence_max: float = 1.0
    lag_max: float = 0.6
    input_register: int = 24
    output_register: int = 36

    def __post_init__(self):
        if not isinstance(self.address, str) or not _HOST_NAME.fullmatch(self.address):
            raise InputError(
                f"robot address = {str(self.address)[:60]!r} is neither a host name nor an address"
            )
        object.__setattr__(self, "payload_cog", point("robot payload_cog", self.payload_cog))
        check_ranges(
            self,
            {
                "payload_mass": (0.0, 20.0, "kg"),
                "lookahead": (0.03, 0.2, "s"),
                "gain": (100.0, 2000.0, ""),
                "watchdog": (0.04, 1.0, "s"),
                "silence_max": (0.1, 120.0, "s"),
                "lag_max": (0.01, 2.0, "rad"),
            },
            "robot",
        )
        check_count("robot input_register", self.input_register, 0, 45)
        check_count("robot output_register", self.output_register, 0, 45)
        super().__post_init__()

    @property
    def is_loopback(self) -> bool:
        """True where the controller runs on this computer: it is a twin, and no arm."""
        try:
            return ipaddress.ip_address(self.address).is_loopback
        except ValueError:
            return self.address == "localhost"
