"""Compile a kernel ahead of time, in a process of its own, while this one waits for a robot."""

import dataclasses
import json
import subprocess
import sys
import threading

from cablecast.engines.warp_.device import find_device, load
from cablecast.engines.warp_.features import Features
from cablecast.engines.warp_.lanes import LANE_COUNT_CPU
from cablecast.engines.warp_.rollout import rollout_kernel
from cablecast.files import core_count

_PRECISION = "single"


def compile_ahead(features: Features) -> subprocess.Popen[bytes] | None:
    """Begin to compile the kernel of the CPU in single precision, and return at once.

    Whoever needs it meanwhile waits until it is done, as for any process that compiles the same
    kernel. Where it is compiled already this takes another core two seconds. Where it fails,
    whoever needs the kernel compiles it.

    Args:
        features: Features that the kernel plays.

    Returns:
        The process; None on a single core, which would only be slower, or where none can start.
    """
    if core_count() < 2:
        return None
    told, nothing = json.dumps(dataclasses.asdict(features)), subprocess.DEVNULL
    # -P: a file of the current folder must not stand in for a library.
    command = [sys.executable, "-P", "-m", "cablecast.engines.warp_.ahead", told]
    try:
        process = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing)
    except OSError:
        return None
    # Nobody else waits for it.
    threading.Thread(target=process.wait, daemon=True).start()
    return process


if __name__ == "__main__":
    find_device("cpu")
    wanted = Features(**json.loads(sys.argv[1]))
    load(rollout_kernel(_PRECISION, LANE_COUNT_CPU[_PRECISION], wanted).kernel)
