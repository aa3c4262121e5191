import copy
import dataclasses
import json
import os
import subprocess
import sys

import numpy as np
import pytest

from cablecast.cable import load_cable
from cablecast.datasets import Dataset
from cablecast.errors import DatasetError, InputError
from cablecast.models import TrainingConfig, train_forward_model
from cablecast.models.training import initial_weights
from cablecast.motion.action import ActionRanges, MotionConfig
from cablecast.workspace import Workspace

pytest.importorskip("torch")

CABLE = load_cable("cable_1")
SMALL = TrainingConfig(hidden_width=64, epochs=40, batch_size=128)

# A smooth map of four variables over 2,000 points is learned by a 4 x 64 network in 40 epochs to
# about 0.4 % of the cable's length; the tolerance leaves room for another machine's rounding.
LEARNED_PCT = 1.0


def smooth_map(actions):
    """A stick along psi at the end of the arm, which lags the more, the wider theta1 swings."""
    theta1, theta2, r2, psi = actions.T
    heading = psi + 0.3 * np.sin(2 * theta1) * r2
    x = r2 * np.sin(theta2) + CABLE.length * np.sin(heading)
    y = r2 * np.cos(theta2) + CABLE.length * np.cos(heading)
    return np.stack([x, y], axis=-1)


def random_actions(count, seed):
    low, high = np.radians([-80, 5, 0, 0]), np.radians([-5, 80, 0, 90])
    low[2], high[2] = 0.35, 0.8
    actions = np.random.default_rng(seed).uniform(low, high, (count, 4))
    actions[:, 3] += actions[:, 1]
    return actions


def smooth_dataset(count=2000, seed=0):
    actions = random_actions(count, seed)
    landing = smooth_map(actions)
    reach = np.maximum(landing, [0.0, 1.22])
    extent = np.stack([0 * reach[:, 0], reach[:, 0], landing[:, 1], reach[:, 1]], axis=-1)
    settings = {
        "cable": CABLE.to_dict(),
        "workspace": dataclasses.asdict(Workspace()),
        "motion": dataclasses.asdict(MotionConfig()),
    }
    return Dataset(
        actions=actions,
        endpoint_xy=landing,
        status=np.where(Workspace().on_table(landing), "ok", "off_table"),
        duration=np.ones(count),
        extent=extent,
        info={"kind": "sim", "fingerprint": "f00d", "settings": settings},
    )


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
    assert model.action_ranges == ActionRanges.for_config(MotionConfig())
    without_psi = ActionRanges.for_config(MotionConfig(r0=1.0), with_psi=False)
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


def test_training_can_go_on_from_a_model(dataset, model):
    config = dataclasses.replace(SMALL, epochs=1, learning_rate=1e-6)
    moved = train_forward_model(dataset, config=config, start=model)
    actions = random_actions(50, seed=2)
    np.testing.assert_allclose(moved.predict(actions), model.predict(actions), atol=1e-3)
    assert moved.fingerprint != model.fingerprint


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


@pytest.mark.parametrize("name", ["epochs", "batch_size", "learning_rate", "held_out_fraction"])
def test_training_options_out_of_bounds_are_refused(name):
    with pytest.raises(InputError, match=f"{name} = -1 is outside"):
        TrainingConfig(**{name: -1})


def test_first_weights_keep_the_variance_through_the_layers():
    hidden = np.random.default_rng(0).normal(size=(2000, 256))
    for matrix, _ in initial_weights(TrainingConfig(), 256, seed=0)[:-1]:
        hidden = np.maximum(hidden @ matrix, 0)
        assert 0.5 < np.mean(hidden**2) / 1.0 < 2.0


def test_threads_that_wait_leave_the_processor_to_others():
    # libgomp prints, when loaded, what it has read.
    code = "from cablecast.models.torch_ import check_device; check_device('cpu')"
    environment = {k: v for k, v in os.environ.items() if k != "OMP_WAIT_POLICY"}
    done = subprocess.run(
        [sys.executable, "-c", code + "; import os; assert 'OMP_WAIT_POLICY' not in os.environ"],
        env=environment | {"OMP_DISPLAY_ENV": "TRUE"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    if "OMP_WAIT_POLICY" not in done.stderr:
        pytest.skip("torch uses no OpenMP here")
    assert "OMP_WAIT_POLICY = 'PASSIVE'" in done.stderr
