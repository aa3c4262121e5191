"""Measures the errors of the virtual camera on rendered clips, and fits the error model to them.

`python -m cablecast.rigs.virtual.camera_fit` prints what it measured; with --write it renews the
camera_error.json that comes with cablecast.
"""

import argparse
import dataclasses
import pathlib
import sys

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.ur5 import ArmUR5
from cablecast.cable import load_cable
from cablecast.motion.joint_path import JointPath
from cablecast.tracking.calibration import Calibration
from cablecast.tracking.tracker import EndpointTracker
from cablecast.rigs.virtual.arm_shape import arm_shape, joints_at, sight_clearance
from cablecast.rigs.virtual.camera import Film, VirtualCamera, track_film
from cablecast.rigs.virtual.camera_calibrate import calibrate_virtual_camera
from cablecast.rigs.virtual.camera_drawing import FilmedTrial
from cablecast.rigs.virtual.camera_error import MODEL_FILE, CameraErrorModel, bias_terms

Array = NDArray[np.float64]

_NODE_COUNT = 16
_DT = 0.01
_REST_SPEED = 0.02
"""Slower than this the endpoint rests [m/s]."""
_CLEAR = 0.05
"""Farther from the arm's silhouette than this, the arm plays no part [m]."""
_NEAR = 0.06
"""Nearer than this to its edge, on either side, occlusion is measured [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Clip:
    """What was true and what was tracked in the frames of one clip.

    Attributes:
        times: Of the frames [s], shape [frame].
        points: True endpoint [m], shape [frame, 3].
        tracked_xy: What the tracker reported, NaN where it saw nothing [m], shape [frame, 2].
        clearance: Distance of the line of sight from the arm, infinite without an arm [m], shape
            [frame].
        marker_z: Height at which the tracker believed the marker [m].
        blind: Where other green things lie, as x, y and radius [m], shape [place, 3].
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
        """Of the endpoint over the table [m/s], shape [frame]."""
        return np.linalg.norm(np.gradient(self.points[:, :2], self.times, axis=0), axis=-1)


