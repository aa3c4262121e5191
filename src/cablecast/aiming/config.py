"""AimConfig: the settings of aiming, from which the command line and the page derive theirs."""

import dataclasses
from typing import Literal

from cablecast.errors import InputError, check_count, check_number, check_seed

PACE_RANGE = (0.2, 1.25)
"""Range of the pace of a cast [-]: slower ones land where the slowest does, and take longer. None
is chosen that the arm cannot follow."""

COUNT_MAX = 1_000_000
"""Most casts, simulated casts or candidates of one session."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AimConfig:
    """Settings of aiming.

    Raises:
        InputError: A value is out of bounds.
    """

    within_pct: float = 3.0
    """Distance from the target at which a cast has hit, in % of cable length."""
    tries: int = 6
    """Casts at one target at most."""
    force: bool = False
    """Cast at a target that no simulated cast comes near, too, and use all tries at a target even
    where a cast is expected to miss."""
    refit: bool = True
    """Fit the simulator to all casts, and learn anew from it, before a target where it is worth it:
    at three times as many casts as it was fitted to, or at twice as many if first tries land
    farther off than was stated. Takes a minute; --no-refit keeps the model."""
    calibration_count: int = 5
    """Casts that the rig makes before the first target. With 0 it aims at once with the values of
    the cable's file, and the simulator is fitted to the first casts."""
    simulated_count: int = 8_000
    """Number of simulated casts that the model learns from."""
    epochs: int = 60
    """Largest number of passes of the training over them."""
    candidate_count: int = 20_000
    """Number of motions to choose from."""
    fast: bool = False
    """Only the paper's motions, each as fast as its limits allow. Calm ones of the same paths take
    some seconds longer and repeat better, so they are chosen where they reach."""
    polar: bool = True
    """Make polar casts, too, where they are calmer than sweeps: they lift the cable, swing it out,
    and pull it slowly along the table, which takes 20 s. --fast makes none."""
    seed: int = 0
    """Seed of all random numbers."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Simulate and train on the processor or on an NVIDIA graphics card. Fits stay on the
    processor, which simulates their few hundred worlds faster."""

    def __post_init__(self):
        check_number("within_pct", self.within_pct, 0.01, 100.0, "%")
        check_count("tries", self.tries, 1, 1000)
        check_count("calibration_count", self.calibration_count, 0, COUNT_MAX)
        if self.calibration_count == 1:
            raise InputError(
                "calibration_count is 1: a fit takes at least 2 casts; 0 starts without"
            )
        check_count("simulated_count", self.simulated_count, 50, COUNT_MAX)
        check_count("epochs", self.epochs, 1, COUNT_MAX)
        check_count("candidate_count", self.candidate_count, 1, COUNT_MAX)
        check_seed(self.seed)
        for name in ("force", "refit", "fast", "polar"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name} = {getattr(self, name)!r} must be True or False")

    @property
    def pace(self) -> tuple[float, float]:
        """Range of the pace of casts [-]."""
        return (1.0, 1.0) if self.fast else PACE_RANGE

    @classmethod
    def of(cls, values: "AimConfig") -> "AimConfig":
        """Return the settings alone of an object that has more, such as a command line."""
        names = [field.name for field in dataclasses.fields(AimConfig)]
        return AimConfig(**{name: getattr(values, name) for name in names})
