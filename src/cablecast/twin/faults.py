"""Faults that the twin makes on command, and the phases of a trial in which they may come."""

import dataclasses
from typing import Any

from cablecast.checks import check_keys, check_number
from cablecast.errors import InputError

FAULTS: dict[str, str] = {
    "protective_stop": "protective stop, as after a collision",
    "emergency_stop": "emergency stop button pressed",
    "speed_slider": "speed slider at 50 %",
    "wrong_payload": "payload set to 0 kg on the controller",
    "lost_packets": "reports of the controller are lost for 1 s",
    "late_packets": "reports of the controller come 0.3 s late",
    "network_lost": "nothing passes between computer and controller for 5 s",
    "controller_dies": "controller without power",
    "controller_restarts": "controller without power for 3 s, then up again",
    "cable_slips": "the cable slips in the jaws",
    "crooked_reset": "the reset leaves the cable 15 deg aside",
    "camera_frozen": "the camera sends the same picture again and again",
    "camera_black": "the camera sees nothing",
    "camera_unplugged": "the camera's stream ends",
    "camera_exposed": "something changes the camera's exposure",
    "camera_moved_tag": "somebody moves a tag",
}
"""Faults of the twin, each in words."""

PHASES = ("idle", "reset", "approach", "cast", "settle", "readout", "now")
"""Phases that a fault may wait for: the arm stands, the reset's motion, the hold at the start of a
cast, the cast's motion, the time in which the cable comes to rest, and the end of the film. "now"
waits for nothing."""


@dataclasses.dataclass(frozen=True)
class Fault:
    """One fault that waits for its moment.

    Attributes:
        name: One of `FAULTS`.
        phase: One of `PHASES`.
        after: Time from the begin of the phase to the fault [s].
    """

    name: str
    phase: str = "now"
    after: float = 0.0

    def __post_init__(self):
        if self.name not in FAULTS:
            raise InputError(f"unknown fault {self.name[:40]!r}: one of {', '.join(FAULTS)}")
        if self.phase not in PHASES:
            raise InputError(f"unknown phase {self.phase[:40]!r}: one of {', '.join(PHASES)}")
        check_number("fault after", self.after, 0.0, 600.0, "s")

    @classmethod
    def from_dict(cls, values: Any) -> "Fault":
        """Return the fault that plain values describe.

        Raises:
            InputError: A key or a value is unknown.
        """
        values = check_keys(values, {"name", "phase", "after"}, "fault", required={"name"})
        for name in ("name", "phase"):
            if name in values and not isinstance(values[name], str):
                raise InputError(f"fault {name} must be text")
        return cls(**values)
