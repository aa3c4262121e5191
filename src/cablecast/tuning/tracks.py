"""Measured tracks of D_tune, and their distance to simulated ones (paper, equation 4)."""

import dataclasses
import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams
from cablecast.cast import Cast, TrialStatus
from cablecast.data.dataset import Dataset
from cablecast.data.store import dataset_cast
from cablecast.engines.base import CableState, Engine, reset_state
from cablecast.errors import DatasetError, InputError
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.grip_path import GripPath
from cablecast.motion.measured import grip_path_from_joints, grip_path_from_poses
from cablecast.setup import Setup
from cablecast.workspace import Workspace

PATH_SOURCES = ("auto", "commanded", "measured")
_SOURCES = ("commanded", "mixed", "measured")

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
        path_source: Origin of the grip paths: "commanded", "measured", or "mixed".
        edges: Table whose edges the cable may hang over; None for an endless one.
    """

    grip_path: GripPath
    times: NDArray[np.float64]
    endpoint_xy: NDArray[np.float64]
    final_xy: NDArray[np.float64]
    status: NDArray[np.str_]
    actions: NDArray[np.float64]
    path_source: str
    edges: Workspace | None = None

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
    def from_dataset(cls, dataset: Dataset, *, path_source: str = "auto") -> "MeasuredTracks":
        """Return the tracks of a dataset that a rig recorded; see `of_casts`.

        Raises:
            DatasetError: The dataset holds no tracks.
        """
        casts = [dataset_cast(dataset, row) for row in range(len(dataset))]
        return cls.of_casts(
            casts, dataset.setup, path_source, name=str(dataset.path or "the dataset")
        )

    @classmethod
    def of_casts(
        cls,
        casts: Sequence[Cast],
        setup: Setup,
        path_source: str = "auto",
        *,
        name: str = "the session",
    ) -> "MeasuredTracks":
        """Return the tracks of casts on a rig.

        A cast that left the table is compared up to the last sample before the endpoint fell.
        Samples in which the endpoint was not seen are not compared. Neither is the start, where
        simulation and rig are in the reset state.

        Args:
            casts: Casts.
            setup: Set-up that they were made with.
            path_source: Motion of the gripper: "commanded", "measured", or "auto": measured for
                each cast of which the rig reported it, else commanded.
            name: What the casts are called in errors.

        Raises:
            DatasetError: There are no casts, or the motion of one is not known.
            InputError: The path source is unknown.
        """
        if path_source not in PATH_SOURCES:
            raise InputError(f"path source {path_source!r}: one of {', '.join(PATH_SOURCES)}")
        if not casts:
            raise DatasetError(f"{name} has no trials")
        tracks = [cast.track for cast in casts]
        sample_max = max(len(track.times) for track in tracks)
        times = np.empty((len(casts), sample_max))
        xy = np.full((len(casts), sample_max, 2), np.nan)
        for row, track in enumerate(tracks):
            length = len(track.times)
            times[row, :length], times[row, length:] = track.times, track.times[-1]
            xy[row, :length] = track.endpoint_xy
            if track.status is TrialStatus.OFF_TABLE:
                xy[row, _fallen_from(track.endpoint_xy, setup.workspace) :] = np.nan
            elif track.status in (TrialStatus.NON_FINITE, TrialStatus.ABORTED):
                xy[row] = np.nan
        xy[times <= 0.0] = np.nan
        missing = [row for row, cast in enumerate(casts) if not _has_measured_motion(cast)]
        is_measured = np.full(len(casts), path_source != "commanded")
        if path_source == "auto":
            is_measured[missing] = False
            if 0 < len(missing) < len(casts):
                warnings.warn(
                    f"{len(missing)} of {len(casts)} trials have no measured motion, first trial "
                    f"{missing[0]}: their commanded motion is taken",
                    stacklevel=2,
                )
        return cls(
            path_source=_SOURCES[int(is_measured.all()) + int(is_measured.any())],
            grip_path=_grip_paths(casts, setup, is_measured, name),
            times=times,
            endpoint_xy=xy,
            final_xy=np.array([track.final_xy for track in tracks]),
            status=np.array([track.status.code for track in tracks]),
            actions=np.array([cast.sweep for cast in casts]),
            edges=setup.workspace,
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
    return all(dataset.measured_joints(row) is not None for row in range(len(dataset)))


def _has_measured_motion(cast: Cast) -> bool:
    """Return whether the joints of a cast were reported, or its grip tracked."""
    return cast.track.joint_path is not None or cast.grip is not None


def _grip_paths(
    casts: Sequence[Cast], setup: Setup, is_measured: NDArray[np.bool_], name: str
) -> GripPath:
    """Return the measured motions of some casts, and the commanded ones of the others."""
    for row in np.flatnonzero(~is_measured).tolist():
        if not np.all(np.isfinite(casts[row].sweep)):
            raise DatasetError(f"{name} holds no action of trial {row}")
    if not is_measured.any():
        return cast_grip_paths(np.array([cast.sweep for cast in casts]), setup)
    paths = []
    for row, cast in enumerate(casts):
        if not is_measured[row]:
            paths.append(cast_grip_paths(cast.sweep[None], setup))
        elif cast.track.joint_path is not None:
            paths.append(grip_path_from_joints(cast.track.joint_path, setup.arm))
        elif cast.grip is not None:
            paths.append(grip_path_from_poses(*cast.grip))
        else:
            raise DatasetError(f"{name} holds no measured joints of trial {row}")
    return GripPath.stack(paths)


NON_FINITE_DISTANCE = 2.0
"""Distance assigned to a non-finite simulation, in cable lengths; larger than any real one."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrackDistances:
    """Distances between simulated and measured endpoints, candidate by trial.

    Attributes:
        mean: Mean distance over the compared samples of a track [m], shape [candidate, trial]; NaN
            without compared samples.
        final: Distance between the resting points [m], same shape; NaN if the rig's cable did not
            come to rest on the table.
        finite: Whether the simulation stayed finite, same shape.
    """

    mean: NDArray[np.float64]
    final: NDArray[np.float64]
    finite: NDArray[np.bool_]

    def concat(self, other: "TrackDistances") -> "TrackDistances":
        """Return the candidates of both, these first; the trials must be the same."""
        fields = [field.name for field in dataclasses.fields(self)]
        return TrackDistances(
            **{name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in fields}
        )

    @property
    def loss(self) -> NDArray[np.float64]:
        """Equation 4: mean over trials of the mean distance over samples [m], shape [candidate]."""
        return np.nanmean(self.mean, axis=1)


