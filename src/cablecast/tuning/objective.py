"""TrackObjective: distance between simulated and measured tracks (paper, equation 4)."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams
from cablecast.engines.base import CableState, Engine, reset_state
from cablecast.errors import InputError
from cablecast.material import Material
from cablecast.motion.grip_path import GripPath
from cablecast.tuning.tracks import MeasuredTracks

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

    def beside(self, other: "TrackDistances") -> "TrackDistances":
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
            raise InputError("no sample of any track can be compared with a simulation")
        self.engine = engine
        self.cable = cable
        self.tracks = tracks
        self._sample_dt = tracks.sample_dt()
        # The simulated cable rests before the longest track ends, or soon after.
        self._duration = tracks.end

    def __len__(self) -> int:
        return len(self.tracks)

    def tracks_of(
        self, params: CableParams, material: Material | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return simulated endpoints at the measured times.

        Args:
            params: One value per candidate, or shared for one candidate.
            material: Material of the candidates, shared or one value each; that of the cable where
                None.

        Returns:
            Endpoints [m], shape [candidate, trial, sample, 2]; the last sample is the end of the
            simulation. Whether each world stayed finite, shape [candidate, trial].
        """
        values = np.atleast_2d(params.to_array())
        candidate_count, trial_count = len(values), len(self.tracks)
        # Candidates vary fastest: worlds that share a lane group then follow the same motion, pass
        # its knots together and come to rest at about the same time.
        trial = np.repeat(np.arange(trial_count), candidate_count)
        candidate = np.tile(np.arange(candidate_count), trial_count)
        cable = self.cable.with_material(material)
        rollout = self.engine.rollout(
            cable.with_material(cable.material.rows(candidate)),
            CableParams.from_array(values[candidate]),
            self.tracks.grip_path[trial],
            self._initial_state(cable, values, trial, candidate),
            duration=self._duration,
            sample_dt=self._sample_dt,
        )
        sampled = rollout.endpoint_xy.reshape(trial_count, candidate_count, -1, 2)
        at_times = _interpolate(rollout.times, sampled, self.tracks.times)
        finite = rollout.finite.reshape(trial_count, candidate_count)
        xy = np.concatenate([at_times, sampled[:, :, -1:]], axis=2)
        return np.swapaxes(xy, 0, 1), finite.T

    def distances(self, params: CableParams) -> TrackDistances:
        """Return the distances of candidates from the measured tracks.

        Args:
            params: One value per candidate, or shared for one candidate.
        """
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
        self,
        cable: Cable,
        values: NDArray[np.float64],
        trial: NDArray[np.intp],
        candidate: NDArray[np.intp],
    ) -> CableState:
        """Return the reset state of each world.

        It is computed once per candidate and transformed to the start of each trial. The starts
        differ only by the noise of measured joints. One computation per world would take longer
        than the simulation.
        """
        paths = self.tracks.grip_path
        starts = paths.evaluate(paths.knots[:, :1])[:, 0]
        first = GripPath.hold(starts[0], 1.0)
        shape = reset_state(
            cable, CableParams.from_array(values), first, self.engine.segment_count
        ).positions[candidate]
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
    """Interpolate linearly on an even grid.

    Args:
        grid: Ascending times of the samples from 0 [s], shape [step].
        values: Samples, shape [trial, candidate, step, 2].
        times: Wanted times [s], shape [trial, sample].

    Returns:
        Values at the wanted times, shape [trial, candidate, sample, 2].
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
