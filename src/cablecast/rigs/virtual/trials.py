"""Differences from trial to trial: the state after the reset, the table, and the arm."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.ur import JOINT_COUNT
from cablecast.cable import Cable
from cablecast.rigs.virtual.config import TrialNoise
from cablecast.rigs.virtual.reset_library import ResetLibrary

# Length of the ramp from the grip to the table in multiples of the grip's height.
_RAMP_RATIO = 6.0
# Length over which a thick attachment lifts the cable's end [m].
_LIFT_LENGTH = 0.1
# Beyond three standard deviations a person would repeat the reset.
_SIGMA_MAX = 3.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """One draw of everything that the laboratory leaves to chance.

    Attributes:
        key: Seed of the rig and index of the trial, which seed all further draws.
        noise: Deviations from trial to trial.
        bow: Sideways bow at the middle of the cable [m].
        sway: Sideways S-shape at the quarters [m].
        angle: Direction of the cable from the grip's yaw [rad].
        tip_roll: Turn of the lying attachment about the cable [rad].
        curl: Curvature left by earlier trials, in two waves along the cable [1/m], shape [2].
        friction_factor: Factor of the friction [-].
        torque_factor: Factor of the torque of the arm's base joint [-].
    """

    key: tuple[int, int]
    noise: TrialNoise
    bow: float
    sway: float
    angle: float
    tip_roll: float
    curl: tuple[float, float]
    friction_factor: float
    torque_factor: float

    @classmethod
    def draw(cls, noise: TrialNoise, seed: int, index: int) -> "Trial":
        """Draw the index-th trial of a seed; equal arguments give equal trials."""
        rng = np.random.default_rng([seed, index])
        n = np.clip(rng.normal(size=8), -_SIGMA_MAX, _SIGMA_MAX)
        return cls(
            key=(seed, index),
            noise=noise,
            bow=noise.bow * n[0],
            sway=noise.sway * n[1],
            angle=noise.angle * n[2],
            tip_roll=noise.tip_roll * n[3],
            curl=(noise.curl * n[4], noise.curl * n[5]),
            friction_factor=float(np.exp(noise.friction * n[6])),
            torque_factor=float(np.exp(noise.torque * n[7])),
        )

    def rng(self, stream: int) -> np.random.Generator:
        """Return a generator of this trial for one use, told by its number."""
        return np.random.default_rng([*self.key, stream])

    def latencies(self, count: int) -> NDArray[np.float64]:
        """Return the delay of each set point on its way to the arm [s], shape [tick]."""
        return self.noise.latency * np.abs(self.rng(1).normal(size=count))

    def servo_factor(self, count: int) -> NDArray[np.float64]:
        """Return the factor of the frequency of each channel's servo [-], shape [channel]."""
        n = np.clip(self.rng(2).normal(size=JOINT_COUNT), -_SIGMA_MAX, _SIGMA_MAX)
        return np.exp(self.noise.servo * n)[:count]

    def encoder_errors(self, count: int) -> NDArray[np.float64]:
        """Return errors of the reported angles [rad] and rates [rad/s], [2, tick, joint]."""
        scale = np.array([self.noise.encoder, self.noise.encoder * 20.0])
        return scale[:, None, None] * self.rng(3).normal(size=(2, count, JOINT_COUNT))


def reset_shape(
    cable: Cable,
    pose: NDArray[np.float64],
    trial: Trial,
    arc_lengths: NDArray[np.float64],
    end_height: float,
    library: ResetLibrary | None = None,
) -> NDArray[np.float64]:
    """Return the vertices of the cable as a reset leaves it, along the grip's yaw.

    Args:
        cable: Geometry of the cable.
        pose: Pose of the grip at the start: x, y, z [m], yaw, pitch [rad], shape [5].
        trial: Draw of this trial.
        arc_lengths: Distance of each vertex from the grip along the cable [m], shape [vertex].
        end_height: Height of the lying endpoint [m].
        library: States of simulated resets; the shape is drawn, nearly straight, where None.

    Returns:
        Positions in the base frame [m], shape [vertex, 3].
    """
    if library is None:
        local = _drawn_shape(cable, pose[2], trial, arc_lengths, end_height)
    else:
        # A laboratory whose resets are all alike begins from the same one.
        alike = trial.noise.bow == trial.noise.sway == trial.noise.angle == 0.0
        accepted = library.accepted()
        state = int(accepted[0] if alike else trial.rng(4).choice(accepted))
        local = library.resample(state, arc_lengths) + [0.0, 0.0, pose[2]]
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
    arc_lengths: NDArray[np.float64],
    end_height: float,
) -> NDArray[np.float64]:
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
    heading = trial.angle * (1.0 - np.exp(-middle / 0.15))
    heading = heading + trial.bow * np.pi / cable.length * np.sin(2 * np.pi * middle)
    heading = heading + trial.sway * 2 * np.pi / cable.length * np.sin(4 * np.pi * middle)
    positions = np.zeros((len(arc_lengths), 3))
    positions[1:, 0] = np.cumsum(step * np.sin(heading))
    positions[1:, 1] = np.cumsum(step * np.cos(heading))
    positions[:, 2] = height
    return positions


def initial_curl(
    trial: Trial, curl: float, arc_lengths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the curvature of the cable at rest: its own, and what earlier trials left.

    Args:
        trial: Draw of this trial.
        curl: Curvature of its own [1/m].
        arc_lengths: Distance of each vertex from the grip along the cable [m], shape [vertex].

    Returns:
        Sideways and upwards [1/m], shape [2, inner vertex].
    """
    u = arc_lengths[1:-1] / arc_lengths[-1]
    sideways = curl + trial.curl[0] * np.sin(np.pi * u) + trial.curl[1] * np.sin(2 * np.pi * u)
    return np.stack([sideways, np.zeros_like(u)])
