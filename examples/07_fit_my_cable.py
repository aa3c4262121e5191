"""Fit a cable from films of a hand that swings it: no robot, two colored markers, a phone.

`python tools/film.py hand films` makes such films; with them, run
`python examples/07_fit_my_cable.py films`.
"""

import pathlib
import sys

import numpy as np

import cablecast as cc
from cablecast.pipeline.export import export_cable
from cablecast.pipeline.import_casts import import_casts
from cablecast.pipeline.track_video import TrackConfig, join_casts
from cablecast.tuning.tracks import MeasuredTracks
from cablecast.vision.calibration import Calibration
from cablecast.vision.tags import load_cv2
from cablecast.vision.video import read_video, write_video

BLUE = 242.0  # hue of the marker at the hand [deg]; that at the free end is green


def main(
    films: pathlib.Path | str = "films",
    out: pathlib.Path | str = "runs/my-film",
    config: cc.FitConfig | None = None,
) -> None:
    films, out, setup = pathlib.Path(films), pathlib.Path(out), cc.Setup(cable="cable_1")
    videos = sorted(films.glob("*.mp4"))
    looks = TrackConfig(tags=films / "tags.yaml", grip_hue=BLUE)
    for video in videos:
        cc.track_video(video, setup, config=looks, out=out / video.stem)
    join_casts([out / video.stem for video in videos], out / "casts.csv")

    casts = import_casts(out / "casts.csv", setup, out=out / "tune-data")
    tuned = cc.tune(casts, config=config, out=out / "tune")
    for row in ("default", "tuned"):
        error = tuned.metrics["validation"][row]["mean_pct"]
        print(f"{row:8} simulated free end: {error:.1f} % of cable length off, on the way")
    params = tuned.params
    print(f"friction {params.friction:.3f}, EI / m {params.bend_stiffness / params.mass:.4f} m3/s2")
    print(
        f"models for other simulators: {', '.join(map(str, export_cable(tuned, out / 'models')))}"
    )
    replay(videos[0], casts, tuned, out)
    print(f"the replay over the first film is {out / 'replay.mp4'}")


def replay(video, casts, tuned, out):
    """Draw the simulated cable over the film."""
    cv2, setup = load_cv2(), casts.setup
    motion = MeasuredTracks.from_dataset(casts).grip_path[0]
    view = Calibration.load(out / video.stem / "calibration.json").view
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
