"""Casts that were recorded elsewhere become a dataset that tuning reads as its own."""

import csv

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cablecast.cast import TrialStatus
from cablecast.data.recordings import ACTION_COLUMNS, read_recordings
from cablecast.errors import DatasetError, InputError
from cablecast.files import SIZE_MAX
from cablecast.motion.casting import Action
from cablecast.motion.trajectory import plan_trajectory
from cablecast.pipeline.import_casts import import_casts
from cablecast.pipeline.tune import tune
from cablecast.setup import Setup
from cablecast.tuning.tracks import MeasuredTracks
from cablecast.tuning.tune import TuneConfig

SETUP = Setup()
CAST_COUNT = 3
# A grip path fitted to exact poses at 125 Hz follows them to a tenth of a millimetre [m].
FIT_TOLERANCE = 1e-4


def table_of(casts, motion):
    """Rows of samples as somebody else would have recorded them."""
    rows = []
    for number in range(len(casts)):
        track, joints = casts.track(number), casts.commanded_joints(number)
        path = plan_trajectory(Action.from_array(casts.actions[number]), SETUP).grip_path
        samples = {
            round(t, 6): {"x_m": x, "y_m": y}
            for t, (x, y) in zip(track.times, track.endpoint_xy, strict=True)
        }
        for tick, time in enumerate(joints.times):
            row = samples.setdefault(round(time, 6), {})
            if motion == "joints":
                row |= {f"q{k + 1}_rad": q for k, q in enumerate(joints.q[tick])}
            elif motion == "grip":
                x, y, z, yaw, _ = path.evaluate([time])[0, 0]
                row |= {"grip_x_m": x, "grip_y_m": y, "grip_z_m": z, "grip_yaw_rad": yaw}
        if motion == "action":
            samples[0.0] |= dict(zip(ACTION_COLUMNS, casts.actions[number][:4], strict=True))
        rows += [
            {"cast": f"take {number}", "time_s": time} | samples[time] for time in sorted(samples)
        ]
    return rows


def write_table(rows, path):
    names = list(dict.fromkeys(name for row in rows for name in row))
    if path.suffix == ".parquet":
        pq.write_table(pa.table({n: [row.get(n) for row in rows] for n in names}), path)
        return path
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(rows)
    return path


@pytest.mark.parametrize(("motion", "suffix"), [("joints", ".csv"), ("grip", ".parquet")])
def test_tracks_and_motions_are_those_that_were_recorded(casts, tmp_path, motion, suffix):
    table = write_table(table_of(casts, motion), tmp_path / f"table{suffix}")
    imported = import_casts(table, SETUP, out=tmp_path / "out")
    assert len(imported) == CAST_COUNT
    assert imported.rest_xy == pytest.approx(casts.rest_xy, nan_ok=True)
    there, here = (
        MeasuredTracks.from_dataset(casts, path_source="commanded"),
        MeasuredTracks.from_dataset(imported),
    )
    assert here.path_source == "measured"
    times = np.arange(0.0, 2.0, 0.05)
    difference = here.grip_path.evaluate(times) - there.grip_path.evaluate(times)
    assert np.abs(difference[..., :2]).max() < FIT_TOLERANCE
    assert here.endpoint_xy[here.compared] == pytest.approx(there.endpoint_xy[there.compared])
    if motion == "joints":
        assert imported.measured_joints(0).q == pytest.approx(casts.commanded_joints(0).q)


def test_imported_casts_of_a_hand_tune_the_simulator(casts, tmp_path):
    table = write_table(table_of(casts, "grip"), tmp_path / "table.csv")
    config = TuneConfig(generations=2)
    imported = import_casts(table, SETUP)
    with pytest.raises(DatasetError, match="no action of trial 0"):
        MeasuredTracks.from_dataset(imported, path_source="commanded")
    tuned = tune(imported, config=config, segment_count=10, dt=2e-3)
    assert tuned.dynamics.servo is None
    # The casts were made with these parameters, where the search starts.
    assert tuned.metrics["validation"]["default"]["mean_pct"] < 1.0


