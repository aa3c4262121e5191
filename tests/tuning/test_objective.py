import dataclasses

import numpy as np
import pytest

from cablecast.cable import CableParams
from cablecast.engines.base import reset_state
from cablecast.errors import InputError
from cablecast.tuning.tracks import NON_FINITE_DISTANCE, TrackObjective

# The engine computes in single precision; equal worlds in other lanes give equal numbers, and the
# dataset holds them in double.
SINGLE = 1e-6
# At the end of the longest track a cable has had longer to creep to rest than at its own end.
CREEP = 2e-3
# Turning a reset state into place and working it out in place differ by the bisection's rounding.
STATE = 1e-9


def shifted(tracks, by):
    return dataclasses.replace(
        tracks, endpoint_xy=tracks.endpoint_xy + by, final_xy=tracks.final_xy + by
    )


def test_the_parameters_that_made_the_tracks_have_no_distance(engine, cable, truth, good):
    distances = TrackObjective(engine, cable, good).distances(truth)
    assert distances.loss[0] < SINGLE
    assert np.nanmax(distances.final) < CREEP


def test_a_track_that_is_moved_aside_is_as_far_away_as_it_was_moved(engine, cable, truth, good):
    moved = shifted(good, np.array([0.03, 0.04]))
    distances = TrackObjective(engine, cable, moved).distances(truth)
    np.testing.assert_allclose(distances.mean, 0.05, atol=SINGLE)
    np.testing.assert_allclose(distances.final, 0.05, atol=CREEP)


def test_each_candidate_gets_its_own_distances_from_one_batch(engine, cable, truth, good):
    objective = TrackObjective(engine, cable, good)
    batches = []
    rollout = objective.engine.rollout

    def counted(cable, *args, **kwargs):
        batches.append(cable.params.world_count)
        return rollout(cable, *args, **kwargs)

    objective.engine.rollout = counted
    stiff = dataclasses.replace(truth, bend_stiffness=5e-3)
    both = CableParams.stack([stiff, truth])
    distances = objective.distances(both)
    assert batches == [2 * len(good)]
    alone = objective.distances(stiff)
    np.testing.assert_allclose(distances.mean[0], alone.mean[0], atol=SINGLE)
    assert distances.loss[1] < SINGLE < distances.loss[0]


def test_samples_that_are_not_compared_do_not_count(engine, cable, truth, good):
    xy = good.endpoint_xy + 0.05
    xy[:, 4:] = np.nan
    moved = dataclasses.replace(good, endpoint_xy=xy)
    distances = TrackObjective(engine, cable, moved).distances(truth)
    np.testing.assert_allclose(distances.mean, 0.05 * np.sqrt(2), atol=SINGLE)


def test_a_track_without_any_compared_sample_is_left_out(engine, cable, truth, good):
    xy = good.endpoint_xy + 0.05
    xy[0] = np.nan
    distances = TrackObjective(engine, cable, dataclasses.replace(good, endpoint_xy=xy)).distances(
        truth
    )
    assert np.isnan(distances.mean[0, 0])
    assert distances.loss[0] == pytest.approx(0.05 * np.sqrt(2), abs=SINGLE)
    nothing = dataclasses.replace(good, endpoint_xy=np.full_like(xy, np.nan))
    with pytest.raises(InputError, match="no cast has a sample"):
        TrackObjective(engine, cable, nothing)


def test_times_between_the_samples_of_the_engine_are_interpolated(engine, cable, truth, good):
    # Of a measured track at other times only neighbouring points are known: the simulated point
    # must lie between them.
    later = dataclasses.replace(good, times=good.times + 0.037)
    assert later.sample_dt() == 0.01
    objective = TrackObjective(engine, cable, later)
    xy, _ = objective.tracks_of(truth)
    exact, _ = TrackObjective(engine, cable, good).tracks_of(truth)
    trial = 0
    low, high = exact[0, trial, 3:8], exact[0, trial, 4:9]
    middle = xy[0, trial, 3:8]
    way = np.linalg.norm(middle - low, axis=1) + np.linalg.norm(high - middle, axis=1)
    straight = np.linalg.norm(high - low, axis=1)
    assert np.all(way >= straight - SINGLE)
    assert np.all(np.linalg.norm(middle - low, axis=1) <= 0.6 * way + 1e-3)


def test_a_broken_simulation_counts_as_farther_than_any_real_one(engine, cable, truth, good):
    objective = TrackObjective(engine, cable, good)
    rollout = objective.engine.rollout

    def breaking(*args, **kwargs):
        result = rollout(*args, **kwargs)
        result.endpoint_xyz[0, 3:] = np.nan
        result.finite[0] = False
        return result

    objective.engine.rollout = breaking
    distances = objective.distances(truth)
    assert distances.mean[0, 0] == distances.final[0, 0] == NON_FINITE_DISTANCE * cable.length
    assert distances.finite.sum() == len(good) - 1
    assert np.isfinite(distances.loss).all()


def test_reset_states_that_are_turned_into_place_equal_those_worked_out_there(
    engine, cable, truth, good
):
    coefficients = good.grip_path.coefficients.copy()
    # The third trial starts aside and turned, as the joints of a real arm report.
    coefficients[2, :, 0, 0] += 2e-3
    coefficients[2, :, 3, 0] += 5e-3
    path = dataclasses.replace(good.grip_path, coefficients=coefficients)
    objective = TrackObjective(engine, cable, dataclasses.replace(good, grip_path=path))
    trial = np.arange(len(good))
    state = objective._initial_state(truth, trial, np.zeros_like(trial))
    expected = reset_state(cable.with_params(truth), path, objective.engine.segment_count)
    np.testing.assert_allclose(state.positions, expected.positions, atol=STATE)
