"""CastEnv and CastVectorEnv: one cast per episode, for learners that speak Gymnasium."""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import InputError
from cablecast.gym.casters import Caster, EngineCaster, RigCaster
from cablecast.gym.task import CastTask
from cablecast.pipeline.engine import make_engine
from cablecast.pipeline.tuned import Tuned
from cablecast.policies.base import check_targets
from cablecast.rigs.base import Rig
from cablecast.rigs.make import make_rig
from cablecast.setup import Setup
from cablecast.track import TrialStatus

VECTOR_COUNT_MAX = 100_000

Observation = NDArray[np.float32]


class _Casts:
    """Targets, cables and earlier casts of a batch of environments."""

    def __init__(self, count: int, task: CastTask, caster: Caster):
        self.task, self.caster, self.count = task, caster, count
        self.target_xy = np.zeros((count, 2))
        self.cables = np.zeros((count, task.space.dimension))
        self.casts = np.zeros((count, task.tries - 1, 7))
        # Casts at the target so far; at `tries` the next episode draws a new one.
        self.done = np.full(count, task.tries)

    def begin(self, rng: np.random.Generator, target_xy: ArrayLike | None = None) -> None:
        """Begin the next episode of each environment, with a new target where it is due.

        Args:
            rng: Draws targets and cables.
            target_xy: Target of all environments, or one of each [m], shape [2] or [count, 2];
                drawn where None.
        """
        fresh = self.done >= self.task.tries
        # Drawn for all, so that the n-th draw is the n-th target whoever is due.
        targets = self.task.draw_targets(self.count, rng)
        cables = self.task.draw_cables(self.count, rng)
        if target_xy is not None:
            xy = check_targets(self.task.setup, target_xy)
            if len(xy) not in (1, self.count):
                raise InputError(
                    f"{len(xy)} targets for {self.count} environments: one, or as many"
                )
            fresh = np.full(self.count, True)
            targets = np.broadcast_to(xy, (self.count, 2))
        self.target_xy = np.where(fresh[:, None], targets, self.target_xy)
        self.cables = np.where(fresh[:, None], cables, self.cables)
        self.casts[fresh] = 0.0
        self.done[fresh] = 0

    def cast(self, values: ArrayLike) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Make one cast in each environment, and return the rewards and what happened."""
        actions = self.task.to_actions(values, self.target_xy)
        landings = self.caster.cast(actions, self.task.cable_params(self.cables))
        ok = landings.status == TrialStatus.OK.code
        rewards = self.task.rewards(self.target_xy, landings.xy, ok)
        if self.task.tries > 1:
            rows = self.task.cast_rows(values, self.target_xy, landings.xy)
            self.casts = np.concatenate([rows[:, None], self.casts], axis=1)[:, :-1]
        self.done += 1
        return rewards, {
            "action": actions,
            "landing_xy": landings.xy,
            "status": landings.status,
            "target_xy": self.target_xy.copy(),
        }

    def observe(self) -> Observation:
        return self.task.observations(self.target_xy, self.cables, self.casts)


def _make(
    count: int, setup: Setup | None, tuned: Tuned | None, rig: str | Rig, rig_seed: int, device: str
) -> tuple[Callable[..., CastTask], Caster]:
    """Return what makes the task, and what casts."""
    setup = setup or (tuned.setup if tuned is not None else Setup())
    tuned = Tuned.of(tuned, setup)

    def task(**options: Any) -> CastTask:
        made = CastTask(setup=setup, params=tuned.params, **options)
        if rig != "engine" and (made.spread or made.off_table == "miss"):
            what = "spread" if made.spread else "off_table 'miss'"
            raise InputError(f"{what} needs the engine: a rig has one cable and a table with edges")
        return made

    if rig == "engine":
        return task, EngineCaster(make_engine(device=device), setup, tuned.dynamics)
    return task, RigCaster(make_rig(rig, setup, rig_seed))


class CastEnv(gymnasium.Env):
    """One cast per episode: an action, and minus the miss in % of cable length as reward.

    `reset(options={"target_xy": (x, y)})` sets the target. `info` of a step holds the `action` that
    was made, `landing_xy`, `status` and `target_xy`.

    Args:
        setup: Cable, workspace, arm and motion settings; those of `tuned`, or the paper's.
        tuned: Parameters of the cable and servo of the arm, as `tune` finds them.
        rig: "engine", "virtual", package.module:factory or a rig.
        rig_seed: Seed of what a rig draws by chance.
        device: Device of the engine, "cpu" or "cuda".
        **options: Attributes of `CastTask` after `params`.

    Raises:
        InputError: An option is out of bounds, or needs the engine.
        RigError: There is no such rig.
    """

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        setup: Setup | None = None,
        *,
        tuned: Tuned | None = None,
        rig: str | Rig = "engine",
        rig_seed: int = 0,
        device: str = "cpu",
        **options: Any,
    ):
        make_task, caster = _make(1, setup, tuned, rig, rig_seed, device)
        self.task = make_task(**options)
        self._casts = _Casts(1, self.task, caster)
        self.action_space, self.observation_space = _spaces(self.task)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; with a seed, at a new target.

        Args:
            seed: Seed of the targets and cables.
            options: `target_xy`, the target of the episode [m].
        """
        super().reset(seed=seed)
        if seed is not None:
            self._casts.done[:] = self.task.tries
        self._casts.begin(self.np_random, (options or {}).get("target_xy"))
        return self._casts.observe()[0], {"target_xy": self._casts.target_xy[0].copy()}

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Make the cast, which ends the episode.

        Args:
            action: Values within the action space, shape [4].
        """
        rewards, info = self._casts.cast(np.asarray(action, dtype=float)[None])
        info = {name: values[0] for name, values in info.items()}
        info["status"] = str(info["status"])
        return self._casts.observe()[0], float(rewards[0]), True, False, info

    def close(self) -> None:
        """Close the rig."""
        self._casts.caster.close()


class CastVectorEnv(gymnasium.vector.VectorEnv):
    """Many casts at once: a step is one batch of the engine, and ends every episode.

    The observations that a step returns are those of the next episodes (same-step autoreset); those
    of the ended ones are `info["final_obs"]`.

    Args:
        num_envs: Number of casts in a step.
        setup: As for `CastEnv`.
        tuned: As for `CastEnv`.
        rig: As for `CastEnv`; a rig makes the casts one after the other where it cannot make many.
        rig_seed: As for `CastEnv`.
        device: As for `CastEnv`.
        **options: As for `CastEnv`.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 64,
        setup: Setup | None = None,
        *,
        tuned: Tuned | None = None,
        rig: str | Rig = "engine",
        rig_seed: int = 0,
        device: str = "cpu",
        **options: Any,
    ):
        if not 1 <= num_envs <= VECTOR_COUNT_MAX:
            raise InputError(f"num_envs = {num_envs} must be in [1, {VECTOR_COUNT_MAX}]")
        make_task, caster = _make(num_envs, setup, tuned, rig, rig_seed, device)
        self.task = make_task(**options)
        self._casts = _Casts(num_envs, self.task, caster)
        self.num_envs = num_envs
        self.single_action_space, self.single_observation_space = _spaces(self.task)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode in each environment; with a seed, at new targets.

        Args:
            seed: Seed of the targets and cables of all; of a list, the first counts.
            options: `target_xy`, the target of all, or one of each [m], shape [2] or [num_envs, 2].
        """
        first = seed[0] if isinstance(seed, (list, tuple)) else seed
        super().reset(seed=first)
        if first is not None:
            self._casts.done[:] = self.task.tries
        self._casts.begin(self.np_random, (options or {}).get("target_xy"))
        return self._casts.observe(), {"target_xy": self._casts.target_xy.copy()}

    def step(
        self, actions: ArrayLike
    ) -> tuple[Observation, NDArray, NDArray, NDArray, dict[str, Any]]:
        """Make one cast in each environment as one batch, and begin the next episodes.

        Args:
            actions: Values within the action space, shape [num_envs, 4].
        """
        rewards, info = self._casts.cast(actions)
        every = np.ones(self.num_envs, dtype=bool)
        info |= {f"_{name}": every for name in tuple(info)}
        final = np.empty(self.num_envs, dtype=object)
        final[:] = list(self._casts.observe())
        info |= {"final_obs": final, "_final_obs": every}
        self._casts.begin(self.np_random)
        return self._casts.observe(), rewards, every.copy(), ~every, info

    def close_extras(self, **kwargs: Any) -> None:
        """Close the rig."""
        self._casts.caster.close()


def _spaces(task: CastTask) -> tuple[spaces.Box, spaces.Box]:
    """Return the spaces of the actions and of the observations of one environment."""
    low, high = (bound.astype(np.float32) for bound in task.action_bounds)
    seen = np.full(task.observation_size, 2.0, dtype=np.float32)
    return spaces.Box(low, high), spaces.Box(-seen, seen)
