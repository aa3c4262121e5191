import dataclasses

import numpy as np
import pytest
from synthetic_casts import CABLE, dataset_of, random_actions, smooth_dataset, smooth_map

from cablecast.errors import InputError
from cablecast.learning.adaptation import (
    FineTuningConfig,
    correct_model,
    fine_tune,
    folds,
    train_on_real,
    training_mixture,
)
from cablecast.learning.landing import deviations
from cablecast.learning.network import TrainingConfig, fit_correction, train_forward_model
from cablecast.workspace import Workspace

pytest.importorskip("torch")

NETWORK = TrainingConfig(hidden_width=48, hidden_count=2, epochs=25, batch_size=128)
TUNING = FineTuningConfig(epochs=30, batch_size=64, learning_rate=3e-3)
REAL_ONLY = TrainingConfig(
    hidden_width=48, hidden_count=2, epochs=30, batch_size=64, learning_rate=1e-2, patience=30
)
REAL_COUNT, NOISE = 150, 0.005

# The rig lands some 10 cm from the simulator. Learning from 150 casts leaves a seventh of that.
LEFT_OVER = 0.25
# The rig's difference is a formula, no draw from the process that the spread assumes, so the spread
# is 20 % off here. Draws from the process itself are in test_correction_fit.
CALIBRATION = 0.35
# Share of the scatter of landings by which a network misses: some 0.04 where it has memorised them,
# and 1.2 to 1.5 where it has not seen them.
MEMORISED, UNSEEN = 0.3, 0.8


def rig_map(actions):
    """Return landings of a rig that throws farther and to the side, more so in longer sweeps."""
    return smooth_map(actions) + 0.12 * np.stack(
        [np.sin(actions[:, 0]), np.cos(2 * actions[:, 1]) * actions[:, 2]], axis=1
    )


@pytest.fixture(scope="module")
def simulated():
    return smooth_dataset(1000)


@pytest.fixture(scope="module")
def base(simulated):
    return train_forward_model(simulated, config=NETWORK)


@pytest.fixture(scope="module")
def real():
    actions = random_actions(REAL_COUNT, seed=5)
    noise = np.random.default_rng(6).normal(scale=NOISE, size=(REAL_COUNT, 2))
    return dataset_of(actions, rig_map(actions) + noise, kind="real", fingerprint="cafe")


@pytest.fixture(scope="module")
def corrected(base, real):
    return correct_model(base, real)


def scattered(count=30):
    """Casts that land anywhere on the table, whatever the action."""
    width = Workspace().table_width / 2 - 0.05
    landing = np.random.default_rng(0).uniform([-width, 0.2], [width, 1.0], (count, 2))
    return dataset_of(random_actions(count, seed=7), landing, kind="real")


def median_error(model, wanted=rig_map):
    actions = random_actions(300, seed=8)
    actions = actions[Workspace().on_table(wanted(actions))]
    return np.median(np.linalg.norm(model.predict(actions) - wanted(actions), axis=1))


def test_a_correction_learns_what_the_rig_does_differently(base, corrected):
    assert median_error(corrected) < LEFT_OVER * median_error(base)
    metrics = corrected.metrics
    assert metrics["real_median_pct"] < LEFT_OVER * metrics["real_before_median_pct"]
    assert metrics["spread_calibration"] == pytest.approx(1.0, abs=CALIBRATION)
    # The network itself, and what is known of it, stay.
    assert corrected.uncorrected.fingerprint == base.fingerprint
    assert metrics["held_out_median_pct"] == base.metrics["held_out_median_pct"]


