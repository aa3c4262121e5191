"""CastEnv and CastVectorEnv: one cast per episode, for learners that speak Gymnasium."""

import dataclasses
import typing
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import CableParams
from cablecast.cast import TrialStatus
from cablecast.conventions import Array, mirror_xy, polar_to_xy, side_of
from cablecast.data.simulate import simulate_actions
from cablecast.engines import make_engine
from cablecast.errors import (
    ActionError,
    InputError,
    check_choice,
    check_count,
    check_number,
)
from cablecast.gym.picture import picture
from cablecast.motion.action import PSI_MAX, check_action_values, mirror_actions, with_psi
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import check_actions, feasible_ranges
from cablecast.motion.trajectory import plan_trajectory
from cablecast.rigs.base import Rig, run_trials
from cablecast.rigs.make import make_rig
from cablecast.setup import Setup
from cablecast.task import LANDING
from cablecast.tuning.space import SearchSpace
from cablecast.tuning.tuned import Tuned

Observation = NDArray[np.float32]
ActionForm = typing.Literal["normalised", "raw"]
OffTable = typing.Literal["fail", "miss"]

FAIL_REWARD = -300.0
"""Reward of a cast without a landing [% of cable length]: more than the farthest miss on the right
half of the paper's table with its cables."""

INFEASIBLE = "infeasible"
"""Status of an action that is no casting motion, or that the arm cannot make."""

TRIES_MAX = 100
RENDER_MODES = ("rgb_array",)
VECTOR_COUNT_MAX = 100_000

TARGET_RADII = (0.43, 1.23)
"""Range of the radii of the paper's 32 targets [m]."""
TARGET_ANGLE_MAX = float(np.radians(69.0))
"""Largest angle of these targets from the workspace axis [rad]."""

# Batches of targets that are drawn before the table is held to have none.
_DRAWS_MAX = 1000
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
            r2 [m] and psi [rad] of both halves. The pace is always 1.
        tries: Casts at the same target with the same cable, one episode each. The observation holds
            the earlier ones.
        spread: Share of the search ranges of tuning from which cables are drawn [-]: 0 for always
            the same, 1 for the whole ranges.
        observe_cable: Whether the observation holds the cable: length, diameter, ten parameters.
        off_table: What a cast earns that leaves the table: "fail" for `fail_reward`, "miss" for the
            distance of where its end hangs or fell to. An engine knows that, a rig does not.
        fail_reward: Reward of a cast without a landing, and of a motion that the arm cannot make.
        targets: Targets to draw from [m], shape [target, 2]; drawn from the sector of the paper's
            targets if None.
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
            check_choice(name, getattr(self, name), typing.get_args(kinds))
        check_count("tries", self.tries, high=TRIES_MAX)
        check_number("spread", self.spread, 0.0, 1.0)
        check_number("fail_reward", self.fail_reward, -1e6, 0.0, "%")
        if self.targets is not None:
            self.targets = LANDING.values(self.setup, self.targets)
        space = SearchSpace.for_cable(self.setup.cable)
        self.space = dataclasses.replace(space, base=self.params)
        self.ranges = feasible_ranges(self.setup)
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
        """Return targets on the table within reach [m], shape [count, 2].

        Raises:
            InputError: The table has next to none in the sector of the paper's targets.
        """
        if self.targets is not None:
            return self.targets[rng.integers(len(self.targets), size=count)]
        workspace = self.setup.workspace
        chosen = np.empty((0, 2))
        for _ in range(_DRAWS_MAX):
            # Uniform in area: the square of the radius is uniform.
            r = np.sqrt(rng.uniform(*np.square(TARGET_RADII), size=count))
            theta = rng.uniform(-TARGET_ANGLE_MAX, TARGET_ANGLE_MAX, size=count)
            xy = polar_to_xy(np.stack([r, theta], axis=-1))
            near = r <= workspace.reach(self.setup.cable.length)
            chosen = np.concatenate([chosen, xy[near & workspace.on_table(xy)]])
            if len(chosen) >= count:
                return chosen[:count]
        low, high = TARGET_RADII
        raise InputError(
            f"this table has almost no place {low} to {high} m from the robot within reach of the "
            "cable: give targets=[[x, y], ...]"
        )

    def draw_cables(self, count: int, rng: np.random.Generator) -> Array:
        """Return cables as points of the unit cube of the search space, shape [count, 10]."""
        low = self._unit * (1.0 - self.spread)
        high = self._unit + (1.0 - self._unit) * self.spread
        return rng.uniform(low, high, size=(count, len(low)))

    def cable_params(self, cables: Array) -> CableParams:
        """Return the parameters of drawn cables, shared where they are all the same."""
        if self.spread == 0.0:
            # The ranges of tuning need not hold the parameters that tuning found elsewhere.
            return self.params
        return self.space.to_params(cables)

    def to_actions(self, values: ArrayLike, target_xy: Array) -> Array:
        """Return (theta1, theta2, r2, psi) from the environment's actions, shape [count, 4].

        The targets [m], shape [count, 2], give the half of the table.
        """
        values = np.asarray(values, dtype=float)
        if values.shape != (len(target_xy), _ACTION_SIZE):
            raise InputError(
                f"actions have shape {values.shape}: it must be {(len(target_xy), _ACTION_SIZE)}"
            )
        if self.action_form == "raw":
            return values
        bounds = self.ranges.to_array()[:_ACTION_SIZE]
        share = (np.clip(values, -1.0, 1.0) + 1.0) / 2.0
        actions = bounds[:, 0] + share * (bounds[:, 1] - bounds[:, 0])
        return mirror_actions(with_psi(actions), side_of(target_xy))

    def rewards(self, target_xy: Array, landing_xy: Array, ok: NDArray[np.bool_]) -> Array:
        """Return minus the miss of casts in % of cable length, shape [count].

        Landings [m] have the shape [count, 2], with NaN where there is none; `ok` tells which casts
        ended on the table.
        """
        miss = 100.0 * LANDING.miss(landing_xy, target_xy, self.setup)
        counts = np.isfinite(miss) & (ok if self.off_table == "fail" else True)
        return np.where(counts, np.maximum(-miss, self.fail_reward), self.fail_reward)

    def observations(self, target_xy: Array, cables: Array, casts: Array) -> NDArray[np.float32]:
        """Return observations, every value within about -1 to 1, shape [count, value].

        Cables are points in the unit cube, shape [count, 10]; earlier casts are as of `cast_rows`,
        shape [count, tries - 1, 7].
        """
        reach = self.setup.workspace.reach(self.setup.cable.length)
        parts = [self._folded(target_xy, target_xy) / reach]
        if self.observe_cable:
            cable = self.setup.cable
            size = np.tile([cable.length / reach, cable.diameter * 10.0], (len(target_xy), 1))
            parts += [size, cables]
        parts.append(casts.reshape(len(target_xy), -1))
        return np.concatenate(parts, axis=1).astype(np.float32)

    def cast_rows(self, values: ArrayLike, target_xy: Array, landing_xy: Array) -> Array:
        """Return what an observation keeps of casts: action, landing, whether seen; [count, 7]."""
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
        return mirror_xy(xy, side_of(target_xy))


