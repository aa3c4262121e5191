"""The vector environment as Stable-Baselines3 wants it: its VecEnv is older than Gymnasium's."""

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from cablecast.errors import InputError
from cablecast.gym.env import CastVectorEnv
from cablecast.task import LANDING


class CastVecEnv(VecEnv):
    """A `CastVectorEnv` for the learners of Stable-Baselines3.

    Args:
        env: Many casts at once, of the default autoreset mode.

    Raises:
        InputError: It has another autoreset mode.
    """

    def __init__(self, env: CastVectorEnv):
        if (mode := env.metadata["autoreset_mode"]) is not AutoresetMode.NEXT_STEP:
            raise InputError(
                f"Stable-Baselines3 resets by itself: autoreset_mode must be NextStep, not "
                f"{mode.value}"
            )
        self.env = env
        self._actions: Any = None
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> Any:
        """Start an episode in each environment; see `CastVectorEnv.reset`.

        `set_options({"target_xy": ...})`, or a list with the options of each environment, sets the
        targets of this reset.

        Raises:
            InputError: Only some of the environments have a target, or one is no target.
        """
        seed, target_xy = self._seeds[0], self._target_xy()
        self._reset_seeds()
        self._reset_options()
        options = None if target_xy is None else {"target_xy": target_xy}
        return self.env.reset(seed=seed, options=options)[0]

    def _target_xy(self) -> np.ndarray | None:
        """Return the targets of the options [m], shape [1 or environment, 2]; None without any."""
        given = [options.get("target_xy") for options in self._options]
        if all(target is None for target in given):
            return None
        if any(target is None for target in given):
            raise InputError("target_xy must be among the options of every environment, or of none")
        rows = [LANDING.values(self.env.task.setup, target) for target in given]
        # Options of all environments, a target of each among them, are copied to each.
        if all(np.array_equal(row, rows[0]) for row in rows):
            return rows[0]
        return np.concatenate(rows)

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions of the next batch."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Make the batch of casts; see `CastVectorEnv.step`."""
        final, rewards, dones, _, info = self.env.step(self._actions)
        infos = [
            {
                "terminal_observation": final[row],
                "status": str(info["status"][row]),
                "landing_xy": info["landing_xy"][row],
            }
            for row in range(self.num_envs)
        ]
        return self.env.reset()[0], rewards.astype(np.float32), dones, infos

    def close(self) -> None:
        """Close the rig."""
        self.env.close()

    def get_images(self) -> list[Any]:
        """Return the picture of each environment; see `CastVectorEnv.render`."""
        return list(self.env.render() or ())

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute, which all environments share."""
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute, which all environments share."""
        setattr(self.env, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the shared environment once for each index."""
        call = getattr(self.env, method_name)
        return [call(*method_args, **method_kwargs) for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return that no environment is wrapped."""
        return [False for _ in self._get_indices(indices)]
