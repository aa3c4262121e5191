"""EndpointTrack: the path of the endpoint and the end of the trial, returned by every executor."""

import dataclasses
import enum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError

if TYPE_CHECKING:
    from cablecast.motion.trajectory import JointPath


class TrialStatus(enum.Enum):
    """End of a trial; the value is a sentence with advice for the user.

    Off the table is a cast whose endpoint came to rest beyond the edge, or left the table and was
    not seen again. One that passed over the edge and came back has landed.
    """

    OK = "The endpoint came to rest on the table and was seen."
    OFF_TABLE = "The endpoint ended beyond the table's edge: choose a slower or narrower motion."
    OCCLUDED = (
        "The endpoint was hidden from the camera at the end: move the arm away and look again."
    )
    NON_FINITE = "The simulated cable became non-finite: check its parameters and the step."
    ABORTED = "The trial was stopped before its end: clear the cause and run it again."

    @property
    def code(self) -> str:
        """Short name for tables and columns, e.g. `off_table`."""
        return self.name.lower()

    @classmethod
    def from_code(cls, code: str) -> "TrialStatus":
        """Return the status whose `code` this is.

        Raises:
            InputError: No status has this code.
        """
        try:
            return cls[code.upper()]
        except KeyError:
            codes = ", ".join(status.code for status in cls)
            raise InputError(f"unknown trial status {code!r}: one of {codes}") from None


@dataclasses.dataclass(frozen=True, kw_only=True)
class ControllerLog:
    """Reports of an arm's controller during one trial, beside the measured joints.

    There is one report for each time of the track's `joint_path`.

    Attributes:
        times: Times of the reports by the controller's clock [s], shape [report].
        target_q: Set points that the controller followed [rad], shape [report, 6].
        speed_scaling: Speed scaling, the slider's included [-], shape [report].
        safety_bits: Safety status bits, shape [report].
    """

    times: NDArray[np.float64]
    target_q: NDArray[np.float64]
    speed_scaling: NDArray[np.float64]
    safety_bits: NDArray[np.float64]

    def __post_init__(self):
        count = len(self.times)
        shapes = {"target_q": (count, 6), "speed_scaling": (count,), "safety_bits": (count,)}
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise InputError(
                    f"{name} of a controller's log has shape {getattr(self, name).shape}: "
                    f"{count} reports require {shape}"
                )


@dataclasses.dataclass(frozen=True, kw_only=True)
class EndpointTrack:
    """Path of the cable's endpoint during one trial.

    Attributes:
        times: Times since the start of the motion [s], shape [step].
        endpoint_xy: Endpoint on the table [m], shape [step, 2]; NaN where it was not seen.
        status: End of the trial.
        nodes: Cable shape at the same times for pictures, base frame [m], shape
            [step, node, 3]; None if the executor cannot see it.
        joint_path: Measured joints, with the times at which the arm reported them; None if the
            executor has no joints or does not report them. The commanded joints are those of the
            trajectory.
        controller_log: Reports of the arm's controller at the times of `joint_path`; None where
            there is no controller.
    """

    times: NDArray[np.float64]
    endpoint_xy: NDArray[np.float64]
    status: TrialStatus
    nodes: NDArray[np.float64] | None = None
    joint_path: "JointPath | None" = None
    controller_log: ControllerLog | None = None

    def __post_init__(self):
        for name in ("times", "endpoint_xy", "nodes"):
            object.__setattr__(self, name, _numbers(name, getattr(self, name)))
        if self.endpoint_xy.shape != (*self.times.shape, 2) or self.times.ndim != 1:
            raise InputError(
                f"endpoint_xy has shape {self.endpoint_xy.shape}, times {self.times.shape}: "
                "they must be [step, 2] and [step]"
            )
        if self.times.size == 0:
            raise InputError("an endpoint track needs at least one sample")
        nodes = self.nodes
        if nodes is not None and (
            nodes.ndim != 3 or len(nodes) != len(self.times) or nodes.shape[2] != 3
        ):
            raise InputError(
                f"nodes have shape {nodes.shape}: {len(self.times)} times require [step, node, 3]"
            )

    @property
    def final_xy(self) -> NDArray[np.float64]:
        """Resting point of the endpoint [m], shape [2]; NaN unless the status is OK."""
        return self.endpoint_xy[-1] if self.status is TrialStatus.OK else np.full(2, np.nan)


def _numbers(name: str, values: Any) -> NDArray[np.float64] | None:
    """Return an array of real numbers, NaN where masked; None if there are no nodes."""
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(float), np.nan)
    if isinstance(values, np.ndarray) and np.issubdtype(values.dtype, np.floating):
        return values
    if values is None and name == "nodes":
        return None
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} of an endpoint track must be an array of numbers") from None
