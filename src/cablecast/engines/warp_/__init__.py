"""The fast engine, in NVIDIA Warp: one source for CPU and CUDA.

`step.py` reads as a table of contents of the physics; each stage is a file, with a loop over nodes
or segments. `rollout.py` repeats the step in one kernel, over the structs of `world.py` and the
lanes of `lanes.py`. `engine.py` is what users see; `batch.py`, `constants.py` and `device.py` pack
worlds, work out their constants and launch the kernel.

Warp fixes types when it compiles. So each stage has a function, such as `step_functions`, that
builds its Warp functions for a precision and a lane count. Such a builder is a namespace rather
than a procedure, and as long as its stage.
"""

from cablecast.engines.warp_.engine import EngineWarp

__all__ = ["EngineWarp"]
