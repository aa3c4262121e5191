"""Measure the camera over the network, and draw the pictures of docs/camera.md.

    python tools/make_camera_pictures.py --casts 6

The virtual camera sends casts as a stream; the camera of a lab file reads it through OpenCV and
tracks the endpoint. Printed is how far its landings are from the truth.
"""

import argparse
import dataclasses
import pathlib
import threading
import time

import numpy as np

from cablecast.camera.settings import CameraSettings
from cablecast.cast import EndpointTrack
from cablecast.files import write_bytes
from cablecast.motion.action import Action
from cablecast.motion.trajectory import plan_trajectory
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.rigs.virtual.camera_stream import CameraStream
from cablecast.rigs.virtual.config import CameraConfig
from cablecast.rigs.virtual.sensing import RECORD_DT
from cablecast.setup import Setup
from cablecast.vision.check import CameraCheck, draw_report
from cablecast.vision.tags import load_cv2
from cablecast.vision.trials import CameraOfTrials, TrialTiming

IMAGES = pathlib.Path(__file__).parents[1] / "docs" / "images"
CLOCK = 250.0
"""Time of the camera's clock when the laboratory's shows zero [s]."""


class Laboratory:
    """Shows casts to the camera, and a still scene between them, in a thread.

    Args:
        stream: Camera to show them to.
        setup: Gives the arm and the cable.
    """

    def __init__(self, stream: CameraStream, setup: Setup):
        self.stream = stream
        self.setup = setup
        self.time = 10.0
        self._track: EndpointTrack | None = None
        self._start = np.inf
        self._running = True
        self._thread = threading.Thread(target=self._run, daemon=True)

    def prepare(self, track: EndpointTrack) -> float:
        """Show the first instant of a cast, and return since when."""
        self._start, self._track = np.inf, track
        if not self._thread.is_alive():
            self._thread.start()
        return self.time + 5 * RECORD_DT

    def cast(self) -> TrialTiming:
        """Play the cast, and return when it took place."""
        if self._track is None:
            raise RuntimeError("no cast was prepared")
        start = self.time + 0.1
        self._start = start
        end = start + float(self._track.times[-1])
        while self.time < end:
            time.sleep(0.01)
        pairs = np.array([[self.time, time.monotonic()]])
        return TrialTiming(start_time=start, end_time=end, clock_pairs=pairs)

    def close(self) -> None:
        """Stop the clock."""
        self._running = False
        self._thread.join()

    def _run(self) -> None:
        while self._running:
            self.time += RECORD_DT
            track, since = self._track, max(self.time - self._start, 0.0)
            if track is None or track.nodes is None or track.joint_path is None:
                continue
            index = min(round(since / RECORD_DT), len(track.nodes) - 1)
            path = track.joint_path
            q = [float(np.interp(since, path.times, joint)) for joint in path.q.T]
            self.stream.show(self.time, q, track.nodes[index])
            time.sleep(RECORD_DT / 2)


def make_casts(setup: Setup, count: int, seed: int) -> list[EndpointTrack]:
    """Return true motions of casts on the virtual rig, recorded for a camera."""
    rng = np.random.default_rng(seed)
    config = VirtualConfig(sample_dt=RECORD_DT, sensing="exact")
    tracks = []
    with RigVirtual(setup, seed, config) as rig:
        while len(tracks) < count:
            theta1, theta2, r2 = (
                -rng.uniform(0.3, 0.9),
                rng.uniform(0.2, 0.8),
                rng.uniform(0.6, 0.7),
            )
            psi = theta2 + rng.uniform(0.0, 0.5)
            rig.reset()
            track = rig.execute(plan_trajectory(Action(theta1, theta2, r2, psi), setup))
            if np.isfinite(track.final_xy).all():
                tracks.append(track)
    return tracks


def main() -> None:
    """Measure, print and draw."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--casts", type=int, default=6, help="number of casts")
    parser.add_argument("--width", type=int, default=1920, help="width of the pictures [px]")
    parser.add_argument("--rate", type=float, default=60.0, help="frames per second")
    parser.add_argument("--seed", type=int, default=0, help="seed of casts and pictures")
    args = parser.parse_args()
    cv2 = load_cv2()
    config = dataclasses.replace(CameraConfig(), frame_rate=args.rate, exposure=0.001)
    config = config.resized(args.width)
    casts = make_casts(Setup(), args.casts, args.seed)
    with CameraStream(Setup(), config, seed=args.seed, clock=CLOCK) as stream:
        camera = CameraSettings(
            source=stream.url,
            width=config.width,
            height=config.height,
            rate=args.rate,
            exposure=config.exposure,
            clock_offset=-CLOCK,
            clock_offset_sd=0.0,
            lens=config.view.lens,
        )
        setup = Setup(camera=camera)
        laboratory = Laboratory(stream, setup)
        laboratory.prepare(casts[0])
        misses, moving = [], []
        with CameraOfTrials(setup) as trials:
            check = CameraCheck(setup, trials._camera.facts)
            for index, track in enumerate(casts):
                trials.check(laboratory.prepare(track))
                trials.start()
                seen = trials.stop(laboratory.cast())
                count = min(len(seen.times), len(track.times))
                at = np.round(seen.times[:count] / RECORD_DT).astype(int)
                at = np.minimum(at, len(track.times) - 1)
                error = np.linalg.norm(seen.endpoint_xy[:count] - track.endpoint_xy[at], axis=1)
                moving += error[np.isfinite(error)].tolist()
                miss = float(np.linalg.norm(seen.final_xy - track.endpoint_xy[-1]))
                misses.append(miss)
                print(f"cast {index}: {seen.status.code}, landing off by {1e3 * miss:.2f} mm")
            for frame in trials._fresh(8):
                check.look(frame)
            report = check.report()
        laboratory.close()
    misses = np.array(misses)
    good = misses[np.isfinite(misses)]
    print(
        f"landings: {len(good)} of {len(misses)} seen, rms {1e3 * np.sqrt(np.mean(good**2)):.2f} mm"
    )
    print(f"all samples: {len(moving)}, rms {1e3 * np.sqrt(np.mean(np.square(moving))):.2f} mm")
    picture = cv2.imdecode(np.frombuffer(draw_report(report, Setup().workspace), np.uint8), 1)
    small = cv2.resize(picture, (960, 540), interpolation=cv2.INTER_AREA)
    jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
    write_bytes(IMAGES / "camera-check.jpg", jpeg)
    print(f"{IMAGES / 'camera-check.jpg'}: {len(jpeg) / 1024:.0f} KiB")


if __name__ == "__main__":
    main()
