"""The Rig contract: one robot, real or virtual, that executes one motion at a time."""

import contextlib
import importlib
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from cablecast.cable import Cable
from cablecast.errors import CablecastError, RigError
from cablecast.track import EndpointTrack, TrialStatus
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from cablecast.motion.trajectory import Trajectory

RIG_NAMES = ("virtual", "engine")
"""Rigs that come with cablecast; any other is given as package.module:factory."""


@runtime_checkable
class Rig(Protocol):
    """A robot with a cable in its gripper: `RigVirtual`, `RigEngine`, or a user's own.

    A trial is `reset()` and then `execute(trajectory)`. A trial that goes wrong in the world (the
    cable leaves the table, or cannot be seen) is a status of the track; a rig that cannot go on
    raises RigError.

    Two methods are optional:

    - `execute_many(trajectories, progress=None) -> list[EndpointTrack]`, which resets before each,
      for a rig that can run many trials at once; `run_trials` uses it.
    - `seek(index)`, for a rig that draws by chance: the next trial is the index-th. A collection
      that goes on after a stop calls it, so that its rows are those of one that never stopped.

    Attributes:
        description: What the rig is and how it is set, as plain values for a dataset card.
    """

    description: dict[str, Any]

    def reset(self) -> None:
        """Bring cable and arm to the reset state."""
        ...

    def execute(self, trajectory: "Trajectory") -> EndpointTrack:
        """Play one motion from the reset state, and report where the endpoint went.

        Raises:
            RigError: There was no reset since the last motion, or the rig is closed.
        """
        ...

    def close(self) -> None:
        """Let go of what the rig holds; it may be called twice."""
        ...


class RigLifecycle:
    """Keeps the order reset, execute, close; rigs of this package derive from it."""

    def __init__(self) -> None:
        self._closed = False
        self._is_reset = False

    def reset(self) -> None:
        """Bring cable and arm to the reset state."""
        self._check_open()
        self._is_reset = True

    def close(self) -> None:
        """Let go of what the rig holds; it may be called twice."""
        self._closed = True

    def _check_open(self) -> None:
        if self._closed:
            raise RigError(f"{type(self).__name__} is closed: make a new rig")

    def _use_reset(self) -> None:
        """Spend the reset that a motion starts from."""
        self._check_open()
        if not self._is_reset:
            raise RigError(f"{type(self).__name__} must be reset before each motion: call reset()")
        self._is_reset = False


def run_trials(
    rig: Rig,
    trajectories: Sequence["Trajectory"],
    progress: Callable[[int], None] | None = None,
) -> list[EndpointTrack]:
    """Reset and execute for each trajectory, at once where the rig can do that.

    Args:
        rig: Any rig.
        trajectories: One per trial.
        progress: Called with the number of finished trials whenever it grows.

    Returns:
        One track per trajectory, in the same order.
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


def check_track(track: object) -> EndpointTrack:
    """Return what a rig answered, if it is a track that can be used.

    The rig may be a user's own code: this says what it should have returned.

    Raises:
        RigError: It is no track, its times do not rise, or its status contradicts its endpoint.
    """
    if not isinstance(track, EndpointTrack):
        kind = type(track).__name__
        raise RigError(f"the rig's execute returned {kind}: it must return an EndpointTrack")
    if not (np.all(np.isfinite(track.times)) and np.all(np.diff(track.times) > 0)):
        raise RigError("the rig returned a track whose times do not rise: they must be seconds")
    if track.status is TrialStatus.OK and not np.all(np.isfinite(track.final_xy)):
        raise RigError("the rig returned status OK without a final endpoint: it must be finite")
    return track


def make_rig(spec: str, cable: Cable, workspace: Workspace, seed: int) -> Rig:
    """Make the rig that a command line asks for.

    Args:
        spec: "virtual", "engine", or "package.module:factory", where factory(cable, workspace,
            seed) returns a Rig. The module may lie in the working directory.
        cable: The cable in the gripper.
        workspace: Table and arm.
        seed: Seed of everything that the rig draws by chance.

    Raises:
        RigError: No such rig, module or factory, or the factory fails or returns no Rig.
        MissingExtraError: The rig needs a library that is not installed.
    """
    if spec == "virtual":
        from cablecast.rigs.virtual import RigVirtual

        return RigVirtual(cable, workspace, seed)
    if spec == "engine":
        from cablecast.engines.warp_ import EngineWarp
        from cablecast.rigs.engine import RigEngine

        return RigEngine(EngineWarp(), cable, workspace)
    module_name, colon, factory_name = spec.partition(":")
    if not (colon and module_name and factory_name):
        names = ", ".join(RIG_NAMES)
        raise RigError(f"unknown rig {spec!r}: one of {names}, or package.module:factory")
    with _working_directory_importable():
        factory = _find_factory(module_name, factory_name)
        try:
            rig = factory(cable, workspace, seed)
        except CablecastError:
            raise
        except Exception as error:
            raise RigError(f"rig factory {spec} failed: {error_line(error)}") from error
    missing = [name for name in ("reset", "execute", "close") if not _has_method(rig, name)]
    if not isinstance(getattr(rig, "description", None), dict):
        missing.append("description")
    if missing:
        raise RigError(
            f"rig factory {spec} returned a {type(rig).__name__}, which is no Rig: "
            f"it lacks {', '.join(missing)}"
        )
    return rig


def _find_factory(module_name: str, factory_name: str) -> Callable[..., Any]:
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        # The module itself may be there and miss something that it imports: say which is missing.
        if error.name is not None and (module_name + ".").startswith(error.name + "."):
            raise RigError(f"there is no module {error.name!r} for the rig {module_name}") from None
        raise _import_failure(module_name, error) from error
    except Exception as error:
        raise _import_failure(module_name, error) from error
    factory = getattr(module, factory_name, None)
    if factory is None:
        raise RigError(f"rig module {module_name} has no factory {factory_name!r}")
    if not callable(factory):
        raise RigError(f"{module_name}:{factory_name} is a {type(factory).__name__}, no factory")
    return factory


def _import_failure(module_name: str, error: Exception) -> RigError:
    return RigError(f"rig module {module_name} cannot be imported: {error_line(error)}")


def _has_method(rig: object, name: str) -> bool:
    return not isinstance(rig, type) and callable(getattr(rig, name, None))


def error_line(error: BaseException) -> str:
    """What went wrong in somebody else's code, in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


@contextlib.contextmanager
def _working_directory_importable() -> Iterator[None]:
    """A user's rig.py lies where the command runs, which an installed command does not search."""
    directory = os.getcwd()
    if directory in sys.path or "" in sys.path:
        yield
        return
    # At the end, so that a file there never hides an installed package.
    sys.path.append(directory)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):
            sys.path.remove(directory)
