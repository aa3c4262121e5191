"""Gymnasium environments: importing this package registers `cablecast/Cast-v0`.

gymnasium.make("cablecast.gym:cablecast/Cast-v0")
gymnasium.make_vec("cablecast.gym:cablecast/Cast-v0", num_envs=64)
"""

from cablecast.errors import MissingExtraError

try:
    import gymnasium
except ModuleNotFoundError:
    raise MissingExtraError("gymnasium", "gym", "the Gymnasium environment") from None

from cablecast.gym.env import CastEnv, CastVectorEnv

ENV_ID = "cablecast/Cast-v0"

if ENV_ID not in gymnasium.registry:
    gymnasium.register(
        ENV_ID,
        entry_point="cablecast.gym.env:CastEnv",
        vector_entry_point="cablecast.gym.env:CastVectorEnv",
    )

__all__ = ["ENV_ID", "CastEnv", "CastVectorEnv"]
