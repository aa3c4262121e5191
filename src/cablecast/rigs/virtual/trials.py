"""What differs from trial to trial: the state after the reset, the table, and the arm."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable
from cablecast.motion.grip_path import GripPath
from cablecast.rigs.virtual.config import TrialNoise

# Length of the ramp from the grip to the table in multiples of the grip's height.
_RAMP_RATIO = 6.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """One draw of everything that the laboratory leaves to chance.

    Attributes:
        bow: Sideways bow at the middle of the cable [m].
        sway: Sideways S-shape at the quarters [m].
        angle: Direction of the cable from the grip's yaw [rad].
        friction_factor: Multiplies the friction [-].
        path_factor: Multiplies how far the gripper moves [-].
        time_factor: Multiplies how long it takes [-].
        delay: Added to the arm's lag [s].
    """

    bow: float
    sway: float
    angle: float
    friction_factor: float
    path_factor: float
    time_factor: float
    delay: float

    @classmethod
    def draw(cls, noise: TrialNoise, seed: int, index: int) -> "Trial":
        """The index-th trial of a rig with a seed; equal arguments give equal trials."""
        rng = np.random.default_rng([seed, index])
        # Beyond three standard deviations a person would repeat the reset.
        n = np.clip(rng.normal(size=7), -3.0, 3.0)
        return cls(
            bow=noise.bow * n[0],
            sway=noise.sway * n[1],
            angle=noise.angle * n[2],
            friction_factor=float(np.exp(noise.friction * n[3])),
            path_factor=float(np.exp(noise.path_scale * n[4])),
            time_factor=float(np.exp(noise.time_scale * n[5])),
            delay=noise.delay * n[6],
        )


def arm_poses(
    grip_path: GripPath, trial: Trial, arm_lag: float, dt: float, step_count: int
) -> NDArray[np.float64]:
    """Where the gripper really is when it is commanded along a path.

    Args:
        grip_path: The command, one row.
        trial: Draw of this trial.
        arm_lag: Time constant of the arm [s].
        dt: Step [s].
        step_count: Number of steps from the beginning of the motion.

    Returns:
        x, y, z [m], yaw, pitch [rad], shape [step + 1, 5].
    """
    from scipy.signal import lfilter

    times = np.arange(step_count + 1) * dt / trial.time_factor
    commanded = grip_path.evaluate(times)[0]
    start = commanded[0]
    decay = np.exp(-dt / max(arm_lag + trial.delay, dt))
    # A first-order lag, begun at rest.
    moved = trial.path_factor * (commanded - start)
    return start + lfilter([1.0 - decay], [1.0, -decay], moved, axis=0)


def reset_shape(
    cable: Cable, grip_path: GripPath, trial: Trial, arc_lengths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Vertices of the cable as a reset leaves it: nearly straight, along the grip's yaw.

    Args:
        cable: Geometry.
        grip_path: Its start gives the grip pose.
        trial: Draw of this trial.
        arc_lengths: Distance of each vertex from the grip along the cable [m], shape [vertex].

    Returns:
        Positions in the base frame [m], shape [vertex, 3].
    """
    start = grip_path.evaluate(grip_path.knots[:, :1])[0, 0]
    drop = start[2] - cable.radius
    # A gentle ramp from the grip to the table; gravity finds the true descent within the settling
    # time. An attachment beyond the cable lies flat on the table in line with it.
    ramp = np.clip(arc_lengths / max(_RAMP_RATIO * abs(drop), 1e-9), 0.0, 1.0)
    height = cable.radius + drop * 0.5 * (1.0 + np.cos(np.pi * ramp))
    height[:2] = start[2]
    step = np.sqrt(np.diff(arc_lengths) ** 2 - np.diff(height) ** 2)
    middle = (arc_lengths[1:] + arc_lengths[:-1]) / 2 / cable.length
    # Slopes of the sideways shapes; all vanish at the grip, which holds the tangent.
    slope = trial.angle * (1.0 - np.exp(-middle / 0.15))
    slope = slope + trial.bow * np.pi / cable.length * np.sin(2 * np.pi * middle)
    slope = slope + trial.sway * 2 * np.pi / cable.length * np.sin(4 * np.pi * middle)
    heading = start[3] + np.where(middle <= 1.0, slope, slope[middle <= 1.0][-1])
    positions = np.empty((len(arc_lengths), 3))
    positions[0, :2] = start[:2]
    positions[1:, 0] = start[0] + np.cumsum(step * np.sin(heading))
    positions[1:, 1] = start[1] + np.cumsum(step * np.cos(heading))
    positions[:, 2] = height
    return positions
