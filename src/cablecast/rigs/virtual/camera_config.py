"""Settings of the camera over the virtual table: its lens, its place, and its troubles.

Only the renderer reads them. The tracker works with what it calibrates from rendered pictures.
"""

import dataclasses

import numpy as np

from cablecast.errors import InputError
from cablecast.tracking.lens import CameraView, Lens


@dataclasses.dataclass(frozen=True, kw_only=True)
class LightConfig:
    """How the light changes.

    Attributes:
        drift: Amplitude of a slow change of brightness [-].
        drift_period: Of that change [s].
        flicker: Amplitude of what mains light leaves after the exposure [-].
        flicker_rate: Beat of the lamps against the frames [1/s].
        tint: Amplitude of the change of colour [-].
        step: A lamp or a cloud changes the brightness at once by up to this part [-].
        falloff: How much darker the table's far corners are than its middle [-].
    """

    drift: float = 0.08
    drift_period: float = 7.0
    flicker: float = 0.02
    flicker_rate: float = 13.3
    tint: float = 0.02
    step: float = 0.12
    falloff: float = 0.25

    def __post_init__(self):
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            high = 100.0 if field.name in ("drift_period", "flicker_rate") else 0.6
            if not 0.0 <= value <= high:
                raise InputError(f"light {field.name} = {value} is outside [0, {high:g}]")


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraConfig:
    """The camera over the virtual table: a webcam on a stand, mounted nearly level.

    Attributes:
        width: Of its images [px].
        height: Of its images [px].
        frame_rate: [1/s].
        exposure: Time during which a frame is exposed [s].
        focal: Focal length [px]; the paper's camera has about 1360 at this size.
        centre_offset: Of the optical axis from the image's middle, u and v [px].
        distortion: k1, k2, p1, p2, k3 of OpenCV's model [-].
        position: Of the camera in the base frame [m].
        tilt: About the x, y and z axes of the base frame away from straight down [rad].
        noise: Standard deviation of a pixel's noise, of 255.
        blur: Standard deviation of the lens's blur [px].
        tag_error: Standard deviation of where tags are stuck from where they should be [m].
        light: How the light changes.
        distractors: Whether other green things lie on the table.
    """

    width: int = 1920
    height: int = 1080
    frame_rate: float = 60.0
    exposure: float = 0.006
    focal: float = 1366.0
    centre_offset: tuple[float, float] = (7.5, -5.0)
    distortion: tuple[float, float, float, float, float] = (-0.062, 0.021, 6e-4, -4e-4, 0.0)
    position: tuple[float, float, float] = (0.012, 0.752, 2.24)
    tilt: tuple[float, float, float] = (0.008, -0.006, 0.010)
    noise: float = 3.0
    blur: float = 0.7
    tag_error: float = 0.001
    light: LightConfig = dataclasses.field(default_factory=LightConfig)
    distractors: bool = True

    def __post_init__(self):
        for name, low, high in (
            ("frame_rate", 1.0, 1000.0),
            ("exposure", 0.0, 0.1),
            ("noise", 0.0, 40.0),
            ("blur", 0.0, 5.0),
            ("tag_error", 0.0, 0.05),
        ):
            value = getattr(self, name)
            if not (np.isfinite(value) and low <= value <= high):
                raise InputError(f"camera {name} = {value} is outside [{low:g}, {high:g}]")
        if self.exposure * self.frame_rate > 1.0:
            raise InputError(
                f"camera exposure = {self.exposure} s is longer than a frame at "
                f"{self.frame_rate:g} frames/s"
            )
        if self.position[2] < 1.0:
            raise InputError(f"camera height = {self.position[2]} m is below 1 m, the arm's reach")

    @property
    def view(self) -> CameraView:
        """The true lens at the true place."""
        lens = Lens(
            width=self.width,
            height=self.height,
            focal=(self.focal, self.focal),
            centre=(
                (self.width - 1) / 2 + self.centre_offset[0],
                (self.height - 1) / 2 + self.centre_offset[1],
            ),
            distortion=self.distortion,
        )
        return CameraView(lens=lens, rotation=camera_rotation(self.tilt), position=self.position)


def camera_rotation(tilt: tuple[float, float, float]) -> tuple[tuple[float, float, float], ...]:
    """Rotation of a camera that looks down with y of the base frame upwards in its image.

    Args:
        tilt: Small turns about x, y and z of the base frame [rad].
    """
    cx, cy, cz = np.cos(tilt)
    sx, sy, sz = np.sin(tilt)
    Rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    Ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    Rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    R = np.diag([1.0, -1.0, -1.0]) @ (Rz @ Ry @ Rx).T
    return tuple(tuple(row) for row in R.tolist())
