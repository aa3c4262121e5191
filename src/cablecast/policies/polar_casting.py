"""PolarCastingPolicy: the paper's baseline, a swing in the vertical plane and a slow pull."""

import dataclasses
import functools
from typing import Any

from numpy.typing import ArrayLike

from cablecast.motion.polar_cast import plan_polar_cast
from cablecast.motion.polar_config import PolarCastConfig
from cablecast.motion.polar_reach import PolarReach
from cablecast.policies.base import Plan, check_targets
from cablecast.setup import Setup


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolarCastingPolicy:
    """Policy that plans by geometry alone: nothing is learned or simulated.

    Attributes:
        setup: Cable, table and arm.
        cast: Settings of the lift, the swing and the pull.
    """

    setup: Setup
    cast: PolarCastConfig = dataclasses.field(default_factory=PolarCastConfig)

    @property
    def info(self) -> dict[str, Any]:
        """Name and settings of the policy."""
        return {"name": "polar casting"} | dataclasses.asdict(self.cast)

    @functools.cached_property
    def reach(self) -> PolarReach:
        """Region in which the endpoint can be laid down."""
        return PolarReach.of(self.setup, self.cast)

    def plan(
        self,
        target_xy: ArrayLike | None = None,
        *,
        r: ArrayLike | None = None,
        theta_deg: ArrayLike | None = None,
    ) -> Plan:
        """Plan a motion for each target; outside `reach`, it ends as near as possible.

        Args:
            target_xy: Targets [m], shape [2] or [target, 2]; alternative to r and theta_deg.
            r: Distances from the robot's base [m], a number or shape [target].
            theta_deg: Angles from straight ahead, positive to the robot's right [deg], a number or
                shape [target].

        Raises:
            InputError: Both forms of targets are given, or neither.
            TargetError: A target is not finite, out of reach of arm and cable, or off the table.
            JointLimitError: The arm cannot follow the motion.
        """
        targets = check_targets(self.setup, target_xy, r=r, theta_deg=theta_deg)
        nearest = self.reach.nearest(targets)
        return Plan(
            setup=self.setup,
            target_xy=targets,
            predicted_xy=nearest,
            inside_coverage=self.reach.contains(targets),
            motions=tuple(plan_polar_cast(xy, self.setup, self.cast) for xy in nearest),
        )
