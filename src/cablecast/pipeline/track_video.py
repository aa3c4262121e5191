"""track_video: the track of the endpoint in a recorded video."""

import dataclasses
import hashlib
import itertools
import math
import os
import pathlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.lens import VIEW_BOUNDS_DEG
from cablecast.camera.settings import CameraSettings
from cablecast.camera.tags import EndTag, TagLayout
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.data.recordings import CAST_COLUMN, GRIP_COLUMNS, YAW_COLUMN
from cablecast.errors import (
    CameraError,
    DamagedFileError,
    InputError,
    check_argument_types,
    check_number,
)
from cablecast.files import read_csv, write_bytes, write_csv
from cablecast.pipeline.camera import film_offset, read_log
from cablecast.pipeline.places import folder_or_temporary
from cablecast.runs.folder import METRICS_FILE, RunFolder
from cablecast.runs.progress import DONE_NOTE, Progress, ProgressCallback, show
from cablecast.setup import Setup
from cablecast.vision.calibration import (
    Board,
    Calibration,
    TagShift,
    calibrate_lens,
    calibrate_view,
    check_tags,
)
from cablecast.vision.clock import check_film_rate
from cablecast.vision.end_tag import TagTracker, make_tracker
from cablecast.vision.tags import detect_tags, load_cv2
from cablecast.vision.tracker import (
    EndpointTracker,
    MarkerConfig,
    TrackerConfig,
    grab_of,
    hue_apart,
    sample_path,
)
from cablecast.vision.trials import tags_of
from cablecast.vision.video import (
    RATE_MAX,
    RATE_MIN,
    capture_rate,
    read_pictures,
    read_video,
)

TRACK_FILE = "track.csv"
FRAMES_FILE = "frames.csv"
CALIBRATION_FILE = "calibration.json"
PICTURE_FILE = "track.png"

CASTS_FILE = "casts.csv"

_COLUMNS = ("time_s", "x_m", "y_m")
_CAST_COLUMNS = (CAST_COLUMN, *_COLUMNS, *GRIP_COLUMNS)
_CALIBRATION_FRAMES = 12
_TAGS_STRIDE, _TAGS_LOOKS = 60, 9
"""Frames from one look for the tags to the next, and looks in a film of few frames."""
_CAMERA = CameraSettings(source="film")
"""Camera where there is no lab file with one: its angle of view and marker are the defaults."""

