"""Learn where casts land, and ask for the cast that lands on a target.

The forward model predicts the landing of an action. The policy predicts many candidates once, and
then answers any number of targets by looking for the nearest prediction. The dataset is the one of
03_make_a_dataset.py.
"""

import pathlib

import numpy as np

from cablecast.conventions import polar_to_xy
from cablecast.datasets.reader import read_dataset
from cablecast.models import TrainingConfig, train_forward_model
from cablecast.policies.forward_search import ForwardSearchPolicy


def main(
    out: pathlib.Path = pathlib.Path("runs/examples"),
    epochs: int = 40,
    candidate_count: int = 10_000,
) -> None:
    dataset = read_dataset(out / "dataset")
    model = train_forward_model(dataset, config=TrainingConfig(epochs=epochs), seed=0)
    print(f"median error on held-out casts: {model.metrics['held_out_median_pct']:.2f} % of length")
    model.save(out / "model")

    policy = ForwardSearchPolicy.build(
        model, dataset.motion_config, dataset.workspace, candidate_count, seed=0
    )
    policy.save(out / "model")

    targets = polar_to_xy([[1.10, np.radians(16.7)], [0.80, np.radians(-30)], [1.0, 0.0]])
    plan = policy.plan(targets)
    for target, action, landing in zip(targets, plan.actions, plan.predicted_xy, strict=True):
        theta1, theta2, _, psi = np.degrees(action)
        off = 100 * np.linalg.norm(landing - target) / policy.cable.length
        print(
            f"target ({target[0]:+.2f}, {target[1]:.2f}) m: theta1 = {theta1:+.1f}, "
            f"theta2 = {theta2:+.1f}, psi = {psi:+.1f} deg, r2 = {action[2]:.2f} m, "
            f"predicted {off:.1f} % of length from it"
        )


if __name__ == "__main__":
    main()
