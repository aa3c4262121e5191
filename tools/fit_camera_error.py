"""Measure the errors of the virtual camera on rendered clips, and fit the error model to them.

    python tools/fit_camera_error.py --clips 150

prints what it measured; with --write it renews the camera_error.json that comes with cablecast.
"""

import argparse
import dataclasses
import pathlib
import sys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.shape import arm_shape, sight_clearance
from cablecast.arm.ur import ArmUR
from cablecast.cable import load_cable
from cablecast.conventions import Array
from cablecast.motion.trajectory import JointPath, joints_at
from cablecast.rigs.virtual.camera import (
    TrialFilm,
    VirtualCamera,
    calibrate_virtual_camera,
    track_film,
)
from cablecast.rigs.virtual.drawing import FilmedTrial
from cablecast.rigs.virtual.sensing import MODEL_PATH, CameraErrorModel, bias_terms
from cablecast.vision.calibration import Calibration
from cablecast.vision.tracker import MarkerConfig, sight_of

_ARM = ArmUR()
"""Arm that hides part of the table."""
_NODE_COUNT = 16
_DT = 0.01
_REST_SPEED = 0.02
"""Speed below which the endpoint rests [m/s]."""
_CLEAR = 0.05
"""Distance from the arm's silhouette beyond which the arm plays no part [m]."""
_EDGE_CLEARANCE = 0.03
"""Distance from the arm's silhouette within which the arm covers some of the marker [m]."""
_NEAR = 0.06
"""Distance from its edge, on either side, within which occlusion is measured [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Clip:
    """True and tracked endpoints in the frames of one clip.

    Attributes:
        times: Times of the frames [s], shape [frame].
        points: True endpoint [m], shape [frame, 3].
        tracked_xy: Endpoint that the tracker reported, NaN where it saw nothing [m], shape
            [frame, 2].
        clearance: Distance of the line of sight from the arm, infinite without an arm [m], shape
            [frame].
        marker_z: Height at which the tracker believed the marker [m].
        blind: Places of other green things, as x, y and radius [m], shape [place, 3].
    """

    times: Array
    points: Array
    tracked_xy: Array
    clearance: Array
    marker_z: float
    blind: Array

    @property
    def on_blind(self) -> NDArray[np.bool_]:
        """Frames in which the endpoint lies on or by another green thing, shape [frame]."""
        to_place = self.points[:, None, :2] - self.blind[:, :2]
        return np.any(np.hypot(*np.moveaxis(to_place, -1, 0)) < self.blind[:, 2], axis=1)

    @property
    def speed(self) -> Array:
        """Speed of the endpoint over the table [m/s], shape [frame]."""
        return np.linalg.norm(np.gradient(self.points[:, :2], self.times, axis=0), axis=-1)


def clip_trial(rng: np.random.Generator, index: int) -> FilmedTrial:
    """Make up a motion: the endpoint glides from place to place, every other time past an arm.

    Args:
        rng: Draws the motion.
        index: Number of the clip, which decides whether there is an arm.
    """
    cable = load_cable(("cable_1", "cable_2", "cable_3")[index % 3])
    duration = rng.uniform(0.35, 0.9)
    times = np.arange(int(duration / _DT) + 12, dtype=np.float64) * _DT
    u = np.clip(times / duration, 0.0, 1.0)
    glide = u**3 * (10 - 15 * u + 6 * u * u)
    joint_path = None
    grip = np.array([rng.uniform(-0.4, 0.4), rng.uniform(0.5, 0.75)])
    if index % 2:
        theta = rng.uniform(-0.9, 0.9)
        reach = rng.uniform(0.5, 0.85)
        turn = rng.uniform(-0.15, 0.15) * glide
        yaw = theta + turn
        grip = np.stack([reach * np.sin(yaw), reach * np.cos(yaw)], axis=-1)
        still = np.zeros_like(times)
        poses = np.stack([grip[:, 0], grip[:, 1], still + 0.02, yaw, still], axis=1)
        q = _ARM.inverse(poses)
        joint_path = JointPath(times=times, q=q, qd=np.gradient(q, times, axis=0))
        # Towards the arm's silhouette, which hides some of the way.
        passing = grip[0] * rng.uniform(0.45, 1.0) + rng.normal(0, 0.03, 2)
        away = rng.normal(0, 1.0, 2)
        away *= rng.uniform(0.12, 0.3) / np.linalg.norm(away)
        ends = np.stack([passing + away, passing - away * rng.uniform(-0.3, 1.0)])
    else:
        ends = rng.uniform([-1.25, 0.12], [1.25, 1.42], (2, 2))
    ends = np.clip(ends, [-1.34, 0.04], [1.34, 1.46])
    path = ends[0] + glide[:, None] * (ends[1] - ends[0])
    share = np.linspace(0.0, 1.0, _NODE_COUNT)[:, None]
    start = np.broadcast_to(grip, path.shape)
    level = start[:, None] + share * (path - start)[:, None]
    # A bow, so that the marker points in all directions.
    across = np.stack([-(path - start)[:, 1], (path - start)[:, 0]], axis=-1)
    bow = rng.uniform(-0.6, 0.6) * np.sin(np.pi * share)
    nodes = np.concatenate(
        [level + bow * across[:, None], np.full((*level.shape[:2], 1), cable.radius)], axis=-1
    )
    return FilmedTrial(cable=cable, times=times, nodes=nodes, joint_path=joint_path)


def measure(
    camera: VirtualCamera,
    calibration: Calibration,
    clip_count: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
    marker: MarkerConfig | None = None,
) -> list[Clip]:
    """Film and track made-up motions.

    Args:
        camera: Camera that films.
        calibration: Calibration that the tracker works with.
        clip_count: Number of motions.
        seed: Seed of the motions.
        progress: Called with the number of finished clips.
        marker: Marker that is looked for; one of the hue that is drawn where None.
    """
    clips = []
    for index in range(clip_count):
        rng = np.random.default_rng([seed, index])
        trial = clip_trial(rng, index)
        film = camera.film(trial, seed=int(rng.integers(2**31)))
        tracker = track_film(film, calibration, marker)
        times, tracked_xy = tracker.frames
        points = trial.shape_at(times)[:, -1]
        clearance = np.full(len(times), np.inf)
        if trial.joint_path is not None:
            shape = arm_shape(joints_at(trial.joint_path, times), _ARM)
            clearance = sight_clearance(points, calibration.view.position, shape)
        clips.append(
            Clip(
                times=times,
                points=points,
                tracked_xy=tracked_xy,
                clearance=clearance,
                marker_z=trial.cable.radius,
                blind=np.reshape(sight_of(tracker).blind, (-1, 3)),
            )
        )
        if progress is not None:
            progress(index + 1)
    return clips


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Frames:
    """All frames of some clips, next to what geometry alone expects of them.

    Attributes:
        place: Apparent place of the endpoint [m], shape [frame, 2].
        velocity: Velocity of that place [m/s], shape [frame, 2].
        error: Distance of the tracked endpoint from it, NaN where not seen [m], shape [frame, 2].
        clearance: Distance of the line of sight from the arm [m], shape [frame].
        on_blind: Whether the endpoint lies on another green thing, shape [frame].
        clip: Index of the clip, shape [frame].
    """

    place: Array
    velocity: Array
    error: Array
    clearance: Array
    on_blind: NDArray[np.bool_]
    clip: NDArray[np.intp]

    @classmethod
    def of(cls, clips: list[Clip], blank: CameraErrorModel) -> "_Frames":
        """Return the frames of some clips, seen by a camera without errors."""
        apparent = [blank.apparent(clip.points, clip.marker_z) for clip in clips]
        place = np.concatenate(apparent)
        return cls(
            place=place,
            velocity=np.concatenate(
                [np.gradient(a, c.times, axis=0) for a, c in zip(apparent, clips, strict=True)]
            ),
            error=np.concatenate([c.tracked_xy for c in clips]) - place,
            clearance=np.concatenate([c.clearance for c in clips]),
            on_blind=np.concatenate([c.on_blind for c in clips]),
            clip=np.concatenate([np.full(len(c.times), i) for i, c in enumerate(clips)]),
        )

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Whether the marker was seen, shape [frame]."""
        return np.all(np.isfinite(self.error), axis=1)

    @property
    def clear(self) -> NDArray[np.bool_]:
        """Whether nothing is in the way, shape [frame]."""
        return (self.clearance > _CLEAR) & ~self.on_blind


