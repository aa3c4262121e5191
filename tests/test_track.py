import numpy as np
import pytest

from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.errors import InputError


def track(status=TrialStatus.OK):
    times = np.array([0.0, 0.1, 0.2])
    return EndpointTrack(times=times, endpoint_xy=np.arange(6.0).reshape(3, 2), status=status)


@pytest.mark.parametrize("status", list(TrialStatus))
def test_the_landing_is_the_last_sample_of_a_trial_that_ended_well(status):
    landing = [4.0, 5.0] if status is TrialStatus.OK else [np.nan, np.nan]
    np.testing.assert_array_equal(track(status).final_xy, landing)
    assert TrialStatus.from_code(status.code) is status
    assert status.value.endswith(".")


def test_an_unknown_status_is_refused_with_those_that_exist():
    with pytest.raises(InputError, match="'lost': one of ok, off_table"):
        TrialStatus.from_code("lost")


def test_lists_will_do_and_what_is_masked_or_none_was_not_seen():
    masked = np.ma.array([[0.0, 1.0], [2.0, 3.0]], mask=[[True, True], [False, False]])
    for xy in ([[None, None], [2, 3]], masked):
        track = EndpointTrack(times=[0, 1], endpoint_xy=xy, status=TrialStatus.OK)
        assert track.times.dtype == float
        assert np.isnan(track.endpoint_xy[0]).all()
        np.testing.assert_array_equal(track.final_xy, [2.0, 3.0])


@pytest.mark.parametrize(
    "values",
    [
        {"times": np.zeros(3)},
        {"endpoint_xy": np.zeros((2, 3))},
        {"times": np.zeros(0), "endpoint_xy": np.zeros((0, 2))},
        {"times": ["now", "later"]},
        {"endpoint_xy": None},
        {"nodes": np.zeros((2, 5, 2))},
        {"nodes": np.zeros((3, 5, 3))},
    ],
    ids=str,
)
def test_a_track_that_is_no_array_of_numbers_is_refused(values):
    good = {"times": [0.0, 1.0], "endpoint_xy": np.zeros((2, 2)), "status": TrialStatus.OK}
    with pytest.raises(InputError):
        EndpointTrack(**good | values)
