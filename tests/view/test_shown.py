import numpy as np
import pytest

from cablecast.cast import Cast, EndpointTrack, TrialStatus
from cablecast.view.look import FRAME_DT, ShownCast


def track(endpoint_xy, nodes=None):
    endpoint_xy = np.array(endpoint_xy, dtype=float)
    times = 0.1 * np.arange(len(endpoint_xy))
    return EndpointTrack(times=times, endpoint_xy=endpoint_xy, status=TrialStatus.OK, nodes=nodes)


def shown(seen):
    cast = Cast(action=None, duration=1.0, joint_path=None, track=seen, purpose="aim")
    return ShownCast.of_cast(cast)


def test_between_samples_the_path_does_not_overshoot_and_rests_where_they_rest():
    cast = shown(track([[0, 1], [0.2, 1], [0.4, 1], [0.4, 1]]))
    assert cast.times[1] == pytest.approx(FRAME_DT)
    assert cast.path[:, 0].max() <= 0.4 + 1e-12
    assert np.all(np.diff(cast.path[:, 0]) >= -1e-12)
    assert np.allclose(cast.tip_at(0.25)[:2], [0.4, 1])


def test_what_was_not_seen_is_not_drawn():
    cast = shown(track([[0, 1], [np.nan, np.nan], [0.4, 1], [0.5, 1]]))
    assert np.isnan(cast.tip_at(0.1)[:2]).all()
    assert np.isnan(cast.tip_at(0.06)[:2]).all()
    assert np.allclose(cast.tip_at(0.3)[:2], [0.5, 1])
    assert np.all(np.isfinite(cast.trail(1.0)))


def test_the_cable_keeps_its_place_before_and_after_the_cast():
    nodes = np.zeros((3, 2, 3))
    nodes[:, 1, 0] = [0.0, 0.1, 0.3]
    cast = shown(track([[0, 1]] * 3, nodes))
    assert np.allclose(cast.nodes_at(-1.0), nodes[0])
    assert np.allclose(cast.nodes_at(9.0), nodes[-1])
    assert np.allclose(cast.nodes_at(0.1), nodes[1])


def test_the_end_is_seen_at_times_that_were_typed_with_few_digits():
    # Multiples of the interval of the shapes are a rounding error off such times.
    times = np.array([0.0, 0.35, 0.7])
    path = np.array([[0.0, 1.0], [0.2, 1.0], [0.4, 1.1]])
    cast = shown(EndpointTrack(times=times, endpoint_xy=path, status=TrialStatus.OK))
    assert np.allclose(cast.path[-1], path[-1])


def test_what_was_seen_once_is_drawn_at_that_time_alone():
    cast = shown(track([[0, 1], [np.nan, np.nan], [np.nan, np.nan]]))
    assert np.allclose(cast.path[0], [0, 1])
    assert np.isnan(cast.path[1:]).all()
