"""The process on residuals: a Kalman filter at one place, a map over many."""

import dataclasses

import numpy as np
import pytest

from cablecast.aiming.residual import (
    FRICTION_SIZE,
    FewCastResidual,
    Places,
    ResidualScales,
    length_scales,
)

# The covariance has a small number added to its diagonal, 1e-9 beside a noise of 4e-4.
JITTER = 1e-4

PLACE_COUNT = len(length_scales())

SCALES = ResidualScales(amplitude=0.08, noise=0.02, length=1.0, power=0.0)


def places(inputs, log_sizes=0.0, log_scatters=0.0, frictions=0.0):
    inputs = np.atleast_2d(inputs)
    return Places(
        inputs=inputs,
        log_sizes=np.full(len(inputs), log_sizes),
        log_scatters=np.full(len(inputs), log_scatters),
        frictions=np.full(len(inputs), frictions),
    )


HERE, FAR = places(np.zeros(PLACE_COUNT)), places(np.full(PLACE_COUNT, 50.0))


def test_before_any_cast_the_residual_is_unknown_and_zero_on_average():
    mean, variance = FewCastResidual.empty(SCALES).predict(HERE)
    np.testing.assert_array_equal(mean, [[0.0, 0.0]])
    assert variance == pytest.approx([0.08**2])


def test_repeated_casts_are_averaged_as_by_a_kalman_filter():
    process = FewCastResidual.empty(SCALES)
    mean, variance = 0.0, 0.08**2
    for seen in (0.05, 0.03, 0.06, 0.01):
        gain = variance / (variance + 0.02**2)
        mean, variance = mean + gain * (seen - mean), (1.0 - gain) * variance
        process = process.with_cast(HERE, np.array([seen, -seen]))
        found, left = process.predict(HERE)
        np.testing.assert_allclose(found, [[mean, -mean]], rtol=JITTER)
        np.testing.assert_allclose(left, [variance], rtol=JITTER)


def test_a_cast_teaches_nothing_of_a_place_far_away():
    process = FewCastResidual.empty(SCALES).with_cast(HERE, np.array([0.1, 0.1]))
    mean, variance = process.predict(FAR)
    np.testing.assert_allclose(mean, 0.0, atol=1e-6)
    assert variance == pytest.approx([0.08**2])


def test_the_mirror_image_of_an_action_shares_a_part_of_its_residual():
    left = places(-np.eye(PLACE_COUNT)[-1])
    right = places(np.eye(PLACE_COUNT)[-1])
    process = FewCastResidual.empty(SCALES).with_cast(right, np.array([0.1, 0.0]))
    same, mirrored = (process.predict(place)[0][0, 0] for place in (right, left))
    assert 0.3 * same < mirrored < 0.9 * same


def test_casts_to_some_places_miss_by_more_and_sensitive_ones_scatter_by_more():
    process = FewCastResidual.empty(dataclasses.replace(SCALES, power=1.0))
    far = places(np.zeros(PLACE_COUNT), log_sizes=np.log(3.0))
    assert process.predict(far)[1] == pytest.approx(9 * process.predict(HERE)[1])
    assert process.scatter_variance(far) == pytest.approx(process.scatter_variance(HERE))
    scattered = places(np.zeros(PLACE_COUNT), log_scatters=np.log(3.0))
    assert process.predict(scattered)[1] == pytest.approx(process.predict(HERE)[1])
    assert process.scatter_variance(scattered) == pytest.approx(9 * process.scatter_variance(HERE))


def test_what_the_friction_moves_is_less_known_and_misses_alike_far_away():
    process = FewCastResidual.empty(dataclasses.replace(SCALES, amplitude=0.001))
    friction = 2.0 / FRICTION_SIZE * 0.05
    here = places(np.zeros(PLACE_COUNT), frictions=friction)
    there = places(np.full(PLACE_COUNT, 1.0), frictions=0.5 * friction)
    assert process.predict(here)[1] == pytest.approx(0.1**2, rel=1e-3)
    known = process.with_cast(here, np.array([0.1, -0.1]))
    # Half as much is moved there by the friction that was found out here.
    mean, variance = known.predict(there)
    assert 0.2 < mean[0, 0] / 0.1 < 0.5
    np.testing.assert_allclose(mean[0, 0], -mean[0, 1])
    assert variance[0] < 0.9 * process.predict(there)[1][0]
    # The same distance is far for what does not follow the friction.
    plain = FewCastResidual.empty(SCALES).with_cast(HERE, np.array([0.1, -0.1]))
    share = plain.predict(places(np.full(PLACE_COUNT, 1.0)))[0][0, 0] / 0.1
    assert share < 0.5 * mean[0, 0] / (0.5 * 0.1)


def test_many_casts_overrule_what_was_expected_of_the_scales():
    rng = np.random.default_rng(1)
    inputs = rng.normal(size=(60, PLACE_COUNT)) * [1, 1, 1, 1, 0, 0, 0, 0]
    truth = FewCastResidual.empty(ResidualScales(amplitude=0.2, noise=0.01, length=1.0, power=0.0))
    grown = dataclasses.replace(
        truth, places=places(inputs), residuals=np.zeros((60, 2)), scatter=np.ones(60)
    )
    drawn = np.linalg.cholesky(grown._covariance) @ rng.normal(size=(60, 2))
    process = FewCastResidual.empty(ResidualScales(amplitude=0.05, noise=0.03, length=1.0))
    for row in range(60):
        process = process.with_cast(places(inputs[row]), drawn[row])
    fitted = process.fitted().scales
    assert fitted.amplitude == pytest.approx(0.2, rel=0.4)


def test_casts_of_the_fit_do_not_tell_the_scales():
    process = FewCastResidual.empty(SCALES)
    for number in range(6):
        process = process.with_cast(places(np.full(PLACE_COUNT, 3.0 * number)), np.zeros(2))
    none = np.zeros(6, dtype=bool)
    assert process.fitted(none).scales == SCALES
    assert process.fitted().scales.amplitude < 0.5 * SCALES.amplitude


def test_errors_of_casts_far_from_each_other_are_hardly_taken_for_scatter():
    found = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        process = FewCastResidual.empty()
        for number in range(24):
            # Sensitive casts are off by more, and each lands far from all others.
            place = places(np.full(PLACE_COUNT, 20.0 * number), log_scatters=0.9 * rng.normal())
            size = 0.035 * np.hypot(1.0, np.exp(place.log_scatters[0]))
            process = process.with_cast(place, size * rng.normal(size=2))
        found.append(process.fitted().scales.noise)
    assert np.mean(found) < 1.5 * process.believed.noise


def test_casts_at_one_place_that_differ_are_scatter():
    rng = np.random.default_rng(5)
    process = FewCastResidual.empty()
    for _ in range(40):
        process = process.with_cast(HERE, 4.7 * process.believed.noise * rng.normal(size=2))
    assert process.fitted().scales.noise > 2.5 * process.believed.noise
