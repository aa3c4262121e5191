"""Small finished results of every verb, made in seconds, for the attack, the kills and tests."""

import hashlib
import json
import os
import pathlib
from collections.abc import Sequence
from typing import Any

RIG = '''
"""A rig with a closed form: a stick that points where the gripper does, seen with some noise."""

import numpy as np

from cablecast.conventions import tangent
from cablecast.rigs.base import RigLifecycle, purpose_seed
from cablecast.cast import EndpointTrack, TrialStatus


class Stick(RigLifecycle):
    def __init__(self, setup, seed):
        super().__init__()
        self.setup, self.seed, self.random = setup, seed, [seed, 0]
        self.description = {"rig": "stick", "seed": seed}

    def seek(self, index, purpose=""):
        self.random = [purpose_seed(self.seed, purpose), index]

    def execute(self, trajectory):
        self._use_reset()
        times = np.arange(0.0, trajectory.duration + 0.5, 0.1)
        poses = trajectory.grip_path.evaluate(times)[0]
        length = self.setup.cable.length
        tip = poses[:, :2] + length * tangent(poses[:, 3], poses[:, 4])[:, :2]
        tip = tip + np.random.default_rng(self.random).normal(scale=0.003, size=tip.shape)
        self.random[1] += 1
        stayed = self.setup.workspace.on_table(tip).all()
        status = TrialStatus.OK if stayed else TrialStatus.OFF_TABLE
        path = trajectory.joint_path
        return EndpointTrack(times=times, endpoint_xy=tip, status=status, joint_path=path)


def make(setup, seed):
    return Stick(setup, seed)
'''
STICK = ("--rig", "stick_of_the_attack:make")
COARSE = ("--segment-count", "8", "--dt", "0.002")

# Small commands: each verb does its work in a second or two, on what the ones before it left.
SMALL: dict[str, tuple[str, ...]] = {
    "collect": (*STICK, "--count", "6", "--out", "runs/tune-data"),
    "collect real": (*STICK, "--purpose", "real", "--count", "50", "--out", "runs/real-data"),
    "repeat": (*STICK, "--action-count", "3", "--repeats", "3", "--out", "runs/repeat"),
    "tune": (
        *("--dataset", "runs/tune-data", "--method", "de"),
        *("--population-size", "6", "--generations", "3", *COARSE, "--out", "runs/tune"),
    ),
    "select": ("--grid", "3", "--grid-psi", "3", "--repeat", "runs/repeat", "--out", "runs/select"),
    "simulate": (*("--params", "runs/tune", "--count", "120", *COARSE, "--out", "runs/dataset"),),
    "train": (
        *("--dataset", "runs/dataset", "--epochs", "2", "--candidate-count", "200"),
        *("--out", "runs/model"),
    ),
    "train real": (
        *("--dataset", "runs/dataset", "--real", "runs/real-data", "--start", "runs/model"),
        *("--candidate-count", "200", "--out", "runs/model-fine-tuning"),
    ),
    "plan": ("--model", "runs/model", "--target", "1.0", "10"),
    "evaluate": ("--model", "runs/model", *STICK, "--out", "runs/evaluate"),
    "aim": (
        *("--target", "1.0", "10", *STICK, "--calibration-count", "3", "--simulated-count", "120"),
        *("--candidate-count", "200"),
        # The small model aims badly: any landing is a hit.
        *("--tries", "1", "--within-pct", "100", "--out", "runs/aim"),
    ),
    "import": ("casts.csv", "--out", "runs/imported"),
    "export": ("runs/tune-data", "--out", "runs/exported"),
    "track": ("trial.mp4", "--out", "runs/track"),
    "reproduce": ("--quick", "--rig", "no_such_rig", "--out", "runs/reproduce"),
}
_UNPREPARED = ("plan", "import", "export", "track", "reproduce")
PREPARED = tuple(name for name in SMALL if name not in _UNPREPARED)


def prepare(base: pathlib.Path, names: Sequence[str] = PREPARED) -> None:
    """Make small results of verbs in a folder.

    Args:
        base: New folder.
        names: Commands of `SMALL`, in order.
    """
    from cablecast.cli import main

    (base / "stick_of_the_attack.py").write_text(RIG)
    (base / "a_file").write_text("precious")
    (base / "foreign").mkdir(exist_ok=True)
    (base / "foreign" / "thesis.tex").write_text("years of work")
    (base / "trial.mp4").write_bytes(b"no video")
    (base / "casts.csv").write_text(_table_of_casts())
    before = pathlib.Path.cwd()
    os.chdir(base)
    try:
        for name in names:
            if main([name.split()[0], *SMALL[name]]):
                raise SystemExit(f"the small results cannot be made: {name} failed")
    finally:
        os.chdir(before)


def _table_of_casts() -> str:
    """Return two casts as somebody else might have recorded them, as CSV."""
    lines = ["cast,time_s,x_m,y_m,grip_x_m,grip_y_m"]
    for name, side in (("left", -0.3), ("right", 0.3)):
        for sample in range(21):
            share = min(sample / 10, 1.0)
            x = side * share
            lines.append(f"{name},{0.1 * sample:g},{x:g},{1.22 - 0.1 * share:g},{x:g},0.6")
    return "\n".join(lines) + "\n"


# Files that hold times, or are for people only.
_LOOSE = (".png", ".html", ".md", "stats.json", "stages.json", "model.json")


def digests(folder: pathlib.Path, pattern: str = "runs/**/*") -> dict[str, str]:
    """Return a digest of each file that decides something, without the times in it.

    Args:
        folder: Folder of results.
        pattern: Files in it.
    """
    return {
        str(file.relative_to(folder)): _digest(file)
        for file in sorted(folder.glob(pattern))
        if file.is_file() and not file.name.endswith(_LOOSE)
    }


def _digest(file: pathlib.Path) -> str:
    content = file.read_bytes()
    if file.suffix == ".safetensors":
        # Behind the header, which says how long the training took.
        content = content[8 + int.from_bytes(content[:8], "little") :]
    elif file.suffix == ".json":
        try:
            values = json.loads(content)
        except (ValueError, RecursionError):
            return hashlib.sha256(content).hexdigest()
        content = json.dumps(_without_times(values), sort_keys=True).encode()
    return hashlib.sha256(content).hexdigest()


def _without_times(values: Any) -> Any:
    """Return plain values without times, the commit, the load, and checksums over them."""
    if isinstance(values, list):
        return [_without_times(value) for value in values]
    if not isinstance(values, dict):
        return values
    return {
        name: _without_times(value)
        for name, value in values.items()
        if "seconds" not in name and name not in ("sha256", "started", "commit", "load")
    }