def test_an_action_stands_for_a_motion_that_nobody_measured(casts, tmp_path):
    rows, said = [row | {"grip_yaw_deg": 3.0} for row in table_of(casts, "action")], []
    imported = import_casts(write_table(rows, tmp_path / "table.csv"), SETUP, report=said.append)
    # A column that is nearly known is named.
    assert any("nothing is read of the columns grip_yaw_deg" in line for line in said)
    assert imported.actions == pytest.approx(casts.actions)
    assert MeasuredTracks.from_dataset(imported).path_source == "commanded"


def test_a_stated_pace_is_read_and_an_empty_cell_means_1(casts, tmp_path):
    rows = table_of(casts, "action")
    stated = [row for row in rows if "r2_m" in row]
    for row, pace in zip(stated, (0.4, "", 1.1), strict=True):
        row["pace"] = pace
    imported = import_casts(write_table(rows, tmp_path / "table.csv"), SETUP)
    assert imported.actions[:, 4].tolist() == [0.4, 1.0, 1.1]
    stated[0]["pace"] = 7.0
    lines = []
    read_recordings(write_table(rows, tmp_path / "table.csv"), SETUP, lines.append)
    assert "'take 0'" in lines[0]
    assert "pace = 7 is outside [0.05, 3]" in lines[0]


def rows_with(x_of, times=None):
    times = np.arange(0.0, 1.0, 0.1) if times is None else times
    action = {"theta1_rad": -0.5, "theta2_rad": 0.5, "r2_m": 0.6, "psi_rad": 0.5}
    return [{"cast": "a", "time_s": t, "x_m": x_of(t), "y_m": 1.0} | action for t in times]


@pytest.mark.parametrize(
    ("x_of", "times", "status"),
    [
        (lambda t: 0.2, None, TrialStatus.OK),
        (lambda t: t, None, TrialStatus.OCCLUDED),
        (lambda t: 0.12 * t, np.arange(0.0, 3.0, 0.25), TrialStatus.OCCLUDED),
        (lambda t: 0.2 if t < 0.5 else "", None, TrialStatus.OCCLUDED),
        (lambda t: 4 * t, None, TrialStatus.OFF_TABLE),
    ],
    ids=["at rest", "still moving", "moving with few looks", "hidden", "off the table"],
)
def test_the_end_of_a_cast_is_read_from_its_track(x_of, times, status, tmp_path):
    table = write_table(rows_with(x_of, times), tmp_path / "table.csv")
    assert read_recordings(table, SETUP)[0].cast.status is status


@pytest.mark.parametrize(
    ("x_of", "status"),
    [(lambda t: 0.2, TrialStatus.OK), (lambda t: t, TrialStatus.OCCLUDED)],
    ids=["at rest", "moving"],
)
def test_a_marker_that_is_lost_a_moment_before_the_end_was_seen_at_rest(x_of, status, tmp_path):
    rows = rows_with(lambda t: x_of(t) if t < 0.75 else "")
    (one,) = read_recordings(write_table(rows, tmp_path / "table.csv"), SETUP)
    track = one.cast.track
    assert track.status is status
    assert track.times[-1] == pytest.approx(0.7)
    assert np.all(np.isfinite(track.endpoint_xy))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows: [row.pop("y_m") for row in rows], "lacks the columns y_m"),
        (lambda rows: rows[3].update(x_m="fast"), "x_m = 'fast' in row 4"),
        (lambda rows: [row.update(time_s=-t) for t, row in enumerate(rows)], r"row \d+ \(time"),
        (lambda rows: [row.update(time_s="") for row in rows], r"row 1 \(time_s = nan\)"),
        (lambda rows: [row.update(x_m="") for row in rows], "seen 0 times"),
        (lambda rows: [row.update(theta1_rad=-9.5) for row in rows], r"a.*theta1"),
        (lambda rows: [row.pop("r2_m") for row in rows], "lacks r2_m"),
        (lambda rows: [row.update(r2_m="") for row in rows], "neither joints, nor a grip"),
        (lambda rows: rows.clear(), "holds no casts|lacks the columns"),
    ],
)
def test_a_bad_table_is_refused_in_one_line(change, words, tmp_path):
    rows = rows_with(lambda t: 0.2)
    change(rows)
    table = write_table(rows, tmp_path / "table.csv")
    with pytest.raises(InputError, match=words) as refused:
        read_recordings(table, SETUP)
    assert "\n" not in str(refused.value)


