import dataclasses

import numpy as np
import pytest
from synthetic_casts import network, random_actions

from cablecast.errors import InputError
from cablecast.learning.network import (
    TrainingConfig,
    fit_network,
    initial_weights,
)

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
    model = network([4, 2], seed=1)
    actions = random_actions(count, seed)
    return model.normalized_casts(actions, model.predict(actions))


def fit(training, held_out=None, weights=None, config=CONFIG, **options):
    weights = weights or initial_weights(config, seed=0)
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
    first = initial_weights(CONFIG, seed=0)
    _, curve = fit(training, weights=first, config=still)
    # 75 rows are two whole batches and a part of one.
    expected = METRE * np.mean(distances(first, training))
    assert curve[0]["loss"] == pytest.approx(expected, rel=1e-4)


def test_the_norm_is_learned_and_not_its_square():
    # One action that lands twice at one place and once at another: the sum of distances is least
    # at the former, the sum of their squares at the mean of all three.
    inputs = np.zeros((90, 4), dtype=np.float32)
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


def test_the_learning_rate_rises_and_falls_once():
    _, curve = fit(linear_casts())
    rates = np.array([row["learning_rate"] for row in curve])
    peak = int(np.argmax(rates))
    assert 0 < peak < len(rates) / 3
    assert np.all(np.diff(rates[: peak + 1]) > 0)
    assert np.all(np.diff(rates[peak:]) < 0)
    assert rates[peak] <= CONFIG.learning_rate
    assert rates[-1] < 1e-3 * CONFIG.learning_rate


@pytest.mark.parametrize("name", ["epochs", "batch_size", "learning_rate", "held_out_fraction"])
def test_training_options_out_of_bounds_are_refused(name):
    with pytest.raises(InputError, match=f"{name} = -1 is outside"):
        TrainingConfig(**{name: -1})


def test_first_weights_keep_the_variance_through_the_layers():
    hidden = np.random.default_rng(0).normal(size=(2000, 4))
    for matrix, _ in initial_weights(TrainingConfig(), seed=0)[:-1]:
        hidden = np.maximum(hidden @ matrix, 0)
        assert 0.5 < np.mean(hidden**2) / 1.0 < 2.0
