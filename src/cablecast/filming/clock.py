"""Clocks: the offset between the robot's and the camera's, from what both saw of one motion.

The camera sees something move (the gripper) or shine (a lamp on a digital output); the robot
reports the same with its own times. The offset is the shift at which the one explains the other
best.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError

Array = NDArray[np.float64]

FRAME_COUNT_MIN = 30
"""Fewest frames that tell an offset."""

PART_COUNT = 8
"""Parts of the record that are left out in turn, which tells how sure the offset is."""
RUN_LENGTH = 3
"""Frames in a row that are left out together, since errors of neighbours resemble one another."""
_EXPLAINED_MIN = 0.5
"""Smallest share of what the camera saw that the robot's report must explain."""
_REFINE_COUNT = 3


@dataclasses.dataclass(frozen=True, kw_only=True)
class ClockOffset:
    """Offset between two clocks.

    Attributes:
        offset: Time of the robot's clock when the camera's shows zero [s].
        sd: Standard deviation of the offset [s].
        explained: Share of the variance of what the camera saw that the robot's report explains.
        frame_count: Frames that it was found from.
    """

    offset: float
    sd: float
    explained: float
    frame_count: int


def controller_shift(clock_pairs: Array) -> float:
    """Return the time of this computer's clock when the controller's shows zero [s].

    The report that travelled fastest tells it best.

    Args:
        clock_pairs: Times of reports by the controller's clock, and of their arrival by that of
            this computer [s], shape [report, 2].

    Raises:
        InputError: There are no reports.
    """
    pairs = np.asarray(clock_pairs, dtype=float).reshape(-1, 2)
    if not len(pairs):
        raise InputError("the controller reported no times, which a camera without a clock needs")
    return float(np.min(pairs[:, 1] - pairs[:, 0]))


def fit_offset(
    times: Array,
    seen: Array,
    reported: Callable[[Array], Array],
    low: float,
    high: float,
    step: float = 0.004,
) -> ClockOffset:
    """Return the offset at which a report explains best what the camera saw.

    The camera's signal may be any multiple of the reported one, plus a constant: its scale depends
    on what part of the gripper was seen.

    Args:
        times: Times of the frames by the camera's clock [s], shape [frame].
        seen: Signal in the frames, NaN where there is none, shape [frame].
        reported: Signal at given times by the robot's clock; NaN outside its record.
        low: Smallest offset [s].
        high: Largest offset [s].
        step: Step of the first search [s]; a fraction of the time in which the signal changes.

    Raises:
        InputError: There are too few frames, or the two have nothing in common.
    """
    keep = np.isfinite(seen)
    times, seen = times[keep], seen[keep]
    if len(times) < FRAME_COUNT_MIN:
        raise InputError(
            f"{len(times)} frames show the motion: at least {FRAME_COUNT_MIN} are needed"
        )
    parts = np.arange(len(times)) // RUN_LENGTH % PART_COUNT
    offset, explained = _best(times, seen, reported, np.arange(low, high + step, step))
    if explained < _EXPLAINED_MIN:
        raise InputError(
            f"what the robot reports explains only {100 * explained:.0f} % of what the camera saw: "
            "is the gripper in sight, and nothing else in motion?"
        )
    near = offset + np.arange(-10, 11) * step / 2
    left_out = [
        _best(times[parts != part], seen[parts != part], reported, near)[0]
        for part in range(PART_COUNT)
    ]
    sd = jackknife_sd(np.array(left_out))
    return ClockOffset(offset=offset, sd=sd, explained=explained, frame_count=len(times))


def jackknife_sd(left_out: Array) -> float:
    """Return the standard deviation of an estimate, from those with each part left out in turn."""
    count = len(left_out)
    return float(np.sqrt((count - 1) / count * np.sum((left_out - np.mean(left_out)) ** 2)))


def parabola_minimum(places: Array, values: Array) -> float:
    """Return the place of a minimum, between the places about the least of some values.

    Args:
        places: Even places, shape [place].
        values: Values there, shape [place].
    """
    least = int(np.clip(np.argmin(values), 1, len(values) - 2))
    left, middle, right = values[least - 1 : least + 2]
    bend, step = left - 2 * middle + right, places[1] - places[0]
    shift = 0.5 * (left - right) / bend if bend > 0 else 0.0
    return float(places[least] + step * np.clip(shift, -1.0, 1.0))


def _best(
    times: Array, seen: Array, reported: Callable[[Array], Array], offsets: Array
) -> tuple[float, float]:
    """Return the offset that explains most, refined by a parabola, and how much it explains."""
    best, step = float(offsets[0]), float(offsets[1] - offsets[0])
    for _ in range(_REFINE_COUNT):
        shares = np.array([_explained(seen, reported(times + offset)) for offset in offsets])
        if not np.isfinite(shares).any():
            return best, 0.0
        best, step = float(offsets[int(np.nanargmax(shares))]), float(offsets[1] - offsets[0])
        offsets = best + np.linspace(-step, step, 9)
    left, middle, right = (
        _explained(seen, reported(times + best + shift)) for shift in (-step, 0.0, step)
    )
    bend = left - 2 * middle + right
    if np.isfinite(bend) and bend < 0:
        best += float(np.clip(0.5 * step * (left - right) / bend, -step, step))
    return best, float(np.nan_to_num(_explained(seen, reported(times + best))))


def _explained(seen: Array, reported: Array) -> float:
    """Return the share of the variance of one signal that a line of the other explains."""
    both = np.isfinite(reported)
    if both.sum() < FRAME_COUNT_MIN / 2 or both.sum() < 0.5 * len(seen):
        return np.nan
    a, b = seen[both] - seen[both].mean(), reported[both] - reported[both].mean()
    scale = float(a @ a) * float(b @ b)
    # A motion seen backwards is another motion.
    return float(max(a @ b, 0.0) ** 2 / scale) if scale > 0 else np.nan


def lamp_signal(
    switch_times: Array, exposure: float, first_on: bool = True
) -> Callable[[Array], Array]:
    """Return the brightness of a lamp in frames, as a share of full.

    Args:
        switch_times: Times at which it was switched, by the robot's clock, rising [s].
        exposure: Exposure of a frame [s]; the lamp may be switched within it.
        first_on: Whether the first time switches it on.

    Returns:
        Function from times of frames to brightness from 0 to 1.
    """
    edges = np.asarray(switch_times, dtype=float)
    signs = np.where(np.arange(len(edges)) % 2 == 0, 1.0, -1.0) * (1.0 if first_on else -1.0)

    def brightness(times: Array) -> Array:
        passed = (times[:, None] - edges) / exposure + 0.5
        level = np.clip(passed, 0.0, 1.0) @ signs
        return level + (0.0 if first_on else 1.0)

    return brightness