def test_a_table_may_be_larger_than_a_file_that_a_person_writes(tmp_path):
    rows = rows_with(lambda t: 0.2, np.arange(0.0, 1.4, 0.01))
    table = write_table([row | {"note": "x" * 2**17} for row in rows], tmp_path / "table.csv")
    assert table.stat().st_size > 16 * SIZE_MAX
    assert len(read_recordings(table, SETUP)[0].cast.track.times) == len(rows)


@pytest.mark.parametrize("name", ["none.csv", "none.parquet", "broken.parquet"])
def test_a_file_that_cannot_be_read_is_refused(name, tmp_path):
    (tmp_path / "broken.parquet").write_bytes(b"PAR1 and nothing else")
    with pytest.raises(InputError, match=r"no file|no Parquet file"):
        read_recordings(tmp_path / name, SETUP)


LAG = 0.03


def log_of_a_controller(troubles=True):
    """Return the rows of three casts as a controller logs them, and the numbers of bad rows."""
    rng = np.random.default_rng(3)
    rows, bad = [], []
    for number, theta in enumerate((-0.5, -0.4, -0.6)):
        action = Action(theta, 0.4, 0.62, 0.6)
        commanded = plan_trajectory(action, SETUP).joint_path
        times = np.cumsum(rng.uniform(0.010, 0.034, 120))
        times = times[times < commanded.times[-1] + 0.5]
        for tick, time in enumerate(times):
            q = [np.interp(time - LAG, commanded.times, commanded.q[:, k]) for k in range(6)]
            row = {"cast": f"take {number}", "time_s": time, "x_m": 0.2, "y_m": 1.0}
            row |= {f"q{k + 1}_rad": angle for k, angle in enumerate(q)}
            row |= dict(zip(ACTION_COLUMNS, action.to_array()[:4], strict=True))
            if troubles and tick == 20:
                rows.append(dict(row))
            if troubles and tick in (30, 40, 50, 60):
                changes = {
                    30: {"q2_rad": 1e154},
                    40: {"time_s": time - 0.4},
                    50: {"q3_rad": float(row["q3_rad"]) + 0.8},
                    60: {"time_s": "nan"},
                }
                row |= changes[tick]
                bad.append(len(rows) + 1)
            rows.append(row)
    return rows, bad


def test_a_log_as_controllers_write_it_is_taken_and_what_is_not_sound_is_named(tmp_path):
    rows, bad = log_of_a_controller()
    lines = []
    table = write_table(rows, tmp_path / "table.csv")
    imported = import_casts(table, SETUP, report=lines.append)
    assert len(imported) == 3
    assert f"row {bad[0]} (q2_rad = 1e+154) and 3 more" in lines[0]
    assert "1 rows repeat the time of the row before" in lines[1]
    assert len(lines) == 6
    clean, _ = log_of_a_controller(troubles=False)
    whole = import_casts(write_table(clean, tmp_path / "clean.csv"), SETUP)
    for cast in range(3):
        kept, all_of_it = imported.measured_joints(cast), whole.measured_joints(cast)
        assert len(kept.times) == len(all_of_it.times) - 4
        assert np.isin(kept.times, all_of_it.times).all()


