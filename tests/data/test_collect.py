import dataclasses
import errno
import json

import numpy as np
import pytest
from tests.data.killed import contents, run_and_kill
from tests.data.stick_rig import (
    CABLE,
    COUNT,
    NOISE,
    SERVO_DELAY,
    SETUP,
    ManyStickRig,
    StickRig,
    collect,
    collect_and_die,
)

import cablecast
from cablecast.cast import ControllerLog, TrialStatus
from cablecast.data import record as record_module
from cablecast.data import writer
from cablecast.data.dataset import read_dataset
from cablecast.data.record import sample_actions
from cablecast.errors import DatasetError, InputError, RigError, StoppedError
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import check_actions, feasible_ranges
from cablecast.motion.trajectory import plan_trajectory

# Files in the order in which they are renamed: info, the rows, stats, card, info.
FILE_COUNT = COUNT + 4
# The grip path ends within 1e-5 m of the action; the noise of the camera comes on top.
LANDING_TOLERANCE = 5 * NOISE
KILOBYTE = 1024


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    """Collect a dataset in one go; tests must not change it."""
    path = tmp_path_factory.mktemp("collected") / "d"
    collect(path)
    return path


def test_a_row_holds_the_action_the_track_and_both_joint_paths(unbroken):
    dataset = read_dataset(unbroken)
    assert len(dataset) == COUNT
    assert dataset.ok.sum() >= 2
    for row, values in enumerate(dataset.actions):
        action = Action.from_array(values)
        trajectory = plan_trajectory(action, SETUP)
        track = dataset.track(row)
        expected = StickRig()._track(trajectory, row)
        assert track.status is expected.status
        np.testing.assert_array_equal(track.times, expected.times)
        np.testing.assert_array_equal(track.endpoint_xy, expected.endpoint_xy)
        commanded, actual = dataset.commanded_joints(row), dataset.measured_joints(row)
        np.testing.assert_array_equal(commanded.q, trajectory.joint_path.q)
        np.testing.assert_array_equal(commanded.times, trajectory.joint_path.times)
        np.testing.assert_array_equal(actual.times, commanded.times + SERVO_DELAY)
        np.testing.assert_array_equal(actual.q, commanded.q)
        assert dataset.rig(row) == {"rig": "stick", "seed": 0}
        assert dataset.duration[row] == pytest.approx(trajectory.duration)
        if track.status is TrialStatus.OK:
            r2, psi = action.r2, action.psi
            tip = np.array([r2 * np.sin(action.theta2), r2 * np.cos(action.theta2)])
            tip += CABLE.length * np.array([np.sin(psi), np.cos(psi)])
            assert np.linalg.norm(dataset.rest_xy[row] - tip) < LANDING_TOLERANCE
        else:
            assert np.all(np.isnan(dataset.rest_xy[row]))


def test_a_rig_that_sees_no_joints_leaves_their_columns_empty(tmp_path):
    dataset = collect(tmp_path / "d", StickRig(sees_joints=False), count=2)
    assert dataset.measured_joints(0) is None
    assert dataset.commanded_joints(0) is not None


def test_nothing_moves_again_after_a_person_stopped_a_batch(tmp_path):
    rig = ManyStickRig(troubles=[(1, StoppedError("somebody pressed stop"))])
    with pytest.raises(RigError, match="somebody pressed stop"):
        collect(tmp_path / "d", rig)
    assert len(rig.batches) == 1
    assert rig.executed == [0, 1]


def test_many_trials_at_once_give_the_same_rows(unbroken, tmp_path):
    collect(tmp_path / "d", ManyStickRig())
    assert contents(tmp_path / "d") == contents(unbroken)


@pytest.mark.parametrize("moment", ["trial3", 0, 4, FILE_COUNT - 3, FILE_COUNT - 1])
def test_a_killed_and_resumed_collection_equals_an_unbroken_one(unbroken, tmp_path, moment):
    run_and_kill(collect_and_die, moment, tmp_path / "d")
    rig = StickRig()
    collect(tmp_path / "d", rig)
    assert contents(tmp_path / "d") == contents(unbroken)
    # Trials whose row was stored are not made again, and none of what is finished.
    stored = 3 if moment == "trial3" else min(max(moment - 1, 0), COUNT)
    assert rig.executed == list(range(stored, COUNT))
    rig = StickRig()
    assert len(collect(tmp_path / "d", rig)) == COUNT
    assert rig.executed == []


def test_a_killed_batch_loses_no_earlier_batch(unbroken, tmp_path, monkeypatch):
    run_and_kill(collect_and_die, "trial5", tmp_path / "d", ManyStickRig)
    kept = len(list((tmp_path / "d/data").rglob("file-*.parquet")))
    monkeypatch.setattr(record_module, "core_count", lambda: 1)
    monkeypatch.setattr(record_module, "_CASTS_PER_CORE", 2)
    rig = ManyStickRig()
    collect(tmp_path / "d", rig)
    assert contents(tmp_path / "d") == contents(unbroken)
    assert rig.executed == list(range(kept, COUNT))


