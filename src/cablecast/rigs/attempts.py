"""Attempts at one trial: what fails is repeated, some times."""

from collections.abc import Callable
from typing import TypeVar

from cablecast.errors import RigError
from cablecast.motion.trajectory import Trajectory
from cablecast.rigs.base import Rig, error_line
from cablecast.track import EndpointTrack, TrialStatus

ATTEMPT_COUNT = 3
"""Number of attempts at a trial before it is given up."""

Kept = TypeVar("Kept")


class TrialFailedError(RigError):
    """A trial failed as often as it was to be tried; the message begins with `failed`."""


def seek_trial(rig: Rig, index: int, purpose: str) -> None:
    """Let the next trial of a rig that draws by chance be the index-th of a purpose.

    Args:
        rig: Rig, with or without `seek`.
        index: Number of the trial.
        purpose: One of `PURPOSES`, or none.
    """
    seek = getattr(rig, "seek", None)
    if callable(seek):
        seek(index, purpose)


def attempt_trial(
    rig: Rig,
    motion: Trajectory,
    *,
    index: int,
    purpose: str,
    keep: Callable[[EndpointTrack, int], Kept],
    count: int = ATTEMPT_COUNT,
) -> Kept:
    """Reset a rig and play one motion, again and again until it succeeds.

    Args:
        rig: Rig to play it on.
        motion: Motion to play.
        index: Number of the trial, which a rig that draws by chance draws from.
        purpose: Purpose of the trial, one of `PURPOSES` or none.
        keep: Makes the result of a track and of the number of failures before it; a track that it
            refuses has failed, too.
        count: Number of attempts.

    Returns:
        Result of `keep`.

    Raises:
        TrialFailedError: All attempts failed.
    """
    reason = ""
    for failures in range(count):
        try:
            seek_trial(rig, index, purpose)
            rig.reset()
            track = rig.execute(motion)
            if track.status is not TrialStatus.ABORTED:
                return keep(track, failures)
            reason = "the rig reported it as aborted"
        # A rig is foreign code: whatever it raises, the trial has failed.
        except Exception as error:
            reason = str(error) if isinstance(error, RigError) else error_line(error)
    raise TrialFailedError(f"failed {count} times, the last time because: {reason}")
