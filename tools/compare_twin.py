"""Compare the twin with what stands behind it: clock, landings, and fits with the virtual rig's.

    python tools/compare_twin.py --casts 10 --held-out 6

The same casts are made by the real arm's code on a twin, whose camera is a network stream, and by
the virtual rig in this process. Printed is the offset that `cablecast camera sync` finds between
two clocks that are one; how far the landings that the camera reports are from where the twin has
the cable's end; and how far simulated casts are from others of either rig, with parameters fitted
to the casts of the one and of the other: both fits are compared on the same casts. Intervals hold
90 % of bootstrap draws. Casts are kept in --out, so that the command goes on where it was stopped.
"""

import argparse
import dataclasses
import json
import pathlib

import numpy as np

from cablecast.cast import EndpointTrack
from cablecast.data.dataset import Dataset
from cablecast.data.record import collect_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.evaluation.evaluate import difference_interval
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.trajectory import Trajectory
from cablecast.pipeline.camera import sync_camera
from cablecast.pipeline.tune import tune
from cablecast.rigs.arm import RigArm
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.ur.twin.laboratory import TwinConfig
from cablecast.rigs.ur.twin.process import TwinProcess
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.setup import Setup, load_setup
from cablecast.tuning.tracks import MeasuredTracks, TrackObjective
from cablecast.tuning.tuned import Tuned

ROOT = pathlib.Path(__file__).parents[1]
CAMERA = {"width": 960, "height": 540, "rate": 30.0}
PATIENCE, RATE = 10.0, 4.0
"""Settings of the clock: as fast as this computer simulates, and waiting for the client."""


class RigCompared(RigArm):
    """The real arm's code, which notes how far each landing is from the twin's truth.

    Args:
        setup: Lab file of the twin.
        twin: Twin that knows the truth.
        notes: File that keeps what is noted.
    """

    def __init__(self, setup: Setup, twin: TwinProcess, notes: pathlib.Path):
        super().__init__(setup)
        self._twin, self._notes = twin, notes

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        """Play one motion, and note where the cable's end came to rest."""
        track = super().execute(trajectory)
        timing = self.last_timing
        if np.isfinite(track.final_xy).all() and timing is not None:
            truth = self._twin.admin.truth(timing.end_time - 0.05, timing.end_time + 0.05)
            at = np.argmin(np.abs(np.array(truth["times"]) - timing.start_time - track.times[-1]))
            miss = track.final_xy - np.array(truth["tip"][int(at)][:2])
            with self._notes.open("a") as file:
                file.write(json.dumps(miss.tolist()) + "\n")
        return track


def casts_of_twin(setup: Setup, actions: np.ndarray, out: pathlib.Path, address: str) -> Dataset:
    """Return casts on a twin."""
    robot = dataclasses.replace(setup.robot, address=address)
    camera = dataclasses.replace(setup.camera, **CAMERA)
    setup = dataclasses.replace(setup, robot=robot, camera=camera)
    config = TwinConfig(address=address, rate=RATE, patience=PATIENCE, camera_port=0)
    with TwinProcess(setup, config) as twin:
        seen = dataclasses.replace(camera, source=str(twin.camera_url))
        setup = dataclasses.replace(setup, camera=seen)
        out.parent.mkdir(parents=True, exist_ok=True)
        if not out.exists():
            found = sync_camera(setup)
            print(
                f"clocks: {1e3 * found.offset:.1f} ms apart, {1e3 * found.sd:.1f} ms uncertain, "
                f"{100 * found.explained:.0f} % explained",
                flush=True,
            )
        rig = RigCompared(setup, twin, out.parent / "misses.jsonl")
        with CheckedRig(rig, setup, time_limit=3600.0) as rig:
            return collect_dataset(out, rig, setup, purpose="tune", actions=actions, attempts=5)


def misses_of(tuned: Tuned, casts: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances of simulated casts from real ones [% of length]: mean, and at rest."""
    tracks = MeasuredTracks.from_dataset(casts)
    distances = TrackObjective(EngineWarp(), casts.cable, tracks).distances(tuned.params)
    share = 100 / casts.cable.length
    return share * distances.mean[0], share * distances.final[0]


def compared(of_twin: np.ndarray, of_virtual: np.ndarray) -> str:
    """Return the medians of two fits over the same casts, and their difference."""
    known = np.isfinite(of_twin) & np.isfinite(of_virtual)
    first, second = of_twin[known], of_virtual[known]
    middle, low, high = difference_interval(first, second)
    return (
        f"{np.median(first):.2f} and {np.median(second):.2f} %, difference {middle:+.2f} "
        f"({low:+.2f} to {high:+.2f}), {len(first)} casts"
    )


def main() -> None:
    """Make the casts, fit, and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--casts", type=int, default=10, help="casts to fit to")
    parser.add_argument("--held-out", type=int, default=6, help="casts to validate with")
    parser.add_argument("--others", type=int, default=60, help="virtual casts to compare fits on")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--address", default="127.9.0.2", help="loopback address of the twin")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("build/compare-twin"))
    args = parser.parse_args()
    setup = load_setup(ROOT / "examples" / "twin.yaml")
    actions = feasible_uniform(args.casts + args.held_out, setup, seed=args.seed)
    twin = casts_of_twin(setup, actions, args.out / "twin", args.address)
    more = feasible_uniform(args.others, setup, seed=args.seed + 1)
    with CheckedRig(RigVirtual(setup, 0, VirtualConfig(without=("arm",))), setup) as rig:
        virtual, others = (
            collect_dataset(args.out / name, rig, setup, purpose=purpose, actions=rows, attempts=1)
            for name, purpose, rows in (("virtual", "tune", actions), ("others", "real", more))
        )
    lines = (args.out / "misses.jsonl").read_text().splitlines()
    misses = 1e3 * np.linalg.norm([json.loads(line) for line in lines], axis=1)
    rms = float(np.sqrt(np.mean(misses**2)))
    print(
        f"{len(misses)} landings over the network: {rms:.2f} mm rms, {misses.max():.2f} mm at most"
    )
    fits = [tune(casts, validation_count=args.held_out) for casts in (twin, virtual)]
    frictions = ", ".join(f"{fit.params.friction:.3f}" for fit in fits)
    print(f"fits to {args.casts} casts of the twin and of the virtual rig: friction {frictions}")
    for name, casts in (("twin, fitted ones too", twin), ("virtual rig", others)):
        (twin_way, twin_rest), (virtual_way, virtual_rest) = (misses_of(fit, casts) for fit in fits)
        print(f"casts of the {name}, on the way, medians: {compared(twin_way, virtual_way)}")
        print(f"casts of the {name}, at rest, medians: {compared(twin_rest, virtual_rest)}")


if __name__ == "__main__":
    main()
