"""Stable-Baselines3 takes the vector environment."""

import numpy as np
import pytest

sb3 = pytest.importorskip("stable_baselines3")

from cablecast.errors import InputError  # noqa: E402
from cablecast.gym.env import CastVectorEnv  # noqa: E402
from cablecast.gym.stable_baselines import CastVecEnv  # noqa: E402

pytestmark = pytest.mark.usefixtures("coarse_engine")


def test_a_learner_steps_it_and_gets_the_observation_of_the_ended_episode():
    env = CastVecEnv(CastVectorEnv(4))
    env.seed(7)
    first = env.reset()
    observations, rewards, dones, infos = env.step(np.zeros((4, 4), dtype=np.float32))
    assert dones.all()
    assert rewards.dtype == np.float32
    assert np.array_equal([info["terminal_observation"] for info in infos], first)
    assert not np.array_equal(observations, first)
    assert env.env_is_wrapped(object) == [False] * 4
    assert env.get_attr("num_envs", [0, 1]) == [4, 4]
    with pytest.raises(InputError, match="must be NextStep, not SameStep"):
        CastVecEnv(CastVectorEnv(4, autoreset_mode="SameStep"))


def test_options_set_the_targets_of_the_next_reset_and_of_no_other():
    env = CastVecEnv(CastVectorEnv(2))
    one, each = (0.2, 1.0), [(0.2, 1.0), (-0.3, 0.9)]

    def targets(options):
        env.set_options(options)
        env.reset()
        return env.env._casts.target_xy.tolist()

    assert targets({"target_xy": one}) == [list(one)] * 2
    assert targets({"target_xy": each}) == [list(xy) for xy in each]
    assert targets([{"target_xy": xy} for xy in each]) == [list(xy) for xy in each]
    env.step(np.zeros((2, 4), dtype=np.float32))
    assert env.env._casts.target_xy.tolist() != [list(xy) for xy in each]
    with pytest.raises(InputError, match="of every environment, or of none"):
        targets([{"target_xy": one}, {}])
    with pytest.raises(InputError, match="off the table"):
        targets({"target_xy": (0.0, -0.5)})


def test_the_same_seed_learns_the_same():
    rewards = []
    for _ in range(2):
        model = sb3.PPO("MlpPolicy", CastVecEnv(CastVectorEnv(8)), n_steps=2, batch_size=16, seed=3)
        model.learn(16)
        rewards.append(model.predict(np.zeros(14, dtype=np.float32), deterministic=True)[0])
    assert np.array_equal(*rewards)