def fit_error_model(
    clips: list[Clip], camera: VirtualCamera, calibration: Calibration, seed: int
) -> CameraErrorModel:
    """Return the error model that describes some clips best.

    Args:
        clips: Filmed and tracked motions.
        camera: Camera that filmed them.
        calibration: Calibration that the tracker worked with.
        seed: Seed of the motions, for the record.
    """
    # A cast begins with its marker in sight. Where an arm or a cloth hides it, it is never found.
    clips = [clip for clip in clips if np.isfinite(clip.tracked_xy[: TrialFilm.LEAD]).any()]
    low, high = _seen_rectangle(camera, calibration)
    blank = CameraErrorModel(
        camera=calibration.view.position,
        seen_low=low,
        seen_high=high,
        bias=((0.0,) * 6, (0.0,) * 6),
        place_sd=0.0,
        noise_sd=0.0,
        noise_per_speed=0.0,
        edge_sd=0.0,
        edge_clearance=0.0,
        delay=0.0,
        hidden_clearance=0.0,
        hidden_spread=0.0,
        blind=tuple(tuple(float(v) for v in row) for row in _common_blind(clips)),
        miss_rate=0.0,
    )
    frames = _Frames.of(clips, blank)
    bias, delay = _fit_bias(frames)
    left = frames.error - bias_terms(frames.place) @ bias.T + delay * frames.velocity
    missed = frames.clear & ~frames.seen
    around = _around_arm(frames)
    return dataclasses.replace(
        blank,
        bias=tuple(tuple(float(value) for value in row) for row in bias),
        delay=delay,
        miss_rate=float(missed.sum() / max(frames.clear.sum(), 1)),
        **_fit_scatter(frames, left),
        **_fit_occlusion(frames),
        sources={
            "command": "python tools/fit_camera_error.py",
            "seed": seed,
            "clips_begun_in_sight": len(clips),
            "frame_count": len(frames.clip),
            "frames_near_arm": int(around.sum()),
            "frames_seen": int(frames.seen.sum()),
            "calibration_rms": calibration.rms,
        },
    )


