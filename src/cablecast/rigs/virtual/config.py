"""Settings of the virtual laboratory: its numerics, how far two equal trials differ, its camera.

Only the renderer reads the settings of the camera. The tracker works with what it calibrates from
rendered pictures.
"""

import dataclasses
import math
from typing import Any

import numpy as np

from cablecast.camera.lens import CameraView, Lens
from cablecast.camera.settings import MARKER_HUE
from cablecast.errors import InputError, check_count, check_number, check_ranges, check_seed
from cablecast.rigs.virtual._hidden import EFFECTS
from cablecast.workspace import Workspace

LABORATORY_VERSION = 7
"""Version of the laboratory; results of two versions are not compared."""
SENSING_NAMES = ("exact", "error_model", "camera")
"""Ways of seeing the cable: exactly as it is, with the measured errors of the camera, or with that
camera itself, frame by rendered frame."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrialNoise:
    """Standard deviations of what changes from trial to trial.

    They were set by the scatter of repeated landings on the real table (paper, section VI-B), which
    `cablecast repeat` prints next to ours. Most of it comes from the reset. The rest is kept small,
    since some fast casts magnify any difference.

    Attributes:
        reset: Deviation of the cable after a reset, as a multiple of the laboratory's [-].
        tip_roll: Turn of the lying attachment about the cable [rad].
        curl: Curvature that earlier trials have left in the cable [1/m].
        friction: Relative change of the friction between cable and table [-].
        servo: Relative change of the friction of each joint's gear with its temperature, or of the
            response frequency of an arm without gears [-].
        torque: Relative change of the torque of the base joint [-].
        latency: Delay of a set point on its way to the arm [s].
        encoder: Error of a reported joint angle [rad].
    """

    reset: float = 1.1
    tip_roll: float = 0.2
    curl: float = 0.1
    friction: float = 0.028
    servo: float = 0.04
    torque: float = 0.01
    latency: float = 5e-4
    encoder: float = 5e-5

    def __post_init__(self):
        check_ranges(
            self,
            {
                "reset": (0.0, 5.0, ""),
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
        without: Names of effects to leave out, of `EFFECTS`.
        noise: Deviations from trial to trial.
        segment_count: Segments of the discrete rod. Twice as many move a landing by a median of 3 %
            of the cable length; the rod is the world here, so that is a matter of likeness.
        dt: Step [s]. An eighth of it moves a landing by a median of 0.9 %.
        sample_dt: Time between samples of a track [s]; the paper's camera analysis takes 100 ms.
        reset_time: Time in which the cable settles between the reset and the motion [s].
        rest_time_max: Longest time from the end of the motion to the end of the trial [s].
        rest_speed: The cable rests while all of it is slower than this [m/s].
        sensing: Way of seeing the endpoint: "exact", "error_model" or "camera".
        thread_count: Threads that trials are spread over; all cores if None. It never changes a
            result.
    """

    lab_seed: int = 0
    without: tuple[str, ...] = ()
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
        object.__setattr__(self, "without", tuple(self.without))
        for name in self.without:
            if name not in EFFECTS:
                known = ", ".join(EFFECTS)
                raise InputError(f"virtual rig effect {str(name)[:40]!r} is not one of: {known}")
        if self.sensing not in SENSING_NAMES:
            names = ", ".join(SENSING_NAMES)
            raise InputError(f"virtual rig sensing = {self.sensing!r} is not one of {names}")
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


