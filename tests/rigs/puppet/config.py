import dataclasses

from cablecast.arm.robot import RobotConfig
from cablecast.errors import check_ranges


@dataclasses.dataclass(frozen=True, kw_only=True)
class RobotPuppet(RobotConfig):
    driver = "puppet"
    string_length: float
    report_dt: float = 0.008

    def __post_init__(self):
        bounds = {"string_length": (0.1, 5.0, "m"), "report_dt": (0.001, 0.02, "s")}
        check_ranges(self, bounds, "robot")
        super().__post_init__()
