"""Let a reinforcement learner find the casts, beside the forward model on as many casts.

One cast is an episode of one step, so the learner has nothing to plan ahead: it must only learn
which action ends where. It needs `pip install stable-baselines3`.
"""

import gymnasium
import numpy as np
from stable_baselines3 import SAC

import cablecast as cc
from cablecast.gym.stable_baselines import CastVecEnv

TASK = {"id": "cablecast.gym:cablecast/Cast-v0", "observe_cable": False}


def main(casts: int = 4000, targets: int = 200, candidate_count: int = 20_000) -> None:
    # Casts beyond the table's edge earn their miss, too, which only a simulator can tell.
    training = CastVecEnv(gymnasium.make_vec(num_envs=20, off_table="miss", **TASK))
    learner = SAC("MlpPolicy", training, learning_starts=200, gradient_steps=20, seed=0)
    learner.learn(casts)

    test = gymnasium.make_vec(num_envs=targets, **TASK)
    observations, _ = test.reset(seed=1)
    actions, _ = learner.predict(observations, deterministic=True)
    _, rewards, _, _, info = test.step(actions)
    landed = info["status"] == "ok"
    print(f"SAC: {landed.sum()} of {targets} casts landed, median {np.median(-rewards):.1f} % off")

    setup = cc.Setup()
    simulated = cc.simulate(setup, count=casts)
    policy = cc.train(simulated, candidate_count=candidate_count, epochs=30)
    with cc.make_rig("engine", setup) as rig:
        summary = cc.evaluate(policy, rig, info["target_xy"]).summary
    print(f"forward model: {summary.count} landed, median {summary.median_pct:.1f} % off")


if __name__ == "__main__":
    main()