def _fit_bias(frames: _Frames) -> tuple[Array, float]:
    """Fit the bias of both axes [m], shape [2, 6], and one delay [s], by least squares."""
    good = frames.seen & frames.clear
    terms = bias_terms(frames.place[good])
    zero = np.zeros_like(terms)
    left = np.block([[terms, zero], [zero, terms]])
    left = np.column_stack([left, -frames.velocity[good].T.ravel()])
    solution = np.linalg.lstsq(left, frames.error[good].T.ravel(), rcond=None)[0]
    return np.asarray(solution[:12], dtype=float).reshape(2, 6), float(solution[12])


def _fit_scatter(frames: _Frames, left: Array) -> dict[str, float]:
    """Fit the scatter of what bias and delay leave.

    Args:
        frames: All frames.
        left: Errors less bias and delay [m], shape [frame, 2].

    Returns:
        Fields of CameraErrorModel by name.
    """
    good = frames.seen & frames.clear
    speed = np.linalg.norm(frames.velocity, axis=1)
    # At rest, the mean of a clip's error is its ground's, the scatter about it the frames'.
    still = good & (speed < _REST_SPEED)
    means, scatter = [], []
    for clip_index in np.unique(frames.clip[still]):
        values = left[still & (frames.clip == clip_index)]
        for part in (values[: TrialFilm.LEAD], values[TrialFilm.LEAD :]):
            if len(part) >= 4:
                means.append(part.mean(axis=0))
                scatter.append(part.var(axis=0, ddof=1))
    place_sd = float(np.sqrt(np.mean(np.square(means))))
    noise_sd = float(np.sqrt(np.mean(scatter)))
    plain = noise_sd**2 + place_sd**2
    moving = good & (speed > 5 * _REST_SPEED)
    excess = np.mean(left[moving] ** 2, axis=1) - plain
    slope2 = float(np.sum(excess * speed[moving] ** 2) / np.sum(speed[moving] ** 4))
    covered = frames.seen & (frames.clearance < _EDGE_CLEARANCE)
    edge2 = float(np.mean(left[covered] ** 2)) - plain if covered.any() else 0.0
    return {
        "place_sd": place_sd,
        "noise_sd": noise_sd,
        "noise_per_speed": float(np.sqrt(max(slope2, 0.0))),
        "edge_sd": float(np.sqrt(max(edge2, 0.0))),
        "edge_clearance": _EDGE_CLEARANCE,
    }


def _around_arm(frames: _Frames) -> NDArray[np.bool_]:
    """Return which frames tell where the arm begins to hide the marker."""
    return np.isfinite(frames.clearance) & (np.abs(frames.clearance) < _NEAR) & ~frames.on_blind


def _fit_occlusion(frames: _Frames) -> dict[str, float]:
    """Fit a logistic function of the clearance, by maximum likelihood.

    Returns:
        Fields of CameraErrorModel by name.
    """
    from scipy.optimize import minimize

    around = _around_arm(frames)

    def unlikelihood(parameters: Array) -> float:
        z = (frames.clearance[around] - parameters[0]) / np.exp(parameters[1])
        return float(np.sum(np.logaddexp(0.0, np.where(frames.seen[around], -z, z))))

    best = minimize(unlikelihood, [0.005, np.log(0.004)], method="Nelder-Mead").x
    return {"hidden_clearance": float(best[0]), "hidden_spread": float(np.exp(best[1]))}


