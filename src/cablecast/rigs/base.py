"""The Rig contract: a robot with a cable in its gripper, which carries out one motion at a time."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np

from cablecast.cast import EndpointTrack
from cablecast.errors import CablecastError, InputError, RigError, check_seed
from cablecast.motion.trajectory import Trajectory

PURPOSES = ("tune", "real", "repeat", "aim")
"""Purposes of trials; each draws chances of its own."""

_ERROR_LENGTH_MAX = 300


@runtime_checkable
class Rig(Protocol):
    """A robot with a cable in its gripper: `RigVirtual`, `RigEngine`, or a user's own.

    A trial is `reset()` and then `execute(trajectory)`. A trial that goes wrong in the world (the
    cable leaves the table, or cannot be seen) is a status of the track; a rig that cannot go on
    raises RigError.

    Four methods are optional:

    - `execute_many(trajectories, progress=None) -> list[EndpointTrack]`, which resets before each,
      for a rig that can run many trials at once; `run_trials` uses it.
    - `seek(index, purpose="")`, for a rig that draws by chance: the next trial is the index-th of a
      purpose. Trials of two purposes must draw differently, for which `purpose_seed` is made. A
      collection that goes on after a stop calls it, so that its rows are those of one that never
      stopped. A trial that is made again has another index, larger by a million.
    - `picture()`, for a rig with a camera: its latest picture of the table, BGR, uint8, shape
      [v, u, 3], or None while there is none. `cablecast view` shows it; it may be called from
      another thread than the others, also while the arm moves.
    - `sight()`, for a rig with a camera: a `CameraSight` with the camera's place and the places
      where it cannot tell the marker, as far as they are known by now, or None. Casts are aimed
      past them.

    Attributes:
        description: Kind and settings of the rig, as plain values for a dataset card.
    """

    description: dict[str, Any]

    def reset(self) -> None:
        """Bring cable and arm to the reset state.

        Every cast begins at rest with the gripper at `reset_pose(setup.workspace)`; the joints
        there are `setup.arm.inverse(reset_pose(setup.workspace))`, and those of its first set
        point.
        """
        ...

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        """Play one motion from the reset state, and report where the endpoint went.

        Raises:
            RigError: There was no reset since the last motion, or the rig is closed.
        """
        ...

    def close(self) -> None:
        """Release the rig's resources; may be called twice."""
        ...


class RigLifecycle:
    """Keeps the order reset, execute, close; rigs of this package derive from it.

    As a context manager it closes the rig at the end.
    """

    def __init__(self) -> None:
        self._closed = False
        self._is_reset = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def reset(self) -> None:
        """Bring cable and arm to the reset state."""
        self._check_open()
        self._is_reset = True

    def close(self) -> None:
        """Release the rig's resources; may be called twice."""
        self._closed = True

    def _check_open(self) -> None:
        if self._closed:
            raise RigError("the rig is closed: make a new one")

    def _use_reset(self) -> None:
        """Spend the reset that a motion starts from."""
        self._check_open()
        if not self._is_reset:
            raise RigError("the rig must be reset before each motion: call reset()")
        self._is_reset = False


def purpose_seed(seed: int, purpose: str = "") -> int:
    """Return the seed of a rig's trials for a purpose.

    With one seed for all, the n-th cast to tune with would be scattered like the n-th cast
    that the tuned simulator is tested on.

    Args:
        seed: Seed of the rig.
        purpose: One of `PURPOSES`; the seed itself where empty.

    Raises:
        InputError: There is no such purpose, or the seed is out of bounds.

    >>> purpose_seed(5)
    5
    """
    check_seed(seed)
    if purpose == "":
        return int(seed)
    if purpose not in PURPOSES:
        raise InputError(
            f"unknown purpose {str(purpose)[:40]!r} of trials: one of {', '.join(PURPOSES)}"
        )
    place = PURPOSES.index(purpose)
    return int(np.random.SeedSequence([int(seed), place]).generate_state(1)[0])


def run_trials(
    rig: Rig,
    trajectories: Sequence[Trajectory],
    progress: Callable[[int], None] | None = None,
) -> list[EndpointTrack]:
    """Reset and execute for each trajectory, at once where the rig can do that.

    Return their tracks in the same order; `progress` is told the number of finished trials.
    """
    execute_many = getattr(rig, "execute_many", None)
    if callable(execute_many):
        return list(execute_many(trajectories, progress))  # pyright: ignore[reportArgumentType]
    tracks = []
    for trajectory in trajectories:
        rig.reset()
        tracks.append(rig.execute(trajectory))
        if progress is not None:
            progress(len(tracks))
    return tracks


@contextlib.contextmanager
def foreign_code(failure: str) -> Iterator[None]:
    """Turn whatever foreign code raises into a RigError of one line.

    Errors of cablecast and the user's interrupt pass as they are.

    Args:
        failure: Words before the error, such as "the rig's reset failed".
    """
    try:
        yield
    except (CablecastError, KeyboardInterrupt):
        raise
    # It may even call sys.exit.
    except BaseException as error:
        raise RigError(f"{failure}: {error_line(error)}") from error


def error_line(error: BaseException) -> str:
    """Return an error of foreign code in one line."""
    text = " ".join(str(error).split())[:_ERROR_LENGTH_MAX]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
