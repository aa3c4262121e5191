"""Fit a cable from films of a hand that swings it: no robot, two colored markers, a phone.

`python tools/film.py hand films` makes such films; with them, run
`python examples/07_fit_my_cable.py films`.
"""

import pathlib
import sys

import numpy as np

import cablecast as cc
from cablecast.pipeline.import_casts import import_casts
from cablecast.pipeline.track_video import TrackConfig
from cablecast.tuning.tracks import MeasuredTracks
from cablecast.vision.calibration import Calibration
from cablecast.vision.tags import load_cv2
from cablecast.vision.video import read_video, write_video

# Hue [deg] and height [m] of the markers: green at the free end, blue at the hand.
MARKERS = {"end": (122.0, None), "grip": (242.0, 0.02)}


def main(
    films: pathlib.Path | str = "films",
    out: pathlib.Path | str = "runs/my-film",
    config: cc.TuneConfig | None = None,
) -> None:
    films, out, setup = pathlib.Path(films), pathlib.Path(out), cc.Setup(cable="cable_1")
    videos = sorted(films.glob("*.mp4"))
    table = ["cast,time_s,x_m,y_m,grip_x_m,grip_y_m"]
    for video in videos:
        frames = {name: track(video, films, out, name, setup) for name in MARKERS}
        for end, grip in zip(frames["end"], frames["grip"], strict=True):
            table.append(",".join([video.stem, *end[1:], *grip[2:]]))
    (out / "casts.csv").write_text("\n".join(table) + "\n")

    casts = import_casts(out / "casts.csv", setup, out=out / "tune-data")
    tuned = cc.tune(casts, config=config, out=out / "tune")
    for row in ("default", "tuned"):
        error = tuned.metrics["validation"][row]["mean_pct"]
        print(f"{row:8} held-out films: {error:.1f} % of cable length apart")
    replay(videos[0], casts, tuned, out)
    print(f"the replay over the first film is {out / 'replay.mp4'}")


def track(video, films, out, name, setup):
    """Return the rows of frames.csv: frame, time, x and y of a marker."""
    hue, height = MARKERS[name]
    begin = (0.0, setup.workspace.reset_y + (setup.cable.length if name == "end" else 0.0))
    config = TrackConfig(tags=films / "tags.yaml", marker_hue=hue, marker_z=height, begin=begin)
    folder = out / f"track-{video.stem}-{name}"
    cc.track_video(video, setup, config=config, out=folder)
    return [line.split(",") for line in (folder / "frames.csv").read_text().splitlines()[1:]]


def replay(video, casts, tuned, out):
    """Draw the simulated cable over the film."""
    cv2, setup = load_cv2(), casts.setup
    motion = MeasuredTracks.from_dataset(casts).grip_path[0]
    view = Calibration.load(out / f"track-{video.stem}-end" / "calibration.json").view
    info, frames = read_video(video)
    duration = info.frame_count / info.rate
    rollout = cc.EngineWarp().rollout(
        setup.cable.with_params(tuned.params),
        motion,
        duration=duration,
        sample_dt=0.01,
        record_nodes=True,
    )

    def drawn():
        for time, frame in frames:
            nodes = rollout.nodes[0, np.argmin(np.abs(rollout.times - time))]
            pixels = np.round(view.to_image(nodes)).astype(np.int32)
            yield cv2.polylines(frame, [pixels], False, (200, 0, 200), 2, cv2.LINE_AA)

    write_video(out / "replay.mp4", drawn(), info.rate)


if __name__ == "__main__":
    main(*sys.argv[1:])