def _common_blind(clips: list[Clip]) -> Array:
    """Return the green things that most clips found: a marker or an arm in the way changes some."""
    places = np.concatenate([clip.blind for clip in clips])
    kept: list[Array] = []
    while len(places):
        same = np.hypot(*(places[:, :2] - places[0, :2]).T) < 0.05
        if same.sum() > len(clips) / 2:
            kept.append(np.median(places[same], axis=0))
        places = places[~same]
    return np.array(kept).reshape(-1, 3)


def _seen_rectangle(
    camera: VirtualCamera, calibration: Calibration
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the part of the table's plane in which a whole marker fits into the image [m]."""
    config, view = camera.config, calibration.view
    u = np.linspace(0, config.width - 1, 30)
    v = np.linspace(0, config.height - 1, 30)
    left = view.to_table(np.stack([np.zeros(30), v], axis=-1))[:, 0].max()
    right = view.to_table(np.stack([np.full(30, config.width - 1.0), v], axis=-1))[:, 0].min()
    far = view.to_table(np.stack([u, np.zeros(30)], axis=-1))[:, 1].min()
    near = view.to_table(np.stack([u, np.full(30, config.height - 1.0)], axis=-1))[:, 1].max()
    margin = 0.02
    return (
        (float(left + margin), float(near + margin)),
        (float(right - margin), float(far - margin)),
    )


def error_table(clips: list[Clip]) -> str:
    """Return what was measured, as a table to read."""
    error = np.concatenate([c.tracked_xy - c.points[:, :2] for c in clips])
    distance = 1e3 * np.linalg.norm(error, axis=1)
    speed = np.concatenate([c.speed for c in clips])
    clearance = np.concatenate([c.clearance for c in clips])
    x = np.concatenate([c.points[:, 0] for c in clips])
    seen = np.isfinite(distance)
    far = clearance > _CLEAR
    rows = [
        ("all frames in which it was seen", seen),
        ("at rest, away from the arm", seen & far & (speed < _REST_SPEED)),
        ("0.02 to 1 m/s, away from the arm", seen & far & (speed >= _REST_SPEED) & (speed < 1)),
        ("1 to 2 m/s", seen & far & (speed >= 1) & (speed < 2)),
        ("2 m/s and faster", seen & far & (speed >= 2)),
        ("middle of the table, |x| < 0.5 m", seen & far & (np.abs(x) < 0.5)),
        ("sides of the table, |x| > 0.9 m", seen & far & (np.abs(x) > 0.9)),
        ("within 3 cm of the arm's silhouette", seen & (clearance < 0.03)),
    ]
    lines = [f"{'':38}{'frames':>8}{'rms mm':>8}{'p95 mm':>8}{'max mm':>8}"]
    for name, mask in rows:
        if mask.any():
            d = distance[mask]
            rms = np.sqrt(np.mean(d**2))
            lines.append(
                f"{name:38}{mask.sum():8}{rms:8.2f}{np.percentile(d, 95):8.2f}{d.max():8.2f}"
            )
    covered = clearance < -0.03
    lines.append(f"{'frames deep below the arm':38}{covered.sum():8}, seen {seen[covered].sum()}")
    plain = far & ~np.concatenate([c.on_blind for c in clips])
    lines.append(f"{'frames in plain sight':38}{plain.sum():8}, missed {(~seen[plain]).sum()}")
    return "\n".join(lines)


def main() -> None:
    """Measure the virtual camera's errors and fit the error model."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--clips", type=int, default=240, help="number of motions to film")
    parser.add_argument("--seed", type=int, default=0, help="seed of motions, light and noise")
    parser.add_argument("--out", type=pathlib.Path, help="file to write the error model to")
    parser.add_argument("--write", action="store_true", help=f"renew {MODEL_PATH.name}")
    args = parser.parse_args()
    camera = VirtualCamera()
    calibration = calibrate_virtual_camera(camera, args.seed)

    def progress(count: int) -> None:
        end = "\n" if count == args.clips else ""
        print(f"\r{count} of {args.clips} clips", end=end, file=sys.stderr, flush=True)

    clips = measure(camera, calibration, args.clips, args.seed, progress)
    print(error_table(clips))
    model = fit_error_model(clips, camera, calibration, args.seed)
    for name, value in dataclasses.asdict(model).items():
        print(f"  {name:18}{value}")
    out = MODEL_PATH if args.write else args.out
    if out is not None:
        model.save(out)
        print(f"written to {out}")


if __name__ == "__main__":
    main()
