"""A camera that asks the twin for the truth: for tests and benchmarks of the arm alone.

It sees what no camera can. Results that were made with it say so in the description of their rig.
"""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.errors import RigError
from cablecast.rigs.ur.twin.process import TwinClient
from cablecast.setup import Setup
from cablecast.vision.trials import TrialTiming

_SAMPLE_DT = 0.1
_FALLEN_Z = -0.005
_WAIT_MAX = 60.0


class TruthCamera:
    """Asks a twin where the endpoint is, instead of looking.

    Args:
        setup: Lab file of a twin.

    Raises:
        RigError: The lab file's robot is no twin, or it does not answer.
    """

    def __init__(self, setup: Setup):
        if setup.robot is None or not setup.robot.is_loopback:
            raise RigError("only a twin tells the truth: this lab file's robot is none")
        self.setup = setup
        self._twin = TwinClient(setup.robot.address)
        self.description: dict[str, Any] = {"camera": "truth of the twin"}

    def check(self, after: float | None = None) -> None:
        """Refuse a twin that does not answer."""
        self._twin.state()

    def start(self) -> None:
        """Do nothing: the twin remembers all."""

    def stop(self, timing: TrialTiming) -> EndpointTrack:
        """Return the true track; see `TrialCamera`."""
        deadline = time.monotonic() + _WAIT_MAX
        while self._twin.state()["time"] < timing.end_time:
            if time.monotonic() > deadline:
                raise RigError("the clock of the twin stands still")
            time.sleep(0.01)
        truth = self._twin.truth(timing.start_time - 0.1, timing.end_time + 0.1)
        seen = np.array(truth["times"]) - timing.start_time
        tip = np.array(truth["tip"], dtype=float)
        count = int((timing.end_time - timing.start_time) / _SAMPLE_DT + 1e-9) + 1
        times = _SAMPLE_DT * np.arange(count, dtype=np.float64)
        points = np.stack([np.interp(times, seen, tip[:, axis]) for axis in range(3)], axis=1)
        fell = ~self.setup.workspace.on_table(points[:, :2]) | (points[:, 2] < _FALLEN_Z)
        return EndpointTrack(
            times=times,
            endpoint_xy=points[:, :2],
            status=TrialStatus.OFF_TABLE if fell.any() else TrialStatus.OK,
            joint_path=timing.joint_path,
        )

    def cancel(self) -> None:
        """Do nothing: nothing was begun."""

    def locate(self, after: float | None = None) -> NDArray[np.float64] | None:
        """Return where the endpoint is now [m], shape [2]."""
        return np.array(self._twin.state()["tip"][:2], dtype=float)

    def into_sight(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the joints themselves: nothing hides the truth."""
        return q

    def holds_cable(self, q: NDArray[np.float64], after: float) -> bool:
        """Return whether the jaws hold the cable."""
        return bool(self._twin.state()["holds_cable"])

    def close(self) -> None:
        """Close the connection."""
        self._twin.close()