_PLAIN = ("view_deg", "begin", "start", "end", "rate", "marker", "marker_hue", "marker_z")
"""Settings of a run that are no files."""
_OF_THE_GRIP = ("grip_hue", "grip_tag", "grip_tag_size", "grip_z")
"""Settings of a run that looks for the held end, too."""
_GRIP_HUE_APART = 45.0
"""Least difference between the hues of the two markers [deg], which light changes by 20 deg."""
_OF_THE_CAMERA = (
    "width",
    "height",
    "row_time",
    "view_deg",
    "lens",
    "tags",
    "tag_family",
    "end_tag",
    "marker",
    "marker_hue",
)
"""Settings of the lab file's camera that a track depends on."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrackConfig:
    """Description of a recording.

    Attributes:
        calibration: A calibration.json of the same camera at the same place; computed from the tags
            in the video if None.
        tags: YAML file of the tags' places on the table; those of the lab file if None.
        board: Folder of pictures of the default calibration board, for the lens; if None, the
            lens of the lab file's camera if the video has its size, or else found from the tags.
        view_deg: Angle of view of the camera over the diagonal [deg], where nothing else gives the
            lens; that of the lab file's camera if None.
        begin: Point near the endpoint when the video starts [m]; straight ahead at the end of the
            cable if None.
        start: Time at which the motion begins, from the first frame on [s].
        log: CSV file of the joints of the arm in the film (time_s, q1 to q6), whose time 0 is then
            that of the track, and by which the film's rate is checked.
        rate: Frames per second with which the video was taken [1/s]; as many as it is stored with
            if None, which must then be possible.
        end: Time of the last frame that counts, from the start of the motion on [s]; that of the
            last one if None.
        marker: Length and width of the marker along and across the cable [m]; those of the lab
            file's camera if None.
        marker_hue: Hue of the marker: 0 is red, 120 green, 240 blue [deg]; that of the lab file's
            camera if None.
        marker_z: Height of the marker's middle above the table [m]; the cable's radius if None.
        grip_hue: Hue of a second marker, where a hand holds the cable [deg].
        grip_tag: Number of a tag of the family 4X4_50 there in its place, which tells how the hand
            turns; without either the held end is not looked for.
        grip_tag_size: Length of a side of the tag's black square [m].
        grip_z: Height of that marker or tag above the table [m]; the lab file's grip height if
            None.
    """

    calibration: pathlib.Path | None = None
    tags: pathlib.Path | None = None
    board: pathlib.Path | None = None
    view_deg: float | None = None
    begin: tuple[float, float] | None = None
    start: float = 0.0
    log: pathlib.Path | None = None
    rate: float | None = None
    end: float | None = None
    marker: tuple[float, float] | None = None
    marker_hue: float | None = None
    marker_z: float | None = None
    grip_hue: float | None = None
    grip_tag: int | None = None
    grip_tag_size: float = 0.03
    grip_z: float | None = None

    def __post_init__(self):
        for name in ("marker_hue", "grip_hue"):
            check_number(name, getattr(self, name) or 0.0, 0.0, 360.0, "deg")
        for name in ("marker_z", "grip_z"):
            check_number(name, getattr(self, name) or 0.0, 0.0, 0.5, "m")
        if self.grip_hue is not None and self.grip_tag is not None:
            raise InputError("a marker or a tag shows the held end: give grip_hue or grip_tag")
        if self.calibration is not None and (self.tags or self.board):
            raise InputError("a calibration says it all: give either it, or tags and board")
        if self.log is not None and self.start:
            raise InputError("the log says when the motion begins: give either it, or the start")
        for name, low, high, unit in (
            ("view_deg", *VIEW_BOUNDS_DEG, "deg"),
            ("end", 0.1, 3600.0, "s"),
            ("rate", RATE_MIN, 100 * RATE_MAX, "1/s"),
        ):
            if (value := getattr(self, name)) is not None:
                check_number(name, value, low, high, unit)
        check_number("start", self.start, 0.0, 3600.0, "s")
        for name, value in zip(
            ("marker length", "marker width"), self.marker or _CAMERA.marker, strict=True
        ):
            check_number(name, value, 0.002, 0.5, "m")
        for name, value in zip(("begin x", "begin y"), self.begin or (0.0, 0.0), strict=True):
            check_number(name, value, -10.0, 10.0, "m")

    @property
    def finds_grip(self) -> bool:
        """Whether the held end is looked for, too."""
        return self.grip_hue is not None or self.grip_tag is not None


@dataclasses.dataclass(frozen=True, kw_only=True)
class VideoTrack:
    """Track of an endpoint in a video, every 100 ms, and the contents of metrics.json."""

    track: EndpointTrack
    metrics: dict[str, Any]


@check_argument_types
def track_video(
    video: str | os.PathLike[str],
    setup: Setup,
    *,
    config: TrackConfig | None = None,
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = show,
) -> VideoTrack:
    """Find the marker in a video from above, and where the endpoint went (section V-C).

    Args:
        video: Any video that FFmpeg reads, from a camera that did not move.
        setup: Gives the table, and the cable: its length and how high the marker lies.
        config: Camera, tags, marker and time of the motion.
        out: Folder that keeps the track, the calibration and a picture; none if None.
        progress: Called with the number of frames done.

    Raises:
        CameraError: The camera was moved since its calibration, or in the film.
        InputError: There is no such video, it does not fit the calibration, or a value is out of
            bounds.
        MissingExtraError: OpenCV is not installed.
    """
    load_cv2()
    config, video = config or TrackConfig(), pathlib.Path(video)
    if not video.is_file():
        raise InputError(f"there is no video {video}")
    if config.board is not None and not config.board.is_dir():
        raise InputError(f"board folder {config.board}: there is no such folder")
    camera = (setup.camera or _CAMERA).to_dict()
    settings = {
        **setup.to_settings(),
        "camera": {name: camera[name] for name in _OF_THE_CAMERA if name in camera},
        "video": str(video),
        "video_sha256": _digest(video),
        "calibration_sha256": _digest(config.calibration),
        "tags_sha256": _digest(config.tags),
        "board_sha256": _digest(config.board),
        **({} if config.log is None else {"log_sha256": _digest(config.log)}),
        **{name: getattr(config, name) for name in _PLAIN},
        **({name: getattr(config, name) for name in _OF_THE_GRIP} if config.finds_grip else {}),
    }
    with folder_or_temporary(out) as folder:
        run = RunFolder.open(folder, "track", settings)
        done = run.metrics
        if done is not None:
            progress(Progress(task=f"Tracking {video.name}", note=DONE_NOTE))
            return VideoTrack(track=_read_track(run, done), metrics=done)
        found = _track(video, setup, config, progress)
        with run.locked():
            track, metrics = found.tracker.track(), _metrics(found)
            if out is not None:
                _write_files(run, found, video.stem)
                metrics["track_sha256"] = _digest(run.path / TRACK_FILE)
                run.finish(metrics)
        return VideoTrack(track=track, metrics=metrics)


def join_casts(folders: Iterable[str | os.PathLike[str]], file: str | os.PathLike[str]) -> int:
    """Join the tracks of films by hand into a table for `cablecast import`, one cast each.

    Args:
        folders: Folders of `track_video`, which looked for the held end, too.
        file: Table to write.

    Returns:
        Number of casts.

    Raises:
        InputError: In a folder the held end was not looked for.
    """
    names = _CAST_COLUMNS
    tables = [read_csv(pathlib.Path(one) / FRAMES_FILE, _CAST_COLUMNS) for one in folders]
    if all(table and YAW_COLUMN in table[0] for table in tables):
        names = (*names, YAW_COLUMN)
    rows = [[row[name] for name in names] for table in tables for row in table]
    write_csv(pathlib.Path(file), names, rows)
    return len(tables)


def _digest(path: pathlib.Path | None) -> str | None:
    """Return the checksum of a file, or of all files of a folder."""
    if path is None:
        return None
    if not (path.is_dir() or path.is_file()):
        # A device would be read without end.
        raise InputError(f"there is no file {path}")
    digest = hashlib.sha256()
    for file in sorted(f for f in path.iterdir() if f.is_file()) if path.is_dir() else [path]:
        with file.open("rb") as stream:
            digest.update(hashlib.file_digest(stream, "sha256").digest())
    return digest.hexdigest()[:16]


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Found:
    """What was found in a film.

    Attributes:
        tracker: Tracker of the endpoint, which has seen all frames.
        grip: Tracker of the held end; None where it was not looked for.
        calibration: Calibration of the camera.
        shift: Its check in the part of the film in which the tags are farthest from their places.
        image: Last frame.
    """

    tracker: EndpointTracker
    grip: EndpointTracker | None
    calibration: Calibration
    shift: TagShift
    image: Any


def _grip_tracker(
    calibration: Calibration,
    setup: Setup,
    config: TrackConfig,
    camera: CameraSettings,
    end: TrackerConfig,
) -> EndpointTracker | None:
    """Return the tracker of the held end, if it is looked for.

    Args:
        calibration: Calibration of the camera.
        setup: Gives the place where the cable is held at the start.
        config: Marker or tag of the held end.
        camera: Settings that the endpoint is tracked with.
        end: Settings of its tracker.
    """
    if not config.finds_grip:
        return None
    workspace, tag = setup.workspace, None
    height = workspace.grip_height if config.grip_z is None else config.grip_z
    if config.grip_tag is not None:
        tag = EndTag(id=config.grip_tag, size=config.grip_tag_size, height=height)
        other = camera.end_tag
        if other is not None and (other.id, other.family) == (tag.id, tag.family):
            raise InputError(f"grip_tag = {tag.id} is the number of the tag at the free end, too")
    elif camera.end_tag is None:
        apart = abs(hue_apart(end.marker.hue, config.grip_hue or 0.0))
        if apart < _GRIP_HUE_APART:
            raise InputError(
                f"marker_hue = {end.marker.hue:g} and grip_hue = {config.grip_hue:g} deg are "
                f"{apart:g} deg apart: markers of less than {_GRIP_HUE_APART:g} are mixed up"
            )
    marker = dataclasses.replace(end.marker, hue=config.grip_hue or 0.0)
    return make_tracker(
        calibration.view,
        workspace,
        setup.cable,
        dataclasses.replace(camera, end_tag=tag),
        dataclasses.replace(end, marker=marker, marker_z=height),
        start_xy=(0.0, workspace.reset_y),
    )


def _track(
    video: pathlib.Path, setup: Setup, config: TrackConfig, progress: ProgressCallback
) -> _Found:
    """Return what was found in a film."""
    calibration = _calibrate(video, setup, config, progress)
    info, frames = read_video(video)
    # A film that does not say its length may be long.
    stride = info.frame_count // _TAGS_LOOKS if info.frame_count else _TAGS_STRIDE
    stride, looks = min(max(stride, 1), _TAGS_STRIDE), []
    camera = setup.camera or _CAMERA
    length, width = config.marker or camera.marker
    hue = camera.marker_hue if config.marker_hue is None else config.marker_hue
    # A phone beside the camera of the lab file has another shutter.
    is_own = (camera.width, camera.height) == (info.width, info.height)
    options = TrackerConfig(
        marker=MarkerConfig(length=length, width=width, hue=hue),
        marker_z=setup.cable.radius if config.marker_z is None else config.marker_z,
        exposure_max=min(1.0 / 120, 1.0 / info.rate),
        row_time=camera.row_time if is_own else 0.0,
    )
    tracker = make_tracker(
        calibration.view,
        setup.workspace,
        setup.cable,
        camera,
        options,
        start_xy=config.begin or (0.0, setup.workspace.reset_y + setup.cable.length),
    )
    grip = _grip_tracker(calibration, setup, config, camera, options)
    image, time, task = None, 0.0, f"Tracking {video.name}"
    # Slow motion is stored with fewer frames per second than it was taken with.
    taken = capture_rate(video) if config.rate is None else config.rate
    if config.rate is None and taken is not None and abs(taken / info.rate - 1.0) > 0.05:
        raise InputError(
            f"{video} was taken with {taken:g} frames/s, and is stored with {info.rate:g}: say "
            f"--rate {taken:g} if it is slow motion, or --rate {info.rate:g} if not"
        )
    pace = 1.0 if taken is None else info.rate / taken
    start = config.start
    if config.log is not None:
        reported = read_log(config.log, setup.arm)
        view, row_time = calibration.view, tracker.config.row_time
        start = -film_offset(video, reported, setup.arm, view, row_time, pace=pace).offset
    for count, (time, image) in enumerate(frames, start=1):
        if config.end is not None and pace * time - start > config.end:
            break
        for one in (tracker, *([] if grip is None else [grip])):
            one.update(pace * time - start, grab_of(image))
        if (count - 1) % stride == 0:
            looks.append(detect_tags(image, calibration.family))
        if count % 60 == 0:
            total = max(info.frame_count, count)
            progress(Progress(task=task, done=count, total=total, unit="frames"))
    if config.log is not None and not 0.0 <= start <= pace * time:
        raise InputError(
            f"time 0 of {config.log} lies {start:.1f} s after the first frame of {video}, and the "
            f"last one {pace * time:.1f} s: let the log count from the start of the motion"
        )
    if config.rate is None and config.log is None:
        check_film_rate(*tracker.frames, info.rate)
    # In the median of a third, a camera that shakes while the arm moves is where it was.
    thirds = [[looks[i] for i in part] for part in np.array_split(np.arange(len(looks)), 3)]
    shifts = [
        check_tags(third, calibration, f" {where} of {video}", "cut the film there, or film anew")
        for third, where in zip(
            thirds, ("at the start", "in the middle", "at the end"), strict=True
        )
        if third
    ]
    return _Found(
        tracker=tracker,
        grip=grip,
        calibration=calibration,
        shift=max(shifts, key=lambda shift: shift.px),
        image=image,
    )


def _calibrate(
    video: pathlib.Path, setup: Setup, config: TrackConfig, progress: ProgressCallback
) -> Calibration:
    """Return the calibration that was given, or one from the tags in the video."""
    progress(Progress(task="Looking for tags in the video"))
    info, frames = read_video(video)
    pictures = [image for _, image in itertools.islice(frames, _CALIBRATION_FRAMES)]
    if config.calibration is not None:
        calibration = Calibration.load(config.calibration)
        lens = calibration.view.lens
        if (info.width, info.height) != (lens.width, lens.height):
            raise InputError(
                f"{video} has {info.width} x {info.height} px, but the camera was calibrated with "
                f"{lens.width} x {lens.height} px"
            )
        found = [detect_tags(image, calibration.family) for image in pictures]
        advice = "leave --calibration out, and the tags in the film calibrate it"
        shift = check_tags(found, calibration, f" at the start of {video}", advice)
        if shift.moved:
            raise CameraError(
                f"tags {list(shift.moved)} were moved since {config.calibration} was made "
                f"({shift.moved_words}): {advice}"
            )
        return calibration
    camera, layout = setup.camera or _CAMERA, tags_of(setup)
    if config.tags is not None:
        layout = TagLayout.load(config.tags)
    known, lens = camera.lens, None
    if config.board is not None:
        images = read_pictures(config.board)
        fit = calibrate_lens(images, Board())
        pattern = ", of the older pattern" if fit.board.legacy else ""
        task = f"Lens from {fit.picture_count} of {len(images)} pictures of a board{pattern}"
        progress(Progress(task=task, note=f"rms {fit.rms_px:.2f} px"))
        lens = fit.lens
    elif known is not None and (known.width, known.height) == (info.width, info.height):
        lens = known
    degrees = config.view_deg or camera.view_deg
    return calibrate_view(pictures, layout, lens=lens, diagonal_view=math.radians(degrees))


def _metrics(found: _Found) -> dict[str, Any]:
    calibration, shift = found.calibration, found.shift
    track = found.tracker.track()
    landed = track.final_xy
    return {
        "status": track.status.code,
        "meaning": track.status.value,
        "final_xy": landed.tolist() if np.isfinite(landed).all() else None,
        "sample_count": len(track.times),
        "samples_seen": int(np.isfinite(track.endpoint_xy).all(axis=1).sum()),
        "frame_count": len(found.tracker.frames[0]),
        "frames_seen": _seen_count(found.tracker),
        "calibration_rms_mm": 1e3 * calibration.rms,
        "tags_used": len(calibration.tag_ids),
        "tags_rejected": list(calibration.rejected_ids),
        "tags_turned": calibration.turned,
        "tags_off_px": shift.px,
        "tags_off_mm": 1e3 * shift.table,
        "tags_moved": shift.moved_words,
        **({} if found.grip is None else {"grip_seen": _seen_count(found.grip)}),
    }


def _seen_count(tracker: EndpointTracker) -> int:
    """Return the number of frames in which a tracker saw what it follows."""
    return int(np.isfinite(tracker.frames[1]).all(axis=1).sum())


def _write_files(run: RunFolder, found: _Found, name: str) -> None:
    """Write the files of a run; the name is that of the film."""
    found.calibration.save(run.path / CALIBRATION_FILE)
    track = found.tracker.track()
    times, xy = found.tracker.frames
    names, more = ("frame", *_COLUMNS), ()
    if found.grip is not None:
        # A rolling shutter exposes the held end at another moment than the free one.
        grip_times, places = found.grip.frames
        places = sample_path(grip_times, places, times)
        names, more = (*names, *GRIP_COLUMNS), (places,)
        if isinstance(found.grip, TagTracker):
            turns = sample_path(grip_times, found.grip.turns[:, None], times)
            names, more = (*names, YAW_COLUMN), (places, turns)
        names = (*names, CAST_COLUMN)
    rows = _rows(times, np.column_stack([xy, *more]))
    if found.grip is not None:
        rows = ((*row, name) for row in rows)
    write_csv(run.path / FRAMES_FILE, names, rows)
    write_csv(run.path / TRACK_FILE, ("sample", *_COLUMNS), _rows(track.times, track.endpoint_xy))
    if found.image is not None:
        _draw(run.path / PICTURE_FILE, found.image, found.tracker)


def _rows(times: Any, places: Any) -> Iterator[tuple[Any, ...]]:
    """Yield numbered rows of places; cells are empty where nothing was seen."""
    for number, (time, place) in enumerate(zip(times, places, strict=True)):
        cells = (f"{value:.5f}" if math.isfinite(value) else "" for value in place)
        yield number, f"{time:.5f}", *cells


def _read_track(run: RunFolder, metrics: dict[str, Any]) -> EndpointTrack:
    """Return the track of a run that is done."""
    file = run.path / TRACK_FILE
    if not file.is_file() or _digest(file) != metrics["track_sha256"]:
        raise DamagedFileError(
            f"{file} is not what was written: delete {run.path / METRICS_FILE}, and the same "
            "command tracks the video again"
        )
    rows = [[float(row[n] or "nan") for n in _COLUMNS] for row in read_csv(file, _COLUMNS)]
    values = np.array(rows).reshape(-1, 3)
    status = TrialStatus.from_code(metrics["status"])
    return EndpointTrack(times=values[:, 0], endpoint_xy=values[:, 1:], status=status)


def _draw(path: pathlib.Path, image: Any, tracker: EndpointTracker) -> None:
    """Draw the endpoint's path into the last frame: thin where seen, a ring at each sample."""
    cv2, picture, violet = load_cv2(), image.copy(), (200, 0, 200)

    def pixels(xy: NDArray[np.float64]) -> list[tuple[int, int] | None]:
        points = np.column_stack([xy, np.full(len(xy), tracker.config.marker_z)])
        uv = tracker.view.to_image(points)
        return [(round(u), round(v)) if np.isfinite([u, v]).all() else None for u, v in uv.tolist()]

    for a, b in itertools.pairwise(pixels(tracker.frames[1])):
        if a is not None and b is not None:
            cv2.line(picture, a, b, violet, 2, cv2.LINE_AA)
    for centre in pixels(tracker.track().endpoint_xy):
        if centre is not None:
            cv2.circle(picture, centre, 7, violet, 2, cv2.LINE_AA)
    write_bytes(path, cv2.imencode(".png", picture)[1].tobytes())
