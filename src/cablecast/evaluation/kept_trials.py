"""Casts of an evaluation on the disk, so that one that was stopped goes on where it was.

On a robot 160 casts take an hour. Each is stored as soon as it is done; how a cast is planned does
not depend on the ones before it, so those that are missing are all that is left to do.
"""

import dataclasses
import io
import pathlib
import zipfile
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cablecast.errors import InputError, RigError
from cablecast.files import write_bytes
from cablecast.machine import core_count
from cablecast.motion.joint_path import JointPath
from cablecast.motion.trajectory import Trajectory
from cablecast.rigs.base import Rig, check_track, run_trials
from cablecast.track import EndpointTrack, TrialStatus

# Casts per core that a rig makes at once: what a kill can lose, against cores that wait for the
# last cast of a batch.
_CASTS_PER_CORE = 8


@dataclasses.dataclass(frozen=True)
class KeptTrials:
    """A folder with one file per cast.

    Attributes:
        folder: Where they are; it belongs to one evaluation and is made when needed.
    """

    folder: pathlib.Path

    def run(
        self,
        rig: Rig,
        trajectories: Sequence[Trajectory],
        progress: Callable[[int], None] | None = None,
    ) -> list[EndpointTrack]:
        """Reset and execute for each trajectory that has no file yet.

        A rig that draws by chance is told which trial is next, so that the tracks are those of an
        evaluation that was never stopped.

        Args:
            rig: Any rig.
            trajectories: One per trial, the same ones whenever the evaluation is started.
            progress: Called with the number of finished trials whenever it grows.

        Returns:
            One track per trajectory, in the same order.

        Raises:
            InputError: A file is damaged.
            RigError: The rig failed, or returned something that is no track.
        """
        tracks = {index: self.load(index) for index in range(len(trajectories)) if self.has(index)}
        if tracks and progress is not None:
            progress(len(tracks))
        seek = getattr(rig, "seek", None)
        size = _CASTS_PER_CORE * core_count() if hasattr(rig, "execute_many") else 1
        missing = [index for index in range(len(trajectories)) if index not in tracks]
        for batch in _consecutive(missing, size):
            if callable(seek):
                seek(batch[0])
            done = len(tracks)
            made = run_trials(
                rig,
                [trajectories[index] for index in batch],
                None if progress is None else lambda count, done=done: progress(done + count),
            )
            if len(made) != len(batch):
                raise RigError(f"the rig returned {len(made)} tracks for {len(batch)} motions")
            for index, track in zip(batch, made, strict=True):
                tracks[index] = check_track(track)
                self.save(index, track)
        return [tracks[index] for index in range(len(trajectories))]

    def has(self, index: int) -> bool:
        """Whether a trial is stored."""
        return self._file(index).is_file()

    def save(self, index: int, track: EndpointTrack) -> None:
        """Store what a rig returned."""
        arrays: dict[str, Any] = {"times": track.times, "endpoint_xy": track.endpoint_xy}
        if track.nodes is not None:
            arrays["nodes"] = track.nodes
        if track.joint_path is not None:
            arrays |= {f"joint_{n}": getattr(track.joint_path, n) for n in ("times", "q", "qd")}
        content = io.BytesIO()
        np.savez_compressed(content, status=np.array(track.status.code), **arrays)
        write_bytes(self._file(index), content.getvalue())

    def load(self, index: int) -> EndpointTrack:
        """The track of a stored trial.

        Raises:
            InputError: Its file is damaged.
        """
        file = self._file(index)
        try:
            with np.load(file) as arrays:
                joints = None
                if "joint_q" in arrays:
                    joints = JointPath(**{n: arrays[f"joint_{n}"] for n in ("times", "q", "qd")})
                return EndpointTrack(
                    times=arrays["times"],
                    endpoint_xy=arrays["endpoint_xy"],
                    status=TrialStatus.from_code(str(arrays["status"])),
                    nodes=arrays.get("nodes"),
                    joint_path=joints,
                )
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(
                f"{file} is damaged ({error!r}): delete it, and that cast is made again"
            ) from None

    def _file(self, index: int) -> pathlib.Path:
        return self.folder / f"{index:05d}.npz"


def _consecutive(indices: Sequence[int], size: int) -> list[list[int]]:
    """Runs of indices that follow one another, each at most some size."""
    runs: list[list[int]] = []
    for index in indices:
        if runs and index == runs[-1][-1] + 1 and len(runs[-1]) < size:
            runs[-1].append(index)
        else:
            runs.append([index])
    return runs
