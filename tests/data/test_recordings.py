"""Casts that were recorded elsewhere become a dataset that tuning reads as its own."""

import csv

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cablecast.cast import TrialStatus
from cablecast.data.record import collect_dataset
from cablecast.data.recordings import read_recordings
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import DatasetError, InputError
from cablecast.motion.action import Action
from cablecast.motion.trajectory import plan_trajectory
from cablecast.pipeline.import_casts import import_casts
from cablecast.pipeline.tune import tune
from cablecast.rigs.engine import RigEngine
from cablecast.setup import Setup
from cablecast.tuning.tracks import MeasuredTracks
from cablecast.tuning.tune import TuneConfig

SETUP = Setup()
CAST_COUNT = 3
# A grip path fitted to exact poses at 125 Hz follows them to a tenth of a millimetre [m].
FIT_TOLERANCE = 1e-4


@pytest.fixture(scope="module")
def casts(tmp_path_factory):
    rig = RigEngine(EngineWarp(segment_count=10, dt=2e-3), SETUP)
    out = tmp_path_factory.mktemp("casts") / "tune-data"
    return collect_dataset(out, rig, SETUP, purpose="tune", count=CAST_COUNT)


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
            names = ("theta1_rad", "theta2_rad", "r2_m", "psi_rad")
            samples[0.0] |= dict(zip(names, casts.actions[number], strict=True))
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


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("motion", ["joints", "grip"])
def test_tracks_and_motions_are_those_that_were_recorded(casts, tmp_path, motion, suffix):
    table = write_table(table_of(casts, motion), tmp_path / f"table{suffix}")
    imported = import_casts(table, SETUP, out=tmp_path / "out")
    assert len(imported) == CAST_COUNT
    assert imported.endpoint_xy == pytest.approx(casts.endpoint_xy, nan_ok=True)
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
    config = TuneConfig(coarse_generations=1, fine_generations=1)
    imported = import_casts(table, SETUP)
    tuned = tune(imported, config=config, segment_count=10, dt=2e-3)
    assert tuned.dynamics.servo is None
    # The casts were made with these parameters, where the search starts.
    assert tuned.metrics["validation"]["default"]["mean_pct"] < 1.0


def test_an_action_stands_for_a_motion_that_nobody_measured(casts, tmp_path):
    table = write_table(table_of(casts, "action"), tmp_path / "table.csv")
    imported = import_casts(table, SETUP)
    assert imported.actions == pytest.approx(casts.actions)
    assert MeasuredTracks.from_dataset(imported).path_source == "commanded"


def test_a_motion_without_an_action_cannot_be_commanded(casts, tmp_path):
    imported = import_casts(write_table(table_of(casts, "grip"), tmp_path / "table.csv"), SETUP)
    with pytest.raises(DatasetError, match="no action of trial 0"):
        MeasuredTracks.from_dataset(imported, path_source="commanded")


def rows_with(x_of, times=None):
    times = np.arange(0.0, 1.0, 0.1) if times is None else times
    return [
        {
            "cast": "a",
            "time_s": t,
            "x_m": x_of(t),
            "y_m": 1.0,
            "theta1_rad": -0.5,
            "theta2_rad": 0.5,
            "r2_m": 0.6,
            "psi_rad": 0.5,
        }
        for t in times
    ]


@pytest.mark.parametrize(
    ("x_of", "status"),
    [
        (lambda t: 0.2, TrialStatus.OK),
        (lambda t: t, TrialStatus.OCCLUDED),
        (lambda t: 0.2 if t < 0.5 else "", TrialStatus.OCCLUDED),
        (lambda t: 4 * t, TrialStatus.OFF_TABLE),
    ],
    ids=["at rest", "still moving", "hidden", "off the table"],
)
def test_the_end_of_a_cast_is_read_from_its_track(x_of, status, tmp_path):
    table = write_table(rows_with(x_of), tmp_path / "table.csv")
    assert read_recordings(table, SETUP)[0].status is status


@pytest.mark.parametrize(
    ("x_of", "status"),
    [(lambda t: 0.2, TrialStatus.OK), (lambda t: t, TrialStatus.OCCLUDED)],
    ids=["at rest", "moving"],
)
def test_a_marker_that_is_lost_a_moment_before_the_end_was_seen_at_rest(x_of, status, tmp_path):
    rows = rows_with(lambda t: x_of(t) if t < 0.75 else "")
    (one,) = read_recordings(write_table(rows, tmp_path / "table.csv"), SETUP)
    assert one.status is status
    assert one.times[-1] == pytest.approx(0.7)
    assert np.all(np.isfinite(one.endpoint_xy))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows: [row.pop("y_m") for row in rows], "lacks the columns y_m"),
        (lambda rows: rows[3].update(x_m="fast"), "x_m = 'fast' in row 4"),
        (lambda rows: rows[3].update(time_s=0.0), "times must ascend"),
        (lambda rows: rows[3].update(time_s=""), "has no time"),
        (lambda rows: [row.update(x_m="") for row in rows], "seen 0 times"),
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


@pytest.mark.parametrize("name", ["none.csv", "none.parquet", "broken.parquet"])
def test_a_file_that_cannot_be_read_is_refused(name, tmp_path):
    (tmp_path / "broken.parquet").write_bytes(b"PAR1 and nothing else")
    with pytest.raises(InputError, match=r"no file|no Parquet file"):
        read_recordings(tmp_path / name, SETUP)