def clip_trial(rng: np.random.Generator, index: int) -> FilmedTrial:
    """A made-up motion: the endpoint glides from one place to another; half pass by the arm.

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
        arm = ArmUR5()
        theta = rng.uniform(-0.9, 0.9)
        reach = rng.uniform(0.5, 0.85)
        turn = rng.uniform(-0.15, 0.15) * glide
        yaw = theta + turn
        grip = np.stack([reach * np.sin(yaw), reach * np.cos(yaw)], axis=-1)
        still = np.zeros_like(times)
        poses = np.stack([grip[:, 0], grip[:, 1], still + 0.02, yaw, still], axis=1)
        q = arm.inverse(poses)
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
    camera: VirtualCamera, calibration: Calibration, clip_count: int, seed: int, progress=None
) -> list[Clip]:
    """Film and track made-up motions.

    Args:
        camera: The camera.
        calibration: What the tracker knows of it.
        clip_count: How many motions.
        seed: Chooses them.
        progress: Called with the number of finished clips.
    """
    clips = []
    for index in range(clip_count):
        rng = np.random.default_rng([seed, index])
        trial = clip_trial(rng, index)
        film = camera.film(trial, seed=int(rng.integers(2**31)))
        tracker = track_film(film, calibration)
        times, tracked_xy = tracker.frames
        points = trial.shape_at(times)[:, -1]
        clearance = np.full(len(times), np.inf)
        if trial.joint_path is not None:
            shape = arm_shape(joints_at(trial.joint_path, times))
            clearance = sight_clearance(points, calibration.view.position, shape)
        clips.append(
            Clip(
                times=times,
                points=points,
                tracked_xy=tracked_xy,
                clearance=clearance,
                marker_z=trial.cable.radius,
                blind=blind_places(tracker, calibration),
            )
        )
        if progress is not None:
            progress(index + 1)
    return clips


def blind_places(tracker: EndpointTracker, calibration: Calibration) -> Array:
    """Circles around the green things that the tracker saw in its first picture.

    Args:
        tracker: After at least one frame.
        calibration: Where pixels lie on the table.

    Returns:
        x, y and radius [m], shape [place, 3].
    """
    from scipy.ndimage import find_objects, label

    if tracker.still_green is None:
        return np.empty((0, 3))
    labels, _ = label(tracker.still_green)  # pyright: ignore[reportGeneralTypeIssues]
    half = tracker.config.marker.length / 2
    places = []
    for window in find_objects(labels):
        rows, columns = window
        corners = [(columns.start, rows.start), (columns.stop, rows.stop)]
        a, b = calibration.view.to_table(np.array(corners, dtype=float))
        # A circle of the box's area, and what of the marker reaches into it.
        radius = np.sqrt(abs((b[0] - a[0]) * (b[1] - a[1])) / np.pi) + half
        if tracker.workspace.on_table((a + b) / 2):
            places.append([*((a + b) / 2), radius])
    return np.array(places).reshape(-1, 3)


def fit_error_model(
    clips: list[Clip], camera: VirtualCamera, calibration: Calibration, seed: int
) -> CameraErrorModel:
    """The error model that describes some clips best."""
    from scipy.optimize import minimize

    view = calibration.view
    low, high = _seen_rectangle(camera, calibration)
    blank = CameraErrorModel(
        camera=view.position,
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
    apparent = [blank.apparent(clip.points, clip.marker_z) for clip in clips]
    velocity = np.concatenate(
        [np.gradient(a, clip.times, axis=0) for a, clip in zip(apparent, clips, strict=True)]
    )
    place = np.concatenate(apparent)
    error = np.concatenate([c.tracked_xy for c in clips]) - place
    clearance = np.concatenate([c.clearance for c in clips])
    owner = np.concatenate([np.full(len(c.times), i) for i, c in enumerate(clips)])
    seen = np.asarray(np.all(np.isfinite(error), axis=1))
    on_blind = np.concatenate([c.on_blind for c in clips])
    clear = np.logical_and(clearance > _CLEAR, ~on_blind)
    good = seen & clear
    speed = np.linalg.norm(velocity, axis=1)
    # Bias of both axes and one delay, in one least-squares problem.
    terms = bias_terms(place[good])
    zero = np.zeros_like(terms)
    left = np.block([[terms, zero], [zero, terms]])
    left = np.column_stack([left, -velocity[good].T.ravel()])
    solution = np.linalg.lstsq(left, error[good].T.ravel(), rcond=None)[0]
    bias, delay = solution[:12].reshape(2, 6), float(solution[12])
    rest_error = error - bias_terms(place) @ bias.T + delay * velocity
    # At rest, the mean of a clip's error is its ground's, the scatter about it the frames'.
    still = good & (speed < _REST_SPEED)
    means, scatter = [], []
    for clip_index in np.unique(owner[still]):
        values = rest_error[still & (owner == clip_index)]
        for part in (values[: Film.LEAD], values[Film.LEAD :]):
            if len(part) >= 4:
                means.append(part.mean(axis=0))
                scatter.append(part.var(axis=0, ddof=1))
    place_sd = float(np.sqrt(np.mean(np.square(means))))
    noise_sd = float(np.sqrt(np.mean(scatter)))
    moving = good & (speed > 5 * _REST_SPEED)
    excess = np.mean(rest_error[moving] ** 2, axis=1) - noise_sd**2 - place_sd**2
    slope2 = float(np.sum(excess * speed[moving] ** 2) / np.sum(speed[moving] ** 4))
    near = seen & (clearance < _CLEAR)
    edge_clearance = 0.03
    covered = near & (clearance < edge_clearance)
    plain = noise_sd**2 + place_sd**2
    edge2 = float(np.mean(rest_error[covered] ** 2)) - plain if covered.any() else 0.0
    # Occlusion: a logistic function of the clearance, by maximum likelihood.
    around = np.isfinite(clearance) & (np.abs(clearance) < _NEAR) & ~on_blind

    def unlikelihood(parameters) -> float:
        z = (clearance[around] - parameters[0]) / np.exp(parameters[1])
        return float(np.sum(np.logaddexp(0.0, np.where(seen[around], -z, z))))

    best = minimize(unlikelihood, [0.005, np.log(0.004)], method="Nelder-Mead").x
    missed = np.logical_and(clear, ~seen)
    return dataclasses.replace(
        blank,
        bias=tuple(tuple(float(value) for value in row) for row in bias),
        place_sd=place_sd,
        noise_sd=noise_sd,
        noise_per_speed=float(np.sqrt(max(slope2, 0.0))),
        edge_sd=float(np.sqrt(max(edge2, 0.0))),
        edge_clearance=edge_clearance,
        delay=delay,
        hidden_clearance=float(best[0]),
        hidden_spread=float(np.exp(best[1])),
        miss_rate=float(missed.sum() / max(clear.sum(), 1)),
        sources={
            "command": "python -m cablecast.rigs.virtual.camera_fit",
            "seed": seed,
            "clip_count": len(clips),
            "frame_count": len(owner),
            "frames_near_arm": int(around.sum()),
            "frames_seen": int(seen.sum()),
            "calibration_rms": calibration.rms,
        },
    )


def _common_blind(clips: list[Clip]) -> Array:
    """Green things that most clips found: a marker or an arm in the way changes some."""
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
    """The part of the table's plane in which a whole marker fits into the image [m]."""
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
    """What was measured, for a person."""
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
    parser.add_argument("--clips", type=int, default=240, help="how many motions to film")
    parser.add_argument("--seed", type=int, default=0, help="chooses motions, light and noise")
    parser.add_argument("--out", type=pathlib.Path, help="where to write the error model")
    parser.add_argument("--write", action="store_true", help=f"renew cablecast's own {MODEL_FILE}")
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
    out = pathlib.Path(__file__).with_name(MODEL_FILE) if args.write else args.out
    if out is not None:
        model.save(out)
        print(f"written to {out}")


if __name__ == "__main__":
    main()
