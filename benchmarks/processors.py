"""Other processors: how far the last bits of their arithmetic move a fit and its landings.

NumPy, OpenBLAS and the compiler of the kernels use the widest instructions that a processor has,
which round differently. A process each keeps them to those of an older one, fits the simulator to
the same casts, and simulates others: with the fit of this processor, and with its own.
"""

import dataclasses
import os
import pathlib
import subprocess
import sys
import tempfile
from collections.abc import Iterator

import numpy as np

import cablecast as cc
from benchmarks.common import random_casts
from benchmarks.places import open_rig
from benchmarks.result import Table
from cablecast.data.dataset import read_dataset
from cablecast.engines.warp_ import rollout
from cablecast.tuning.tuned import load_tuned

HERE = "-march=native"
OLDER = {
    "AVX2": ("-target-cpu x86-64-v3", "Haswell", "X86_V4 AVX512_ICL"),
    "SSE 4.2": ("-target-cpu x86-64-v2", "Nehalem", "X86_V3 X86_V4 AVX512_ICL"),
}
"""Processors of x86 by their widest instructions: the compiler flag, in place of that of this one;
OpenBLAS's kernels; and what NumPy must not use."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Landings on older processors, emulated on this one."""

    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    """Cables."""
    count: int = 200
    """Simulated casts."""


def main(args: Args) -> Iterator[Table]:
    """Yield the distances of landings from those on this processor."""
    rows = []
    for cable in args.cables:
        setup = cc.Setup(cable=cable)
        with tempfile.TemporaryDirectory() as name, open_rig("virtual", 0, setup) as rig:
            folder = pathlib.Path(name)
            cc.collect(rig, count=5, sampling="spread", out=folder / "casts")
            # The first fits for the others.
            here = landings(folder, "here", HERE, args.count)
            for processor, (flag, blas, without) in OLDER.items():
                own = {"OPENBLAS_CORETYPE": blas, "NPY_DISABLE_CPU_FEATURES": without}
                words = [name, processor.partition(" ")[0], flag, str(args.count)]
                command = [sys.executable, "-m", __name__, *words]
                subprocess.run(command, check=True, env=os.environ | own)
                there = np.load(folder / f"{words[1]}.npy")
                apart = np.linalg.norm(there - here, axis=-1) / setup.cable.length
                for what, far in zip(("the same fit", "a fit of its own"), apart, strict=True):
                    spread = 100.0 * np.nanquantile(far, [0.5, 0.9, 1.0])
                    rows.append((cable, processor, what, *spread.tolist()))
    columns = ("cable", "processor with", "simulated with", "median", "nine in ten below", "most")
    yield Table(
        "Landings on an older processor, from those here [% of cable length]", columns, rows
    )


def landings(folder: pathlib.Path, name: str, flag: str, count: int) -> np.ndarray:
    """Return landings with the fit of this processor and with an own one, [2, cast, 2] [m].

    They are kept in the folder, whose `casts` are fitted to.
    """
    rollout.CPU_COMPILER_FLAGS = rollout.CPU_COMPILER_FLAGS.replace(HERE, flag)
    casts = read_dataset(folder / "casts")
    own = cc.tune(casts, validation_count=0, out=folder / name)
    paths = random_casts(count, 3, casts.setup)
    found = np.stack(
        [
            fit.rollout(paths, sample_dt=0.05).endpoint_xy[:, -1]
            for fit in (load_tuned(folder / "here", casts.setup), own)
        ]
    )
    np.save(folder / f"{name}.npy", found)
    return found


if __name__ == "__main__":
    path, processor, flag, count = sys.argv[1:]
    landings(pathlib.Path(path), processor, flag, int(count))
