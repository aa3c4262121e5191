"""Album: shapes of the casts of a session, for replays, and which tries were taken back.

A session of `aim` keeps what teaches: the track of the free end and the joints. What is only looked
at, the shape of the whole cable, is kept here.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.runs.parts import Parts
from cablecast.track import TrialStatus
from cablecast.view.shown import ShownCast, joint_path_through

ALBUM_FOLDER = "shapes"
"""Folder of the shapes beside a session of `aim`."""

_UNDONE = "undone"

_METRES, _RADIANS, _SECONDS = 4, 5, 4
"""Decimals that are stored: a tenth of a millisecond and of a millimetre, which nobody sees."""

_KEPT_COUNT = 40
"""Casts that are held in memory; older ones are read again when they are asked for."""


class Album:
    """Shapes of casts by the number of the cast in its session.

    Args:
        parts: Folder of the shapes; they are kept in memory alone where None.

    Attributes:
        undone: Numbers of the casts that were taken back.

    Raises:
        DamagedFileError: A file is not what was written.
    """

    def __init__(self, parts: Parts | None = None):
        self._parts = parts
        self._shown: dict[int, ShownCast] = {}
        noted = None if parts is None else parts.get(_UNDONE)
        self.undone: set[int] = set() if noted is None else set(noted["numbers"])

    def keep(self, number: int, cast: ShownCast) -> None:
        """Keep a cast."""
        self._hold(number, cast)
        if self._parts is not None:
            self._parts.put(f"{number:05d}", cast_to_plain(cast))

    def get(self, number: int) -> ShownCast | None:
        """Return a cast; None where it was not kept."""
        if number not in self._shown and self._parts is not None:
            values = self._parts.get(f"{number:05d}")
            if values is not None:
                self._hold(number, cast_from_plain(values))
        return self._shown.get(number)

    def mark_undone(self, number: int) -> None:
        """Note that a cast was taken back."""
        self.undone = self.undone | {number}
        if self._parts is not None:
            self._parts.put(_UNDONE, {"numbers": sorted(self.undone)})

    def _hold(self, number: int, cast: ShownCast) -> None:
        self._shown[number] = cast
        if self._parts is not None and len(self._shown) > _KEPT_COUNT:
            del self._shown[min(self._shown)]


def cast_to_plain(cast: ShownCast) -> dict[str, Any]:
    """Return a cast as plain values for JSON; see `cast_from_plain`."""
    joints = cast.joint_path
    return {
        "status": cast.status.code,
        "times": _plain(cast.times, _SECONDS),
        "endpoint_xy": _plain(cast.endpoint_xy, _METRES),
        "nodes": None if cast.nodes is None else _plain(cast.nodes, _METRES),
        "joint_times": None if joints is None else _plain(joints.times, _SECONDS),
        "joint_q": None if joints is None else _plain(joints.q, _RADIANS),
    }


def cast_from_plain(values: dict[str, Any]) -> ShownCast:
    """Return the cast that `cast_to_plain` described."""
    joints = None
    if values["joint_times"] is not None:
        joints = joint_path_through(_array(values["joint_times"]), _array(values["joint_q"]))
    return ShownCast(
        times=_array(values["times"]),
        endpoint_xy=_array(values["endpoint_xy"]),
        nodes=None if values["nodes"] is None else _array(values["nodes"]),
        joint_path=joints,
        status=TrialStatus.from_code(values["status"]),
    )


def _plain(values: NDArray[np.float64], decimals: int) -> Any:
    """Return nested lists, None for what is not finite: JSON has no NaN."""
    values = np.round(values, decimals)
    plain = values.astype(object)
    plain[~np.isfinite(values)] = None
    return plain.tolist()


def _array(values: Any) -> NDArray[np.float64]:
    return np.array(values, dtype=float)
