"""Tune the simulator to casts on a rig: the ten parameters of the cable, and the lag of the arm.

A robot makes some casts; here the virtual rig does, whose cable and arm are hidden. The search
looks for the parameters with which simulated tracks lie nearest to the measured ones, and a quarter
of the casts is held out to say how well it went. Both the casts and the search go on where they
were, if they are stopped. `cablecast tune` does the same with more casts and a longer search.
"""

import pathlib

import numpy as np

from cablecast.cable import load_cable
from cablecast.datasets.collect import collect_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.files import write_json
from cablecast.motion.action import MotionConfig
from cablecast.rigs.base import make_rig
from cablecast.tuning.result import PARAMS_FILE, params_file
from cablecast.tuning.servo import identify_servo
from cablecast.tuning.tracks import MeasuredTracks
from cablecast.tuning.tune import TuneConfig, split_tracks, tune_params
from cablecast.workspace import Workspace


def main(
    out: pathlib.Path = pathlib.Path("runs/examples"),
    count: int = 12,
    generations: int = 15,
    population_size: int = 16,
) -> None:
    cable, workspace = load_cable("cable_1"), Workspace()
    rig = make_rig("virtual", cable, workspace, seed=0)
    try:
        data = collect_dataset(
            out / "virtual-tune-data",
            rig,
            cable,
            MotionConfig(),
            workspace,
            purpose="tune",
            count=count,
        )
    finally:
        rig.close()

    # How the arm followed its set points, from the joints that it reported.
    servo = identify_servo(data)
    print(f"the gripper was {1e3 * servo.commanded_rms:.1f} mm (rms) from where it was told to be,")
    print(f"and {1e3 * servo.model_rms:.1f} mm from where the fitted servo has it")

    # The simulator plays the path that the arm took, not the one that it was sent.
    training, validation = split_tracks(MeasuredTracks.from_dataset(data))
    coarse = EngineWarp(segment_count=20, dt=1e-3)
    config = TuneConfig(
        population_size=population_size,
        coarse_generations=generations,
        fine_population_size=8,
        fine_generations=2,
    )
    result = tune_params(
        cable,
        training,
        validation,
        coarse,
        EngineWarp(),
        config,
        checkpoint=out / "tune" / "generations.json",
        progress=lambda state: print(f"  {state.stage}: best {state.best_pct:.1f} % of length"),
    )
    write_json(out / "tune" / PARAMS_FILE, params_file(result, cable.length, servo.model))
    friction = result.params.friction
    print(f"Coulomb coefficient {cable.params.friction:.2f} believed, {friction:.2f} found")
    default, tuned = 100 * np.nanmean(result.validation.mean, axis=1) / cable.length
    print(f"held-out tracks: {default:.1f} % of length away before, {tuned:.1f} % after tuning")


if __name__ == "__main__":
    main()
