"""TrialCamera: what a rig asks of the camera that watches its trials."""

import dataclasses
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cablecast.motion.joint_path import JointPath
from cablecast.track import EndpointTrack


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrialTiming:
    """When a trial took place, by the clock of the arm's controller and by that of this computer.

    Attributes:
        start_time: Begin of the motion by the controller's clock [s].
        end_time: End of the trial, when the cable has had time to come to rest, by the controller's
            clock [s].
        clock_pairs: Times of reports by the controller's clock, and the times at which they arrived
            by `time.monotonic` of this computer [s], shape [report, 2].
        joint_path: Joints as the arm reported them, with times since `start_time`; None where it
            reports none.
    """

    start_time: float
    end_time: float
    clock_pairs: NDArray[np.float64]
    joint_path: JointPath | None = None


@runtime_checkable
class TrialCamera(Protocol):
    """Camera over the table, which films one trial at a time.

    The order is check, then for each trial start, stop or cancel; `locate` may come at any time
    between two trials. A camera that cannot go on raises RigError with one line that says what to
    do.

    Attributes:
        description: Kind and settings of the camera, as plain values for a dataset card.
    """

    description: dict[str, Any]

    def check(self, after: float | None = None) -> None:
        """Check that frames arrive, are fresh and as exposed as before, and that no tag moved.

        Args:
            after: Time by the controller's clock from which on frames count [s]; from now on where
                None, which is only as fresh as the way of a frame from the sensor is short.

        Raises:
            RigError: The camera cannot see a trial; says what to do.
        """
        ...

    def start(self) -> None:
        """Begin to film: the motion starts after this returns."""
        ...

    def stop(self, timing: TrialTiming) -> EndpointTrack:
        """End the film, and return the endpoint's track.

        The frames from `timing.start_time` to `timing.end_time` count. This waits until the last of
        them has arrived.

        Args:
            timing: When the trial took place.

        Returns:
            Track with samples every 100 ms since the motion began; the joint path is that of
            `timing`.
        """
        ...

    def cancel(self) -> None:
        """Drop the film of a trial that was aborted; harmless where none runs."""
        ...

    def locate(self, after: float | None = None) -> NDArray[np.float64] | None:
        """Return where the endpoint is now.

        Args:
            after: Time by the controller's clock from which on frames count [s]; from now on where
                None.

        Returns:
            Place on the table [m], shape [2]; None where it is not seen.
        """
        ...

    def close(self) -> None:
        """Let go of the device; it may be called twice."""
        ...
