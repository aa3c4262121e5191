"""Measured tracks of D_tune, as arrays for comparison with a batch of simulations."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.checks import check_count
from cablecast.datasets.reader import Dataset
from cablecast.datasets.trials import measured_joints, measured_poses, trial_track
from cablecast.errors import DatasetError, InputError
from cablecast.motion.cast import cast_grip_paths
from cablecast.motion.grip_path import GripPath
from cablecast.motion.measured import grip_path_from_joints, grip_path_from_poses
from cablecast.track import TrialStatus
from cablecast.workspace import Workspace

PATH_SOURCES = ("auto", "commanded", "measured")

_GRIDS = (0.1, 0.05, 0.02, 0.01)
_GRID_TOLERANCE = 1e-6


@dataclasses.dataclass(frozen=True, kw_only=True)
class MeasuredTracks:
    """Tracks measured on a rig and the motions that produced them, one row per trial.

    Attributes:
        grip_path: Motion of the gripper, one row per trial.
        times: Sample times of the endpoint [s], shape [trial, sample]; shorter rows repeat their
            last time.
        endpoint_xy: Measured endpoints [m], shape [trial, sample, 2]; NaN where not compared.
        final_xy: Resting points of the endpoint [m], shape [trial, 2]; NaN if it did not come to
            rest on the table or was not seen there.
        status: Status codes of the trials, shape [trial].
        actions: Actions of the trials, shape [trial, 4].
        path_source: Origin of the grip path, "commanded" or "measured".
    """

    grip_path: GripPath
    times: NDArray[np.float64]
    endpoint_xy: NDArray[np.float64]
    final_xy: NDArray[np.float64]
    status: NDArray[np.str_]
    actions: NDArray[np.float64]
    path_source: str

    def __post_init__(self):
        count = len(self.grip_path)
        shape = (count, *self.times.shape[1:])
        if self.times.shape != shape or self.endpoint_xy.shape != (*shape, 2):
            raise InputError(
                f"{count} grip paths, times of shape {self.times.shape} and endpoints of shape "
                f"{self.endpoint_xy.shape} do not match"
            )

    def __len__(self) -> int:
        return len(self.grip_path)

    def __getitem__(self, index) -> "MeasuredTracks":
        """Return the trials that a slice, a mask or an array of indices selects."""
        rows = ("grip_path", "times", "endpoint_xy", "final_xy", "status", "actions")
        return dataclasses.replace(self, **{name: getattr(self, name)[index] for name in rows})

    def alone(self, row: int) -> "MeasuredTracks":
        """Return one trial as a batch of its own, without padding to the length of the others."""
        one = self[[row]]
        count = 1 + int(np.argmax(one.times[0] >= one.times[0, -1]))
        return dataclasses.replace(
            one,
            grip_path=one.grip_path.without_padding(),
            times=one.times[:, :count],
            endpoint_xy=one.endpoint_xy[:, :count],
        )

    @property
    def compared(self) -> NDArray[np.bool_]:
        """Samples that equation 4 sums over, shape [trial, sample]."""
        return np.all(np.isfinite(self.endpoint_xy), axis=-1)

    @property
    def end(self) -> float:
        """Last time of all tracks [s]."""
        return float(self.times.max())

    def sample_dt(self) -> float:
        """Return the coarsest sampling interval whose grid contains all compared times [s].

        If there is none, return 0.01 s: linear interpolation at this interval is off by at most 1
        to 2 mm even where the endpoint's acceleration peaks at 100 m/s².
        """
        times = self.times[self.compared]
        for interval in _GRIDS:
            if np.all(np.abs(times - interval * np.round(times / interval)) < _GRID_TOLERANCE):
                return interval
        return _GRIDS[-1]

    @classmethod
    def from_dataset(
        cls, dataset: Dataset, *, path_source: str = "auto", count: int | None = None
    ) -> "MeasuredTracks":
        """Return the tracks of a dataset that a rig recorded.

        A trial that left the table is compared up to the last sample before the endpoint fell,
        since the simulated table has no edge. Samples in which the endpoint was not seen are not
        compared. Neither is the start, where simulation and rig are in the reset state.

        Args:
            dataset: Trials with the columns times, track_x and track_y.
            path_source: "commanded", "measured", or "auto": measured if the dataset has it.
            count: Number of trials to use, from the first one; all if None.

        Raises:
            DatasetError: The dataset holds no tracks, or fewer than requested.
            InputError: The path source is unknown, or the count is not positive.
        """
        if path_source not in PATH_SOURCES:
            raise InputError(f"path source {path_source!r}: one of {', '.join(PATH_SOURCES)}")
        count = len(dataset) if count is None else check_count("count", count)
        if count > len(dataset) or count == 0:
            name = str(dataset.path or "the dataset")
            raise DatasetError(f"{name} has {len(dataset)} trials, not {max(count, 1)}")
        tracks = [trial_track(dataset, row) for row in range(count)]
        workspace = dataset.setup.workspace
        sample_max = max(len(track.times) for track in tracks)
        times = np.empty((count, sample_max))
        xy = np.full((count, sample_max, 2), np.nan)
        for row, track in enumerate(tracks):
            length = len(track.times)
            times[row, :length], times[row, length:] = track.times, track.times[-1]
            xy[row, :length] = track.endpoint_xy
            if track.status is TrialStatus.OFF_TABLE:
                xy[row, _fallen_from(track.endpoint_xy, workspace) :] = np.nan
            elif track.status in (TrialStatus.NON_FINITE, TrialStatus.ABORTED):
                xy[row] = np.nan
        xy[times <= 0.0] = np.nan
        if path_source == "auto":
            path_source = "measured" if has_measured_motion(dataset) else "commanded"
        return cls(
            path_source=path_source,
            grip_path=_grip_paths(dataset, count, path_source),
            times=times,
            endpoint_xy=xy,
            final_xy=np.array([track.final_xy for track in tracks]),
            status=dataset.status[:count],
            actions=dataset.actions[:count],
        )


def _fallen_from(track: NDArray[np.float64], workspace: Workspace) -> int:
    """Return the index of the first sample that is no longer on the table."""
    seen = np.isfinite(track).all(axis=1)
    outside = seen & ~workspace.on_table(track)
    if outside.any():
        return int(np.argmax(outside))
    if not seen.any():
        return 0
    # It left between two samples, near the one closest to an edge.
    return int(np.argmin(np.where(seen, workspace.edge_distance(track), np.inf)))


def has_measured_joints(dataset: Dataset) -> bool:
    """Return whether the rig reported the joints of every trial."""
    return all(measured_joints(dataset, row) is not None for row in range(len(dataset)))


def has_measured_motion(dataset: Dataset) -> bool:
    """Return whether the joints of every trial were reported, or its grip tracked."""
    return all(
        measured_joints(dataset, row) is not None or measured_poses(dataset, row) is not None
        for row in range(len(dataset))
    )


def _grip_paths(dataset: Dataset, count: int, source: str) -> GripPath:
    """Return the commanded or the measured motions of the first trials."""
    if source == "commanded":
        if np.any(missing := ~np.all(np.isfinite(dataset.actions[:count]), axis=1)):
            name = str(dataset.path or "the dataset")
            raise DatasetError(f"{name} holds no action of trial {int(np.argmax(missing))}")
        return cast_grip_paths(dataset.actions[:count], dataset.setup)
    paths, arm = [], dataset.setup.arm
    for row in range(count):
        joints, poses = measured_joints(dataset, row), measured_poses(dataset, row)
        if joints is not None:
            paths.append(grip_path_from_joints(joints, arm))
        elif poses is not None:
            paths.append(grip_path_from_poses(*poses))
        else:
            name = str(dataset.path or "the dataset")
            raise DatasetError(f"{name} holds no measured joints of trial {row}")
    return GripPath.stack(paths)
