"""cablecast: teach a robot arm to cast the free end of a cable onto a target.

The names below are the public face; each is imported when it is first used, so that `import
cablecast` costs next to nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cablecast.aiming.config import AimConfig
    from cablecast.aiming.session import AimSession
    from cablecast.arm.ur import ArmUR
    from cablecast.cable import Cable, CableParams, load_cable
    from cablecast.camera.settings import CameraSight
    from cablecast.cast import Cast, EndpointTrack, Proposal, TrialStatus
    from cablecast.data.dataset import Dataset, read_dataset
    from cablecast.engines.warp_.engine import EngineWarp
    from cablecast.errors import CablecastError
    from cablecast.evaluation.evaluate import Evaluation
    from cablecast.learning.policy import ForwardSearchPolicy, Plan, PolarCastingPolicy
    from cablecast.motion.casting import Action
    from cablecast.motion.trajectory import Trajectory, plan_trajectory
    from cablecast.pipeline.aim import aim, prepare_aim
    from cablecast.pipeline.check import check
    from cablecast.pipeline.collect import collect
    from cablecast.pipeline.evaluate import evaluate
    from cablecast.pipeline.plan import plan_motion
    from cablecast.pipeline.repeat import repeat
    from cablecast.pipeline.reproduce import reproduce
    from cablecast.pipeline.select import select
    from cablecast.pipeline.simulate import simulate
    from cablecast.pipeline.strike import check_strike, prepare_strike
    from cablecast.pipeline.track_video import track_video
    from cablecast.pipeline.train import train
    from cablecast.pipeline.tune import tune
    from cablecast.rigs.base import Rig, RigLifecycle
    from cablecast.rigs.make import make_rig
    from cablecast.runs.progress import Progress, ignore
    from cablecast.setup import MotionConfig, Setup, StrikeConfig, load_setup, save_setup
    from cablecast.tuning.fit import FitConfig
    from cablecast.tuning.swing import tune_swing
    from cablecast.tuning.tune import TuneConfig
    from cablecast.tuning.tuned import Tuned, load_tuned
    from cablecast.workspace import Workspace, load_targets

__version__ = "0.1.0"

_HOMES = {
    "cablecast.aiming.config": ("AimConfig",),
    "cablecast.aiming.session": ("AimSession",),
    "cablecast.arm.ur": ("ArmUR",),
    "cablecast.cable": ("Cable", "CableParams", "load_cable"),
    "cablecast.camera.settings": ("CameraSight",),
    "cablecast.cast": ("Cast", "EndpointTrack", "Proposal", "TrialStatus"),
    "cablecast.data.dataset": ("Dataset", "read_dataset"),
    "cablecast.engines.warp_.engine": ("EngineWarp",),
    "cablecast.errors": ("CablecastError",),
    "cablecast.evaluation.evaluate": ("Evaluation",),
    "cablecast.learning.policy": ("ForwardSearchPolicy", "Plan", "PolarCastingPolicy"),
    "cablecast.motion.casting": ("Action",),
    "cablecast.motion.trajectory": ("Trajectory", "plan_trajectory"),
    "cablecast.pipeline.aim": ("aim", "prepare_aim"),
    "cablecast.pipeline.check": ("check",),
    "cablecast.pipeline.collect": ("collect",),
    "cablecast.pipeline.evaluate": ("evaluate",),
    "cablecast.pipeline.plan": ("plan_motion",),
    "cablecast.pipeline.repeat": ("repeat",),
    "cablecast.pipeline.reproduce": ("reproduce",),
    "cablecast.pipeline.select": ("select",),
    "cablecast.pipeline.simulate": ("simulate",),
    "cablecast.pipeline.strike": ("check_strike", "prepare_strike"),
    "cablecast.pipeline.track_video": ("track_video",),
    "cablecast.pipeline.train": ("train",),
    "cablecast.pipeline.tune": ("tune",),
    "cablecast.rigs.base": ("Rig", "RigLifecycle"),
    "cablecast.rigs.make": ("make_rig",),
    "cablecast.runs.progress": ("Progress", "ignore"),
    "cablecast.setup": ("MotionConfig", "Setup", "StrikeConfig", "load_setup", "save_setup"),
    "cablecast.tuning.fit": ("FitConfig",),
    "cablecast.tuning.swing": ("tune_swing",),
    "cablecast.tuning.tune": ("TuneConfig",),
    "cablecast.tuning.tuned": ("Tuned", "load_tuned"),
    "cablecast.workspace": ("Workspace", "load_targets"),
}

__all__ = [
    "Action",
    "AimConfig",
    "AimSession",
    "ArmUR",
    "Cable",
    "CableParams",
    "CablecastError",
    "CameraSight",
    "Cast",
    "Dataset",
    "EndpointTrack",
    "EngineWarp",
    "Evaluation",
    "FitConfig",
    "ForwardSearchPolicy",
    "MotionConfig",
    "Plan",
    "PolarCastingPolicy",
    "Progress",
    "Proposal",
    "Rig",
    "RigLifecycle",
    "Setup",
    "StrikeConfig",
    "Trajectory",
    "TrialStatus",
    "TuneConfig",
    "Tuned",
    "Workspace",
    "__version__",
    "aim",
    "check",
    "check_strike",
    "collect",
    "evaluate",
    "ignore",
    "load_cable",
    "load_setup",
    "load_targets",
    "load_tuned",
    "make_rig",
    "plan_motion",
    "plan_trajectory",
    "prepare_aim",
    "prepare_strike",
    "read_dataset",
    "repeat",
    "reproduce",
    "save_setup",
    "select",
    "simulate",
    "track_video",
    "train",
    "tune",
    "tune_swing",
]


def __getattr__(name: str) -> Any:
    """Import a public name where it is first used."""
    for module, names in _HOMES.items():
        if name in names:
            value = getattr(importlib.import_module(module), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module 'cablecast' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
