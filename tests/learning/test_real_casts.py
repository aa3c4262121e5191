import dataclasses

import numpy as np
import pytest
from synthetic_casts import CABLE, dataset_of, network, random_actions

from cablecast.errors import InputError
from cablecast.learning.adaptation import (
    FOLD_COUNT,
    cross_validate,
    folds,
    real_metrics,
    real_rows,
    with_adaptation,
)
from cablecast.learning.landing import MIN_REAL_ROWS, dataset_summary

COUNT = 40


@pytest.fixture
def real():
    landing = np.random.default_rng(0).uniform([-0.5, 0.3], [0.5, 1.0], (COUNT, 2))
    return dataset_of(random_actions(COUNT, seed=1), landing, kind="real", fingerprint="cafe")


def without(real, rows):
    """Return the dataset in which some casts left the table and some were not seen."""
    status, endpoints = real.status.astype("<U12"), real.endpoint_xy.copy()
    half = len(rows) // 2
    status[rows[:half]] = "off_table"
    status[rows[half:]], endpoints[rows[half:]] = "occluded", np.nan
    return dataclasses.replace(real, status=status, endpoint_xy=endpoints)


@pytest.mark.parametrize("count", [MIN_REAL_ROWS, 100, 103])
def test_every_row_is_held_out_once_and_then_not_learned_from(count):
    held_out_rows = []
    for rows, held_out in folds(count, seed=0):
        assert not set(rows) & set(held_out)
        assert sorted([*rows, *held_out]) == list(range(count))
        held_out_rows += list(held_out)
    assert sorted(held_out_rows) == list(range(count))


def test_folds_are_those_of_the_seed():
    first, again, other = (list(folds(50, seed)) for seed in (3, 3, 4))
    assert all(np.array_equal(a[1], b[1]) for a, b in zip(first, again, strict=True))
    assert not all(np.array_equal(a[1], b[1]) for a, b in zip(first, other, strict=True))
    # Casts lie in the order of their actions; a fold must not be a corner of these.
    assert all(np.ptp(held_out) > 25 for _, held_out in first)


def test_cross_validation_never_predicts_a_row_from_itself():
    calls = []

    def fit(rows, held_out):
        calls.append((set(rows), set(held_out)))
        return frozenset(rows)

    parts, whole = cross_validate(COUNT, fit, seed=0)
    assert len(parts) == FOLD_COUNT == len(calls) - 1
    for held_out, learned_from in parts:
        assert not learned_from & set(held_out)
    assert sorted(row for held_out, _ in parts for row in held_out) == list(range(COUNT))
    assert all(not rows & held_out for rows, held_out in calls[:-1])
    assert whole == set(range(COUNT))


def test_progress_is_told_before_every_fit_and_at_the_end():
    calls = []
    cross_validate(COUNT, lambda *_: None, 0, lambda state: calls.append((state.done, state.total)))
    assert calls == [(done, FOLD_COUNT + 1) for done in range(FOLD_COUNT + 2)]


def test_only_casts_that_came_to_rest_in_sight_on_the_table_are_learned_from(real):
    actions, endpoints = real_rows(without(real, np.array([2, 5, 11, 30])), None)
    kept = np.delete(np.arange(COUNT), [2, 5, 11, 30])
    np.testing.assert_array_equal(actions, real.actions[kept])
    np.testing.assert_array_equal(endpoints, real.endpoint_xy[kept])


def test_too_few_real_casts_are_refused(real):
    few = without(real, np.arange(COUNT - MIN_REAL_ROWS + 1))
    with pytest.raises(InputError, match=r"14 of 40 real casts .* needs 15"):
        real_rows(few, None)


@pytest.mark.parametrize("name", ["cable", "workspace", "arm", "motion"])
def test_real_casts_of_another_setup_are_refused(real, name):
    info = {"dataset": {"settings": dict(real.info["settings"])}}
    assert len(real_rows(real, network([4, 2], info=info))[0]) == COUNT
    settings = dict(real.info["settings"][name])
    changed = next(key for key, value in settings.items() if isinstance(value, float))
    settings[changed] += 0.1
    info["dataset"]["settings"][name] = settings
    with pytest.raises(InputError, match=rf"do not match the model: {name}\..*{changed}"):
        real_rows(real, network([4, 2], info=info))


def test_errors_before_and_after_are_those_of_the_network_and_of_the_predictions(real):
    model = network([4, 2])
    predicted = real.endpoint_xy + [0.03, -0.04]
    metrics = real_metrics(real, model, real.actions, real.endpoint_xy, predicted)
    for key in ("real_median_pct", "real_p90_pct", "real_mean_pct"):
        assert metrics[key] == pytest.approx(0.05 / CABLE.length * 100)
    before = np.linalg.norm(model.predict(real.actions) - real.endpoint_xy, axis=1)
    assert metrics["real_before_mean_pct"] == pytest.approx(np.mean(before) / CABLE.length * 100)
    assert (metrics["real_count"], metrics["real_used_count"]) == (COUNT, COUNT)
    alone = real_metrics(real, None, real.actions, real.endpoint_xy, predicted)
    assert not any(key.startswith("real_before") for key in alone)


def test_what_a_model_knew_before_stays_in_its_description(real):
    info = {"metrics": {"held_out_median_pct": 0.5}, "seed": 3}
    after = with_adaptation(
        network([4, 2]), info, real, method="correction", seed=7, metrics={"real_count": COUNT}
    ).info
    assert after["metrics"] == {"held_out_median_pct": 0.5, "real_count": COUNT}
    assert (after["seed"], after["adaptation"]["seed"]) == (3, 7)
    assert after["adaptation"]["dataset"] == dataset_summary(real)
    assert info == {"metrics": {"held_out_median_pct": 0.5}, "seed": 3}