@pytest.mark.parametrize(
    "trouble",
    [ValueError("no image"), TrialStatus.ABORTED, None],
    ids=["ValueError", "aborted", "no track"],
)
@pytest.mark.parametrize("kind", [StickRig, ManyStickRig])
def test_a_trial_that_fails_is_made_again_and_its_row_is_the_same(
    unbroken, tmp_path, trouble, kind
):
    rig = kind(troubles=[(2, trouble)])
    dataset = collect(tmp_path / "d", rig)
    whole = read_dataset(unbroken)
    assert rig.executed.count(2) == 2
    np.testing.assert_array_equal(dataset.rest_xy, whole.rest_xy)
    assert dataset.extra["track_x"] == whole.extra["track_x"]
    assert TrialStatus.ABORTED.code not in dataset.status
    if kind is StickRig:
        assert dataset.extra["attempt"] == [0, 0, 1, 0, 0, 0]


@pytest.mark.parametrize("kind", [StickRig, ManyStickRig])
def test_a_trial_that_keeps_failing_stops_the_collection_and_it_goes_on_there(
    unbroken, tmp_path, kind
):
    troubles = [(3, RigError("emergency stop")) for _ in range(10)]
    rig = kind(troubles=troubles)
    with pytest.raises(RigError, match=r"trial 3 failed 3 times.*emergency stop") as caught:
        collect(tmp_path / "d", rig)
    assert "\n" not in str(caught.value)
    kept = len(list((tmp_path / "d/data").rglob("file-*.parquet")))
    assert f"{kept} of {COUNT} trials are kept" in str(caught.value)
    assert kept >= 3
    again = StickRig()
    collect(tmp_path / "d", again)
    assert 3 in again.executed
    assert len(again.executed) == COUNT - kept
    assert contents(tmp_path / "d") == contents(unbroken)


def test_trials_of_a_batch_beside_a_failing_one_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(record_module, "core_count", lambda: COUNT)
    troubles = [(1, TrialStatus.ABORTED) for _ in range(10)]
    with pytest.raises(RigError, match=rf"{COUNT - 1} of {COUNT} trials are kept"):
        collect(tmp_path / "d", ManyStickRig(troubles=troubles))


@pytest.mark.parametrize("kind", [StickRig, ManyStickRig])
def test_a_full_disk_loses_no_finished_trial(unbroken, tmp_path, monkeypatch, kind):
    path = tmp_path / "d"
    room = [0]

    def used():
        return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())

    def write_bytes(file, content, write=writer.write_bytes):
        if used() + len(content) > room[0]:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(file, content)

    monkeypatch.setattr(writer, "write_bytes", write_bytes)
    monkeypatch.setattr(record_module, "core_count", lambda: 1)
    monkeypatch.setattr(record_module, "_CASTS_PER_CORE", 2)
    size = 2 if kind is ManyStickRig else 1
    # Enough for what is set aside and for one row and a half.
    row = (unbroken / "data/chunk-000/file-000.parquet").stat().st_size
    room[0] = size * record_module._ROW_BYTES_MAX + 2 * KILOBYTE + 3 * row // 2
    rig = kind()
    with pytest.raises(DatasetError, match=r"no more trials \(No space left on device\)"):
        collect(path, rig)
    made = rig.executed
    assert made == list(range(2))
    assert len(list((path / "data").rglob("file-*.parquet"))) == len(made)
    room[0] = 2**40
    rig = kind()
    collect(path, rig)
    assert rig.executed == list(range(len(made), COUNT))
    assert contents(path) == contents(unbroken)


def test_an_interrupt_is_no_failed_trial_and_no_trial_begins_without_room_for_its_row(
    tmp_path, monkeypatch
):
    def fsync(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    for kind in (StickRig, ManyStickRig):
        stopped = kind(troubles=[(0, KeyboardInterrupt())])
        with pytest.raises(KeyboardInterrupt):
            collect(tmp_path / "d", stopped)
        # That is no trial that failed, which would be made again.
        assert stopped.executed == [0]
    monkeypatch.setattr(record_module.os, "fsync", fsync)
    rig = StickRig()
    with pytest.raises(DatasetError, match="no room for another trial"):
        collect(tmp_path / "d", rig)
    assert rig.executed == []
    assert sorted(contents(tmp_path / "d")) == ["meta/info.json"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rig": StickRig(seed=4)}, "rig.seed is 0 there and 4 here"),
        ({"purpose": "real"}, "kind is 'tune' there and 'real' here"),
        ({"sampling": "grid"}, "sampling is 'uniform' there and 'grid' here"),
        ({"setup": SETUP.with_motion(v_max=1.2)}, "motion.v_max is 1.5 there and 1.2 here"),
    ],
)
def test_other_settings_are_refused_by_name(unbroken, options, words):
    before = contents(unbroken)
    with pytest.raises(DatasetError, match=words):
        collect(unbroken, **options)
    assert contents(unbroken) == before


