"""Tries at targets, each stored when it is done, so that a session survives any end of its process.

A session is a run folder (runs/folder.py) with one part per try. A part that was written is whole.
A try that was under way when the process died is known by its part alone: nothing was seen of it.
"""

import contextlib
import dataclasses
import os
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.motion.joint_path import JointPath
from cablecast.runs.folder import RunFolder
from cablecast.runs.parts import Parts
from cablecast.track import TrialStatus
from cablecast.view.shown import ShownCast

TRIES_FOLDER = "tries"
_UNDER_WAY = "under-way"

_METRES, _RADIANS, _SECONDS = 4, 5, 4
"""Decimals that are stored: a tenth of a millisecond and of a millimetre, which nobody sees."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Try:
    """One cast at a target.

    Attributes:
        number: Number of the try, from 1.
        target_xy: Target [m], shape [2].
        aim_xy: Point that the plan aimed at [m], shape [2]; the target, or moved against the
            misses of earlier tries.
        action: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [4].
        predicted_xy: Landing that the model predicted [m], shape [2].
        cast: Cast as it was seen.
        landed_xy: Resting point of the free end [m], shape [2]; NaN if there was none.
        undone: Whether a person has taken the try back: it is kept, and teaches nothing.
    """

    number: int
    target_xy: NDArray[np.float64]
    aim_xy: NDArray[np.float64]
    action: NDArray[np.float64]
    predicted_xy: NDArray[np.float64]
    cast: ShownCast
    landed_xy: NDArray[np.float64]
    undone: bool = False

    @property
    def miss(self) -> float:
        """Distance from the target to the landing [m]; NaN if there was none."""
        return float(np.linalg.norm(self.landed_xy - self.target_xy))

    def is_at(self, target_xy: NDArray[np.float64]) -> bool:
        """Return whether this try was at a given target [m]."""
        return bool(np.allclose(self.target_xy, target_xy, atol=1e-6))


class TryStore:
    """Tries of a session on the disk.

    Args:
        parts: Folder of the parts; None to keep nothing.
    """

    def __init__(self, parts: Parts | None = None):
        self._parts = parts

    def read(self) -> list[Try]:
        """Return the tries that were stored, in order.

        Raises:
            DamagedFileError: One is not what was written.
        """
        tries: list[Try] = []
        if self._parts is not None:
            while (values := self._parts.get(_name(len(tries) + 1))) is not None:
                tries.append(_from_plain(values))
        return tries

    def write(self, one: Try) -> None:
        """Store a try, new or changed."""
        if self._parts is not None:
            self._parts.put(_name(one.number), _to_plain(one))

    def begin(self, number: int, target_xy: NDArray[np.float64]) -> None:
        """Note that a try begins; see `cut_off`."""
        if self._parts is not None:
            self._parts.put(_UNDER_WAY, {"number": number, "target_xy": target_xy.tolist()})

    def cut_off(self) -> NDArray[np.float64] | None:
        """Return the target of a try that never ended [m], shape [2]; None where all ended."""
        noted = None if self._parts is None else self._parts.get(_UNDER_WAY)
        if noted is None or self._parts is None or self._parts.get(_name(noted["number"])):
            return None
        return np.array(noted["target_xy"])


@contextlib.contextmanager
def open_tries(
    folder: str | os.PathLike[str] | None, settings: Mapping[str, Any]
) -> Iterator[TryStore]:
    """Yield the store of a folder, locked against other processes; an empty one where None.

    Args:
        folder: Folder of the session, new or of an earlier session with the same settings.
        settings: Plain values that must agree: the set-up and the rig.

    Raises:
        InputError: The folder holds something else, or another process writes there.
    """
    if folder is None:
        yield TryStore()
        return
    with RunFolder.open(folder, "view", settings).begun() as run:
        yield TryStore(run.parts(TRIES_FOLDER))


def _name(number: int) -> str:
    return f"{number:05d}"


def _to_plain(one: Try) -> dict[str, Any]:
    cast, joints = one.cast, one.cast.joint_path
    return {
        "number": one.number,
        "undone": one.undone,
        "target_xy": one.target_xy.tolist(),
        "aim_xy": one.aim_xy.tolist(),
        "action": one.action.tolist(),
        "predicted_xy": one.predicted_xy.tolist(),
        "landed_xy": _plain(one.landed_xy, 9),
        "status": cast.status.code,
        "times": _plain(cast.times, _SECONDS),
        "endpoint_xy": _plain(cast.endpoint_xy, _METRES),
        "nodes": None if cast.nodes is None else _plain(cast.nodes, _METRES),
        "joint_times": None if joints is None else _plain(joints.times, _SECONDS),
        "joint_q": None if joints is None else _plain(joints.q, _RADIANS),
    }


def _from_plain(values: dict[str, Any]) -> Try:
    joints = None
    if values["joint_times"] is not None:
        times, q = _array(values["joint_times"]), _array(values["joint_q"])
        qd = np.asarray(np.gradient(q, times, axis=0)) if len(times) > 1 else np.zeros_like(q)
        joints = JointPath(times=times, q=q, qd=qd)
    cast = ShownCast(
        times=_array(values["times"]),
        endpoint_xy=_array(values["endpoint_xy"]),
        nodes=None if values["nodes"] is None else _array(values["nodes"]),
        joint_path=joints,
        status=TrialStatus.from_code(values["status"]),
    )
    arrays = ("target_xy", "aim_xy", "action", "predicted_xy", "landed_xy")
    return Try(
        number=values["number"],
        undone=values["undone"],
        cast=cast,
        **{name: _array(values[name]) for name in arrays},
    )


def _plain(values: NDArray[np.float64], decimals: int) -> Any:
    """Return nested lists, None for what is not finite: JSON has no NaN."""
    values = np.round(values, decimals)
    plain = values.astype(object)
    plain[~np.isfinite(values)] = None
    return plain.tolist()


def _array(values: Any) -> NDArray[np.float64]:
    return np.array(values, dtype=float)