def test_the_metrics_of_a_correction_are_those_of_casts_not_seen(base, real, corrected):
    used = real.ok & real.finite
    actions, landing = real.actions[used], real.endpoint_xy[used]
    errors, offsets = [], []
    for rows, held_out in folds(len(actions), seed=0):
        fitted = fit_correction(base, actions[rows], landing[rows], deviations(actions))
        fold = dataclasses.replace(base, correction=fitted)
        offset = fold.predict(actions[held_out]) - landing[held_out]
        spread = fold.predict_spread(actions[held_out])
        errors += list(np.hypot(*offset.T))
        offsets += list((offset / spread[:, None]).ravel())
    pct = np.array(errors) / CABLE.length * 100
    metrics = corrected.metrics
    assert metrics["real_used_count"] == used.sum() < metrics["real_count"] == REAL_COUNT
    assert metrics["real_median_pct"] == pytest.approx(np.median(pct), rel=1e-6)
    assert metrics["real_p90_pct"] == pytest.approx(np.percentile(pct, 90), rel=1e-6)
    rms = np.sqrt(np.mean(np.square(offsets)))
    assert metrics["spread_calibration"] == pytest.approx(rms, rel=1e-6)


def test_a_saved_correction_predicts_the_same(corrected, tmp_path):
    pytest.importorskip("safetensors")
    corrected.save(tmp_path)
    loaded = type(corrected).load(tmp_path)
    actions = random_actions(50, seed=9)
    np.testing.assert_array_equal(loaded.predict(actions), corrected.predict(actions))
    np.testing.assert_array_equal(loaded.predict_spread(actions), corrected.predict_spread(actions))


def test_fine_tuning_learns_the_map_of_the_rig(base, real):
    tuned = fine_tune(base, real, config=TUNING)
    assert median_error(tuned) < LEFT_OVER * median_error(base)
    assert tuned.metrics["real_median_pct"] < LEFT_OVER * tuned.metrics["real_before_median_pct"]
    assert tuned.metrics["held_out_median_pct"] == base.metrics["held_out_median_pct"]
    curve = tuned.info["adaptation"]["curve"]
    assert [row["epoch"] for row in curve] == list(range(1, TUNING.epochs + 1))
    # The curve's held-out loss is the mean distance of casts not seen, [m].
    mean = tuned.metrics["real_mean_pct"] / 100 * CABLE.length
    assert curve[-1]["held_out_loss"] == pytest.approx(mean, rel=0.01)


def test_fine_tuning_starts_from_the_network_and_drops_its_correction(base, real, corrected):
    still = FineTuningConfig(epochs=1, learning_rate=1e-9)
    tuned = fine_tune(corrected, real, config=still)
    assert tuned.correction is None
    actions = random_actions(50, seed=9)
    np.testing.assert_allclose(tuned.predict(actions), base.predict(actions), atol=1e-5)


def test_simulated_casts_in_the_mixture_keep_what_they_have_taught(base, simulated):
    # Real casts of small theta1 only: elsewhere the network knows the simulator alone.
    actions = random_actions(400, seed=10)
    actions = actions[(actions[:, 0] > -0.5) & Workspace().on_table(rig_map(actions))]
    real = dataset_of(actions, rig_map(actions), kind="real")
    far = random_actions(500, seed=11)
    far = far[far[:, 0] < -0.9]

    def forgotten(model):
        return np.median(np.linalg.norm(model.predict(far) - smooth_map(far), axis=1))

    alone = fine_tune(base, real, config=TUNING)
    mixed_config = dataclasses.replace(TUNING, epochs=4, real_fraction=0.4)
    mixed = fine_tune(base, real, simulated=simulated, config=mixed_config)
    assert forgotten(mixed) < 0.5 * forgotten(alone)
    assert mixed.metrics["real_median_pct"] < mixed.metrics["real_before_median_pct"]