DEFAULT_CENTRE_Y = 0.75
"""y of the middle of the paper's table [m]."""
_CLUTTER_SHARE_MIN = 0.5
"""Smallest table with other green things on it, as a share of the paper's width and depth."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LightConfig:
    """Changes of the light, and of the white balance that answers it.

    Attributes:
        drift: Amplitude of a slow change of brightness [-].
        drift_period: Period of that change [s].
        flicker: Amplitude of what mains light leaves after the exposure [-].
        step: Largest sudden change of brightness, by a lamp or a cloud [-].
        lamp_flicker: Amplitude of the lamps' own flicker, which the exposure averages and a rolling
            shutter makes bands of [-].
        lamp_rate: Rate of that flicker, twice the mains' frequency [1/s].
        cast: Brightness of blue, green and red as a multiple of that in white light [-].
        balance: Factor by which an automatic white balance has changed blue, green and red in the
            end [-].
        balance_time: Time that it takes, from the start of the motion on [s].
    """

    drift: float = 0.08
    drift_period: float = 7.0
    flicker: float = 0.02
    step: float = 0.12
    lamp_flicker: float = 0.0
    lamp_rate: float = 100.0
    cast: tuple[float, float, float] = (1.0, 1.0, 1.0)
    balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    balance_time: float = 2.0

    def __post_init__(self):
        amplitude, time = (0.0, 1.0, ""), (0.01, 1e4, "s")
        names = ("drift", "flicker", "step", "lamp_flicker")
        bounds = dict.fromkeys(names, amplitude) | dict.fromkeys(
            ("drift_period", "balance_time"), time
        )
        check_ranges(self, {**bounds, "lamp_rate": (1.0, 1e5, "1/s")}, "light")
        for name in ("cast", "balance"):
            for value in getattr(self, name):
                check_number(f"light {name}", value, 0.1, 10.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraConfig:
    """The camera over the virtual table: a webcam on a stand, mounted nearly level.

    The defaults see the paper's table; `over` mounts the camera for another one.

    Attributes:
        width: Width of the images [px].
        height: Height of the images [px].
        frame_rate: Frames per second [1/s].
        exposure: Time during which a row is exposed [s].
        row_time: Time by which each row is exposed later than the one above it [s].
        focal: Focal length [px]; the paper's camera has about 1360 at this size.
        centre_offset: Offset of the optical axis from the image's middle, u and v [px].
        distortion: Coefficients k1, k2, p1, p2, k3 of OpenCV's model [-].
        position: Place of the camera in the base frame [m].
        tilt: Turns about the x, y and z axes of the base frame away from straight down with y
            upwards in the image [rad].
        noise: Standard deviation of a pixel's noise, of 255.
        blur: Standard deviation of the lens's blur [px].
        dropped: Share of the frames that the camera leaves out [-].
        repeated: Share of the frames in whose place it sends the one before again [-].
        marker_hue: Hue of the marker, where green is 120 [deg].
        light: Changes of the light.
    """

    width: int = 1920
    height: int = 1080
    frame_rate: float = 60.0
    exposure: float = 0.006
    row_time: float = 0.0
    focal: float = 1366.0
    centre_offset: tuple[float, float] = (7.5, -5.0)
    distortion: tuple[float, float, float, float, float] = (-0.062, 0.021, 6e-4, -4e-4, 0.0)
    position: tuple[float, float, float] = (0.012, 0.752, 2.24)
    tilt: tuple[float, float, float] = (0.008, -0.006, 0.010)
    noise: float = 3.0
    blur: float = 0.7
    dropped: float = 0.0
    repeated: float = 0.0
    marker_hue: float = MARKER_HUE
    light: LightConfig = dataclasses.field(default_factory=LightConfig)

    def __post_init__(self):
        for name in ("width", "height"):
            check_count(f"camera {name}", getattr(self, name), 16, 16384)
        check_ranges(
            self,
            {
                "frame_rate": (1.0, 1000.0, "1/s"),
                "exposure": (0.0, 0.1, "s"),
                "row_time": (0.0, 1e-3, "s"),
                "dropped": (0.0, 0.9, ""),
                "repeated": (0.0, 0.9, ""),
                "marker_hue": (0.0, 360.0, "deg"),
            },
            "camera",
        )
        if self.exposure * self.frame_rate > 1.0:
            raise InputError(
                f"camera exposure = {self.exposure} s is longer than a frame at "
                f"{self.frame_rate:g} frames/s"
            )

    @classmethod
    def over(cls, workspace: Workspace) -> "CameraConfig":
        """Return the camera as a person mounts it over a table: high enough to see all of it.

        Over a table that is deeper than wide it is turned by a quarter. Over a smaller table it
        stays as high as over the paper's, out of the arm's way.
        """
        default, mount = cls(), Mount.over(workspace)
        x, y, z = default.position
        return cls(
            position=(x, y + (mount.centre_y - DEFAULT_CENTRE_Y), z * mount.scale),
            tilt=(*default.tilt[:2], default.tilt[2] + mount.quarter_turns * math.pi / 2),
        )

    def resized(self, width: int) -> "CameraConfig":
        """Return the same camera with images of another width [px], for faster drawing."""
        scale = width / self.width
        return dataclasses.replace(
            self,
            width=width,
            height=round(self.height * scale),
            focal=self.focal * scale,
            centre_offset=(self.centre_offset[0] * scale, self.centre_offset[1] * scale),
            row_time=self.row_time / scale,
        )

    def troubled(self, values: dict[str, Any]) -> "CameraConfig":
        """Return the camera with the hidden troubles of a laboratory."""
        light = dataclasses.replace(self.light, **values.get("light", {}))
        return dataclasses.replace(self, **{**values, "light": light})

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
        cx, cy, cz = np.cos(self.tilt)
        sx, sy, sz = np.sin(self.tilt)
        Rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        Ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        Rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        R = np.diag([1.0, -1.0, -1.0]) @ (Rz @ Ry @ Rx).T
        rotation = tuple(tuple(row) for row in R.tolist())
        return CameraView(lens=lens, rotation=rotation, position=self.position)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mount:
    """Place of a camera over a table, compared with that over the paper's table.

    Attributes:
        centre_y: y of the table's middle [m].
        scale: Height of the camera as a multiple of that over the paper's table [-].
        quarter_turns: 1 where the camera is turned by a quarter about the vertical, else 0.
    """

    centre_y: float
    scale: float
    quarter_turns: int

    @classmethod
    def over(cls, workspace: Workspace) -> "Mount":
        """Return the place over a table that shows all of it."""
        wide, deep = workspace.half_width, (workspace.y_max - workspace.y_min) / 2
        turned = deep > wide
        if turned:
            wide, deep = deep, wide
        return cls(
            centre_y=(workspace.y_min + workspace.y_max) / 2,
            scale=max(1.0, wide / Workspace().half_width, deep / DEFAULT_CENTRE_Y),
            quarter_turns=int(turned),
        )


def clutter_place(x: float, y: float, workspace: Workspace) -> tuple[float, float] | None:
    """Return where something at x, y on the paper's table lies on another one [m].

    Returns:
        x and y [m]; None for a table too small to be cluttered.
    """
    across = workspace.half_width / Workspace().half_width
    along = (workspace.y_max - workspace.y_min) / (2 * DEFAULT_CENTRE_Y)
    if min(across, along) < _CLUTTER_SHARE_MIN:
        return None
    return x * across, workspace.y_min + y * along
