"""Settings of the virtual laboratory: its numerics, and how far two equal trials differ."""

import dataclasses

import numpy as np

from cablecast.errors import InputError

SENSING_NAMES = ("exact", "error_model", "camera")
"""What the rig sees its cable with: nothing between it and the truth, the measured errors of its
camera, or that camera itself, frame by rendered frame."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrialNoise:
    """Standard deviations of what changes from trial to trial.

    They were set by the scatter of repeated landings on the real table (paper, section VI-B), which
    `cablecast repeat` prints beside ours. Most of it comes from the reset; the rest is kept small,
    since some fast casts magnify any difference, however small.

    Attributes:
        bow: Sideways bow of the cable after a reset, at its middle [m].
        sway: The same for an S-shape, at its quarters [m].
        angle: Direction of the cable after a reset [rad].
        tip_roll: How the attachment comes to lie, turned about the cable [rad].
        curl: Curvature that earlier trials have left in the cable [1/m].
        friction: Relative change of the friction between cable and table [-].
        servo: Relative change of how fast each joint's servo answers [-].
        torque: Relative change of the torque that the base joint can give [-].
        latency: How late a set point reaches the arm [s].
        encoder: Error of a reported joint angle [rad].
    """

    bow: float = 0.002
    sway: float = 0.001
    angle: float = 0.0033
    tip_roll: float = 0.1
    curl: float = 0.04
    friction: float = 0.006
    servo: float = 0.003
    torque: float = 0.003
    latency: float = 0.0002
    encoder: float = 5e-5

    def __post_init__(self):
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            bound = 5.0 if field.name == "curl" else 0.5
            if not (np.isfinite(value) and 0.0 <= value <= bound):
                raise InputError(f"trial noise {field.name} = {value} is outside [0, {bound}]")

    @classmethod
    def none(cls) -> "TrialNoise":
        """A laboratory in which equal motions end equally."""
        return cls(**{field.name: 0.0 for field in dataclasses.fields(cls)})


@dataclasses.dataclass(frozen=True, kw_only=True)
class VirtualConfig:
    """Settings of the virtual laboratory.

    Attributes:
        lab_seed: Which laboratory: another one has another copy of each cable and another table.
            It stays the same while one rig's seed varies, so that data collected today and an
            evaluation tomorrow meet the same cable.
        noise: What changes from trial to trial.
        segment_count: Segments of the discrete rod. Twice as many move a landing by a median of 3 %
            of the cable length; the rod is the world here, so that is no error, but a likeness.
        dt: Step [s]. An eighth of it moves a landing by a median of 0.9 %.
        sample_dt: Time between samples of a track [s]; the paper's camera analysis takes 100 ms.
        reset_time: How long the cable settles after a reset before the motion begins [s].
        rest_time_max: How long after the motion a trial may last [s].
        rest_speed: Below this speed everywhere the cable rests [m/s].
        sensing: What the endpoint is seen with: "exact", "error_model" or "camera".
        thread_count: Threads that trials are spread over; all cores where None. It never changes a
            result.
    """

    lab_seed: int = 0
    noise: TrialNoise = dataclasses.field(default_factory=TrialNoise)
    segment_count: int = 30
    dt: float = 1e-3
    sample_dt: float = 0.1
    reset_time: float = 0.3
    rest_time_max: float = 2.5
    rest_speed: float = 0.002
    sensing: str = "error_model"
    thread_count: int | None = None

    def __post_init__(self):
        if self.sensing not in SENSING_NAMES:
            names = ", ".join(SENSING_NAMES)
            raise InputError(f"virtual rig sensing = {self.sensing!r} is not one of {names}")
        for name, low, high in (
            ("lab_seed", 0, 2**32 - 1),
            ("segment_count", 4, 200),
            ("dt", 1e-5, 2e-3),
            ("sample_dt", 0.01, 1.0),
            ("reset_time", 0.0, 10.0),
            ("rest_time_max", 0.1, 60.0),
            ("rest_speed", 1e-4, 0.1),
            ("thread_count", 1, 1024),
        ):
            value = getattr(self, name)
            if name == "thread_count" and value is None:
                continue
            if not (np.isfinite(value) and low <= value <= high):
                raise InputError(f"virtual rig {name} = {value} is outside [{low:g}, {high:g}]")