@pytest.mark.parametrize(("fraction", "copies"), [(0.5, 20), (0.3, 8), (0.01, 1)])
def test_the_mixture_has_the_fraction_of_real_casts_that_was_asked_for(
    base, simulated, fraction, copies
):
    actions, landing = random_actions(50, seed=12), np.full((50, 2), 0.5)
    endpoints = simulated.endpoint_xy.copy()
    endpoints[:10] = np.nan
    broken = dataclasses.replace(simulated, endpoint_xy=endpoints)
    config = FineTuningConfig(real_fraction=fraction, real_weight=3.0)
    (inputs, outputs), weights = training_mixture(base, actions, landing, broken, config)
    assert weights is not None
    is_real = weights == 3.0
    assert is_real.sum() == copies * 50
    assert np.all(weights[~is_real] == 1.0)
    # Each repetition is a whole one, so the fraction is off by up to half of 50 in 990 + 50.
    assert np.mean(is_real) == pytest.approx(max(fraction, 50 / 1040), abs=25 / 1040)
    np.testing.assert_array_equal(inputs[~is_real], base.normalize(simulated.actions[10:]))
    np.testing.assert_array_equal(inputs[is_real], np.tile(base.normalize(actions), (copies, 1)))
    place = base.endpoint_mean + base.endpoint_scale * outputs
    # Normalised endpoints are single precision.
    np.testing.assert_allclose(place[is_real], 0.5, atol=1e-6)
    np.testing.assert_allclose(place[~is_real], simulated.endpoint_xy[10:], atol=1e-6)


def test_without_simulated_casts_the_real_ones_count_alike(base):
    actions, landing = random_actions(50, seed=12), np.full((50, 2), 0.5)
    (inputs, outputs), weights = training_mixture(base, actions, landing, None, FineTuningConfig())
    assert weights is None
    np.testing.assert_array_equal(inputs, base.normalize(actions))
    assert outputs.shape == (50, 2)


def test_a_network_learns_the_rig_from_real_casts_alone():
    actions = random_actions(200, seed=13)
    model = train_on_real(dataset_of(actions, rig_map(actions), kind="real"), config=REAL_ONLY)
    # Guessing the middle of all landings misses by 0.4 m, the network by some 0.02 m.
    assert median_error(model) < 0.05
    assert model.metrics["real_median_pct"] / 100 * CABLE.length < 0.05
    assert model.predict_spread(actions) is None
    assert len(model.margins) == 200


@pytest.mark.parametrize("learn", ["fine_tune", "train_on_real"])
def test_memorised_casts_do_not_lower_the_cross_validated_error(base, learn):
    """Landings that no action explains can be memorised, but not predicted."""
    real = scattered()
    if learn == "fine_tune":
        config = FineTuningConfig(epochs=60, learning_rate=1e-2)
        model = fine_tune(base, real, config=config)
    else:
        config = dataclasses.replace(REAL_ONLY, epochs=60, patience=60, learning_rate=1e-2)
        model = train_on_real(real, config=config)
    scatter = np.median(np.linalg.norm(real.endpoint_xy - real.endpoint_xy.mean(axis=0), axis=1))
    missed = np.median(np.linalg.norm(model.predict(real.actions) - real.endpoint_xy, axis=1))
    assert missed < MEMORISED * scatter
    assert model.metrics["real_median_pct"] / 100 * CABLE.length > UNSEEN * scatter


def test_progress_is_told_with_the_number_of_all_fits(base, real):
    calls = []
    still = FineTuningConfig(epochs=1)
    fine_tune(
        base, real, config=still, progress=lambda state: calls.append((state.done, state.total))
    )
    assert calls == [(done, 6) for done in range(7)]


def test_a_mixture_without_simulated_casts_is_refused(base, real):
    with pytest.raises(InputError, match=r"real_fraction = 0.4 needs simulated casts"):
        fine_tune(base, real, config=FineTuningConfig(real_fraction=0.4))


@pytest.mark.parametrize(
    ("name", "value"), [("real_fraction", 0.0), ("real_weight", 1e4), ("epochs", 0)]
)
def test_options_out_of_bounds_are_refused(name, value):
    with pytest.raises(InputError, match=f"{name} = .* is outside"):
        FineTuningConfig(**{name: value})
