"""`cablecast track`: find the endpoint's track in a recorded video."""

import dataclasses
import pathlib
import re
import sys
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cablecast.cli.options import DEFAULT_CABLE, RUNS_FOLDER, argument, polar_text

if TYPE_CHECKING:
    from cablecast.cable import Cable
    from cablecast.tracking.calibration import Calibration
    from cablecast.tracking.tracker import EndpointTracker

TRACK_FILE = "track.csv"
FRAMES_FILE = "frames.csv"
CALIBRATION_FILE = "calibration.json"
PICTURE_FILE = "track.png"

_CALIBRATION_FRAMES = 12
_BOARD_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Track:
    """Find the green marker in a video from above and write where the endpoint went.

    Writes the track every 100 ms (track.csv), the endpoint in every frame (frames.csv), how the
    trial ended (metrics.json), the calibration, and a picture of the track. Where the marker was
    not seen the tables are empty: nothing is guessed. docs/camera.md tells how to set up a camera.
    """

    video: Annotated[tyro.conf.Positional[pathlib.Path], argument("VIDEO")]
    """The video: any that FFmpeg reads, from a camera that did not move."""
    calibration: Annotated[
        pathlib.Path | None, argument("FILE", "computed from the tags in the video")
    ] = None
    """A calibration.json of the same camera at the same place, as this command writes it."""
    tags: Annotated[pathlib.Path | None, argument("FILE", "11 tags along the table's edges")] = None
    """Without a calibration: a YAML file that says where the tags lie on the table. Write one with
    `python -m cablecast.tracking.tags DIR`."""
    board: Annotated[pathlib.Path | None, argument("DIR", "the lens is found from the tags")] = None
    """Without a calibration: a folder of pictures of a calibration board, which tell the lens."""
    view_deg: Annotated[float, argument("DEG")] = 78.0
    """Without a calibration and a board: the camera's angle of view over the diagonal [deg]."""
    cable: Annotated[str, argument("CABLE")] = DEFAULT_CABLE
    """Which cable: tells how high the marker lies, and where the endpoint begins."""
    begin: Annotated[
        tuple[float, float] | None, argument("X Y", "straight ahead, at the end of the cable")
    ] = None
    """About where the endpoint lies when the video begins [m]."""
    start: Annotated[float, argument("S")] = 0.0
    """When the motion begins, from the first frame on [s]: time 0 of the track."""
    marker: Annotated[tuple[float, float], argument("LENGTH WIDTH")] = (0.038, 0.016)
    """Size of the marker along and across the cable [m]."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/track-VIDEO")] = None
    """Where to put the results."""

    def run(self) -> None:
        """Track, write the results, and say how the trial ended."""
        from cablecast.cable import load_cable
        from cablecast.cli.run_folder import RunFolder
        from cablecast.errors import InputError

        cable = load_cable(self.cable)
        if self.calibration is not None and (self.tags or self.board):
            raise InputError("--calibration says it all: give either it, or --tags and --board")
        if not 0.0 <= self.start <= 3600.0:
            raise InputError(f"--start {self.start} s is outside [0, 3600]")
        if not self.video.is_file():
            raise InputError(f"there is no video {self.video}")
        settings = {
            "video": str(self.video),
            "video_bytes": self.video.stat().st_size,
            "calibration": self.calibration and str(self.calibration),
            "tags": self.tags and str(self.tags),
            "board": self.board and str(self.board),
            "view_deg": self.view_deg,
            "cable": cable.to_dict(),
            "begin": self.begin,
            "start": self.start,
            "marker": self.marker,
        }
        name = "track-" + (re.sub(r"[^\w.-]+", "_", self.video.stem).strip(".") or "video")
        run = RunFolder.open(self.out or RUNS_FOLDER / name, "track", settings)
        if run.metrics is None:
            self._track(run, cable)
        _print_result(run)

    def _track(self, run: Any, cable: "Cable") -> None:
        import numpy as np

        from cablecast.datasets.progress import console_progress
        from cablecast.files import write_text
        from cablecast.tracking.marker import MarkerConfig
        from cablecast.tracking.tracker import EndpointTracker, TrackerConfig
        from cablecast.tracking.video import read_video
        from cablecast.workspace import Workspace

        calibration = self._calibrate()
        workspace = Workspace()
        info, frames = read_video(self.video)
        lens = calibration.view.lens
        if (info.width, info.height) != (lens.width, lens.height):
            from cablecast.errors import InputError

            raise InputError(
                f"{self.video} has {info.width} x {info.height} px, but the camera was calibrated "
                f"with {lens.width} x {lens.height} px"
            )
        length, width = self.marker
        tracker = EndpointTracker(
            calibration.view,
            workspace,
            TrackerConfig(
                marker=MarkerConfig(length=length, width=width),
                marker_z=cable.radius,
                exposure_max=min(1.0 / 120, 1.0 / info.rate),
            ),
            start_xy=self.begin or (0.0, workspace.reset_y + cable.length),
        )
        image = None
        with console_progress(f"Tracking {self.video.name}", "frames") as progress:
            for count, (time, frame) in enumerate(frames, start=1):
                image = frame
                tracker.update(time - self.start, lambda w, f=frame: f[w[1] : w[3], w[0] : w[2]])
                if count % 60 == 0:
                    progress(count, max(info.frame_count, count))
        track = tracker.track()
        run.begin()
        calibration.save(run.path / CALIBRATION_FILE)
        times, xy = tracker.frames
        write_text(run.path / FRAMES_FILE, _csv("frame", np.arange(len(times)), times, xy))
        write_text(
            run.path / TRACK_FILE,
            _csv("sample", np.arange(len(track.times)), track.times, track.endpoint_xy),
        )
        if image is not None:
            _draw(run.path / PICTURE_FILE, image, tracker)
        seen = np.isfinite(xy).all(axis=1)
        landed = track.final_xy
        run.finish(
            {
                "status": track.status.code,
                "meaning": track.status.value,
                "final_xy": landed.tolist() if np.isfinite(landed).all() else None,
                "sample_count": len(track.times),
                "samples_seen": int(np.isfinite(track.endpoint_xy).all(axis=1).sum()),
                "frame_count": len(times),
                "frames_seen": int(seen.sum()),
                "calibration_rms_mm": 1e3 * calibration.rms,
                "tags_used": len(calibration.tag_ids),
                "tags_rejected": list(calibration.rejected_ids),
            }
        )

    def _calibrate(self) -> "Calibration":
        """The calibration that was given, or one from the tags in the video."""
        import itertools
        import math

        from cablecast.tracking.calibration import Calibration, calibrate_view
        from cablecast.tracking.tags import TagLayout, default_layout
        from cablecast.tracking.video import read_video

        if self.calibration is not None:
            return Calibration.load(self.calibration)
        layout = default_layout() if self.tags is None else TagLayout.load(self.tags)
        print("Looking for tags in the video", file=sys.stderr)
        _, frames = read_video(self.video)
        pictures = [image for _, image in itertools.islice(frames, _CALIBRATION_FRAMES)]
        lens = None if self.board is None else _lens_from_board(self.board)
        return calibrate_view(
            pictures, layout, lens=lens, diagonal_view=math.radians(self.view_deg)
        )


def _lens_from_board(folder: pathlib.Path) -> Any:
    """Intrinsics from a folder of pictures of the default board."""
    from cablecast.errors import InputError
    from cablecast.tracking.calibration import Board, calibrate_lens
    from cablecast.tracking.opencv import load_cv2

    cv2 = load_cv2()
    if not folder.is_dir():
        raise InputError(f"--board {folder}: there is no such folder")
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in _BOARD_SUFFIXES)
    images = [image for image in (cv2.imread(str(file)) for file in files) if image is not None]
    if not images:
        raise InputError(f"--board {folder} holds no pictures")
    lens, rms = calibrate_lens(images, Board())
    print(f"The lens follows from {len(images)} pictures (rms {rms:.2f} px)", file=sys.stderr)
    return lens


def _csv(index_name: str, index: Any, times: Any, xy: Any) -> str:
    """A table of positions; empty where not seen."""
    lines = [f"{index_name},time_s,x_m,y_m"]
    for i, time, (x, y) in zip(index, times, xy, strict=True):
        place = f"{x:.5f},{y:.5f}" if x == x else ","
        lines.append(f"{i},{time:.5f},{place}")
    return "\n".join(lines) + "\n"


def _draw(path: pathlib.Path, image: Any, tracker: "EndpointTracker") -> None:
    """The last frame with the endpoint's path in it: thin where seen, a ring at each sample."""
    import itertools

    import numpy as np

    from cablecast.files import write_bytes
    from cablecast.tracking.opencv import load_cv2

    cv2 = load_cv2()
    picture = image.copy()
    _, xy = tracker.frames
    z = np.full(len(xy), tracker.config.marker_z)
    pixels = tracker.view.to_image(np.column_stack([xy, z]))
    for a, b in itertools.pairwise(pixels):
        if np.isfinite(a).all() and np.isfinite(b).all():
            ends = [tuple(np.round(p).astype(int).tolist()) for p in (a, b)]
            cv2.line(picture, ends[0], ends[1], (200, 0, 200), 2, cv2.LINE_AA)
    track = tracker.track()
    z = np.full(len(track.times), tracker.config.marker_z)
    for pixel in tracker.view.to_image(np.column_stack([track.endpoint_xy, z])):
        if np.isfinite(pixel).all():
            centre = tuple(np.round(pixel).astype(int).tolist())
            cv2.circle(picture, centre, 7, (200, 0, 200), 2, cv2.LINE_AA)
    write_bytes(path, cv2.imencode(".png", picture)[1].tobytes())


def _print_result(run: Any) -> None:
    metrics = run.metrics or {}
    print(f"{metrics['status']}: {metrics['meaning']}")
    if metrics["final_xy"] is not None:
        print(f"endpoint  {polar_text(metrics['final_xy'])}")
    print(f"seen in   {metrics['frames_seen']} of {metrics['frame_count']} frames")
    print(
        f"tags      {metrics['tags_used']} used, rms {metrics['calibration_rms_mm']:.1f} mm"
        + (f", moved: {metrics['tags_rejected']}" if metrics["tags_rejected"] else "")
    )
    print(f"track     {run.path / TRACK_FILE}\npicture   {run.path / PICTURE_FILE}")
