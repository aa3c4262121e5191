"""The fast engine, in NVIDIA Warp: one source for CPU and CUDA."""

from cablecast.engines.warp_.engine import EngineWarp

__all__ = ["EngineWarp"]