def test_descriptions_that_cannot_be_stored_and_counts_below_one_are_refused_before_any_trial(
    tmp_path,
):
    rig = StickRig()
    for value in (float("nan"), object()):
        rig.description["camera"] = value
        with pytest.raises(RigError, match=r"description\['camera'\]"):
            collect(tmp_path / "d", rig)
    assert rig.executed == []
    for options in ({"count": 0}, {"repeats": 0}, {"attempts": 0}):
        with pytest.raises(InputError, match=r"= 0 "):
            collect(tmp_path / "d", **options)
    assert not (tmp_path / "d").exists()


def test_repeats_of_an_action_follow_one_another_and_differ_only_by_chance(tmp_path):
    actions = sample_actions("grid", 2, SETUP)
    dataset = collect(tmp_path / "d", purpose="repeat", actions=actions, count=None, repeats=3)
    assert dataset.extra["repeat"] == [0, 1, 2, 0, 1, 2]
    np.testing.assert_array_equal(dataset.actions, np.repeat(actions, 3, axis=0))
    tracks = [dataset.track(row).endpoint_xy for row in range(3)]
    assert np.abs(tracks[0] - tracks[1]).max() > 0
    assert np.abs(tracks[0] - tracks[1]).max() < 10 * NOISE


@pytest.mark.parametrize("sampling", ["uniform", "grid"])
def test_sampled_actions_are_feasible_and_fill_their_ranges(sampling):
    actions = sample_actions(sampling, 300, SETUP, seed=2)
    assert check_actions(actions, SETUP).mask.all()
    ranges = feasible_ranges(SETUP)
    wrist = actions[:, 3] - actions[:, 1]
    for values, (low, high) in zip(
        (actions[:, 0], actions[:, 1], actions[:, 2], wrist),
        (ranges.theta1, ranges.theta2, ranges.r2, ranges.wrist),
        strict=True,
    ):
        assert np.all((values >= low - 1e-9) & (values <= high + 1e-9))
        # Each third of the range is met, though limits thin some of them out.
        assert np.all(np.histogram(values, 3, (low - 1e-9, high + 1e-9))[0] > 10)
    other = sample_actions(sampling, 300, SETUP, seed=3)
    assert not np.array_equal(np.sort(actions, axis=0), np.sort(other, axis=0))


def test_uniform_actions_begin_alike_and_those_of_a_grid_have_no_order_that_drift_could_follow():
    few, many = (sample_actions("uniform", count, SETUP) for count in (20, 400))
    np.testing.assert_array_equal(many[:20], few)
    actions = sample_actions("grid", 200, SETUP)
    # 200 shuffled values have a correlation with their place below 0.25 with 99.9 %.
    for column in range(4):
        place = np.arange(len(actions))
        assert abs(np.corrcoef(place, actions[:, column])[0, 1]) < 0.25


def test_the_card_explains_every_column(unbroken):
    card = (unbroken / "README.md").read_text()
    info = json.loads((unbroken / "meta/info.json").read_text())
    dataset = read_dataset(unbroken)
    for name in dataset.extra:
        assert f"| `{name}` |" in card
        assert name in info["features"]
    assert "D_tune" in card
    assert "endless" not in card


def test_a_collection_goes_on_after_an_update_of_the_package(tmp_path, monkeypatch):
    """Versions are recorded, and never compared."""
    with monkeypatch.context() as before:
        before.setattr(cablecast, "__version__", "0.0.9")
        first = collect(tmp_path / "d")
    sorted(tmp_path.glob("d/data/**/*.parquet"))[1].unlink()
    kept = contents(tmp_path / "d/data")
    second = collect(tmp_path / "d")
    assert kept.items() <= contents(tmp_path / "d/data").items()
    assert second.actions.tolist() == first.actions.tolist()
    assert second.setup == SETUP
    # What the user has changed is another matter.
    with pytest.raises(DatasetError, match=r"motion.control_dt is 0.008 there and 0.01 here"):
        collect(tmp_path / "d", setup=SETUP.with_motion(control_dt=0.01))


class LoggingRig(StickRig):
    """Reports what its controller said in every other trial."""

    def execute(self, trajectory):
        track = super().execute(trajectory)
        if self.executed[-1] % 2:
            return track
        path = track.joint_path
        ones = np.ones(len(path.times))
        log = ControllerLog(times=path.times, target_q=path.q, speed_scaling=ones, safety_bits=ones)
        return dataclasses.replace(track, controller_log=log)


def test_some_trials_may_have_a_log_and_others_none(tmp_path):
    collect(tmp_path / "d", LoggingRig())
    logs = [read_dataset(tmp_path / "d").controller_log(row) for row in range(COUNT)]
    assert [log is not None for log in logs] == [row % 2 == 0 for row in range(COUNT)]
