"""The simulator of fits, simulated casts and rigs, at the resolution that is asked for."""

from typing import Any


def make_engine(
    segment_count: int | None = None, dt: float | None = None, device: str = "cpu"
) -> Any:
    """Return the simulator; what is not given is what the convergence study chose.

    Args:
        segment_count: Segments of the simulated cable.
        dt: Time step [s].
        device: "cpu" or "cuda".
    """
    from cablecast.engines.warp_ import EngineWarp

    given = {"segment_count": segment_count, "dt": dt}
    return EngineWarp(device=device, **{k: v for k, v in given.items() if v is not None})
