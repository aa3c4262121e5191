"""PolarCastingPolicy: the paper's baseline, a swing in the vertical plane and a slow pull."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.motion.action import MotionConfig
from cablecast.motion.polar_cast import PolarCastConfig, PolarReach, plan_polar_cast
from cablecast.motion.trajectory import Trajectory
from cablecast.workspace import Workspace


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolarPlan:
    """One whole motion per target, which no action describes.

    Attributes:
        trajectories: What to execute from the reset state, one per target.
        actions: NaN, shape [target, 4].
        predicted_xy: Where the endpoints shall come to rest: the targets, or the nearest points
            that polar casting reaches [m], shape [target, 2].
        inside_coverage: Whether the target lies within reach of polar casting, shape [target].
    """

    trajectories: tuple[Trajectory, ...]
    actions: NDArray[np.float64]
    predicted_xy: NDArray[np.float64]
    inside_coverage: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.trajectories)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolarCastingPolicy:
    """Plans by geometry alone: it knows the cable's length, and nothing was learned or simulated.

    Attributes:
        cable: The cable.
        workspace: Table and arm.
        cast: Settings of the lift, the swing and the pull.
        config: Gives the control cycle of the joint paths.
    """

    cable: Cable
    workspace: Workspace
    cast: PolarCastConfig = dataclasses.field(default_factory=PolarCastConfig)
    config: MotionConfig = dataclasses.field(default_factory=MotionConfig)

    @property
    def reach(self) -> PolarReach:
        """The region in which the endpoint can be laid down."""
        return PolarReach.of(self.cable, self.workspace, self.cast)

    def plan(self, target_xy: ArrayLike) -> PolarPlan:
        """Plan a motion for each target; beyond reach, one that ends as near as it can.

        Args:
            target_xy: Targets [m], shape [2] or [target, 2].

        Raises:
            TargetError: A target is not finite, out of reach of arm and cable, or off the table.
            JointLimitError: The arm cannot follow the motion.
        """
        targets = np.atleast_2d(self.workspace.check_target(target_xy, self.cable.length))
        reach = self.reach
        near = reach.nearest(targets)
        return PolarPlan(
            trajectories=tuple(
                plan_polar_cast(xy, self.cable, self.workspace, self.cast, self.config)
                for xy in near
            ),
            actions=np.full((len(targets), 4), np.nan),
            predicted_xy=near,
            inside_coverage=reach.contains(targets),
        )
