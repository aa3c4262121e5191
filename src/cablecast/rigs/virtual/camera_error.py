"""The measured errors of the virtual camera, as a quick stand-in for rendering and tracking.

What geometry tells is computed: the apparent place of an endpoint above the marker's plane, and
what the arm, the table's edge and the image's border hide. The rest was measured on rendered clips
by `python -m cablecast.rigs.virtual.camera_fit`, which writes camera_error.json.
"""

import dataclasses
import importlib.resources
import json
import pathlib

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.ur5 import ArmUR5
from cablecast.errors import InputError
from cablecast.files import write_json
from cablecast.motion.joint_path import JointPath
from cablecast.rigs.virtual.arm_shape import arm_shape, joints_at, sight_clearance

Array = NDArray[np.float64]

MODEL_FILE = "camera_error.json"
_BELOW_Z = -0.004
"""An endpoint below this height hangs beside the table [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraErrorModel:
    """What the tracker reports where the endpoint truly is, as a distribution.

    Attributes:
        camera: Place of the camera that the calibration found [m].
        seen_low: Least x and y of the table's plane that the image shows [m].
        seen_high: Largest [m].
        bias: Mean error along x and y as a quadratic polynomial, coefficients of 1, x, y - 0.75,
            x², x (y - 0.75), (y - 0.75)² [m], shape [2, 6] as nested tuples.
        place_sd: Error that stays while the endpoint stays, from what it lies on [m].
        noise_sd: Error of one frame [m].
        noise_per_speed: Further error of one frame per speed [s].
        edge_sd: Error of one frame while the arm covers some of the marker [m].
        edge_clearance: That is so below this distance from the arm's silhouette [m].
        delay: How late the track is [s].
        hidden_clearance: The arm hides the marker half of the times at this distance between the
            line of sight and the arm [m].
        hidden_spread: Width of the change from seen to hidden, of a logistic function [m].
        blind: Places where the tracker cannot tell the marker from another green thing, each as x,
            y and radius [m], shape [place, 3] as nested tuples.
        miss_rate: Part of the frames in which a marker in plain sight is missed [-].
        sources: How the values were found, as plain values.
    """

    camera: tuple[float, float, float]
    seen_low: tuple[float, float]
    seen_high: tuple[float, float]
    bias: tuple[tuple[float, ...], tuple[float, ...]]
    place_sd: float
    noise_sd: float
    noise_per_speed: float
    edge_sd: float
    edge_clearance: float
    delay: float
    hidden_clearance: float
    hidden_spread: float
    blind: tuple[tuple[float, ...], ...]
    miss_rate: float
    sources: dict = dataclasses.field(default_factory=dict)

    def __post_init__(self):
        if np.shape(self.bias) != (2, 6):
            raise InputError(f"bias has shape {np.shape(self.bias)}: it must be [2, 6]")
        for name in ("place_sd", "noise_sd", "noise_per_speed", "edge_sd", "hidden_spread"):
            value = getattr(self, name)
            if not (np.isfinite(value) and 0.0 <= value <= 1.0):
                raise InputError(f"camera error {name} = {value} is outside [0, 1]")
        if not 0.0 <= self.miss_rate <= 1.0:
            raise InputError(f"camera error miss_rate = {self.miss_rate} is outside [0, 1]")

    def save(self, path: pathlib.Path) -> None:
        """Write the model as JSON."""
        write_json(path, dataclasses.asdict(self))

    @classmethod
    def load(cls, path: pathlib.Path | None = None) -> "CameraErrorModel":
        """Read a model; by default the one that comes with cablecast.

        Raises:
            InputError: There is no such file, or it is no error model.
        """
        try:
            if path is None:
                room = importlib.resources.files("cablecast.rigs.virtual")
                text = room.joinpath(MODEL_FILE).read_text()
            else:
                text = path.read_text()
            values = json.loads(text)
            values |= {name: tuple(values[name]) for name in ("camera", "seen_low", "seen_high")}
            nested = {name: tuple(tuple(row) for row in values[name]) for name in ("bias", "blind")}
            return cls(**values | nested)
        except InputError:
            raise
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path or MODEL_FILE} is no camera error model ({error!r})") from None

    def apparent(self, points: Array, marker_z: float) -> Array:
        """Where endpoints seem to be to a tracker that believes them at one height.

        Args:
            points: True places [m], shape [..., 3].
            marker_z: Height that the tracker believes in [m].

        Returns:
            x and y [m], shape [..., 2].
        """
        camera = np.asarray(self.camera)
        scale = (camera[2] - marker_z) / (camera[2] - points[..., 2])
        return camera[:2] + scale[..., None] * (points[..., :2] - camera[:2])

    def hidden(
        self,
        times: Array,
        points: Array,
        joint_path: JointPath | None,
        rng: np.random.Generator,
        arm: ArmUR5 | None = None,
    ) -> tuple[NDArray[np.bool_], Array]:
        """Which frames cannot show the marker.

        Args:
            times: Of the frames [s], shape [frame].
            points: True places of the endpoint [m], shape [frame, 3].
            joint_path: Joints as they really moved; None for a table without an arm.
            rng: Draws what is left to chance.
            arm: The robot.

        Returns:
            Which are hidden, and the distance of each line of sight from the arm [m], both of shape
            [frame].
        """
        on_ground = self.apparent(points, 0.0)
        hidden = np.any((on_ground < self.seen_low) | (on_ground > self.seen_high), axis=-1)
        # What hangs beside the table is hidden by it, or shows the marker from its narrow end.
        hidden |= points[..., 2] < _BELOW_Z
        for x, y, radius in self.blind:
            hidden |= np.hypot(on_ground[..., 0] - x, on_ground[..., 1] - y) < radius
        clearance = np.full(len(times), np.inf)
        # One draw a trial: a marker that rests half covered is seen in all frames or in none.
        quantile = np.clip(rng.uniform(), 1e-6, 1 - 1e-6)
        if joint_path is not None:
            shape = arm_shape(joints_at(joint_path, times), arm)
            clearance = sight_clearance(points, self.camera, shape)
            threshold = self.hidden_clearance + self.hidden_spread * np.log(
                quantile / (1 - quantile)
            )
            hidden |= clearance < threshold
        return hidden | (rng.uniform(size=len(times)) < self.miss_rate), clearance

    def observe(
        self,
        times: Array,
        points: Array,
        joint_path: JointPath | None,
        marker_z: float,
        rng: np.random.Generator,
        arm: ArmUR5 | None = None,
    ) -> Array:
        """What the tracker would report in each frame.

        Args:
            times: Of the frames, rising [s], shape [frame].
            points: True places of the endpoint [m], shape [frame, 3].
            joint_path: Joints as they really moved; None for a table without an arm.
            marker_z: Height at which the tracker believes the marker [m].
            rng: Draws what is left to chance.
            arm: The robot.

        Returns:
            x and y [m], NaN where the marker would not be seen, shape [frame, 2].
        """
        hidden, clearance = self.hidden(times, points, joint_path, rng, arm)
        seen = self.apparent(points, marker_z)
        velocity = np.gradient(seen, times, axis=0) if len(times) > 1 else np.zeros_like(seen)
        speed = np.linalg.norm(velocity, axis=-1)
        error = bias_terms(seen) @ np.asarray(self.bias).T - self.delay * velocity
        error += self._place_error(seen, rng)
        sd = np.hypot(self.noise_sd, self.noise_per_speed * speed)
        sd = np.where(clearance < self.edge_clearance, np.hypot(sd, self.edge_sd), sd)
        error += sd[:, None] * rng.normal(size=seen.shape)
        return np.where(hidden[:, None], np.nan, seen + error)

    def _place_error(self, seen: Array, rng: np.random.Generator) -> Array:
        """An error that changes with the place and not with time, shape [frame, 2]."""
        # Waves across the table in random directions: nearby places have nearby errors.
        waves = rng.normal(0.0, 1.0 / _PLACE_SCALE, (8, 2))
        phases = rng.uniform(0.0, 2 * np.pi, (2, 8))
        angle = seen @ waves.T
        return self.place_sd * np.stack(
            [np.cos(angle + phase).sum(axis=-1) / 2.0 for phase in phases], axis=-1
        )


_PLACE_SCALE = 0.02
"""Within this distance a marker lies on about the same ground: its own size [m]."""


def bias_terms(xy: Array) -> Array:
    """Terms of the bias polynomial at some places, shape [..., 6]."""
    x, y = xy[..., 0], xy[..., 1] - 0.75
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
