"""`cablecast track`: find the endpoint's track in a recorded video."""

import dataclasses
import pathlib
import re
from typing import Annotated, Any

import tyro

from cablecast.cli.options import argument


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
    """Without a calibration: a YAML file that says where the tags lie on the table."""
    board: Annotated[pathlib.Path | None, argument("DIR", "the lens is found from the tags")] = None
    """Without a calibration: a folder of pictures of a calibration board, which tell the lens."""
    view_deg: Annotated[float, argument("DEG")] = 78.0
    """Without a calibration and a board: the camera's angle of view over the diagonal [deg]."""
    setup: Annotated[pathlib.Path | None, argument("FILE", "the paper's set-up")] = None
    """Lab file that describes cable and table."""
    cable: Annotated[str | None, argument("CABLE", "that of --setup, or cable_1")] = None
    """Cable in the video: tells how high the marker lies, and where the endpoint begins."""
    begin: Annotated[
        tuple[float, float] | None, argument("X Y", "straight ahead, at the end of the cable")
    ] = None
    """Point near the endpoint when the video begins [m]."""
    start: Annotated[float, argument("S")] = 0.0
    """Time at which the motion begins, from the first frame on [s]: time 0 of the track."""
    marker: Annotated[tuple[float, float], argument("LENGTH WIDTH")] = (0.038, 0.016)
    """Size of the marker along and across the cable [m]."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/track-VIDEO")] = None
    """Folder of the results."""

    def run(self) -> None:
        """Track, write the results, and print how the trial ended."""
        from cablecast.cli.options import load_lab
        from cablecast.cli.progress import console_progress
        from cablecast.pipeline.track_video import TrackConfig, track_video
        from cablecast.runs.places import RUNS_FOLDER

        config = TrackConfig(
            calibration=self.calibration,
            tags=self.tags,
            board=self.board,
            view_deg=self.view_deg,
            begin=self.begin,
            start=self.start,
            marker=self.marker,
        )
        name = "track-" + (re.sub(r"[^\w.-]+", "_", self.video.stem).strip(".") or "video")
        out = self.out or RUNS_FOLDER / name
        with console_progress() as progress:
            found = track_video(
                self.video,
                load_lab(self.setup, self.cable),
                config=config,
                out=out,
                progress=progress,
            )
        _print_result(found.metrics, out)


def _print_result(metrics: dict[str, Any], out: pathlib.Path) -> None:
    from cablecast.cli.options import polar_text
    from cablecast.pipeline.track_video import PICTURE_FILE, TRACK_FILE

    print(f"{metrics['status']}: {metrics['meaning']}")
    if metrics["final_xy"] is not None:
        print(f"endpoint  {polar_text(metrics['final_xy'])}")
    print(f"seen in   {metrics['frames_seen']} of {metrics['frame_count']} frames")
    print(
        f"tags      {metrics['tags_used']} used, rms {metrics['calibration_rms_mm']:.1f} mm"
        + (f", moved: {metrics['tags_rejected']}" if metrics["tags_rejected"] else "")
    )
    print(f"track     {out / TRACK_FILE}\npicture   {out / PICTURE_FILE}")
