"""Differences from trial to trial: the state after the reset, the table, and the arm."""

import dataclasses

import numpy as np

from cablecast.cable import Cable
from cablecast.conventions import Array
from cablecast.errors import check_count, check_seed
from cablecast.rigs.base import RigLifecycle, purpose_seed
from cablecast.rigs.checked import RETRY_STRIDE
from cablecast.rigs.virtual._hidden import HiddenCable, HiddenTable
from cablecast.rigs.virtual.config import TrialNoise

ASIDE_MAX = 0.012
"""Largest distance of an accepted reset's endpoint from straight ahead [m]: a camera sees a larger
one, and the reset is done again."""

RESET_WAVES = np.array([1.0, 1.0, 0.5, 0.5, 0.5, 0.3, 0.3])
"""Deviations of the heading that a reset leaves along a cable, as multiples of its spread: where it
comes down from the grip, and in six sines of whole half waves. Simulated resets left these, within
a factor of two."""

# Length of the ramp from the grip to the table in multiples of the grip's height.
_RAMP_RATIO = 6.0
# Length over which a thick attachment lifts the cable's end [m].
_LIFT_LENGTH = 0.1
# Beyond three standard deviations a person would repeat the reset.
_SIGMA_MAX = 3.0


class RigOfTrials(RigLifecycle):
    """A rig whose n-th trial of a purpose draws from the seed, the purpose and n.

    Trials of two purposes have nothing in common; those of an equal index and purpose are equal, so
    that a collection that goes on after a stop draws what it would have drawn.

    Args:
        seed: Seed of what differs from trial to trial.

    Raises:
        InputError: The seed is out of bounds.
    """

    def __init__(self, seed: int):
        super().__init__()
        self.seed = check_seed(seed)
        self._purpose, self._trial_count = "", 0

    def seek(self, index: int, purpose: str = "") -> None:
        """Let the next trial be the index-th of a purpose.

        Raises:
            InputError: The index is negative, or there is no such purpose.
        """
        self._check_open()
        # Refuses what is no purpose.
        purpose_seed(self.seed, purpose)
        self._purpose = purpose
        self._trial_count = check_count("trial index", index, 0)

    @property
    def _next(self) -> tuple[int, int]:
        """Seed of the purpose, and index of the next trial."""
        return purpose_seed(self.seed, self._purpose), self._trial_count


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """One draw of everything that the laboratory leaves to chance.

    Attributes:
        key: Seed of the rig and index of the trial, which seed all further draws.
        noise: Deviations from trial to trial.
        tip_roll: Turn of the lying attachment about the cable [rad].
        curl: Curvature left by earlier trials, in two waves along the cable [1/m], shape [2].
        friction_factor: Factor of the friction, of which the drift is a part [-].
        torque_factor: Factor of the torque of the arm's base joint [-].
    """

    key: tuple[int, int]
    noise: TrialNoise
    tip_roll: float
    curl: tuple[float, float]
    friction_factor: float
    torque_factor: float

    @classmethod
    def draw(cls, noise: TrialNoise, seed: int, index: int, drift: float = 1.0) -> "Trial":
        """Draw the index-th trial of a seed; equal arguments give equal trials.

        The drift is the factor by which the table's friction has changed by then [-].
        """
        rng = np.random.default_rng([seed, index])
        n = np.clip(rng.normal(size=5), -_SIGMA_MAX, _SIGMA_MAX)
        return cls(
            key=(seed, index),
            noise=noise,
            tip_roll=noise.tip_roll * n[0],
            curl=(noise.curl * n[1], noise.curl * n[2]),
            friction_factor=drift * float(np.exp(noise.friction * n[3])),
            torque_factor=float(np.exp(noise.torque * n[4])),
        )

    def rng(self, stream: int) -> np.random.Generator:
        """Return a generator of this trial for the use of a number."""
        return np.random.default_rng([*self.key, stream])

    def latencies(self, count: int) -> Array:
        """Return the delay of each set point on its way to the arm [s], shape [tick]."""
        return self.noise.latency * np.abs(self.rng(1).normal(size=count))

    def servo_factor(self, count: int) -> Array:
        """Return the factor of the frequency of each channel's servo [-], shape [channel]."""
        n = np.clip(self.rng(2).normal(size=max(count, 6)), -_SIGMA_MAX, _SIGMA_MAX)
        return np.exp(self.noise.servo * n)[:count]

    def encoder_errors(self, count: int, joint_count: int) -> Array:
        """Return errors of the reported angles [rad] and rates [rad/s], [2, tick, joint]."""
        scale = np.array([self.noise.encoder, self.noise.encoder * 20.0])
        return scale[:, None, None] * self.rng(3).normal(size=(2, count, joint_count))


