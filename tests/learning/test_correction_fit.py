import dataclasses

import numpy as np
import pytest
from synthetic_casts import network, random_actions

from cablecast.errors import InputError
from cablecast.learning.kernel import matern
from cablecast.learning.landing import MIN_REAL_ROWS, deviations
from cablecast.learning.network import fit_correction, fit_process

pytest.importorskip("torch")

LEARNED, FRESH = 200, 1500

AMPLITUDE, NOISE = 0.05, 0.02
LENGTH_SCALES = np.array([1.5, 2.5, 6.0, 2.0, 3.0, 6.0])
SIZE_WEIGHTS = np.array([0.6, 0.0, -0.3, 0.0, 0.5])

# In 12 draws, fits to 200 casts missed the weights of the features by up to 0.14.
WEIGHT_ERROR = 0.2
# The local noise was 0.90 to 1.09 times the true one in the 12 draws.
NOISE_FACTOR = 1.2
# The local amplitude was 0.76 to 1.40 times the true one: it is known together with the length
# scales only.
AMPLITUDE_FACTOR = 1.6

# Root mean square of 3000 offsets over their spread: 0.97 to 1.08 in the 12 draws.
CALIBRATION = 0.1
# Share of landings in the region for 50 %: 0.44 to 0.53 in the 12 draws; for 90 %: 0.86 to 0.91.
COVERAGE = 0.06

# The square of a distance in the plane, in units of the variance along an axis, is exponential with
# mean 2: this is the radius of the circle that holds a share of a normal scatter.
HALF = np.sqrt(-2 * np.log(0.5))
NINE_TENTHS = np.sqrt(-2 * np.log(0.1))


@pytest.fixture(scope="module")
def drawn():
    """Return a network, and actions with landings drawn from the process of the correction."""
    model = network([4, 16, 2])
    actions = random_actions(LEARNED + FRESH, seed=3)
    changes = deviations(actions)
    places, sizes = model.correction_inputs(actions, changes)
    generator = np.random.default_rng(4)
    kernel = matern(places / LENGTH_SCALES, places / LENGTH_SCALES)
    factor = np.linalg.cholesky(kernel + 1e-9 * np.eye(len(kernel)))
    g = AMPLITUDE * factor @ generator.normal(size=(len(actions), 2))
    g += NOISE * generator.normal(size=g.shape)
    landing = model.predict(actions) + np.exp(sizes @ SIZE_WEIGHTS)[:, None] * g
    return model, actions, landing, changes


@pytest.fixture(scope="module")
def corrected(drawn):
    model, actions, landing, changes = drawn
    fitted = fit_correction(model, actions[:LEARNED], landing[:LEARNED], changes)
    return dataclasses.replace(model, correction=fitted)


def test_the_fit_finds_the_process_that_the_landings_were_drawn_from(drawn, corrected):
    model, actions, _, changes = drawn
    fitted = corrected.correction
    _, sizes = model.correction_inputs(actions, changes)
    # The sensitivity varies little from action to action here, so its weight and the amplitude are
    # known together only: compare the local size, not the weight.
    ratio = np.exp(sizes @ (fitted.size_weights - SIZE_WEIGHTS))
    np.testing.assert_allclose(fitted.size_weights[:4], SIZE_WEIGHTS[:4], atol=WEIGHT_ERROR)
    noise = np.median(fitted.noise * ratio)
    amplitude = np.median(fitted.amplitude * ratio)
    assert NOISE / NOISE_FACTOR < noise < NOISE * NOISE_FACTOR
    assert AMPLITUDE / AMPLITUDE_FACTOR < amplitude < AMPLITUDE * AMPLITUDE_FACTOR


def test_fresh_landings_scatter_as_far_as_the_spread_says(drawn, corrected):
    _, actions, landing, _ = drawn
    offset = landing[LEARNED:] - corrected.predict(actions[LEARNED:])
    offset /= corrected.predict_spread(actions[LEARNED:])[:, None]
    assert np.sqrt(np.mean(offset**2)) == pytest.approx(1.0, abs=CALIBRATION)
    radius = np.linalg.norm(offset, axis=1)
    assert np.mean(radius < HALF) == pytest.approx(0.5, abs=COVERAGE)
    assert np.mean(radius < NINE_TENTHS) == pytest.approx(0.9, abs=COVERAGE)


