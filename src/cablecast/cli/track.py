"""`cablecast track`: track the endpoint in a recorded video."""

import dataclasses
import pathlib
import re
import shlex
from typing import Annotated, Any

import tyro

from cablecast.cli.options import argument, casts_text, load_lab, picked, polar_text
from cablecast.errors import InputError
from cablecast.runs.places import RUNS_FOLDER


@dataclasses.dataclass(frozen=True, kw_only=True)
class Track:
    """Track the marker at the cable's end in a video from above.

    Writes the track every 100 ms (track.csv), the endpoint in every frame (frames.csv), the status
    of the trial (metrics.json), the calibration, and a picture of the track. Cells are empty where
    the marker was not seen; nothing is guessed. A video of some seconds takes about a minute.
    With --grip-hue or --grip-tag it also follows the hand that swings the cable, and writes a table
    for `cablecast import` (casts.csv). docs/camera.md explains how to set up a camera, and
    docs/tutorial-cable.md how to film a hand.
    """

    videos: Annotated[
        tyro.conf.Positional[tuple[pathlib.Path, ...]], argument("VIDEO [VIDEO ...]", "required")
    ]
    """Videos in any format that FFmpeg reads, from a camera that did not move."""
    calibration: Annotated[
        pathlib.Path | None, argument("FILE", "computed from the tags in the video")
    ] = None
    """Calibration of the same camera at the same place (calibration.json of an earlier run)."""
    tags: Annotated[pathlib.Path | None, argument("FILE", "those of --setup")] = None
    """YAML file with the places of the tags on the table; not with --calibration."""
    board: Annotated[pathlib.Path | None, argument("DIR", "lens of --setup, or by the tags")] = None
    """Folder of pictures of the default calibration board, to fit the lens; not with --calibration.
    Other boards: `cablecast calibrate lens`, and --setup."""
    view_deg: Annotated[float | None, argument("DEG", "that of --setup, or 78")] = None
    """Angle of view over the image's diagonal [deg], where nothing else gives the lens."""
    setup: Annotated[pathlib.Path | None, argument("FILE", "the paper's set-up")] = None
    """Lab file that describes cable and table, and the camera if it has that section."""
    cable: Annotated[str | None, argument("CABLE", "that of --setup, or cable_1")] = None
    """Cable in the video, which gives the height of the marker and the start of the endpoint."""
    begin: Annotated[
        tuple[float, float] | None, argument("X Y", "straight ahead, at the end of the cable")
    ] = None
    """Point near the endpoint at the beginning of the video [m]."""
    start: Annotated[float, argument("S")] = 0.0
    """Time of the first frame of the motion, which is time 0 of the track [s]."""
    log: Annotated[pathlib.Path | None, argument("FILE", "the film's rate is believed")] = None
    """CSV of the joints of the arm in the video: time_s [s] and q1 to q6 [rad]. Its time 0 is that
    of the track, in place of --start, and the arm's way tells whether the film's rate is true."""
    rate: Annotated[float | None, argument("1/S", "as many as it is stored with")] = None
    """Frames per second with which the video was taken, for slow motion [1/s]."""
    end: Annotated[float | None, argument("S", "the end of the video")] = None
    """Time of the last frame that counts, after the start of the motion [s]: before a hand or the
    robot picks the cable up."""
    marker: Annotated[
        tuple[float, float] | None, argument("LENGTH WIDTH", "that of --setup, or 0.038 0.016")
    ] = None
    """Size of the marker along and across the cable [m]."""
    marker_hue: Annotated[float | None, argument("DEG", "that of --setup, or 122, green")] = None
    """Hue of the marker: 0 is red, 120 green, 240 blue [deg]. `camera check --pick` measures it."""
    marker_z: Annotated[float | None, argument("M", "the cable's radius")] = None
    """Height of the marker above the table [m]."""
    grip_hue: Annotated[float | None, argument("DEG", "no hand is looked for")] = None
    """Hue of a second marker, of the same size, where a hand holds the cable [deg]."""
    grip_tag: Annotated[int | None, argument("ID", "no hand is looked for")] = None
    """Number of a tag of the family 4X4_50 in its place, which tells how the hand turns."""
    grip_tag_size: Annotated[float, argument("M")] = 0.03
    """Side of the black square of that tag [m]."""
    grip_z: Annotated[float | None, argument("M", "grip_height of --setup, or 0.02")] = None
    """Height of the hand's marker or tag above the table [m]."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/track-VIDEO, or runs/track")] = None
    """Folder of the results; of several videos, of a folder for each."""

    def run(self) -> None:
        """Track, write the results, and print the status of each trial."""
        from cablecast.cli.progress import console_progress
        from cablecast.pipeline.track_video import (
            CASTS_FILE,
            TrackConfig,
            join_casts,
            track_video,
        )

        config = TrackConfig(**picked(self, *(f.name for f in dataclasses.fields(TrackConfig))))
        names = [re.sub(r"[^\w.-]+", "_", one.stem).strip(".") or "video" for one in self.videos]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise InputError(f"{names.count(twice[0])} videos are called {twice[0]}: rename them")
        if not names:
            raise InputError("name a VIDEO to track")
        if len(names) == 1:
            out = self.out or RUNS_FOLDER / f"track-{names[0]}"
            folders = [out]
        else:
            out = self.out or RUNS_FOLDER / "track"
            folders = [out / name for name in names]
        setup = load_lab(self.setup, self.cable)
        for video, folder in zip(self.videos, folders, strict=True):
            with console_progress() as progress:
                found = track_video(video, setup, config=config, out=folder, progress=progress)
            _print_result(found.metrics, folder)
        if config.finds_grip:
            table = out / CASTS_FILE
            count = join_casts(folders, table)
            print(f"{casts_text(count, setup.cable.name)} in {table}; the next command is")
            print(f"  {self._import_command(table)}")

    def _import_command(self, table: pathlib.Path) -> str:
        known = {"--setup": self.setup, "--cable": self.cable}
        more = [str(word) for pair in known.items() if pair[1] for word in pair]
        return shlex.join(["cablecast", "import", str(table), *more])


def _print_result(metrics: dict[str, Any], out: pathlib.Path) -> None:
    from cablecast.pipeline.track_video import PICTURE_FILE, TRACK_FILE

    print(f"{metrics['status']}: {metrics['meaning']}")
    if metrics["final_xy"] is not None:
        print(f"endpoint  {polar_text(metrics['final_xy'])}")
    print(f"seen in   {metrics['frames_seen']} of {metrics['frame_count']} frames")
    if "grip_seen" in metrics:
        print(f"hand in   {metrics['grip_seen']} of {metrics['frame_count']} frames")
    print(
        f"tags      {metrics['tags_used']} used, rms {metrics['calibration_rms_mm']:.1f} mm"
        + (f", moved: {metrics['tags_rejected']}" if metrics["tags_rejected"] else "")
        + (", turned by 180 deg against OpenCV's own pictures" if metrics["tags_turned"] else "")
    )
    print(
        f"check     tags within {metrics['tags_off_px']:.1f} px, {metrics['tags_off_mm']:.1f} mm "
        "on the table, of their places in the calibration"
        + (f", moved: {metrics['tags_moved']}" if metrics["tags_moved"] else "")
    )
    print(f"track     {out / TRACK_FILE}\npicture   {out / PICTURE_FILE}")