def feasible_mask(actions: Array, setup: Setup) -> NDArray[np.bool_]:
    """Return which actions, of any finite values, are casting motions that the arm can make."""
    if np.any(bad := ~np.all(np.isfinite(actions), axis=1)):
        row = int(np.argmax(bad))
        raise InputError(f"action {row} = {actions[row].tolist()} is not finite")
    mask = np.array([_is_cast(action) for action in actions])
    if np.any(mask):
        mask[mask] = check_actions(actions[mask], setup, both_sides=False).mask
    return mask


def _is_cast(action: Array) -> bool:
    try:
        check_action_values(action[None])
    except ActionError:
        return False
    return True


class _Casts:
    """Casts of a batch of environments: targets, cables, earlier casts, and the engine or rig."""

    def __reduce__(self) -> typing.NoReturn:
        raise InputError(
            "an environment holds compiled kernels or a rig, which cannot be pickled or copied: "
            "pickle a function that makes it, or its Setup and options"
        )

    def __init__(
        self,
        count: int,
        setup: Setup | None,
        *,
        tuned: Tuned | None = None,
        rig: str | Rig = "engine",
        rig_seed: int = 0,
        device: str = "cpu",
        render_mode: str | None = None,
        **options: Any,
    ):
        if render_mode is not None:
            check_choice("render_mode", render_mode, RENDER_MODES)
        self.render_mode = render_mode
        setup = setup or (tuned.setup if tuned is not None else Setup())
        if not isinstance(setup, Setup):
            raise InputError(f"setup must be Setup, not {type(setup).__name__}")
        tuned = Tuned.of(tuned, setup)
        self.dynamics = tuned.dynamics
        self.task = CastTask(setup=setup, params=tuned.params, **options)
        if rig != "engine" and (self.task.spread or self.task.off_table == "miss"):
            what = "spread" if self.task.spread else "off_table 'miss'"
            raise InputError(f"{what} needs the engine: a rig has one cable and a table with edges")
        self.engine = make_engine("warp", device=device) if rig == "engine" else None
        self.rig = None if rig == "engine" else make_rig(rig, setup, rig_seed)
        self.count = count
        self.target_xy = np.zeros((count, 2))
        self.cables = np.zeros((count, self.task.space.dimension))
        self.casts = np.zeros((count, self.task.tries - 1, _CAST_SIZE))
        # Where the casts at the target landed, the latest first.
        self.landings = np.full((count, self.task.tries, 2), np.nan)
        # Casts at the target so far; at `tries` the next episode draws a new one.
        self.done = np.full(count, self.task.tries)

    def start(
        self,
        rng: np.random.Generator,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
    ) -> Observation:
        """Start the next episode of each environment, with a new target where it is due.

        With a seed it is due in all of them. `target_xy` [m] of the options is one target for all
        or one of each, shape [2] or [count, 2]; targets are drawn without it.
        """
        target_xy = (options or {}).get("target_xy")
        if seed is not None:
            self.done[:] = self.task.tries
        fresh = self.done >= self.task.tries
        # Drawn for all, so that the n-th draw does not depend on which of them are due.
        targets = self.task.draw_targets(self.count, rng)
        cables = self.task.draw_cables(self.count, rng)
        if target_xy is not None:
            xy = LANDING.values(self.task.setup, target_xy)
            if len(xy) not in (1, self.count):
                raise InputError(
                    f"{len(xy)} targets for {self.count} environments: one, or as many"
                )
            fresh = np.full(self.count, True)
            targets = np.broadcast_to(xy, (self.count, 2))
        self.target_xy = np.where(fresh[:, None], targets, self.target_xy)
        self.cables = np.where(fresh[:, None], cables, self.cables)
        self.casts[fresh], self.landings[fresh] = 0.0, np.nan
        self.done[fresh] = 0
        return self.observe()

    def step(self, values: ArrayLike) -> tuple[Array, dict[str, Any]]:
        """Make one cast in each environment, and return the rewards and what happened."""
        actions = self.task.to_actions(values, self.target_xy)
        landing_xy, status = self._cast(actions)
        rewards = self.task.rewards(self.target_xy, landing_xy, status == TrialStatus.OK.code)
        if self.task.tries > 1:
            rows = self.task.cast_rows(values, self.target_xy, landing_xy)
            self.casts = np.concatenate([rows[:, None], self.casts], axis=1)[:, :-1]
        self.landings = np.concatenate([landing_xy[:, None], self.landings], axis=1)[:, :-1]
        self.done += 1
        return rewards, {
            "action": actions,
            "landing_xy": landing_xy,
            "status": status,
            "target_xy": self.target_xy.copy(),
        }

    def _cast(self, actions: Array) -> tuple[Array, NDArray[np.str_]]:
        """Return the resting points [m], NaN where there is none, and the statuses of casts."""
        setup = self.task.setup
        feasible = feasible_mask(actions, setup)
        xy = np.full((self.count, 2), np.nan)
        status = np.full(self.count, INFEASIBLE, dtype="<U16")
        if not np.any(feasible):
            return xy, status
        if self.engine is not None:
            params = self.task.cable_params(self.cables).rows(feasible)
            columns = simulate_actions(
                actions[feasible], self.dynamics.with_params(params), setup, self.engine
            )
            xy[feasible] = np.stack([columns["endpoint_x"], columns["endpoint_y"]], axis=-1)
            status[feasible] = columns["status"]
            if self.task.off_table == "fail":
                # No rig sees where a cable hangs beyond the table's edge.
                xy[status != TrialStatus.OK.code] = np.nan
        else:
            motions = [plan_trajectory(Action.from_array(row), setup) for row in actions[feasible]]
            tracks = run_trials(self.rig, motions)  # pyright: ignore[reportArgumentType]
            for row, track in zip(np.flatnonzero(feasible), tracks, strict=True):
                status[row] = track.status.code
                xy[row] = track.final_xy if track.status is TrialStatus.OK else np.nan
        return xy, status

    def observe(self) -> Observation:
        return self.task.observations(self.target_xy, self.cables, self.casts)

    def pictures(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each environment; None unless a render mode asks for them."""
        if self.render_mode is None:
            return None
        shown = zip(self.target_xy, self.landings, strict=True)
        return tuple(picture(self.task.setup.workspace, *each) for each in shown)

    def spaces(self) -> tuple[spaces.Box, spaces.Box]:
        """Return the spaces of the actions and of the observations of one environment."""
        low, high = (bound.astype(np.float32) for bound in self.task.action_bounds)
        seen = np.full(self.task.observation_size, 2.0, dtype=np.float32)
        return spaces.Box(low, high), spaces.Box(-seen, seen)

    def close(self) -> None:
        """Close the rig; an engine holds nothing."""
        if self.rig is not None:
            self.rig.close()


class CastEnv(gymnasium.Env):
    """One cast per episode: an action, and minus the miss in % of cable length as reward.

    `reset(options={"target_xy": (x, y)})` sets the target. `info` of a step holds the `action` that
    was made, `landing_xy`, `status` and `target_xy`.

    Args:
        setup: Cable, workspace, arm and motion settings; those of `tuned`, or the paper's.
        **options: `tuned`, parameters of the cable and servo of the arm as `tune` finds them;
            `rig`, "engine", "virtual", package.module:factory or a rig, and `rig_seed`, the seed of
            its random numbers; `device` of the engine, "cpu" or "cuda"; `render_mode`, None or
            "rgb_array" for pictures from above; and the attributes of `CastTask` after `params`.

    Raises:
        InputError: An option is out of bounds, or needs the engine.
        RigError: There is no such rig.
    """

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 1}  # noqa: RUF012

    def __init__(self, setup: Setup | None = None, **options: Any):
        self._casts = _Casts(1, setup, **options)
        self.task, self.render_mode = self._casts.task, self._casts.render_mode
        self.action_space, self.observation_space = self._casts.spaces()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; with a seed, at a new target."""
        super().reset(seed=seed)
        observation = self._casts.start(self.np_random, seed, options)[0]
        return observation, {"target_xy": self._casts.target_xy[0].copy()}

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Make the cast, which ends the episode."""
        rewards, info = self._casts.step(np.asarray(action, dtype=float)[None])
        info = {name: values[0] for name, values in info.items()}
        info["status"] = str(info["status"])
        return self._casts.observe()[0], float(rewards[0]), True, False, info

    def render(self) -> NDArray[np.uint8] | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return the table from above with target and landings, shape [row, column, 3]."""
        pictures = self._casts.pictures()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Close the rig."""
        self._casts.close()


class CastVectorEnv(gymnasium.vector.VectorEnv):
    """Many casts at once: a step is one batch of the engine, and ends every episode.

    With next-step autoreset, Gymnasium's default, every other step starts the next episodes and
    leaves its actions alone. With same-step autoreset each step returns the observations of the
    next episodes; those of the ended ones are `info["final_obs"]`, next to `info["final_info"]`.
    A rig makes the casts one after the other where it cannot make many.

    Args:
        num_envs: Number of casts in a step.
        setup: As for `CastEnv`.
        autoreset_mode: When the next episodes start.
        **options: As for `CastEnv`.
    """

    metadata = CastEnv.metadata

    def __init__(
        self,
        num_envs: int = 64,
        setup: Setup | None = None,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ):
        if not isinstance(autoreset_mode, AutoresetMode):
            check_choice("autoreset_mode", autoreset_mode, [mode.value for mode in AutoresetMode])
        mode = AutoresetMode(autoreset_mode)
        if mode is AutoresetMode.DISABLED:
            raise InputError("autoreset_mode must be NextStep or SameStep: each step ends episodes")
        self.metadata = self.metadata | {"autoreset_mode": mode}
        self._same_step, self._ended = mode is AutoresetMode.SAME_STEP, False
        check_count("num_envs", num_envs, high=VECTOR_COUNT_MAX)
        self._casts = _Casts(num_envs, setup, **options)
        self.task, self.num_envs = self._casts.task, num_envs
        self.render_mode = self._casts.render_mode
        self.single_action_space, self.single_observation_space = self._casts.spaces()
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode in each environment; with a seed, at new targets.

        Of a list of seeds, the first counts. `options` may hold `target_xy` [m], shape [2] or
        [num_envs, 2].
        """
        first = seed[0] if isinstance(seed, (list, tuple)) else seed
        super().reset(seed=first)
        self._ended = False
        observations = self._casts.start(self.np_random, first, options)
        return observations, self._targets()

    def _targets(self) -> dict[str, Any]:
        every = np.ones(self.num_envs, dtype=bool)
        return {"target_xy": self._casts.target_xy.copy(), "_target_xy": every}

    def step(
        self, actions: ArrayLike
    ) -> tuple[Observation, NDArray, NDArray, NDArray, dict[str, Any]]:
        """Make one cast in each environment as one batch, or start the next episodes."""
        every = np.ones(self.num_envs, dtype=bool)
        if self._ended:
            self._ended = False
            observations = self._casts.start(self.np_random)
            return observations, np.zeros(self.num_envs), ~every, ~every, self._targets()
        rewards, info = self._casts.step(actions)
        info |= {f"_{name}": every for name in tuple(info)}
        observations = self._casts.observe()
        if not self._same_step:
            self._ended = True
            return observations, rewards, every.copy(), ~every, info
        final = np.empty(self.num_envs, dtype=object)
        final[:] = list(observations)
        info = {"final_info": info, "_final_info": every, "final_obs": final, "_final_obs": every}
        observations = self._casts.start(self.np_random)
        return observations, rewards, every.copy(), ~every, info | self._targets()

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return the table of each environment from above; see `CastEnv.render`."""
        return self._casts.pictures()

    def close_extras(self, **kwargs: Any) -> None:
        """Close the rig."""
        self._casts.close()
