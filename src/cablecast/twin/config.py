"""TwinConfig: where the twin listens, and how it behaves."""

import dataclasses

from cablecast.arm.geometry import ARM_MODELS
from cablecast.checks import check_count, check_number, check_seed
from cablecast.errors import InputError

ROBOT_SERVERS = frozenset({"rtde", "dashboard", "program", "program_realtime"})
"""Servers of the controller itself; the rest belong to the laboratory around it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TwinConfig:
    """Settings of a twin.

    Attributes:
        address: Loopback address. ur-rtde has fixed ports, so that two twins at a time need two
            addresses: on Linux, 127.0.0.1 to 127.255.255.254 are all of this computer.
        rtde_port: Port of the Real-Time Data Exchange.
        dashboard_port: Port of the dashboard server.
        program_port: Port that takes programs, the secondary client interface.
        realtime_port: Another port that takes programs, the real-time client interface.
        camera_port: Port of the camera's stream, on 127.0.0.1.
        admin_port: Port that takes faults, and tells the truth to tests.
        rate: Largest speed of the twin's clock [-]: 1 for that of the world, more for tests. It
            runs slower where the simulation cannot keep up, and no faster than the world where no
            client of RTDE is connected.
        patience: Longest time for which the clock waits for a silent client while a program runs
            [s], so that the watchdog does not bark at a busy computer. A real controller waits for
            nobody.
        seed: Seed of what differs from trial to trial.
        lab_seed: Seed of the laboratory.
        segment_count: Segments of the simulated cable.
        has_cable: False for an arm that holds a stick as long as the cable, which is quicker.
        has_camera: False for no camera, whatever the lab file says.
    """

    address: str = "127.0.0.1"
    rtde_port: int = 30004
    dashboard_port: int = 29999
    program_port: int = 30002
    realtime_port: int = 30003
    camera_port: int = 30100
    admin_port: int = 30101
    rate: float = 1.0
    patience: float = 0.0
    seed: int = 0
    lab_seed: int = 0
    segment_count: int = 30
    has_cable: bool = True
    has_camera: bool = True

    def __post_init__(self):
        for field in dataclasses.fields(self):
            if field.name.endswith("_port"):
                check_count(f"twin {field.name}", getattr(self, field.name), 0, 65535)
        check_number("twin rate", self.rate, 0.01, 100.0)
        check_number("twin patience", self.patience, 0.0, 60.0)
        check_seed(self.seed)
        check_seed(self.lab_seed)
        check_count("twin segment_count", self.segment_count, 4, 200)

    @property
    def ports(self) -> dict[str, int]:
        """Port of each server."""
        return {
            "rtde": self.rtde_port,
            "dashboard": self.dashboard_port,
            "program": self.program_port,
            "program_realtime": self.realtime_port,
            "admin": self.admin_port,
        }


def is_e_series(model: str) -> bool:
    """Return whether an arm belongs to the e-Series.

    Raises:
        InputError: There is no such model.
    """
    if model not in ARM_MODELS:
        raise InputError(f"unknown arm model {model[:40]!r}")
    return model.endswith("e")
