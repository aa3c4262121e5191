"""An exported data set has the layout of LeRobot v3, and its numbers are those of the casts."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from cablecast.data.dataset import read_dataset
from cablecast.data.lerobot import (
    DATA_FILE,
    EPISODES_FILE,
    TASKS_FILE,
    VIDEO_FILE,
    Video,
    episodes_of,
    statistics,
)
from cablecast.errors import DatasetError, InputError
from cablecast.pipeline.export import export_dataset
from cablecast.pipeline.import_casts import import_casts
from cablecast.setup import Setup
from cablecast.vision.video import read_video, write_video

FPS, CAST_COUNT = 10, 3
# LeRobot stores 32 bits.
FLOAT32 = 1e-6


@pytest.fixture(scope="module")
def exported(casts, tmp_path_factory):
    return export_dataset(casts, tmp_path_factory.mktemp("exported") / "lerobot")


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """Return a cast whose free end is first seen 0.52 s after its joints started to turn."""
    joints = ",".join(f"q{k}_rad" for k in range(1, 7))
    rows = [f"cast,time_s,x_m,y_m,{joints}"]
    for tick in range(100):
        xy = f"0.1,{1.0 + 0.001 * tick:.3f}" if tick >= 26 else ","
        rows.append(f"a,{tick / 50:.2f},{xy},0,-1,1.5,-2,-1.5,{tick / 50:.2f}")
    table = tmp_path_factory.mktemp("late") / "table.csv"
    table.write_text("\n".join(rows) + "\n")
    return import_casts(table, Setup())


def test_an_episode_starts_with_a_motion_that_is_earlier_than_the_track(late):
    track = late.track(0)
    (episode,) = episodes_of(late, FPS)
    # Frames stay at the times of the track: the first whole one after the start is at 0.02 s.
    assert track.times[0] == pytest.approx(0.52)
    turned = episode["observation.state"][:, 5]
    assert turned == pytest.approx(0.02 + 0.1 * np.arange(len(turned)), abs=FLOAT32)
    assert episode["observation.endpoint_seen"].tolist() == [False] * 5 + [True] * (len(turned) - 5)
    first = np.tile(track.endpoint_xy[0], (6, 1))
    assert episode["observation.endpoint"][:6] == pytest.approx(first, abs=FLOAT32)
    assert episode["timestamp"] == pytest.approx(0.1 * np.arange(len(turned)))
    # Films start with the motion, at time 0.
    (filmed,) = episodes_of(late, FPS, with_films=True)
    turned = filmed["observation.state"][:, 5]
    assert turned == pytest.approx(0.1 * np.arange(len(turned)), abs=FLOAT32)
    assert filmed["observation.endpoint_seen"].tolist() == [t >= 0.52 for t in filmed["timestamp"]]


def rows_of(folder, file):
    return pq.read_table(folder / file).to_pylist()


def test_frames_hold_the_track_and_the_commanded_joints(casts, exported):
    frames = rows_of(exported, DATA_FILE)
    for row in range(CAST_COUNT):
        mine = [frame for frame in frames if frame["episode_index"] == row]
        track, joints = casts.track(row), casts.commanded_joints(row)
        assert [frame["observation.endpoint"] for frame in mine] == [
            pytest.approx(xy, abs=FLOAT32) for xy in track.endpoint_xy
        ]
        assert [frame["timestamp"] for frame in mine] == pytest.approx(track.times)
        after = [np.interp(0.1 * (k + 1), joints.times, joints.q[:, 0]) for k in range(len(mine))]
        assert [frame["action"][0] for frame in mine] == pytest.approx(after, abs=FLOAT32)
        assert [frame["next.done"] for frame in mine] == [False] * (len(mine) - 1) + [True]
        assert mine[-1]["next.success"] == (casts.status[row] == "ok")
        assert mine[0]["observation.cast"] == pytest.approx(casts.actions[row], abs=FLOAT32)
    assert [frame["index"] for frame in frames] == list(range(len(frames)))


def test_episodes_and_description_point_to_the_frames(exported):
    frames, episodes = rows_of(exported, DATA_FILE), rows_of(exported, EPISODES_FILE)
    info = json.loads((exported / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"]) == ("v3.0", FPS)
    assert (info["total_episodes"], info["total_frames"]) == (CAST_COUNT, len(frames))
    for episode in episodes:
        first, last = episode["dataset_from_index"], episode["dataset_to_index"]
        assert {frame["episode_index"] for frame in frames[first:last]} == {
            episode["episode_index"]
        }
        assert episode["length"] == last - first
    for name, feature in info["features"].items():
        value = frames[0][name]
        assert feature["shape"] == [len(value) if isinstance(value, list) else 1], name
    tasks = rows_of(exported, TASKS_FILE)
    assert [task["task_index"] for task in tasks] == [0]
    assert tasks[0]["task"] in episodes[0]["tasks"]


def test_the_library_of_data_sets_opens_what_export_and_collect_write(exported, casts, tmp_path):
    datasets = pytest.importorskip("datasets")
    # As the card of a data set says.
    there, collected = (
        datasets.load_dataset(
            "parquet", data_files=str(folder / "data/*/*.parquet"), cache_dir=str(tmp_path)
        )["train"]
        for folder in (exported, casts.path)
    )
    frames = rows_of(exported, DATA_FILE)
    assert len(there) == len(frames)
    assert there[5]["action"] == pytest.approx(frames[5]["action"])
    assert collected["theta1"] == pytest.approx(casts.actions[:, 0])
    # Tasks are the index of a table of pandas, which that library brings.
    tasks = pytest.importorskip("pandas").read_parquet(exported / TASKS_FILE)
    assert "cable_1" in tasks.index[0]
    assert tasks["task_index"].tolist() == [0]


def test_statistics_are_those_of_each_number():
    values = np.array([[0.0, 10.0], [1.0, 10.0], [2.0, 10.0]])
    stats = statistics(values)
    assert (stats["min"], stats["max"], stats["mean"]) == ([0, 10], [2, 10], [1, 10])
    assert (stats["count"], stats["q50"]) == ([3], [1, 10])


def clock(count):
    """Frames in which a white bar moves by 4 px each, and so tells which frame was taken."""
    for frame in range(count):
        picture = np.zeros((64, 4 * count + 16, 3), dtype=np.uint8)
        picture[:, 4 * frame : 4 * frame + 4] = 255
        yield picture


def test_films_follow_one_another_with_one_frame_per_frame_of_the_data(casts, tmp_path):
    rate = 30
    for number in range(CAST_COUNT):
        write_video(tmp_path / f"films/{number:06d}.mp4", clock(5 * rate), rate)
    out = export_dataset(casts, tmp_path / "out", films=tmp_path / "films")
    info, film = read_video(out / VIDEO_FILE)
    pictures = [frame for _, frame in film]
    data = rows_of(out, DATA_FILE)
    assert (info.rate, len(pictures)) == (FPS, len(data))
    seconds = [np.argmax(picture.mean(axis=(0, 2))) / 4 / rate for picture in pictures]
    # The last frame of a film is one frame before its end, and compression blurs the bar.
    assert seconds == pytest.approx([row["timestamp"] for row in data], abs=1.3 / rate)
    episodes = rows_of(out, EPISODES_FILE)
    starts = [row["videos/observation.images.top/from_timestamp"] for row in episodes]
    assert starts == pytest.approx([row["dataset_from_index"] / FPS for row in episodes])
    stats = json.loads((out / "meta/stats.json").read_text())["observation.images.top"]
    # Bars of 4 of 616 columns are white; compression blurs them a little.
    assert np.shape(stats["mean"]) == np.shape(stats["q99"]) == (3, 1, 1)
    assert np.ravel(stats["mean"]) == pytest.approx(4 / pictures[0].shape[1], rel=0.1)
    assert np.ravel(stats["max"]) == pytest.approx(1.0, abs=0.1)
    assert stats["count"] == [len(pictures)]
    counts = [row["stats/observation.images.top/count"] for row in episodes]
    assert counts == [[row["length"]] for row in episodes]


def test_colours_of_pictures_are_counted_in_the_order_of_lerobot():
    colors = np.zeros((2, 3, 256), dtype=int)
    # Red is half black and half white, green is grey, blue is white in the second episode only.
    colors[0, 0, [0, 255]] = 8
    colors[0, 1, 51] = 16
    colors[0, 2, 0] = 16
    colors[1] = colors[0]
    colors[1, 2] = np.roll(colors[0, 2], 255)
    video = Video(size=(4, 4), colors=colors)
    first, both = video.statistics(0), video.statistics()
    assert np.ravel(first["mean"]) == pytest.approx([0.5, 0.2, 0.0])
    assert np.ravel(first["std"]) == pytest.approx([0.5, 0.0, 0.0], abs=1e-9)
    assert np.ravel(both["mean"]) == pytest.approx([0.5, 0.2, 0.5])
    assert np.ravel(both["max"]) == pytest.approx([1.0, 0.2, 1.0])
    assert np.ravel(both["q01"]) == pytest.approx([0.0, 0.2, 0.0])
    assert (first["count"], both["count"]) == ([1], [2])


def test_missing_films_simulated_casts_and_full_folders_are_refused(
    casts, exported, unbroken, tmp_path
):
    (tmp_path / "films").mkdir()
    with pytest.raises(InputError, match=r"there is no video .*000000\.mp4"):
        export_dataset(casts, tmp_path / "out", films=tmp_path / "films")
    # Nothing is left behind.
    assert [path.name for path in tmp_path.iterdir()] == ["films"]
    with pytest.raises(DatasetError, match="simulated casts"):
        export_dataset(read_dataset(unbroken), exported.parent / "other")
    with pytest.raises(InputError, match="not empty"):
        export_dataset(casts, exported)
