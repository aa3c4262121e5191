"""Memory per world and compilation time of every engine, measured in processes of their own."""

import json
import os
import subprocess
import sys
import tempfile

from benchmarks.common import Table, has

# Runs in a process of its own: a process can measure its peak memory and compilation only once.
_CHILD = """
import json, pathlib, sys, time
from cablecast.cable import load_cable
from cablecast.engines import make_engine
from cablecast.motion.grip_path import GripPath
name, worlds = sys.argv[1], int(sys.argv[2])
cable = load_cable("cable_1")
path = GripPath.stack([GripPath.hold([0.0, 0.6, 0.02, 0.0, 0.0], 0.1)] * worlds)
seconds = []
engine = make_engine(name)
for _ in range(2):
    start = time.perf_counter()
    engine.rollout(cable, cable.params, path, duration=0.1)
    seconds.append(time.perf_counter() - start)
status = pathlib.Path("/proc/self/status")
peak = float("nan")
if status.exists():
    # Unlike ru_maxrss this does not count what the parent process had when it started us.
    peak = 1024.0 * float(status.read_text().split("VmHWM:")[1].split()[0])
print(json.dumps([seconds, peak]))
"""


def _child(name: str, worlds: int, cache: str | None = None) -> tuple[list[float], float]:
    """Return the times of two rollouts [s] and the peak memory [byte] of a process of its own.

    Args:
        name: Name of the engine.
        worlds: Number of worlds.
        cache: Folder of compiled kernels; the user's where None.
    """
    environment = dict(os.environ)
    if cache is not None:
        environment["WARP_CACHE_PATH"] = cache
    out = subprocess.run(
        [sys.executable, "-c", _CHILD, name, str(worlds)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(out.stdout.strip().splitlines()[-1])


def footprint() -> Table:
    """Measure the memory of each world, and the time before the first step."""
    table = Table(
        "Memory per world in memory at once (PyBullet: one after the other, so only results), and "
        "what the first rollout takes beyond the second",
        ("engine", "memory per world [KiB]", "compile [s]", "compile, cached [s]"),
        [],
    )
    for name, few, many in (("warp", 512, 33_280), ("mujoco", 4, 64), ("pybullet", 2, 12)):
        if name != "warp" and not has(name):
            continue
        with tempfile.TemporaryDirectory() as cache:
            (first, second), _ = _child(name, few, cache)
            cold = first - second
        (first, second), least = _child(name, few)
        _, most = _child(name, many)
        memory = (most - least) / (many - few) / 1024
        table.rows.append((name, memory, cold, first - second))
    return table
