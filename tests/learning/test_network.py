import copy
import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest
from tests.learning.synthetic_casts import (
    CABLE,
    network,
    random_actions,
    smooth_dataset,
    smooth_map,
)

from cablecast.errors import DatasetError, InputError
from cablecast.learning.landing import FEATURE_COUNT
from cablecast.learning.network import (
    ForwardModel,
    TrainingConfig,
    fit_network,
    initial_weights,
    train_forward_model,
)
from cablecast.motion.feasibility import feasible_ranges
from cablecast.setup import MotionConfig, Setup
from cablecast.workspace import Workspace

OTHER = Setup(cable="cable_2", workspace=Workspace(table_width=2.0)).with_motion(v_max=1.2)

pytest.importorskip("safetensors")

ACTIONS = random_actions(100, seed=1)

# Predictions are computed in single precision, for landings of the order of a metre.
SINGLE_PRECISION = 1e-5


@pytest.fixture(scope="module")
def random_model():
    """Return a model with random weights and margins."""
    generator = np.random.default_rng(0)
    return dataclasses.replace(
        network([FEATURE_COUNT, 16, 16, 2]),
        margin_features=generator.normal(size=(40, FEATURE_COUNT)).astype(np.float32),
        margins=generator.normal(size=40).astype(np.float32),
        info={
            "metrics": {"held_out_median_pct": 0.5},
            "dataset": {"settings": OTHER.to_settings()},
        },
    )


def test_a_saved_model_is_loaded_with_the_same_predictions_and_description(random_model, tmp_path):
    random_model.save(tmp_path)
    loaded = ForwardModel.load(tmp_path)
    np.testing.assert_array_equal(loaded.predict(ACTIONS), random_model.predict(ACTIONS))
    np.testing.assert_array_equal(
        loaded.predict_margin(ACTIONS), random_model.predict_margin(ACTIONS)
    )
    assert loaded.info == random_model.info
    assert loaded.fingerprint == random_model.fingerprint
    assert loaded.setup == OTHER


def test_numpy_predicts_what_torch_computes(random_model):
    torch = pytest.importorskip("torch")
    actions = random_actions(5000, seed=1)
    hidden = torch.tensor(random_model.normalize(actions))
    for k, (matrix, offset) in enumerate(random_model.weights):
        hidden = hidden @ torch.tensor(matrix) + torch.tensor(offset)
        if k < len(random_model.weights) - 1:
            hidden = torch.nn.functional.silu(hidden)
    expected = random_model.endpoint_mean + random_model.endpoint_scale * hidden.numpy()
    np.testing.assert_allclose(random_model.predict(actions), expected, atol=SINGLE_PRECISION)


