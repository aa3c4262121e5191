"""cablecast: teach a robot arm to throw the free end of a cable onto a target.

The names below are the public face; each is imported when it is first used, so that `import
cablecast` costs next to nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cablecast.aiming.config import AimConfig as AimConfig
    from cablecast.aiming.session import AimSession as AimSession
    from cablecast.arm.ur import ArmUR as ArmUR
    from cablecast.cable import Cable as Cable
    from cablecast.cable import CableParams as CableParams
    from cablecast.cable import load_cable as load_cable
    from cablecast.camera.settings import CameraSight as CameraSight
    from cablecast.cast import Cast as Cast
    from cablecast.cast import EndpointTrack as EndpointTrack
    from cablecast.cast import Proposal as Proposal
    from cablecast.cast import TrialStatus as TrialStatus
    from cablecast.data.dataset import Dataset as Dataset
    from cablecast.data.dataset import read_dataset as read_dataset
    from cablecast.engines.warp_.engine import EngineWarp as EngineWarp
    from cablecast.errors import CablecastError as CablecastError
    from cablecast.evaluation.evaluate import Evaluation as Evaluation
    from cablecast.learning.policy import ForwardSearchPolicy as ForwardSearchPolicy
    from cablecast.learning.policy import Plan as Plan
    from cablecast.learning.policy import PolarCastingPolicy as PolarCastingPolicy
    from cablecast.motion.action import Action as Action
    from cablecast.motion.trajectory import (
        Trajectory as Trajectory,
    )
    from cablecast.motion.trajectory import (
        plan_trajectory as plan_trajectory,
    )
    from cablecast.pipeline.aim import aim as aim
    from cablecast.pipeline.aim import prepare_aim as prepare_aim
    from cablecast.pipeline.collect import collect as collect
    from cablecast.pipeline.evaluate import evaluate as evaluate
    from cablecast.pipeline.plan import plan_motion as plan_motion
    from cablecast.pipeline.repeat import repeat as repeat
    from cablecast.pipeline.reproduce import reproduce as reproduce
    from cablecast.pipeline.select import select as select
    from cablecast.pipeline.simulate import simulate as simulate
    from cablecast.pipeline.track_video import track_video as track_video
    from cablecast.pipeline.train import train as train
    from cablecast.pipeline.tune import tune as tune
    from cablecast.rigs.base import Rig as Rig
    from cablecast.rigs.base import RigLifecycle as RigLifecycle
    from cablecast.rigs.make import make_rig as make_rig
    from cablecast.runs.progress import Progress as Progress
    from cablecast.setup import (
        MotionConfig as MotionConfig,
    )
    from cablecast.setup import (
        Setup as Setup,
    )
    from cablecast.setup import (
        load_setup as load_setup,
    )
    from cablecast.setup import (
        save_setup as save_setup,
    )
    from cablecast.tuning.fit import FitConfig as FitConfig
    from cablecast.tuning.tune import TuneConfig as TuneConfig
    from cablecast.tuning.tuned import Tuned as Tuned
    from cablecast.tuning.tuned import load_tuned as load_tuned
    from cablecast.workspace import Workspace as Workspace
    from cablecast.workspace import load_targets as load_targets

__version__ = "0.1.0"

_HOMES = {
    "Action": "cablecast.motion.action",
    "AimConfig": "cablecast.aiming.config",
    "AimSession": "cablecast.aiming.session",
    "ArmUR": "cablecast.arm.ur",
    "Cable": "cablecast.cable",
    "CableParams": "cablecast.cable",
    "CameraSight": "cablecast.camera.settings",
    "Cast": "cablecast.cast",
    "Proposal": "cablecast.cast",
    "CablecastError": "cablecast.errors",
    "Dataset": "cablecast.data.dataset",
    "EndpointTrack": "cablecast.cast",
    "EngineWarp": "cablecast.engines.warp_.engine",
    "Evaluation": "cablecast.evaluation.evaluate",
    "FitConfig": "cablecast.tuning.fit",
    "ForwardSearchPolicy": "cablecast.learning.policy",
    "MotionConfig": "cablecast.setup",
    "Plan": "cablecast.learning.policy",
    "PolarCastingPolicy": "cablecast.learning.policy",
    "Progress": "cablecast.runs.progress",
    "Rig": "cablecast.rigs.base",
    "RigLifecycle": "cablecast.rigs.base",
    "Setup": "cablecast.setup",
    "Trajectory": "cablecast.motion.trajectory",
    "TrialStatus": "cablecast.cast",
    "TuneConfig": "cablecast.tuning.tune",
    "Tuned": "cablecast.tuning.tuned",
    "Workspace": "cablecast.workspace",
    "aim": "cablecast.pipeline.aim",
    "collect": "cablecast.pipeline.collect",
    "evaluate": "cablecast.pipeline.evaluate",
    "load_cable": "cablecast.cable",
    "load_setup": "cablecast.setup",
    "load_targets": "cablecast.workspace",
    "load_tuned": "cablecast.tuning.tuned",
    "make_rig": "cablecast.rigs.make",
    "plan_motion": "cablecast.pipeline.plan",
    "plan_trajectory": "cablecast.motion.trajectory",
    "prepare_aim": "cablecast.pipeline.aim",
    "read_dataset": "cablecast.data.dataset",
    "repeat": "cablecast.pipeline.repeat",
    "reproduce": "cablecast.pipeline.reproduce",
    "save_setup": "cablecast.setup",
    "select": "cablecast.pipeline.select",
    "simulate": "cablecast.pipeline.simulate",
    "track_video": "cablecast.pipeline.track_video",
    "train": "cablecast.pipeline.train",
    "tune": "cablecast.pipeline.tune",
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
    "Trajectory",
    "TrialStatus",
    "TuneConfig",
    "Tuned",
    "Workspace",
    "__version__",
    "aim",
    "collect",
    "evaluate",
    "load_cable",
    "load_setup",
    "load_targets",
    "load_tuned",
    "make_rig",
    "plan_motion",
    "plan_trajectory",
    "prepare_aim",
    "read_dataset",
    "repeat",
    "reproduce",
    "save_setup",
    "select",
    "simulate",
    "track_video",
    "train",
    "tune",
]


def __getattr__(name: str) -> Any:
    """Import a public name where it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module 'cablecast' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(_HOMES))
