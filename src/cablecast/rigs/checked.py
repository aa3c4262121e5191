"""CheckedRig: any rig behind checks of its answers, a time limit, and errors of one line."""

import inspect
import sys
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.sight import CameraSight
from cablecast.checks import check_count, check_number, check_seed
from cablecast.errors import CablecastError, RigError
from cablecast.motion.trajectory import Trajectory
from cablecast.rigs.answers import check_description, check_picture, check_sight, check_track
from cablecast.rigs.base import Rig, RigLifecycle, error_line, purpose_seed
from cablecast.rigs.time_limit import call_within
from cablecast.setup import Setup
from cablecast.track import EndpointTrack

Answer = TypeVar("Answer")

TIME_LIMIT = 120.0
"""Longest time of one reset or one trial [s]; both take some 20 s on a robot."""

METHODS = ("reset", "execute", "close")
"""Methods that every rig has."""


class CheckedRig(RigLifecycle):
    """A rig whose every answer is checked; `make_rig` returns one.

    It has `seek`, `execute_many`, `picture` and `sight` exactly where the rig itself has them.
    Whatever the rig raises comes out as a CablecastError, but for KeyboardInterrupt. As a context
    manager it closes the rig at the end, and an error in closing never hides an earlier one.

    Args:
        rig: Any object that answers the `Rig` contract.
        setup: Set-up that the rig was made for; answers are checked against it.
        seed: Seed of what the rig draws by chance.
        time_limit: Longest time of one reset or one trial [s]; None for no limit. It holds in the
            main thread of systems with interval timers.

    Attributes:
        rig: The rig itself.
        setup: Set-up that the rig was made for.
        seed: Seed of what the rig draws by chance.
        description: Kind and settings of the rig, as plain values.
        time_limit: Longest time of one reset or one trial [s]; None for no limit.

    Raises:
        RigError: The object is no rig, or its description is no plain dictionary.
        InputError: The seed or the time limit is out of bounds.
    """

    seek: Callable[..., None]
    execute_many: Callable[..., list[EndpointTrack]]
    picture: Callable[[], NDArray[np.uint8] | None]
    sight: Callable[[], CameraSight | None]

    def __init__(
        self, rig: Rig, setup: Setup, seed: int = 0, *, time_limit: float | None = TIME_LIMIT
    ):
        super().__init__()
        if missing := missing_parts(rig):
            raise RigError(f"a {type(rig).__name__} is no rig: it lacks {', '.join(missing)}")
        if time_limit is not None:
            time_limit = check_number("time_limit", time_limit, 0.01, 1e6, "s")
        self.rig = rig
        self.setup = setup
        self.seed = check_seed(seed)
        self.time_limit = time_limit
        self.description: dict[str, Any] = check_description(
            self._call("description", lambda: rig.description)
        )
        # What the rig lacks, this one lacks too: callers ask by hasattr.
        if callable(getattr(rig, "execute_many", None)):
            self.execute_many = self._execute_many
        if callable(getattr(rig, "seek", None)):
            _check_takes_purpose(rig)
            self.seek = self._seek
        if callable(getattr(rig, "picture", None)):
            self.picture = self._picture
        if callable(getattr(rig, "sight", None)):
            self.sight = self._sight

    def reset(self) -> None:
        """Bring cable and arm to the reset state."""
        self._check_open()
        self._is_reset = False
        self._call("reset", self.rig.reset)
        self._is_reset = True

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        """Play one motion from the reset state, and report where the endpoint went.

        Raises:
            RigError: There was no reset since the last motion, the rig failed or took too long, or
                its answer is impossible.
        """
        self._use_reset()
        track = self._call("execute", lambda: self.rig.execute(trajectory))
        return check_track(track, trajectory, self.setup)

    def close(self) -> None:
        """Let go of what the rig holds; it may be called twice.

        Where another error is on its way, an error in closing is added to it as a note.
        """
        if self._closed:
            return
        super().close()
        earlier = sys.exc_info()[1]
        try:
            self._call("close", self.rig.close)
        except CablecastError as error:
            if earlier is None:
                raise
            earlier.add_note(f"closing the rig failed as well: {error}")

    def _execute_many(
        self,
        trajectories: Sequence[Trajectory],
        progress: Callable[[int], None] | None = None,
    ) -> list[EndpointTrack]:
        """Reset and execute for each trajectory, and check every answer."""
        self._check_open()
        self._is_reset = False
        tracks = self._call(
            "execute_many",
            lambda: list(self.rig.execute_many(trajectories, progress)),  # pyright: ignore
            count=len(trajectories),
        )
        if len(tracks) != len(trajectories):
            raise RigError(
                f"the rig's execute_many returned {len(tracks)} tracks for {len(trajectories)} "
                "motions"
            )
        return [
            check_track(track, trajectory, self.setup)
            for track, trajectory in zip(tracks, trajectories, strict=True)
        ]

    def _seek(self, index: int, purpose: str = "") -> None:
        """Let the next trial be the index-th of a purpose."""
        self._check_open()
        index = check_count("trial index", index, 0)
        purpose_seed(self.seed, purpose)
        self._call("seek", lambda: self.rig.seek(index, purpose))  # pyright: ignore

    def _picture(self) -> NDArray[np.uint8] | None:
        """Return the latest picture of the rig's camera; None where there is none yet."""
        self._check_open()
        return check_picture(self._call("picture", lambda: self.rig.picture()))  # pyright: ignore

    def _sight(self) -> CameraSight | None:
        """Return what the rig's camera cannot see; None where the rig does not know."""
        self._check_open()
        return check_sight(self._call("sight", lambda: self.rig.sight()))  # pyright: ignore

    def _call(self, name: str, call: Callable[[], Answer], count: int = 1) -> Answer:
        """Return what a method of the rig returns, within the time of some trials."""
        limit = None if self.time_limit is None else self.time_limit * max(count, 1)
        try:
            return call_within(limit, f"the rig's {name}", call)
        except (CablecastError, KeyboardInterrupt):
            raise
        # A rig is somebody else's code: it may even call sys.exit.
        except BaseException as error:
            raise RigError(f"the rig's {name} failed: {error_line(error)}") from error


def missing_parts(rig: object) -> list[str]:
    """Return the names of what an object lacks to be a rig."""
    if isinstance(rig, type):
        return [*METHODS, "description"]
    missing = [name for name in METHODS if not callable(getattr(rig, name, None))]
    # Not read here: a description may be computed, and fail.
    if not hasattr(type(rig), "description") and not hasattr(rig, "description"):
        missing.append("description")
    return missing


def _check_takes_purpose(rig: Any) -> None:
    """Refuse a rig that would give the trials of all purposes the same luck."""
    try:
        inspect.signature(rig.seek).bind(0, "tune")
    except ValueError:
        return
    except TypeError:
        raise RigError(
            "the rig's seek must take an index and a purpose, seek(index, purpose=''), and draw "
            "differently for each purpose"
        ) from None
