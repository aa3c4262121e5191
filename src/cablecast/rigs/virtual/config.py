"""Settings of the virtual laboratory: its numerics, and how far two equal trials differ."""

import dataclasses

from cablecast.errors import InputError, check_count, check_ranges, check_seed

SENSING_NAMES = ("exact", "error_model", "camera")
"""Ways of seeing the cable: exactly as it is, with the measured errors of the camera, or with that
camera itself, frame by rendered frame."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrialNoise:
    """Standard deviations of what changes from trial to trial.

    They were set by the scatter of repeated landings on the real table (paper, section VI-B), which
    `cablecast repeat` prints beside ours. Most of it comes from the reset. The rest is kept small,
    since some fast casts magnify any difference.

    Attributes:
        bow: Sideways bow of the cable after a reset, at its middle [m].
        sway: Sideways S-shape of the cable after a reset, at its quarters [m].
        angle: Direction of the cable after a reset [rad].
        tip_roll: Turn of the lying attachment about the cable [rad].
        curl: Curvature that earlier trials have left in the cable [1/m].
        friction: Relative change of the friction between cable and table [-].
        servo: Relative change of the response frequency of each joint's servo [-].
        torque: Relative change of the torque of the base joint [-].
        latency: Delay of a set point on its way to the arm [s].
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
        check_ranges(
            self,
            {
                "bow": (0.0, 0.5, "m"),
                "sway": (0.0, 0.5, "m"),
                "angle": (0.0, 0.5, "rad"),
                "tip_roll": (0.0, 0.5, "rad"),
                "curl": (0.0, 5.0, "1/m"),
                "friction": (0.0, 0.5, ""),
                "servo": (0.0, 0.5, ""),
                "torque": (0.0, 0.5, ""),
                "latency": (0.0, 0.5, "s"),
                "encoder": (0.0, 0.5, "rad"),
            },
            "trial noise",
        )

    @classmethod
    def none(cls) -> "TrialNoise":
        """Return the noise of a laboratory in which equal motions end equally."""
        return cls(**{field.name: 0.0 for field in dataclasses.fields(cls)})


@dataclasses.dataclass(frozen=True, kw_only=True)
class VirtualConfig:
    """Settings of the virtual laboratory.

    Attributes:
        lab_seed: Seed of the laboratory: another one has another copy of each cable and another
            table. It stays the same while one rig's seed varies, so that data collected today and
            an evaluation tomorrow meet the same cable.
        noise: Deviations from trial to trial.
        segment_count: Segments of the discrete rod. Twice as many move a landing by a median of 3 %
            of the cable length; the rod is the world here, so that is a matter of likeness.
        dt: Step [s]. An eighth of it moves a landing by a median of 0.9 %.
        sample_dt: Time between samples of a track [s]; the paper's camera analysis takes 100 ms.
        reset_time: Time in which the cable settles between the reset and the motion [s].
        rest_time_max: Longest time from the end of the motion to the end of the trial [s].
        rest_speed: The cable rests while all of it is slower than this [m/s].
        sensing: Way of seeing the endpoint: "exact", "error_model" or "camera".
        stored_resets: Whether trials begin with states that simulated resets left, where there are
            any; otherwise they begin with drawn shapes.
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
    stored_resets: bool = True
    thread_count: int | None = None

    def __post_init__(self):
        if self.sensing not in SENSING_NAMES:
            names = ", ".join(SENSING_NAMES)
            raise InputError(f"virtual rig sensing = {self.sensing!r} is not one of {names}")
        if not isinstance(self.stored_resets, bool):
            raise InputError(
                f"virtual rig stored_resets = {self.stored_resets!r} must be true or false"
            )
        check_seed(self.lab_seed)
        check_count("virtual rig segment_count", self.segment_count, 4, 200)
        if self.thread_count is not None:
            check_count("virtual rig thread_count", self.thread_count, 1, 1024)
        check_ranges(
            self,
            {
                "dt": (1e-5, 2e-3, "s"),
                "sample_dt": (0.01, 1.0, "s"),
                "reset_time": (0.0, 10.0, "s"),
                "rest_time_max": (0.1, 60.0, "s"),
                "rest_speed": (1e-4, 0.1, "m/s"),
            },
            "virtual rig",
        )