def test_the_spread_tells_sure_casts_from_unsure_ones(drawn, corrected):
    _, actions, landing, _ = drawn
    error = np.linalg.norm(landing[LEARNED:] - corrected.predict(actions[LEARNED:]), axis=1)
    spread = corrected.predict_spread(actions[LEARNED:])
    parts = np.array_split(np.argsort(spread), 3)
    # Each third is calibrated by itself: the mean square error is twice the squared spread.
    for part in parts:
        ratio = np.sqrt(np.mean(error[part] ** 2) / np.mean(2 * spread[part] ** 2))
        assert ratio == pytest.approx(1.0, abs=2 * CALIBRATION)
    assert np.median(error[parts[2]]) > 2 * np.median(error[parts[0]])


def test_a_known_residual_field_is_recovered():
    model = network([4, 16, 2])

    def field(actions):
        return 0.1 * np.stack([np.sin(2 * actions[:, 0]), actions[:, 1] * actions[:, 2]], axis=1)

    actions, fresh = random_actions(150, seed=5), random_actions(400, seed=6)
    landing = model.predict(actions) + field(actions)
    fitted = fit_correction(model, actions, landing, deviations(actions))
    after = dataclasses.replace(model, correction=fitted)
    missed = np.linalg.norm(model.predict(fresh) + field(fresh) - after.predict(fresh), axis=1)
    # A smooth field without noise on 150 points: next to nothing of its 0.1 m is left.
    assert np.median(missed) < 0.001
    assert np.percentile(missed, 95) < 0.01


def test_a_correction_of_a_corrected_model_starts_from_its_network(drawn, corrected):
    model, actions, landing, changes = drawn
    first = fit_correction(model, actions[:60], landing[:60], changes)
    second = fit_correction(corrected, actions[:60], landing[:60], changes)
    for name, value in first.tensors().items():
        np.testing.assert_array_equal(second.tensors()[name], value)


def test_an_irrelevant_size_variable_gets_next_to_no_weight():
    generator = np.random.default_rng(7)
    places, sizes = generator.normal(size=(100, 2)), generator.normal(size=(100, 2))
    residuals = np.exp(0.8 * sizes[:, :1]) * generator.normal(scale=0.03, size=(100, 2))
    weights = fit_process(places, sizes, residuals).size_weights
    np.testing.assert_allclose(weights, [0.8, 0.0], atol=WEIGHT_ERROR)


def test_an_irrelevant_place_variable_gets_a_long_but_no_endless_length_scale():
    generator = np.random.default_rng(2)
    places, sizes = generator.normal(size=(40, 3)), generator.normal(size=(40, 3))
    residuals = 0.05 * np.stack([np.sin(places[:, 0]), np.cos(places[:, 0])], axis=1)
    residuals += generator.normal(scale=0.01, size=(40, 2))
    relevant, *irrelevant = fit_process(places, sizes, residuals).length_scales
    assert 1 < relevant < 3
    # In ten draws: 8 to 32 with the prior, most above 10,000 without it.
    assert all(5 < length_scale < 100 for length_scale in irrelevant)


def test_too_few_casts_are_refused(drawn):
    model, actions, landing, changes = drawn
    with pytest.raises(InputError, match=f"14 real casts .* needs {MIN_REAL_ROWS}"):
        fit_correction(model, actions[:14], landing[:14], changes)


def test_residuals_that_are_not_finite_are_reported(drawn):
    model, actions, landing, changes = drawn
    broken = landing[:20] * np.where(np.arange(20) == 7, np.nan, 1.0)[:, None]
    with pytest.raises(InputError, match="no finite fit"):
        fit_correction(model, actions[:20], broken, changes)