def test_a_heading_that_is_seen_less_often_than_the_grip_is_that_of_the_looks_beside_it(
    casts, tmp_path
):
    rows = table_of(casts, "grip")
    whole = read_recordings(write_table(rows, tmp_path / "whole.csv"), SETUP)
    for tick, row in enumerate(row for row in rows if "grip_x_m" in row):
        for name in ("grip_yaw_rad", "grip_z_m"):
            if tick % 4:
                del row[name]
    some = read_recordings(write_table(rows, tmp_path / "some.csv"), SETUP)
    for one, other in zip(whole, some, strict=True):
        np.testing.assert_array_equal(one.cast.grip[0], other.cast.grip[0])
        np.testing.assert_allclose(one.cast.grip[1], other.cast.grip[1], atol=0.02)
        assert np.ptp(other.cast.grip[1][:, 3]) > 0.5


@pytest.mark.parametrize(
    ("motion", "hidden", "words"),
    [
        ("joints", [f"q{joint}_rad" for joint in range(1, 7)], "the joints moved unseen for 0.6"),
        ("grip", ["grip_x_m", "grip_y_m"], "the grip moved unseen for 0.6"),
        ("grip", ["grip_yaw_rad"], "the grip moved unseen for 0.6"),
    ],
)
def test_a_cast_that_moved_unseen_is_left_out_and_named(casts, motion, hidden, words, tmp_path):
    rows, lines = table_of(casts, motion), []
    for row in rows:
        if row["cast"] == "take 0" and 0.3 < row["time_s"] < 0.9:
            for name in hidden:
                row.pop(name, None)
    kept = read_recordings(write_table(rows, tmp_path / "table.csv"), SETUP, lines.append)
    assert [cast.name for cast in kept] == ["take 1", "take 2"]
    assert f"'take 0': {words}" in lines[0]
    assert "the cast is left out" in lines[0]


def test_joints_and_looks_of_two_files_may_follow_each_other(casts, tmp_path):
    rows = table_of(casts, "joints")
    joints = [{k: v for k, v in row.items() if k not in ("x_m", "y_m")} for row in rows]
    joints = [row for row in joints if "q1_rad" in row]
    looks = [{k: v for k, v in row.items() if "_rad" not in k} for row in rows if "x_m" in row]
    said = []
    table = write_table(joints + looks, tmp_path / "two.csv")
    first, *_ = read_recordings(table, SETUP, report=said.append)
    assert len(first.cast.track.times) == len(casts.track(0).times)
    assert first.cast.track.times[0] == 0.0
    assert not any("cannot be used" in line for line in said)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda row: row.update(x_m=row.get("y_m"), y_m=row.get("x_m")), "m from the grip, and"),
        (lambda row: row.update(q1_rad=row.get("q1_rad", 0.0) + np.pi / 2), "is base_yaw_deg that"),
        (lambda row: row.update(q7_rad=0.0), "q7_rad, and the arm of the lab file 6 joints"),
    ],
    ids=["axes swapped", "base turned", "a joint more"],
)
def test_an_end_that_the_cable_does_not_reach_from_the_grip_is_refused(
    casts, tmp_path, change, words
):
    rows = table_of(casts, "joints")
    for row in rows:
        change(row)
    with pytest.raises(InputError, match=words):
        read_recordings(write_table(rows, tmp_path / "table.csv"), SETUP)