class TrackObjective:
    """Objective that simulates the measured motions with candidate parameters in one batch.

    Args:
        engine: Simulator.
        cable: Cable that was cast.
        tracks: Tracks measured on a rig.

    Raises:
        InputError: No sample of any track can be compared.
    """

    def __init__(self, engine: Engine, cable: Cable, tracks: MeasuredTracks):
        if not tracks.compared.any():
            raise InputError(
                "no cast has a sample that can be compared with a simulation: each broke off, was "
                "aborted, or its free end was never seen"
            )
        self.engine = engine
        self.cable = cable
        self.tracks = tracks
        self._sample_dt = tracks.sample_dt()
        # The simulated cable rests before the longest track ends, or soon after.
        self._duration = tracks.end

    def __len__(self) -> int:
        return len(self.tracks)

    def tracks_of(self, params: CableParams) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return simulated endpoints of candidates at the measured times, and which are finite.

        Endpoints [m] have the shape [candidate, trial, sample, 2], whose last sample is the end of
        the simulation; worlds that stayed finite are marked, shape [candidate, trial].
        """
        candidate_count, trial_count = params.world_count or 1, len(self.tracks)
        # Candidates vary fastest: worlds that share a lane group then follow the same motion, pass
        # its knots together and come to rest at about the same time.
        trial = np.repeat(np.arange(trial_count), candidate_count)
        candidate = np.tile(np.arange(candidate_count), trial_count)
        rollout = self.engine.rollout(
            self.cable.with_params(params.rows(candidate)),
            self.tracks.grip_path[trial],
            self._initial_state(params, trial, candidate),
            duration=self._duration,
            sample_dt=self._sample_dt,
            edges=self.tracks.edges,
        )
        sampled = rollout.endpoint_xy.reshape(trial_count, candidate_count, -1, 2)
        at_times = _interpolate(rollout.times, sampled, self.tracks.times)
        finite = rollout.finite.reshape(trial_count, candidate_count)
        xy = np.concatenate([at_times, sampled[:, :, -1:]], axis=2)
        return np.swapaxes(xy, 0, 1), finite.T

    def distances(self, params: CableParams) -> TrackDistances:
        """Return the distances of candidates from the measured tracks."""
        xy, finite = self.tracks_of(params)
        penalty = NON_FINITE_DISTANCE * self.cable.length
        apart = np.linalg.norm(xy[:, :, :-1] - self.tracks.endpoint_xy, axis=-1)
        compared = self.tracks.compared
        count = compared.sum(axis=1)
        total = np.where(compared, apart, 0.0).sum(axis=2)
        mean = np.where(finite, total / np.maximum(count, 1), penalty)
        final = np.linalg.norm(xy[:, :, -1] - self.tracks.final_xy, axis=-1)
        final = np.where(finite, final, penalty)
        return TrackDistances(
            mean=np.where(count > 0, mean, np.nan),
            final=np.where(np.isfinite(self.tracks.final_xy).all(axis=1), final, np.nan),
            finite=finite,
        )

    def _initial_state(
        self, params: CableParams, trial: NDArray[np.intp], candidate: NDArray[np.intp]
    ) -> CableState:
        """Return the reset state of each world.

        It is computed once per candidate and transformed to the start of each trial. The starts
        differ only by the noise of measured joints. One computation per world would take longer
        than the simulation.
        """
        paths = self.tracks.grip_path
        starts = paths.evaluate(paths.knots[:, :1])[:, 0]
        first = GripPath.hold(starts[0], 1.0)
        reset = reset_state(self.cable.with_params(params), first, self.engine.segment_count)
        shape = reset.positions[candidate]
        turn = starts[trial, 3] - starts[0, 3]
        c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
        x, y = (shape[..., axis] - starts[0, axis] for axis in (0, 1))
        positions = np.empty_like(shape)
        # Yaw is measured from the y axis towards x.
        positions[..., 0] = starts[trial, 0, None] + c * x + s * y
        positions[..., 1] = starts[trial, 1, None] + c * y - s * x
        radius = self.cable.radius
        drop = starts[0, 2] - radius
        stretch = (starts[trial, 2] - radius) / drop if abs(drop) > 1e-9 else np.ones(len(trial))
        positions[..., 2] = radius + stretch[:, None] * (shape[..., 2] - radius)
        return CableState.at_rest(positions)


def _interpolate(
    grid: NDArray[np.float64], values: NDArray[np.float64], times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Interpolate samples, shape [trial, candidate, step, 2], linearly on an even grid from 0 on.

    Wanted times [s] have the shape [trial, sample], values there [trial, candidate, sample, 2].
    """
    interval = grid[1] - grid[0]
    # Round, so that a time on the grid does not mix in its neighbour, which may be NaN.
    place = np.clip(np.round(times / interval, 6), 0.0, len(grid) - 1)
    before = np.minimum(place.astype(int), len(grid) - 2)
    share = place - before
    trial = np.arange(len(times))[:, None]
    low = np.moveaxis(values, 1, 2)[trial, before]
    high = np.moveaxis(values, 1, 2)[trial, before + 1]
    share = share[:, :, None, None]
    return np.moveaxis((1.0 - share) * low + share * high, 2, 1)