DAY_STARTS = {"": 0, "tune": 0, "repeat": 0, "real": 10, "aim": 10}
"""Reading of the table's clock at the first cast of each purpose [casts]: a day begins with ten
casts to calibrate, and what is cast for their sake follows."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Drift:
    """Friction that wanders over the casts, with the wear of the table and the air of the day.

    There is one clock, of a table and a rig's seed, which casts of every purpose read. Its reading
    follows from purpose and number of a cast, so that a session that is resumed goes on with it.

    Attributes:
        amplitude: Largest relative change [-].
        period: Casts in which it goes up and down once.
        start: Phase at the first cast of the day [rad].
    """

    amplitude: float
    period: float
    start: float

    @classmethod
    def of(cls, table: HiddenTable, seed: int) -> "Drift":
        """Return the drift on a table for a rig's seed."""
        start = float(np.random.default_rng([seed, 6]).uniform(0.0, 2 * np.pi))
        return cls(amplitude=table.drift, period=table.drift_period, start=start)

    def factor(self, purpose: str, index: int) -> float:
        """Return the factor of the friction in the index-th cast of a purpose [-]."""
        # A cast that is made again, whose index is larger by a million, follows the failed one.
        count = DAY_STARTS[purpose] + index % RETRY_STRIDE
        return float(np.exp(self.amplitude * np.sin(2 * np.pi * count / self.period + self.start)))


def reset_shape(
    cable: Cable, pose: Array, trial: Trial, arc_lengths: Array, end_height: float, spread: float
) -> Array:
    """Return the vertices of the cable as a reset leaves it, nearly straight along the grip's yaw.

    Args:
        cable: Geometry of the cable.
        pose: Pose of the grip: x, y, z [m], yaw, pitch [rad], shape [5].
        trial: Draw of this trial.
        arc_lengths: Distance of each vertex from the grip along the cable [m], shape [vertex].
        end_height: Height of the lying endpoint [m].
        spread: Standard deviation of the heading that a reset leaves [rad].

    Returns:
        Positions in the base frame [m], shape [vertex, 3].
    """
    local = _drawn_shape(cable, pose[2], trial, arc_lengths, end_height, spread)
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    positions = np.empty_like(local)
    positions[:, 0] = pose[0] + cos * local[:, 0] + sin * local[:, 1]
    positions[:, 1] = pose[1] - sin * local[:, 0] + cos * local[:, 1]
    positions[:, 2] = local[:, 2]
    return positions


def _drawn_shape(
    cable: Cable,
    grip_height: float,
    trial: Trial,
    arc_lengths: Array,
    end_height: float,
    spread: float,
) -> Array:
    """Draw a nearly straight shape, seen from the grip but for its heights [m], [vertex, 3]."""
    drop = grip_height - cable.radius
    # A gentle ramp from the grip to the table; gravity finds the true descent within the settling
    # time.
    ramp = np.clip(arc_lengths / max(_RAMP_RATIO * abs(drop), 1e-9), 0.0, 1.0)
    height = cable.radius + drop * 0.5 * (1.0 + np.cos(np.pi * ramp))
    # A thick attachment lifts the end off the table.
    rest = np.clip((arc_lengths[-1] - arc_lengths) / _LIFT_LENGTH, 0.0, 1.0)
    height += (end_height - cable.radius) * 0.5 * (1.0 + np.cos(np.pi * rest))
    height[:2] = grip_height
    step = np.sqrt(np.diff(arc_lengths) ** 2 - np.diff(height) ** 2)
    middle = (arc_lengths[1:] + arc_lengths[:-1]) / 2 / cable.length
    # Slopes of the sideways shapes; all vanish at the grip, which holds the tangent.
    waves = np.sin(np.pi * np.arange(1, len(RESET_WAVES)) * middle[:, None])
    waves = np.column_stack([1.0 - np.exp(-middle * cable.length / 0.15), waves])
    rng, scale = trial.rng(5), trial.noise.reset * spread
    while True:
        drawn = RESET_WAVES * np.clip(rng.normal(size=len(RESET_WAVES)), -_SIGMA_MAX, _SIGMA_MAX)
        positions = _laid(step, waves @ (scale * drawn), height)
        if abs(positions[-1, 0]) <= ASIDE_MAX:
            return positions


def _laid(step: Array, heading: Array, height: Array) -> Array:
    """Return the vertices of a cable by the headings of its edges [rad]."""
    positions = np.zeros((len(height), 3))
    positions[1:, 0] = np.cumsum(step * np.sin(heading))
    positions[1:, 1] = np.cumsum(step * np.cos(heading))
    positions[:, 2] = height
    return positions


def initial_curl(trial: Trial, truth: HiddenCable, arc_lengths: Array) -> Array:
    """Return the curvature of a cable at rest: its own, and what earlier trials left.

    Returns:
        Sideways and upwards [1/m], shape [2, inner vertex].
    """
    u = arc_lengths[1:-1] / arc_lengths[-1]
    sideways = truth.curl + trial.curl[0] * np.sin(np.pi * u)
    sideways = sideways + trial.curl[1] * np.sin(2 * np.pi * u)
    if truth.kink:
        at = int(np.argmin(np.abs(u - truth.kink_place)))
        sideways[at] += truth.kink / (arc_lengths[at + 2] - arc_lengths[at]) * 2.0
    return np.stack([sideways, np.zeros_like(u)])
