import dataclasses

import numpy as np
import pytest

from cablecast.errors import DatasetError, InputError
from cablecast.motion.trajectory import joint_path
from cablecast.tuning.tracks import MeasuredTracks, has_measured_joints

# The fit of measured joints leaves less than this where they are exact (tests of the fit).
FIT = 2e-4


def with_extra(dataset, **columns):
    return dataclasses.replace(dataset, extra=dataset.extra | columns)


def test_samples_at_the_start_are_not_compared_and_all_others_are(dataset, good):
    assert not good.compared[:, 0].any()
    lengths = [len(times) for times in dataset.extra["times"]]
    rows = np.flatnonzero(dataset.status == "ok")
    assert good.compared.sum(axis=1).tolist() == [lengths[row] - 1 for row in rows]


def test_one_trial_alone_is_that_of_a_dataset_of_its_own(dataset):
    every = MeasuredTracks.from_dataset(dataset)
    lengths = [len(times) for times in dataset.extra["times"]]
    first = int(np.argmin(lengths))
    order = np.r_[first, np.delete(np.arange(len(dataset)), first)]
    ordered = dataset.rows(order)
    own, alone = MeasuredTracks.from_dataset(ordered.rows([0])), every.alone(first)
    assert alone.times.shape[1] < every.times.shape[1]
    for name in ("times", "endpoint_xy", "final_xy", "status", "actions"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(own, name))
    np.testing.assert_array_equal(alone.grip_path.knots, own.grip_path.knots)
    np.testing.assert_array_equal(alone.grip_path.coefficients, own.grip_path.coefficients)


def test_resting_points_are_those_of_the_rig(dataset, good):
    rows = np.flatnonzero(dataset.status == "ok")
    np.testing.assert_array_equal(good.final_xy, dataset.rest_xy[rows])


def test_a_track_that_leaves_the_table_is_compared_while_it_is_on_it(dataset):
    row, fallen = 0, 6
    track = np.array(dataset.extra["track_x"][row])
    track[fallen:] = 5.0
    status = dataset.status.astype("U20").copy()
    status[row] = "off_table"
    endpoint = dataset.rest_xy.copy()
    endpoint[row] = np.nan
    columns = dataset.extra["track_x"].copy()
    columns[row] = track
    changed = dataclasses.replace(
        with_extra(dataset, track_x=columns), status=status, rest_xy=endpoint
    )
    tracks = MeasuredTracks.from_dataset(changed)
    assert tracks.compared[row, 1:fallen].all()
    assert not tracks.compared[row, fallen:].any()
    assert np.isnan(tracks.final_xy[row]).all()


def test_a_turned_table_ends_where_its_own_edges_are(dataset):
    row, fallen = int(np.flatnonzero(dataset.status == "ok")[0]), 5
    track = np.array(dataset.extra["track_x"][row])
    # 1 m aside: on a table 2.75 m wide, but off one that is turned by a quarter.
    columns = dataset.extra["track_x"].copy()
    columns[row] = np.where(np.arange(len(track)) < fallen, track, 1.0)
    settings = dataset.info["settings"]
    workspace = settings["workspace"] | {"table_yaw_deg": 90.0}
    changed = dataclasses.replace(
        with_extra(dataset, track_x=columns),
        info=dataset.info | {"settings": settings | {"workspace": workspace}},
        status=np.where(np.arange(len(dataset)) == row, "off_table", dataset.status),
    )
    assert dataset.setup.workspace.half_width > 1.0 > changed.setup.workspace.half_width
    compared = MeasuredTracks.from_dataset(changed).compared[row]
    assert compared[1:fallen].all()
    assert not compared[fallen:].any()


def test_samples_that_the_camera_missed_are_not_compared(dataset):
    row = int(np.flatnonzero(dataset.status == "ok")[0])
    columns = dataset.extra["track_y"].copy()
    columns[row] = np.array(columns[row])
    columns[row][3:5] = np.nan
    tracks = MeasuredTracks.from_dataset(with_extra(dataset, track_y=columns))
    assert np.flatnonzero(~tracks.compared[row, : len(columns[row])]).tolist() == [0, 3, 4]


@pytest.mark.parametrize(("times", "expected"), [(0.1, 0.1), (0.05, 0.05), (1 / 60, 0.01)])
def test_the_engine_samples_on_the_grid_of_the_measured_times(good, times, expected):
    count = good.times.shape[1]
    even = np.broadcast_to(np.arange(count) * times, good.times.shape)
    assert dataclasses.replace(good, times=even).sample_dt() == expected


def test_the_reported_joints_are_simulated_where_there_are_any(dataset):
    commanded = MeasuredTracks.from_dataset(dataset, path_source="commanded").grip_path
    # An arm that follows exactly, but a tenth of a second late.
    times, q = [], []
    for row in range(len(dataset)):
        exact = joint_path(commanded[row], dataset.setup)
        times.append(np.append(0.0, exact.times + 0.1))
        q.append(np.concatenate([exact.q[:1], exact.q]).ravel())
    reported = with_extra(dataset, actual_times=times, actual_q=q)
    assert has_measured_joints(reported)
    assert not has_measured_joints(dataset)
    tracks = MeasuredTracks.from_dataset(reported)
    assert tracks.path_source == "measured"
    at = np.linspace(0.2, 1.2, 30)
    late = tracks.grip_path.evaluate(at)[..., :2]
    np.testing.assert_allclose(late, commanded.evaluate(at - 0.1)[..., :2], atol=FIT)
    # One trial without them takes nothing from the others.
    times[1] = q[1] = None
    with pytest.warns(UserWarning, match="1 of .* no measured motion, first trial 1: their comm"):
        mixed = MeasuredTracks.from_dataset(with_extra(dataset, actual_times=times, actual_q=q))
    assert mixed.path_source == "mixed"
    np.testing.assert_allclose(
        mixed.grip_path.evaluate(at)[[0, 1], :, :2],
        [late[0], commanded[1:2].evaluate(at)[0, :, :2]],
        atol=1e-9,
    )


def test_datasets_that_cannot_be_compared_are_refused(dataset):
    bare = dataclasses.replace(dataset, extra={})
    with pytest.raises(DatasetError, match="no track"):
        MeasuredTracks.from_dataset(bare)
    with pytest.raises(DatasetError, match="no measured joints"):
        MeasuredTracks.from_dataset(dataset, path_source="measured")
    with pytest.raises(InputError, match="one of auto, commanded, measured"):
        MeasuredTracks.from_dataset(dataset, path_source="guessed")
    with pytest.raises(DatasetError, match="has no trials"):
        MeasuredTracks.from_dataset(dataset.rows([]))