def test_a_table_with_semicolons_tabs_utf_16_or_trailing_commas_is_read(tmp_path):
    table = write_table(rows_with(lambda t: 0.2), tmp_path / "table.csv")
    expected = read_recordings(table, SETUP)[0].cast.track.endpoint_xy
    text = table.read_text()
    head, *lines = text.splitlines()
    others = {
        "trailing commas": "\n".join([head, *(f"{line}," for line in lines)]).encode(),
        "semicolons and decimal commas": text.replace(",", ";").replace(".", ",").encode(),
        "tabs": text.replace(",", "\t").encode(),
        "UTF-16": text.encode("utf-16"),
        "no measurement": (text + "a,0.95,NA,n/a,,,,\n").encode(),
    }
    for name, content in others.items():
        table.write_bytes(content)
        found = read_recordings(table, SETUP)[0].cast.track.endpoint_xy
        np.testing.assert_array_equal(found, expected, err_msg=name)
    table.write_text("\n".join([head, lines[0], lines[1].replace("0.2", "0,2"), *lines[2:]]))
    with pytest.raises(InputError, match=r"line 3 of .* has too many cells"):
        read_recordings(table, SETUP)
    table.write_text(text.replace("theta1_rad", "x_m"))
    with pytest.raises(InputError, match="has two columns x_m"):
        read_recordings(table, SETUP)


def test_a_grip_that_turns_faster_or_farther_than_any_is_in_degrees(casts, tmp_path):
    rows = table_of(casts, "grip")
    for row in rows:
        if "grip_yaw_rad" in row:
            row["grip_yaw_rad"] *= np.degrees(1.0)
    with pytest.raises(InputError, match=r"grip_yaw_rad goes to .* is it in degrees\?"):
        read_recordings(write_table(rows, tmp_path / "table.csv"), SETUP)


UPTIME = 3047.69


def test_rows_of_another_time_than_the_cast_are_dropped_and_counted(tmp_path):
    rows = rows_with(lambda t: 0.2, np.arange(0.0, 2.0, 0.1))
    for head in ([UPTIME] * 8, [UPTIME, UPTIME + 0.1], [-50.0] * 3):
        said = []
        stale = [rows[0] | {"time_s": time} for time in head]
        table = write_table(stale + rows, tmp_path / "table.csv")
        (one,) = read_recordings(table, SETUP, said.append)
        assert len(one.cast.track.times) == len(rows)
        words = f"row 1 (time {head[0]:g} s, far from the others) and {len(head) - 1} more of"
        assert words in said[0]
    said = []
    stray = [*rows[:3], rows[3] | {"time_s": 1e5}, *rows[4:]]
    (one,) = read_recordings(write_table(stray, tmp_path / "table.csv"), SETUP, said.append)
    assert len(one.cast.track.times) == len(rows) - 1
    assert "row 4 (time 100000 s" in said[0]


@pytest.mark.parametrize("clock", [UPTIME, 1.7e9])
def test_times_on_a_clock_of_their_own_are_refused_with_the_cast(clock, tmp_path):
    rows = rows_with(lambda t: 0.2)
    zeros = [dict(row, time_s=0.0) for row in rows[:3]]
    rows = [row | {"time_s": row["time_s"] + clock} for row in rows]
    for table_rows in (rows, zeros + rows):
        table = write_table(table_rows, tmp_path / "table.csv")
        with pytest.raises(
            InputError, match=r"cast 'a': its times begin at \d+.* subtract"
        ) as said:
            read_recordings(table, SETUP)
        assert "inf" not in str(said.value)


@pytest.mark.parametrize(
    ("columns", "scale", "words"),
    [
        (["time_s"], 1e3, "rows are 8 s apart in the median, above 2 s: is time_s in seconds"),
        (
            [f"q{joint}_rad" for joint in range(1, 7)],
            180 / np.pi,
            "rad = -?[0-9.]+, beyond 12.5664 rad: is it in degrees",
        ),
    ],
)
def test_a_table_in_other_units_is_refused_in_one_line_that_asks_for_them(
    casts, tmp_path, columns, scale, words
):
    rows = [
        {name: value * (scale if name in columns else 1) for name, value in row.items()}
        for row in table_of(casts, "joints")
    ]
    said = []
    with pytest.raises(InputError, match=rf"'take 0': .*{words}.*\(2 more casts cannot be used"):
        read_recordings(write_table(rows, tmp_path / "table.csv"), SETUP, said.append)
    assert said == []
