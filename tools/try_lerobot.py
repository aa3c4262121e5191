"""Open an exported data set with LeRobot's own reader, in an environment of its own.

    python tools/try_lerobot.py --python python3.12

LeRobot needs a newer Python and other versions of libraries than cablecast, so that it is no
dependency of the tests. The environment, some gigabytes, is made once in `build/lerobot`.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

from cablecast.data.lerobot import VIDEO_KEY
from cablecast.data.record import collect_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.pipeline.export import export_dataset
from cablecast.rigs.engine import RigEngine
from cablecast.setup import Setup
from cablecast.vision.video import write_video

ROOT = pathlib.Path(__file__).parents[1]
VERSION = "0.6.1"
FPS, COUNT, SIZE = 10, 3, (64, 96)

READER = """
import json, sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset
data = LeRobotDataset("cablecast/casts", root=sys.argv[1], video_backend="pyav")
frame, key = data[len(data) - 1], sys.argv[2]
print(json.dumps({
    "episodes": data.num_episodes,
    "frames": len(data),
    "action": frame["action"].tolist(),
    "shape": list(frame[key].shape),
    "blue": float(frame[key][2].mean()),
    "mean": [float(v) for v in data.meta.stats[key]["mean"].ravel()],
}))
"""


def exported(folder: pathlib.Path) -> pathlib.Path:
    """Return a data set of a few casts with films that get bluer from cast to cast."""
    setup = Setup()
    rig = RigEngine(EngineWarp(20, 1e-3), setup)
    casts = collect_dataset(folder / "casts", rig, setup, purpose="tune", count=COUNT, seed=0)
    for number in range(COUNT):
        picture = np.zeros((*SIZE, 3), dtype=np.uint8)
        picture[..., 0] = 60 * (number + 1)
        write_video(folder / f"films/{number:06d}.mp4", iter([picture] * 20), FPS)
    return export_dataset(casts, folder / "out", fps=FPS, films=folder / "films")


def environment(python: str) -> pathlib.Path:
    """Return the Python of an environment with LeRobot, made where it does not exist."""
    folder = ROOT / "build" / "lerobot"
    inside = folder / "bin" / "python"
    if not (folder / ".installed").exists():
        subprocess.run([python, "-m", "venv", "--clear", str(folder)], check=True)
        # The exact version of torch keeps pip from the CUDA libraries. LeRobot asks for an earlier
        # one, and reads with this one all the same.
        pip = [str(inside), "-m", "pip", "install", "--quiet"]
        subprocess.run([*pip, "lerobot[dataset]", "torch==2.13.0"], check=True)
        subprocess.run([*pip, "--no-deps", f"lerobot=={VERSION}", "av>=15,<16"], check=True)
        (folder / ".installed").touch()
    return inside


def main() -> int:
    """Export, read, and compare; status 1 where the reader sees something else."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--python", default="python3.12", help="a Python that LeRobot runs on")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="cablecast-") as name:
        out = exported(pathlib.Path(name))
        info = json.loads((out / "meta/info.json").read_text())
        inside = environment(arguments.python)
        command = [str(inside), "-c", READER, str(out), VIDEO_KEY]
        read = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if read.returncode:
        return 1
    seen = json.loads(read.stdout.splitlines()[-1])
    print(json.dumps(seen, indent=1))
    expected = {"episodes": COUNT, "frames": info["total_frames"], "shape": [3, *SIZE]}
    wrong = [key for key, value in expected.items() if seen[key] != value]
    # Compression moves colours a little.
    if abs(seen["blue"] - 60 * COUNT / 255) > 0.03 or not 0.2 < seen["mean"][2] < 0.8:
        wrong.append("blue")
    print("LeRobot reads the export" if not wrong else f"LeRobot reads other {', '.join(wrong)}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
