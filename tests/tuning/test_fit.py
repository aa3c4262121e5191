"""Least squares with a prior: a handful of casts is enough, and what they leave open is said."""

import dataclasses

import numpy as np
import pytest

from cablecast.cable import CableParams
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.runs.folder import Parts
from cablecast.setup import Setup
from cablecast.tuning.fit import FitConfig, TrackFit
from cablecast.tuning.space import ParamPrior, SearchSpace
from cablecast.tuning.tracks import TrackObjective
from cablecast.tuning.tune import fit_params
from cablecast.tuning.tuned import load_tuned, write_params

CONFIG = FitConfig(
    start_count=4, rough_iterations=6, kept_start_count=2, coarse_iterations=1, fine_iterations=3
)
FRICTION = 0.12
"""The tracks of three casts tell friction about this well."""


@pytest.fixture(scope="module")
def others(good):
    return good[np.arange(3, len(good))]


@pytest.fixture(scope="module")
def result(cable, few, others):
    engine = EngineWarp(segment_count=10, dt=2e-3)
    return fit_params(Setup(cable=cable), few, others, (engine,) * 3, CONFIG)


def test_three_casts_are_enough_to_predict_others(result, truth):
    assert result.params.friction == pytest.approx(truth.friction, rel=FRICTION)
    default, fitted = (
        result.metrics["validation"][row]["mean_pct"] for row in ("default", "tuned")
    )
    assert fitted < 0.25 * default


def test_what_the_casts_do_not_tell_keeps_the_belief(result, cable):
    posterior = result.posterior
    assert "twist_stiffness" in posterior.undetermined
    assert result.params.mass == pytest.approx(cable.params.mass, rel=0.2)
    assert "bend_stiffness" not in posterior.undetermined
    assert any("do not determine twist stiffness" in line for line in posterior.sentences())
    assert any("only the product" in line for line in posterior.sentences())
    assert np.all(posterior.deviation < 1.001 * posterior.prior.deviation)


def test_draws_stay_in_range_and_begin_with_the_most_likely(result):
    posterior = result.posterior
    draws = posterior.draw(50).to_array()[:, : posterior.space.dimension]
    np.testing.assert_allclose(draws[0], result.params.to_array()[:10])
    assert np.all(draws >= posterior.space.low)
    assert np.all(draws <= posterior.space.high)
    # The product is known, the factors are not.
    friction = draws[:, 4] * draws[:, 5]
    assert np.std(np.log(friction)) < 0.5 * np.std(np.log(draws[:, 4]))


def test_a_bound_in_the_way_is_widened(cable, few, others, truth, engine):
    """What is believed is off by a factor of 50: the range ends at 30."""
    stiff = dataclasses.replace(cable.params, bend_stiffness=truth.bend_stiffness / 50.0)
    believed = dataclasses.replace(cable, params=stiff, deviations={"bend_stiffness": 30.0})
    told = []
    result = fit_params(
        Setup(cable=believed), few, others, (engine,) * 3, CONFIG, progress=told.append
    )
    # A range more to search moves no end away.
    assert len({one.total for one in told}) == 1
    assert [one.done for one in told] == sorted(one.done for one in told)
    assert told[-1].done == told[-1].total
    # Nor is there effort beyond that which was planned, with what was widened.
    assert [one.seconds_left > 0 for one in told] == [True] * (len(told) - 1) + [False]
    high = SearchSpace.for_cable(believed).high[CableParams.names().index("bend_stiffness")]
    assert result.params.bend_stiffness > high


def test_deviations_of_the_cables_file_are_the_prior(cable):
    sure = dataclasses.replace(cable, deviations={"bend_stiffness": 1.01, "lateral_friction": 0.01})
    space = SearchSpace.for_cable(sure)
    prior = ParamPrior.for_cable(sure, space)
    values = space.to_params(prior.mean + np.eye(10)[1] * prior.deviation[1]).to_array()
    assert values[1] == pytest.approx(1.01 * cable.params.bend_stiffness)
    assert prior.deviation[4] == pytest.approx(0.01 / 1.25)
    assert prior.deviation[0] > 5 * prior.deviation[1]


def test_nothing_is_learned_from_a_simulation_that_broke(cable, few, engine, monkeypatch):
    space = SearchSpace.for_cable(cable)
    objective = TrackObjective(engine, cable, few)
    fit = TrackFit(objective, space, ParamPrior.for_cable(cable, space))
    simulate = objective.tracks_of

    def breaks(params):
        xy, finite = simulate(params)
        # The world with a changed bending stiffness, the third of the batch.
        xy[2], finite[2] = np.nan, False
        return xy, finite

    monkeypatch.setattr(objective, "tracks_of", breaks)
    curve = fit.curvatures(fit.prior.mean[None], 0.05, expected=True)[0]
    assert curve.hessian[1, 1] == pytest.approx(fit.prior.precision[1, 1])
    assert curve.hessian[4, 4] > 1.1 * fit.prior.precision[4, 4]


@pytest.mark.parametrize(
    "change", [{"start_count": 0}, {"fine_iterations": 0}, {"coarse_dt": 1.0}, {"seed": -1}]
)
def test_bad_settings_are_refused(change):
    with pytest.raises(InputError, match=next(iter(change))):
        FitConfig(**change)


def test_bad_deviations_are_refused(cable):
    with pytest.raises(InputError, match=r"deviation of mass = 0\.5 is outside"):
        dataclasses.replace(cable, deviations={"mass": 0.5})
    with pytest.raises(InputError, match="unknown keys"):
        dataclasses.replace(cable, deviations={"colour": 1.5})


def test_a_posterior_is_read_back_as_it_was_written(result, cable, tmp_path):
    values = result.to_dict()
    write_params(tmp_path / "params.json", values)
    again = load_tuned(tmp_path / "params.json", Setup(cable=cable)).posterior
    np.testing.assert_array_equal(again.covariance, result.posterior.covariance)
    np.testing.assert_array_equal(again.draw(5).to_array(), result.posterior.draw(5).to_array())
    assert again.undetermined == result.posterior.undetermined
    with pytest.raises(InputError, match="no posterior of a fit"):
        type(again).from_dict(
            values["posterior"] | {"mean": [0.5]}, values["search_range"], result.params
        )


def test_a_fit_that_was_stopped_goes_on_at_its_step_with_the_same_result(
    result, cable, few, others, engine, tmp_path
):
    reports, step = [], 3

    def stop(progress):
        reports.append(progress.done)
        if len(reports) == step:
            raise KeyboardInterrupt

    parts = Parts(tmp_path)
    setup = Setup(cable=cable)
    with pytest.raises(KeyboardInterrupt):
        fit_params(setup, few, others, (engine,) * 3, CONFIG, checkpoint=parts, progress=stop)
    assert len(list(tmp_path.iterdir())) == step
    taken = []
    again = fit_params(
        setup,
        few,
        others,
        (engine,) * 3,
        CONFIG,
        checkpoint=parts,
        progress=lambda progress: taken.append(progress.done),
    )
    assert taken[0] == step + 1
    np.testing.assert_array_equal(again.params.to_array(), result.params.to_array())
    np.testing.assert_array_equal(again.posterior.covariance, result.posterior.covariance)
    assert again.metrics["history"] == result.metrics["history"]
    assert again.metrics["simulation_count"] == result.metrics["simulation_count"]
