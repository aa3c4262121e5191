"""Cable simulators behind one contract."""

import typing
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from cablecast.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from cablecast.engines.base import Engine

EngineName = typing.Literal["warp", "mujoco", "pybullet"]
ENGINE_NAMES: tuple[EngineName, ...] = typing.get_args(EngineName)


def make_engine(
    name: str, segment_count: int | None = None, dt: float | None = None, device: str = "cpu"
) -> "Engine":
    """Return an engine by its name; only that engine's library is imported.

    Args:
        name: "warp" (the fast one), "mujoco" (the cross-check) or "pybullet" (the paper's).
        segment_count: Number of segments; by default the engine's own.
        dt: Step [s]; by default the engine's own.
        device: "cpu", or a CUDA device for the warp engine.

    Raises:
        UnknownNameError: No engine has this name.
        MissingExtraError: The engine's library is not installed.
        InputError: A count, step or device that the engine cannot have.
    """
    options = {"segment_count": segment_count, "dt": dt}
    options = {key: value for key, value in options.items() if value is not None}
    if name == "warp":
        from cablecast.engines.warp_ import EngineWarp

        return EngineWarp(**options, device=device)  # pyright: ignore[reportArgumentType]
    if name not in ENGINE_NAMES:
        raise UnknownNameError(f"unknown engine {name!r}: one of {', '.join(ENGINE_NAMES)}")
    if device != "cpu":
        raise InputError(f"the {name} engine runs on the cpu only, not on {device!r}")
    if name == "mujoco":
        from cablecast.engines.mujoco_ import EngineMujoco

        return EngineMujoco(**options)  # pyright: ignore[reportArgumentType]
    from cablecast.engines.pybullet_ import EnginePybullet

    return EnginePybullet(**options)  # pyright: ignore[reportArgumentType]


def engine_name(settings: Mapping[str, Any]) -> str:
    """Return the name of the engine whose settings a dataset holds; see `engine_settings`."""
    return str(settings["class"]).removeprefix("Engine").lower()