def test_predicting_does_not_import_torch(random_model, tmp_path):
    random_model.save(tmp_path)
    code = (
        "import sys, numpy as np\n"
        "from cablecast.learning.network import ForwardModel\n"
        f"model = ForwardModel.load({str(tmp_path)!r})\n"
        "model.predict(np.ones((3, 4)))\n"
        "assert 'torch' not in sys.modules and 'scipy' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True)
    assert done.returncode == 0, done.stderr.decode()


def test_extreme_features_do_not_make_a_prediction_non_finite(random_model):
    assert np.all(np.isfinite(random_model.predict(np.full((1, 4), -1e4))))


pytest.importorskip("torch")

pytestmark = pytest.mark.usefixtures("one_core")

CONFIG = TrainingConfig(
    hidden_width=32, hidden_count=1, epochs=40, batch_size=32, learning_rate=1e-2
)

METRE = 0.3

# Two of three landings of the same action are at one place: the sum of distances is least there,
# and 40 epochs come within this share of their distance.
SETTLED = 0.1


def linear_casts(count=200, seed=0):
    """Normalised casts that a linear network can learn exactly."""
    model = network([FEATURE_COUNT, 2], seed=1)
    actions = random_actions(count, seed)
    return model.normalized_casts(actions, model.predict(actions))


def fit(training, held_out=None, weights=None, config=CONFIG, **options):
    weights = weights or initial_weights(config, seed=0, paced=False)
    settings = {"config": config, "seed": 0, "device": "cpu", "metre": METRE} | options
    return fit_network(weights, training, held_out or training, **settings)


def distances(weights, casts):
    """Distance of each cast from its prediction, computed layer by layer in double precision."""
    hidden = casts[0].astype(float)
    for matrix, offset in weights[:-1]:
        hidden = hidden @ matrix + offset
        hidden = hidden / (1 + np.exp(-hidden))
    predicted = hidden @ weights[-1][0] + weights[-1][1]
    return np.linalg.norm(predicted - casts[1], axis=1)


def test_the_held_out_loss_is_the_mean_distance_in_metres():
    training, held_out = linear_casts(), linear_casts(count=60, seed=5)
    weights, curve = fit(training, held_out, keep_last=True)
    expected = METRE * np.mean(distances(weights, held_out))
    # The network runs in single precision.
    assert curve[-1]["held_out_loss"] == pytest.approx(expected, rel=1e-4)
    assert curve[-1]["held_out_loss"] < 0.1 * curve[0]["held_out_loss"]


def test_a_training_loss_without_learning_is_that_of_the_first_weights():
    still = dataclasses.replace(CONFIG, epochs=1, learning_rate=1e-9, weight_decay=0.0)
    training = linear_casts(count=75)
    first = initial_weights(CONFIG, seed=0, paced=False)
    _, curve = fit(training, weights=first, config=still)
    # 75 rows are two whole batches and a part of one.
    expected = METRE * np.mean(distances(first, training))
    assert curve[0]["loss"] == pytest.approx(expected, rel=1e-4)


def test_the_norm_is_learned_and_not_its_square():
    # One action that lands twice at one place and once at another: the sum of distances is least
    # at the former, the sum of their squares at the mean of all three.
    inputs = np.zeros((90, FEATURE_COUNT), dtype=np.float32)
    outputs = np.tile(np.array([[0, 0], [0, 0], [1, 0]], dtype=np.float32), (30, 1))
    weights, _ = fit((inputs, outputs), keep_last=True)
    assert distances(weights, (inputs, 0 * outputs))[0] < SETTLED


def test_the_best_epoch_is_kept_unless_the_last_is_wanted():
    training = linear_casts(count=100)
    # Validated with the opposite of what is learned, the first epoch stays the best.
    opposite = (training[0], -training[1])
    best, curve = fit(training, opposite)
    last, last_curve = fit(training, opposite, keep_last=True)
    losses = [row["held_out_loss"] for row in curve]
    for weights, loss in ((best, min(losses)), (last, last_curve[-1]["held_out_loss"])):
        expected = METRE * np.mean(distances(weights, opposite))
        assert loss == pytest.approx(expected, rel=1e-4)
    assert min(losses) < 0.97 * last_curve[-1]["held_out_loss"]


@pytest.mark.parametrize("name", ["epochs", "batch_size", "learning_rate", "held_out_fraction"])
def test_training_options_out_of_bounds_are_refused(name):
    with pytest.raises(InputError, match=f"{name} = -1 is outside"):
        TrainingConfig(**{name: -1})


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
    assert model.action_ranges == feasible_ranges(Setup())
    without_psi = feasible_ranges(Setup(motion=MotionConfig(r0=1.0)), turns=False)
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
    noise = np.random.default_rng(0).normal(size=dataset.rest_xy.shape)
    hopeless = dataclasses.replace(dataset, rest_xy=noise)
    config = dataclasses.replace(SMALL, epochs=200, patience=3)
    model = train_forward_model(hopeless, config=config)
    assert model.metrics["epoch_count"] == model.metrics["best_epoch"] + 3 < 200


def test_rows_without_a_known_end_on_the_table_are_left_out(dataset):
    endpoint_xy = dataset.rest_xy.copy()
    endpoint_xy[:100] = np.nan
    status = np.where(np.arange(len(dataset)) < 100, "non_finite", dataset.status)
    broken = dataclasses.replace(dataset, rest_xy=endpoint_xy, status=status)
    model = train_forward_model(broken, config=dataclasses.replace(SMALL, epochs=1))
    metrics = model.metrics
    on_table = int(np.sum(status == "ok"))
    assert metrics["unknown_endpoint_count"] == len(dataset) - on_table
    assert metrics["training_count"] + metrics["held_out_count"] == on_table
    assert metrics["off_table_count"] == int(np.sum(status == "off_table")) > 0
    assert all(np.all(np.isfinite(matrix)) for matrix, _ in model.weights)


def test_an_action_set_without_psi_can_be_learned(dataset):
    actions = dataset.actions.copy()
    actions[:, 3] = actions[:, 1]
    flat = dataclasses.replace(dataset, actions=actions, rest_xy=smooth_map(actions))
    model = train_forward_model(flat, config=dataclasses.replace(SMALL, epochs=5))
    assert np.isfinite(model.metrics["held_out_median_pct"])


def test_a_device_that_is_not_there_is_refused(dataset):
    import torch

    device = "tpu" if torch.cuda.is_available() else "cuda"
    with pytest.raises(InputError, match=device):
        train_forward_model(dataset, config=SMALL, device=device)


def test_training_that_diverges_is_reported(dataset):
    with np.errstate(over="ignore"), pytest.raises(InputError, match="diverged"):
        train_forward_model(
            dataclasses.replace(dataset, rest_xy=dataset.rest_xy * 1e300),
            config=dataclasses.replace(SMALL, epochs=1),
        )
