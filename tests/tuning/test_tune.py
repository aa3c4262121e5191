import dataclasses

import numpy as np
import pytest
from tests.tuning.conftest import coarse_engine

from cablecast.errors import InputError
from cablecast.runs.folder import Parts
from cablecast.setup import Setup
from cablecast.tuning.tune import CANDIDATE_MAX, TuneConfig, split_tracks, tune_params

# Ten tracks and a few hundred candidates: enough to find what a track depends on most.
SEARCH = TuneConfig(population_size=24, generations=40)
SHORT = dataclasses.replace(SEARCH, generations=5)
# Tracks hardly tell bend stiffness, damping and endpoint mass apart; friction they tell well.
FRICTION = 0.10


def tune(cable, tracks, engine, config=SHORT, **options):
    training, validation = split_tracks(tracks)
    return tune_params(Setup(cable=cable), training, validation, engine, config, **options)


@pytest.fixture(scope="module")
def short(cable, good, tmp_path_factory):
    """Return a short search: its result, the states that it told, and its checkpoint."""
    parts = Parts(tmp_path_factory.mktemp("short") / "generations")
    states = []
    result = tune(cable, good, coarse_engine(), checkpoint=parts, progress=states.append)
    return result, states, parts


def test_tuning_finds_the_friction_of_the_cable_that_made_the_tracks(cable, truth, good, engine):
    result = tune(cable, good, engine, SEARCH)
    assert result.params.friction == pytest.approx(truth.friction, rel=FRICTION)
    for tracks, share in (("training", 0.2), ("validation", 0.4)):
        default, tuned = (result.metrics[tracks][row]["mean_pct"] for row in ("default", "tuned"))
        assert tuned < share * default


def test_a_search_that_was_stopped_ends_bit_by_bit_like_one_that_was_not(
    short, cable, good, engine, tmp_path
):
    whole, _, _ = short
    parts = Parts(tmp_path / "generations")
    for stop in (1, 3, 5):

        def stopping(state, stop=stop):
            if state.done == stop:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            tune(cable, good, engine, checkpoint=parts, progress=stopping)
        assert len(list(parts.folder.iterdir())) == stop
    resumed = tune(cable, good, engine, checkpoint=parts)
    assert resumed.params == whole.params
    assert resumed.metrics | {"seconds": 0.0} == whole.metrics | {"seconds": 0.0}


def test_a_finished_search_simulates_no_generation_again(short, cable, good, engine):
    _, _, parts = short
    calls = []
    rollout = engine.rollout
    engine.rollout = lambda *args, **kwargs: calls.append(1) or rollout(*args, **kwargs)
    tune(cable, good, engine, checkpoint=parts)
    # Only the two rows of the result, on training and on validation tracks.
    assert len(calls) == 2


def test_a_checkpoint_of_another_seed_is_refused(short, cable, good, engine):
    _, _, parts = short
    other = dataclasses.replace(SHORT, seed=1)
    with pytest.raises(InputError, match="other candidates"):
        tune(cable, good, engine, other, checkpoint=parts)


def test_tracks_that_cannot_validate_are_refused_before_the_search(cable, good, engine):
    training, validation = split_tracks(good)
    blind = dataclasses.replace(
        validation, endpoint_xy=np.full_like(validation.endpoint_xy, np.nan)
    )
    states = []
    with pytest.raises(InputError, match="no cast has a sample"):
        tune_params(Setup(cable=cable), training, blind, engine, SHORT, progress=states.append)
    assert not states


def test_progress_tells_how_closely_the_casts_are_followed(short, good):
    result, states, _ = short
    assert [(state.done, state.total) for state in states] == [(k, 6) for k in range(1, 7)]
    losses = [row["best_pct"] for row in result.metrics["history"]]
    assert states[-1].note == f"fine: {losses[-1]:.1f} % off"
    assert losses == sorted(losses, reverse=True)
    training, _ = split_tracks(good)
    assert result.metrics["simulation_count"] == SHORT.candidate_count * len(training)
    # The bound on a search counts the candidates that it asks for.
    assert SHORT.candidate_count == 24 * 6 < CANDIDATE_MAX


def test_a_quarter_of_the_tracks_validates_by_default(tracks):
    training, validation = split_tracks(tracks)
    assert (len(training), len(validation)) == (len(tracks) - round(len(tracks) / 4), 2)
    with pytest.raises(InputError, match="validation_count = 10"):
        split_tracks(tracks, 10)
    with pytest.raises(InputError, match="validation_count = 0"):
        split_tracks(tracks, 0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"population_size": 3}, "population_size = 3"),
        ({"population_size": 48.5}, "population_size = 48.5 is not a whole number"),
        ({"generations": True}, "generations = True"),
        ({"generations": 0}, "generations = 0"),
        ({"seed": -1}, "seed = -1"),
        ({"population_size": 10_000, "generations": 20_000}, "make 200010000"),
    ],
    ids=str,
)
def test_settings_out_of_bounds_are_refused(change, words):
    with pytest.raises(InputError, match=words):
        TuneConfig(**change)


def test_a_search_whose_members_are_equally_good_ends(cable, good, engine, monkeypatch):
    monkeypatch.setattr("cablecast.tuning.search.TOLERANCE", 1e3)
    assert len(tune(cable, good, engine).metrics["history"]) == 1
