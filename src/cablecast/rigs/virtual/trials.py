"""Differences from trial to trial: the state after the reset, the table, and the arm.

A whole reset takes 14 s of simulated time, ten times as long as a cast. So it is played in advance
by tools/make_reset_library.py, many times, each time after another cast, and what is kept is how
the cable came to rest. A trial then starts from one of these states.

Only the presets in the default laboratory have them, and only where the reset moves the gripper as
it did when they were made: another table, or another height of the grip, may ask for another
motion. Any other cable starts from a drawn bow.
"""

import dataclasses
import functools
import io
import json
import pathlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, load_cable
from cablecast.errors import DatasetError, InputError
from cablecast.files import read_bytes, write_bytes
from cablecast.motion.polar import reset_path, reset_pose
from cablecast.rigs.virtual._hidden import HiddenCable, HiddenTable, is_preset
from cablecast.rigs.virtual.config import TrialNoise
from cablecast.setup import Setup

Array = NDArray[np.float64]

FORMAT = "cablecast.reset_library"
FORMAT_VERSION = 1

ASIDE_MAX = 0.012
"""Largest distance of an accepted reset's endpoint from straight ahead [m]: a camera sees a larger
one, and the reset is done again."""
AHEAD_MIN = 0.97
"""Smallest distance ahead of an accepted reset's endpoint, as a share of the cable's length: a
cable that lies nearer is folded."""

RESET_WAVES = np.array([1.0, 1.0, 0.5, 0.5, 0.5, 0.3, 0.3])
"""Deviations of the heading that a reset leaves along a cable, as multiples of its spread: where it
comes down from the grip, and in six sines of whole half waves. Simulated resets left these, within
a factor of two."""

_PATH_TOLERANCE = 1e-9
"""Two reset motions are one if they differ by no more than rounding [m and rad]."""
# Length of the ramp from the grip to the table in multiples of the grip's height.
_RAMP_RATIO = 6.0
# Length over which a thick attachment lifts the cable's end [m].
_LIFT_LENGTH = 0.1
# Beyond three standard deviations a person would repeat the reset.
_SIGMA_MAX = 3.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResetLibrary:
    """States in which resets left one cable.

    Attributes:
        cable: Name of the cable.
        arc_lengths: Distance of each node from the grip along the cable [m], shape [node].
        positions: Nodes seen from the grip: x to its right, y ahead, z up [m], shape
            [state, node, 3].
        before_xy: Endpoint before each reset, in the base frame [m], shape [state, 2].
        info: Settings that the states were computed with.
    """

    cable: str
    arc_lengths: Array
    positions: Array
    before_xy: Array
    info: dict[str, Any]

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def endpoints(self) -> Array:
        """Endpoints seen from the grip, x to the right and y ahead [m], shape [state, 2]."""
        return self.positions[:, -1, :2]

    def accepted(self) -> NDArray[np.intp]:
        """Return the states that a trial may start from: those straight ahead, or all without one.

        Returns:
            Indices, shape [accepted].
        """
        aside, ahead = self.endpoints.T
        stretched = ahead >= AHEAD_MIN * self.arc_lengths[-1]
        near = np.flatnonzero((np.abs(aside) <= ASIDE_MAX) & stretched)
        return near if len(near) else np.arange(len(self))

    def resample(self, index: int, arc_lengths: Array) -> Array:
        """Return one state at other distances from the grip along the cable [m], shape [vertex].

        Nodes are seen from the grip [m], shape [vertex, 3].
        """
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.arc_lengths, self.positions[index])(arc_lengths)

    def save(self, path: pathlib.Path) -> None:
        """Write the library whole or not at all; nothing in it is pickled."""
        kind = {"format": FORMAT, "format_version": FORMAT_VERSION}
        meta = kind | {"cable": self.cable, "info": self.info}
        buffer = io.BytesIO()
        np.savez_compressed(
            buffer,
            allow_pickle=False,
            meta=np.array(json.dumps(meta)),
            arc_lengths=self.arc_lengths,
            # Micrometres are more than anyone can tell.
            positions=np.round(self.positions, 6).astype(np.float32),
            before_xy=np.round(self.before_xy, 6),
        )
        write_bytes(path, buffer.getvalue())

    @classmethod
    def load(cls, path: pathlib.Path) -> "ResetLibrary":
        """Return the library that `save` wrote."""
        import zipfile
        import zlib

        try:
            with np.load(io.BytesIO(read_bytes(path)), allow_pickle=False) as stored:
                meta = json.loads(str(stored["meta"]))
                arrays = {
                    name: np.asarray(stored[name], dtype=float)
                    for name in ("arc_lengths", "positions", "before_xy")
                }
            if (meta["format"], meta["format_version"]) != (FORMAT, FORMAT_VERSION):
                raise InputError(f"its format is not that of version {FORMAT_VERSION}")
            return cls(cable=meta["cable"], info=meta["info"], **arrays)
        except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile, zlib.error) as error:
            raise DatasetError(f"no reset library at {path}: {error}") from None


