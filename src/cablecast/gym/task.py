"""CastTask: targets, cables, actions, observations and rewards of the environments, in batches."""

import dataclasses
import typing
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import CableParams
from cablecast.checks import check_count, check_number
from cablecast.errors import InputError
from cablecast.motion.action import PSI_MAX, ActionRanges
from cablecast.motion.mirrored import played, side_hands
from cablecast.policies.base import check_targets
from cablecast.setup import Setup
from cablecast.tuning.search_space import SearchSpace

Array = NDArray[np.float64]
ActionForm = typing.Literal["normalised", "raw"]
OffTable = typing.Literal["fail", "miss"]

FAIL_REWARD = -300.0
"""Reward of a cast without a landing [% of cable length]: more than the farthest miss on the right
half of the paper's table with its cables."""

TRIES_MAX = 100

TARGET_RADII = (0.43, 1.23)
"""Range of the radii of the paper's 32 targets [m]."""
TARGET_ANGLE_MAX = float(np.radians(69.0))
"""Largest angle of these targets from the workspace axis [rad]."""

_ACTION_SIZE = 4
# Action, landing and whether there was one, of an earlier cast.
_CAST_SIZE = _ACTION_SIZE + 3


@dataclasses.dataclass(kw_only=True)
class CastTask:
    """Task of one cast per episode: bring the cable's free end to rest on a target.

    Attributes:
        setup: Cable, workspace, arm and motion settings.
        params: Parameters of the cable about which others are drawn.
        action_form: "normalised": theta1, theta2, r2 and the wrist turn, each from -1 to 1 over its
            range, for the half of the table on which the target lies. "raw": theta1, theta2 [rad],
            r2 [m] and psi [rad] of both halves.
        tries: Casts at the same target with the same cable, one episode each. The observation holds
            the earlier ones.
        spread: Share of the search ranges of tuning from which cables are drawn [-]: 0 for always
            the same, 1 for the whole ranges.
        observe_cable: Whether the observation holds the ten parameters of the cable.
        off_table: What a cast earns that leaves the table: "fail" for `fail_reward`, "miss" for the
            distance of its resting point on an endless plane. An engine knows that, a rig does not.
        fail_reward: Reward of a cast without a landing, and of a motion that the arm cannot make.
        targets: Targets to draw from [m], shape [target, 2]; drawn from the sector of the paper's
            targets where None.
    """

    setup: Setup
    params: CableParams
    action_form: ActionForm = "normalised"
    tries: int = 1
    spread: float = 0.0
    observe_cable: bool = True
    off_table: OffTable = "fail"
    fail_reward: float = FAIL_REWARD
    targets: Any = None

    def __post_init__(self):
        for name, kinds in (("action_form", ActionForm), ("off_table", OffTable)):
            if getattr(self, name) not in typing.get_args(kinds):
                raise InputError(
                    f"{name} {str(getattr(self, name))[:40]!r} must be one of "
                    f"{', '.join(typing.get_args(kinds))}"
                )
        check_count("tries", self.tries, high=TRIES_MAX)
        check_number("spread", self.spread, 0.0, 1.0, "")
        check_number("fail_reward", self.fail_reward, -1e6, 0.0, "%")
        if self.targets is not None:
            self.targets = check_targets(self.setup, self.targets)
        self.space = SearchSpace.for_cable(self.setup.cable)
        self.ranges = ActionRanges.for_setup(self.setup)
        self._unit = self.space.to_unit(self.params)

    @property
    def observation_size(self) -> int:
        """Number of values in an observation."""
        cable = 2 + self.space.dimension if self.observe_cable else 0
        return 2 + cable + _CAST_SIZE * (self.tries - 1)

    @property
    def action_bounds(self) -> tuple[Array, Array]:
        """Least and greatest values of an action, each of shape [4]."""
        if self.action_form == "normalised":
            return -np.ones(_ACTION_SIZE), np.ones(_ACTION_SIZE)
        theta1, theta2 = -self.ranges.theta1[0], self.ranges.theta2[1]
        psi = min(theta2 + self.ranges.wrist[1], PSI_MAX)
        low, high = self.ranges.r2
        return np.array([-theta1, -theta2, low, -psi]), np.array([theta1, theta2, high, psi])

    def draw_targets(self, count: int, rng: np.random.Generator) -> Array:
        """Return targets on the table within reach [m], shape [count, 2]."""
        if self.targets is not None:
            return self.targets[rng.integers(len(self.targets), size=count)]
        workspace = self.setup.workspace
        chosen = np.empty((0, 2))
        while len(chosen) < count:
            # Uniform in area: the square of the radius is uniform.
            low, high = np.square(TARGET_RADII)
            r = np.sqrt(rng.uniform(low, high, size=count))
            theta = rng.uniform(-TARGET_ANGLE_MAX, TARGET_ANGLE_MAX, size=count)
            xy = np.stack([r * np.sin(theta), r * np.cos(theta)], axis=-1)
            near = r <= workspace.reach(self.setup.cable.length)
            chosen = np.concatenate([chosen, xy[near & workspace.on_table(xy)]])
        return chosen[:count]

    def draw_cables(self, count: int, rng: np.random.Generator) -> Array:
        """Return cables as points of the unit cube of the search space, shape [count, 10]."""
        low = self._unit * (1.0 - self.spread)
        high = self._unit + (1.0 - self._unit) * self.spread
        return rng.uniform(low, high, size=(count, len(low)))

    def cable_params(self, cables: Array) -> CableParams:
        """Return the parameters of drawn cables, shape [count, 10]."""
        if self.spread == 0.0:
            # The ranges of tuning need not hold the parameters that tuning found elsewhere.
            return CableParams.from_array(np.tile(self.params.to_array(), (len(cables), 1)))
        return self.space.to_params(cables)

    def to_actions(self, values: ArrayLike, target_xy: Array) -> Array:
        """Return (theta1, theta2, r2, psi) from actions of the environment, shape [count, 4].

        Args:
            values: Actions in the environment's form, shape [count, 4].
            target_xy: Targets [m], which tell the half of the table, shape [count, 2].
        """
        values = np.asarray(values, dtype=float)
        if values.shape != (len(target_xy), _ACTION_SIZE):
            raise InputError(
                f"actions have shape {values.shape}: it must be {(len(target_xy), _ACTION_SIZE)}"
            )
        if self.action_form == "raw":
            return values
        bounds = np.array(
            [self.ranges.theta1, self.ranges.theta2, self.ranges.r2, self.ranges.wrist]
        )
        share = (np.clip(values, -1.0, 1.0) + 1.0) / 2.0
        actions = bounds[:, 0] + share * (bounds[:, 1] - bounds[:, 0])
        actions[:, 3] += actions[:, 1]
        return played(actions, side_hands(target_xy))

    def rewards(self, target_xy: Array, landing_xy: Array, ok: NDArray[np.bool_]) -> Array:
        """Return minus the miss of casts in % of cable length, shape [count].

        Args:
            target_xy: Targets [m], shape [count, 2].
            landing_xy: Resting points [m], shape [count, 2]; NaN where there is none.
            ok: Whether the cast ended on the table, shape [count].
        """
        miss = np.linalg.norm(landing_xy - target_xy, axis=1) / self.setup.cable.length * 100.0
        counts = np.isfinite(miss) & (ok if self.off_table == "fail" else True)
        return np.where(counts, np.maximum(-miss, self.fail_reward), self.fail_reward)

    def observations(self, target_xy: Array, cables: Array, casts: Array) -> NDArray[np.float32]:
        """Return observations, every value within about -1 to 1, shape [count, value].

        Args:
            target_xy: Targets [m], shape [count, 2].
            cables: Cables in the unit cube, shape [count, 10].
            casts: Earlier casts as `cast_rows` returns them, shape [count, tries - 1, 7].
        """
        reach = self.setup.workspace.reach(self.setup.cable.length)
        parts = [self._folded(target_xy, target_xy) / reach]
        if self.observe_cable:
            cable = self.setup.cable
            size = np.tile([cable.length, cable.diameter * 10.0], (len(target_xy), 1))
            parts += [size, cables]
        parts.append(casts.reshape(len(target_xy), -1))
        return np.concatenate(parts, axis=1).astype(np.float32)

    def cast_rows(self, values: ArrayLike, target_xy: Array, landing_xy: Array) -> Array:
        """Return what an observation keeps of casts, shape [count, 7].

        Args:
            values: Actions in the environment's form, shape [count, 4].
            target_xy: Targets [m], shape [count, 2].
            landing_xy: Resting points [m], shape [count, 2]; NaN where there is none.
        """
        low, high = self.action_bounds
        share = 2.0 * (np.clip(np.asarray(values, float), low, high) - low) / (high - low) - 1.0
        seen = np.all(np.isfinite(landing_xy), axis=1, keepdims=True)
        reach = self.setup.workspace.reach(self.setup.cable.length)
        landing = np.where(seen, self._folded(landing_xy, target_xy) / reach, 0.0)
        return np.concatenate([share, np.clip(landing, -2.0, 2.0), seen], axis=1)

    def _folded(self, xy: Array, target_xy: Array) -> Array:
        """Return points as seen when the target is on the right, if actions are seen so."""
        if self.action_form == "raw":
            return xy
        return np.where(target_xy[:, :1] < 0, xy * np.array([-1.0, 1.0]), xy)
