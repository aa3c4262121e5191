"""ArmDriver: what moves one kind of arm for `RigArm`, and what it reports."""

import dataclasses
import enum
import pkgutil
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.robot import DRIVERS
from cablecast.errors import InputError, RigError
from cablecast.rigs.path import JointCurve
from cablecast.setup import Setup


class RigPhase(enum.IntEnum):
    """What the rig is doing, for a person who looks at the controller, and for the twin."""

    IDLE = 0
    RESET = 1
    CAST = 2
    SETTLE = 3
    READOUT = 4


class CastAbortedError(RigError):
    """A motion that was not carried out as it was meant: it must not become data."""


@dataclasses.dataclass(frozen=True)
class ArmReport:
    """One report of an arm's controller.

    Attributes:
        time: Controller's clock [s].
        host_time: `time.monotonic` of this computer when it was read [s].
        q: Measured joint angles [rad].
        qd: Measured joint rates [rad/s].
        target_q: Set points that the controller follows [rad].
        speed_scaling: Share of the commanded speed at which the arm moves [-].
        safety_bits: Safety status, as the controller numbers it.
        is_playing: True while a motion or a program runs.
    """

    time: float
    host_time: float
    q: NDArray[np.float64]
    qd: NDArray[np.float64]
    target_q: NDArray[np.float64]
    speed_scaling: float
    safety_bits: int
    is_playing: bool

    def __post_init__(self):
        for name in ("q", "qd", "target_q"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))


@dataclasses.dataclass(frozen=True)
class MotionRecord:
    """A motion that was carried out.

    Attributes:
        start_time: Start of the motion by the controller's clock [s].
        reports: All reports from its start to its end.
    """

    start_time: float
    reports: Sequence[ArmReport]


class ArmDriver(Protocol):
    """Moves one kind of arm. It is made of a set-up, checks that, and connects to nothing yet.

    Attributes:
        description: Settings that affect casts, as plain values.
    """

    description: dict[str, Any]

    def ready(self) -> str:
        """Connect where needed, refuse an arm that may not move, and say in words what answered.

        Raises:
            RigError: It may not move; says what a person has to do.
        """
        ...

    def latest(self) -> ArmReport:
        """Return the newest report.

        Raises:
            RigError: None has come for too long.
        """
        ...

    def since(self, when: float) -> Sequence[ArmReport]:
        """Return the reports after a time by the controller's clock, oldest first."""
        ...

    def play(self, name: str, curve: JointCurve, phase: RigPhase) -> MotionRecord:
        """Play a motion to its end, and watch it; the arm stands at its start.

        Whatever happens, the arm must not go on moving when this returns or raises.

        Raises:
            CastAbortedError: The motion was not carried out as it was meant.
            StoppedError: A person is to look first: somebody stopped or moved the arm, something
                holds it, it stopped for safety, or its controller is silent.
        """
        ...

    def check_standing(self) -> None:
        """Refuse an arm that is not as it was when the motion began, from a new report."""
        ...

    def set_phase(self, phase: RigPhase) -> None:
        """Say what the rig is doing; harmless where nobody listens."""
        ...

    def stop(self) -> None:
        """Stop a motion of ours that is under way, at any time; this raises nothing.

        `RigArm` calls it after every motion that did not end well, and when it is closed.
        """
        ...

    def close(self) -> None:
        """Disconnect; may be called twice."""
        ...


def make_driver(setup: Setup, name: str | None = None) -> ArmDriver:
    """Return the driver of a lab file, if its robot may be driven.

    Args:
        setup: Set-up with a robot section.
        name: Driver that the section must be for; any if None.

    Raises:
        InputError: There is no robot, it is of another driver, or its arm was not measured or is
            not one that the driver moves.
    """
    if setup.robot is None:
        raise InputError(
            f"the lab file has no robot section: --rig {name or ' or '.join(DRIVERS)} needs one"
        )
    own = setup.robot.driver
    if name not in (None, own):
        raise InputError(f"--rig {name} needs another lab file: the driver of its robot is {own}")
    driver: ArmDriver = pkgutil.resolve_name(DRIVERS[own][1])(setup)
    if not setup.arm.measured:
        raise InputError(
            "the arm of the lab file is not measured: a motion for another geometry drives the "
            "fingers into the table. Measure its five values, and set measured: true"
        )
    return driver