def library_path(cable_name: str) -> pathlib.Path:
    """Return the place of a preset's library in the package."""
    return pathlib.Path(__file__).with_name(f"reset_{cable_name}.npz")


def find_library(setup: Setup, lab_seed: int = 0) -> ResetLibrary | None:
    """Return the library that holds for a set-up, where there is one.

    Only the default laboratory has libraries. A user's own cable has none, nor has a preset whose
    geometry was changed.
    """
    if lab_seed != 0 or not is_preset(setup.cable) or not _moves_as_stored(setup):
        return None
    return _packaged(setup.cable.name)


def _moves_as_stored(setup: Setup) -> bool:
    """Return whether the reset moves the gripper as in the paper's set-up.

    Tuned parameters of the cable are left out: they change what is believed, not what is true.
    """
    preset = load_cable(setup.cable.name)
    stored, here = Setup(cable=preset), dataclasses.replace(setup, cable=preset)
    try:
        paths = [reset_path(reset_pose(s.workspace), s) for s in (stored, here)]
    except InputError:
        return False
    knots, coefficients = ([getattr(p, n) for p in paths] for n in ("knots", "coefficients"))
    if coefficients[0].shape != coefficients[1].shape:
        return False
    same = functools.partial(np.allclose, rtol=0.0, atol=_PATH_TOLERANCE)
    return same(*knots) and same(*(values[..., 0] for values in coefficients))


@functools.cache
def _packaged(cable_name: str) -> ResetLibrary | None:
    path = library_path(cable_name)
    return ResetLibrary.load(path) if path.is_file() else None


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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Drift:
    """Friction that wanders over the casts, with the wear of the table and the air of the day.

    Attributes:
        amplitude: Largest relative change [-].
        period: Casts in which it goes up and down once.
    """

    amplitude: float
    period: float

    @classmethod
    def of(cls, table: HiddenTable) -> "Drift":
        """Return the drift on a table."""
        return cls(amplitude=table.drift, period=table.drift_period)

    def factor(self, trial: Trial) -> float:
        """Return the factor of the friction in a trial, whose seed says where the day starts."""
        if self.amplitude == 0.0:
            return 1.0
        seed, index = trial.key
        start = np.random.default_rng([seed, 6]).uniform(0.0, 2 * np.pi)
        return float(np.exp(self.amplitude * np.sin(2 * np.pi * index / self.period + start)))


def reset_shape(
    cable: Cable,
    pose: Array,
    trial: Trial,
    arc_lengths: Array,
    end_height: float,
    library: ResetLibrary | None = None,
    spread: float | None = None,
) -> Array:
    """Return the vertices of the cable as a reset leaves it, along the grip's yaw.

    Args:
        cable: Geometry of the cable.
        pose: Pose of the grip: x, y, z [m], yaw, pitch [rad], shape [5].
        trial: Draw of this trial.
        arc_lengths: Distance of each vertex from the grip along the cable [m], shape [vertex].
        end_height: Height of the lying endpoint [m].
        library: States of simulated resets; the shape is drawn, nearly straight, where None.
        spread: Standard deviation of the heading that a reset leaves [rad], for a shape of version
            5; None for one of version 4.

    Returns:
        Positions in the base frame [m], shape [vertex, 3].
    """
    if library is None:
        local = _drawn_shape(cable, pose[2], trial, arc_lengths, end_height, spread)
    else:
        # A laboratory whose resets are all alike starts from the same one.
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
    arc_lengths: Array,
    end_height: float,
    spread: float | None,
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
    if spread is None:
        heading = trial.angle * (1.0 - np.exp(-middle / 0.15))
        heading = heading + trial.bow * np.pi / cable.length * np.sin(2 * np.pi * middle)
        heading = heading + trial.sway * 2 * np.pi / cable.length * np.sin(4 * np.pi * middle)
        return _laid(step, heading, height)
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
