"""The tracker in bad light: flicker, bands, casts of colour, a white balance that drifts, any hue.

The virtual camera films the same clips in even light and in each other light. Frames count in which
the marker lies in plain sight: on the table, not on another green thing, and clear of the arm.
"""

import dataclasses
import itertools
import sys
from collections.abc import Iterator

import numpy as np
from tools.fit_camera_error import Clip, measure

from benchmarks.result import Table
from cablecast.rigs.virtual.camera import VirtualCamera, calibrate_virtual_camera
from cablecast.rigs.virtual.config import CameraConfig, LightConfig
from cablecast.vision.tracker import MarkerConfig

EVEN = LightConfig(drift=0.0, flicker=0.0, step=0.0)
CHANNELS = ("blue", "green", "red")
RATES = (30.0, 60.0, 120.0)
SHARES = (0.7, 1.3)
CLEAR = 0.05
"""Distance from the arm's silhouette beyond which it hides nothing of the marker [m]."""
KEYS = ("frame_count", "found_pct", "rms_mm", "of_even", "largest_mm")
COLUMNS = ("light", "frames", "found [%]", "rms [mm]", "of even light", "largest [mm]")
READ_SHARE = 0.9
"""Share of the time between two frames in which a rolling shutter reads its rows [-]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Track the same clips in every light.

    Attributes:
        clips: Number of clips, of which every other one has an arm.
        seed: Seed of the clips, of noise and of light.
    """

    clips: int = 5
    seed: int = 1


def lights() -> dict[str, CameraConfig]:
    """Return the camera in every light, by its name."""
    usual = CameraConfig(exposure=0.001, light=EVEN)

    def lit(config: CameraConfig = usual, **changes) -> CameraConfig:
        return dataclasses.replace(config, light=dataclasses.replace(EVEN, **changes))

    found: dict[str, CameraConfig] = {}
    for rate in RATES:
        found[f"even {rate:g} frames/s"] = at = dataclasses.replace(usual, frame_rate=rate)
        for lamp, amplitude in itertools.product((100.0, 120.0), (0.1, 0.2, 0.3, 0.4, 0.5)):
            name = f"flicker {rate:g} frames/s {lamp:g} Hz {100 * amplitude:g} %"
            found[name] = lit(at, lamp_flicker=amplitude, lamp_rate=lamp)
    for rate, lamp in itertools.product(RATES, (100.0, 120.0)):
        row_time = READ_SHARE / rate / usual.height
        rolling = dataclasses.replace(usual, frame_rate=rate, row_time=row_time)
        found[f"even rolling {rate:g} frames/s"] = rolling
        name = f"bands {rate:g} frames/s {lamp:g} Hz 50 %"
        found[name] = lit(rolling, lamp_flicker=0.5, lamp_rate=lamp)
    for (channel, name), share in itertools.product(enumerate(CHANNELS), SHARES):
        factors = tuple(share if k == channel else 1.0 for k in range(3))
        found[f"cast {name} {100 * (share - 1):+.0f} %"] = lit(cast=factors)
        found[f"balance {name} {100 * (share - 1):+.0f} %"] = lit(balance=factors, balance_time=0.5)
    for share in (0.4, 0.6, 1.4, 1.8):
        found[f"brightness {share:g}"] = lit(cast=(share,) * 3)
    for hue in range(0, 360, 30):
        found[f"hue {hue}"] = dataclasses.replace(usual, marker_hue=float(hue))
    for hue in range(90, 165, 10):
        found[f"green of hue {hue}"] = dataclasses.replace(usual, marker_hue=float(hue))
    found["tenth of the frames lost"] = dataclasses.replace(usual, dropped=0.1)
    return found


def summary(clips: list[Clip]) -> dict[str, float]:
    """Return how many of the frames in plain sight show the marker [%], and the errors [mm]."""
    xy, truth, plain = [], [], []
    for clip in clips:
        # A cast starts in sight.
        if clip.clearance[0] < CLEAR or clip.on_blind[0]:
            continue
        xy.append(clip.tracked_xy)
        truth.append(clip.points[:, :2])
        plain.append((clip.clearance > CLEAR) & ~clip.on_blind)
    if not xy:
        # Everything has the marker's colour.
        return {"frame_count": 0, "found_pct": 0.0, "rms_mm": 0.0, "largest_mm": 0.0}
    seen_xy, plain_all = np.concatenate(xy), np.concatenate(plain)
    errors = np.linalg.norm(seen_xy - np.concatenate(truth), axis=1)
    found = np.isfinite(errors)
    return {
        "frame_count": int(plain_all.sum()),
        "found_pct": 100.0 * float(found[plain_all].mean()),
        "rms_mm": 1e3 * float(np.sqrt(np.mean(errors[found & plain_all] ** 2))),
        "largest_mm": 1e3 * float(errors[found].max()),
    }


def even_of(name: str) -> str:
    """Return the name of the even light that a light is compared with."""
    rate = next((f"{rate:g} frames/s" for rate in RATES if f" {rate:g} frames/s" in name), None)
    return f"even {'rolling ' if 'bands' in name else ''}{rate or '60 frames/s'}"


def main(args: Args) -> Iterator[Table]:
    """Track in every light, and yield the errors."""
    camera = VirtualCamera()
    calibration = calibrate_virtual_camera(camera)
    found: dict[str, dict[str, float]] = {}
    for name, config in lights().items():
        camera.config = config
        # The green ones are found by the usual hue; any other one is said.
        marker = MarkerConfig() if "green of" in name else None
        row = summary(measure(camera, calibration, args.clips, args.seed, marker=marker))
        found[name] = row
        row["of_even"] = row["rms_mm"] / found[even_of(name)]["rms_mm"]
        print(f"{name}: {row}", file=sys.stderr, flush=True)
    rows = [(name, *(row[key] for key in KEYS)) for name, row in found.items()]
    yield Table(f"{args.clips} clips, seed {args.seed}", COLUMNS, rows)
