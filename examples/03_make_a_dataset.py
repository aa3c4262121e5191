"""A dataset of simulated casts that survives being killed at any moment.

Run it, stop it in the middle with Ctrl-C, and run it again: it goes on where it was. Other settings
in the same folder are refused, and the message says which setting differs.
"""

import pathlib

import numpy as np

from cablecast.cable import load_cable
from cablecast.datasets.progress import console_progress
from cablecast.datasets.simulate import simulate_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.action import MotionConfig
from cablecast.workspace import Workspace


def main(out: pathlib.Path = pathlib.Path("runs/examples"), count: int = 4000) -> None:
    cable = load_cable("cable_1")
    with console_progress(f"Simulating {cable.name}") as progress:
        dataset = simulate_dataset(
            out / "dataset",
            cable,
            cable.params,
            EngineWarp(),
            MotionConfig(),
            Workspace(),
            count=count,
            seed=0,
            progress=progress,
            shard_rows=500,
        )
    print(f"{len(dataset)} casts, {dataset.ok.sum()} of them stayed on the table")
    x, y = dataset.endpoint_xy[dataset.ok].T
    print(f"they landed {np.hypot(x, y).min():.2f} to {np.hypot(x, y).max():.2f} m from the robot")
    print(f"the folder {out / 'dataset'} opens in anything that reads Parquet")


if __name__ == "__main__":
    main()
