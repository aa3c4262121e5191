"""From positions in the frames of a trial to the samples of its track, and to how it ended."""

import numpy as np
from numpy.typing import NDArray

from cablecast.track import TrialStatus
from cablecast.workspace import Workspace

_REST_TIME, _REST_DISTANCE, _REST_FRAMES = 0.15, 0.005, 3
"""An endpoint that was seen in so many of the last frames [s], all this near to each other [m],
rests there, whether or not the very last one shows it."""
_BRINK = 0.03
"""Distance from the table's left, right or far edge within which what vanishes fell over it [m]."""


def sample_path(
    times: NDArray[np.float64], xy: NDArray[np.float64], sample_times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return positions at some times from those of the frames next to each.

    A sample that falls on a frame is that frame's. One between two frames lies on the line between
    them, and is NaN if either is NaN or they are more than two frames apart.

    Args:
        times: Times of the frames, rising [s], shape [frame].
        xy: Positions in the frames, NaN where not seen [m], shape [frame, 2].
        sample_times: Times of the samples [s], shape [sample].

    Returns:
        Positions [m], shape [sample, 2].
    """
    sampled = np.full((len(sample_times), 2), np.nan)
    if len(times) == 0:
        return sampled
    frame_dt = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    near = 0.05 * frame_dt + 1e-9
    for i, time in enumerate(sample_times):
        after = int(np.searchsorted(times, time))
        nearest = min(max(after - 1, 0), len(times) - 1)
        if after < len(times) and abs(times[after] - time) < abs(times[nearest] - time):
            nearest = after
        if abs(times[nearest] - time) <= near:
            sampled[i] = xy[nearest]
        elif 0 < after < len(times) and times[after] - times[after - 1] < 1.5 * frame_dt:
            part = (time - times[after - 1]) / (times[after] - times[after - 1])
            sampled[i] = (1 - part) * xy[after - 1] + part * xy[after]
    return sampled


def track_samples(
    times: NDArray[np.float64],
    xy: NDArray[np.float64],
    sample_times: NDArray[np.float64],
    workspace: Workspace,
    edge_tolerance: float = 0.005,
) -> tuple[NDArray[np.float64], TrialStatus]:
    """Return the samples of a track, and how its trial ended.

    No landing hangs on a single frame: where the last sample is missing, it is the place at which
    the endpoint rested in the frames before it.

    Args:
        times: Times of the frames, rising [s], shape [frame].
        xy: Positions in the frames, NaN where not seen [m], shape [frame, 2].
        sample_times: Times of the samples, rising [s], shape [sample].
        workspace: Gives the table's edges.
        edge_tolerance: Distance beyond the edge at which an endpoint is off the table [m].

    Returns:
        Samples [m], shape [sample, 2], and the status.
    """
    samples = sample_path(times, xy, sample_times)
    if len(samples) and np.isnan(samples[-1]).any():
        samples[-1] = _resting_place(times, xy, float(sample_times[-1]))
    return samples, judge_status(times, xy, samples, workspace, edge_tolerance)


def _resting_place(
    times: NDArray[np.float64], xy: NDArray[np.float64], end: float
) -> NDArray[np.float64]:
    """Return where the endpoint rested shortly before a time [m], NaN where it did not, [2]."""
    late = (times <= end) & (times >= end - _REST_TIME) & np.isfinite(xy).all(axis=1)
    if np.count_nonzero(late) < _REST_FRAMES or np.ptp(xy[late], axis=0).max() > _REST_DISTANCE:
        return np.full(2, np.nan)
    return np.median(xy[late], axis=0)


def judge_status(
    times: NDArray[np.float64],
    xy: NDArray[np.float64],
    endpoint_xy: NDArray[np.float64],
    workspace: Workspace,
    edge_tolerance: float = 0.005,
) -> TrialStatus:
    """Return how a trial ended, judged by what was seen.

    Off the table is an endpoint that was seen last beyond the edge, on its way over it, or so near
    to it that nothing else can have hidden it: no arm reaches there. Occluded is any other that was
    not seen at the end. One that swept past the edge and came back has landed.

    Args:
        times: Times of the frames [s], shape [frame].
        xy: Positions in the frames, NaN where not seen [m], shape [frame, 2].
        endpoint_xy: Samples of the track [m], shape [sample, 2].
        workspace: Gives the table's edges.
        edge_tolerance: Distance beyond the edge at which an endpoint is off the table [m].
    """
    seen = np.flatnonzero(np.isfinite(xy).all(axis=1))
    if not len(seen):
        return TrialStatus.OCCLUDED
    last = xy[seen[-1]]
    # A point pulled towards the table by the tolerance must lie on it.
    centre = np.array([0.0, (workspace.y_min + workspace.y_max) / 2])
    if not workspace.on_table(last - np.clip(last - centre, -edge_tolerance, edge_tolerance)):
        return TrialStatus.OFF_TABLE
    if np.isfinite(endpoint_xy[-1]).all():
        return TrialStatus.OK
    # The near edge does not count: there the arm is in the way.
    to_edge = min(workspace.half_width - abs(last[0]), workspace.y_max - last[1])
    if to_edge < _BRINK:
        return TrialStatus.OFF_TABLE
    if len(seen) > 1 and seen[-1] < len(times) - 1:
        a, b = seen[-2:]
        velocity = (xy[b] - xy[a]) / (times[b] - times[a])
        # Two more frames at the speed at which it was seen last.
        ahead = last + velocity * 2 * (times[b + 1] - times[b])
        if not workspace.on_table(ahead):
            return TrialStatus.OFF_TABLE
    return TrialStatus.OCCLUDED
