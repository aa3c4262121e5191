import copy
import dataclasses
import json

import numpy as np
import pytest
from synthetic_casts import CABLE, random_actions, smooth_dataset, smooth_map

from cablecast.errors import DatasetError, InputError
from cablecast.learning.network import TrainingConfig, train_forward_model
from cablecast.motion.action import ActionRanges
from cablecast.setup import MotionConfig, Setup

pytest.importorskip("torch")

SMALL = TrainingConfig(hidden_width=64, epochs=40, batch_size=128)

# A smooth map of four variables over 2,000 points is learned by a 4 x 64 network in 40 epochs to
# about 0.4 % of the cable's length; the tolerance leaves room for another machine's rounding.
LEARNED_PCT = 1.0


@pytest.fixture(scope="module")
def dataset():
    return smooth_dataset()


@pytest.fixture(scope="module")
def model(dataset):
    return train_forward_model(dataset, config=SMALL)


def test_the_network_learns_a_smooth_map(model):
    actions = random_actions(500, seed=9)
    error = np.linalg.norm(model.predict(actions) - smooth_map(actions), axis=1)
    assert np.median(error) / CABLE.length * 100 < LEARNED_PCT
    assert model.metrics["held_out_median_pct"] < LEARNED_PCT
    assert model.metrics["held_out_median_pct"] < model.metrics["held_out_p90_pct"]


def test_a_model_knows_the_ranges_of_the_actions_that_it_learned_from(model):
    assert model.action_ranges == ActionRanges.for_setup(Setup())
    without_psi = ActionRanges.for_setup(Setup(motion=MotionConfig(r0=1.0)), with_psi=False)
    info = copy.deepcopy(model.info)
    # As a file keeps them: lists for tuples.
    info["dataset"]["settings"]["ranges"] = json.loads(json.dumps(dataclasses.asdict(without_psi)))
    assert dataclasses.replace(model, info=info).action_ranges == without_psi
    assert without_psi.wrist == (0.0, 0.0)
    info["dataset"]["settings"]["ranges"] = {"theta1": [0.0, 1.0]}
    with pytest.raises(DatasetError, match="ranges"):
        _ = dataclasses.replace(model, info=info).action_ranges


def test_the_same_seed_gives_the_same_weights_and_another_seed_others(dataset):
    short = dataclasses.replace(SMALL, epochs=2)
    first, again, other = (
        train_forward_model(dataset, config=short, seed=seed) for seed in (3, 3, 4)
    )
    assert first.fingerprint == again.fingerprint
    assert first.fingerprint != other.fingerprint


def test_the_learning_curve_falls_and_the_best_epoch_is_kept(model):
    curve = model.info["curve"]
    losses = [row["held_out_loss"] for row in curve]
    assert [row["epoch"] for row in curve] == list(range(1, len(curve) + 1))
    assert min(losses) < losses[0] / 5
    assert losses[model.metrics["best_epoch"] - 1] == min(losses)
    # The kept weights give the loss of the best epoch: the mean distance, equation 5.
    held_out_mean = model.metrics["held_out_mean_pct"] / 100 * CABLE.length
    assert held_out_mean == pytest.approx(min(losses), rel=1e-3)


def test_training_stops_when_the_held_out_loss_no_longer_falls():
    dataset = smooth_dataset(count=200)
    noise = np.random.default_rng(0).normal(size=dataset.endpoint_xy.shape)
    hopeless = dataclasses.replace(dataset, endpoint_xy=noise)
    config = dataclasses.replace(SMALL, epochs=200, patience=3)
    model = train_forward_model(hopeless, config=config)
    assert model.metrics["epoch_count"] == model.metrics["best_epoch"] + 3 < 200


def test_rows_without_a_known_endpoint_are_left_out_and_off_table_rows_are_not(dataset):
    endpoint_xy = dataset.endpoint_xy.copy()
    endpoint_xy[:100] = np.nan
    status = np.where(np.arange(len(dataset)) < 100, "non_finite", dataset.status)
    broken = dataclasses.replace(dataset, endpoint_xy=endpoint_xy, status=status)
    model = train_forward_model(broken, config=dataclasses.replace(SMALL, epochs=1))
    metrics = model.metrics
    assert metrics["unknown_endpoint_count"] == 100
    assert metrics["training_count"] + metrics["held_out_count"] == len(dataset) - 100
    assert metrics["off_table_count"] > 0
    assert all(np.all(np.isfinite(matrix)) for matrix, _ in model.weights)


def test_an_action_set_without_psi_can_be_learned(dataset):
    actions = dataset.actions.copy()
    actions[:, 3] = actions[:, 1]
    flat = dataclasses.replace(dataset, actions=actions, endpoint_xy=smooth_map(actions))
    model = train_forward_model(flat, config=dataclasses.replace(SMALL, epochs=5))
    assert np.isfinite(model.metrics["held_out_median_pct"])


def test_too_few_rows_are_refused():
    with pytest.raises(InputError, match="20 of 20 rows have a known endpoint: training needs 50"):
        train_forward_model(smooth_dataset(count=20), config=SMALL)


def test_a_device_that_is_not_there_is_refused(dataset):
    import torch

    device = "tpu" if torch.cuda.is_available() else "cuda"
    with pytest.raises(InputError, match=device):
        train_forward_model(dataset, config=SMALL, device=device)


def test_training_that_diverges_is_reported(dataset):
    with np.errstate(over="ignore"), pytest.raises(InputError, match="diverged"):
        train_forward_model(
            dataclasses.replace(dataset, endpoint_xy=dataset.endpoint_xy * 1e300),
            config=dataclasses.replace(SMALL, epochs=1),
        )
