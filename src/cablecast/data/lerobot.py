"""LeRobot v3 data sets: one episode per cast, one frame per sample of the track.

Layout and names follow version 3.0 of the format (huggingface/lerobot, `lerobot.datasets`): frames
in `data/`, episodes in `meta/episodes/`, tasks in `meta/tasks.parquet`, films in `videos/`.
"""

import dataclasses
import json
import pathlib
import string
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cast import TrialStatus
from cablecast.conventions import Array
from cablecast.data.dataset import Dataset
from cablecast.errors import DatasetError
from cablecast.files import write_json, write_text
from cablecast.motion.action import ACTION_NAMES
from cablecast.motion.trajectory import joints_at

VERSION = "v3.0"
VIDEO_KEY = "observation.images.top"
DATA_FILE = "data/chunk-000/file-000.parquet"
EPISODES_FILE = "meta/episodes/chunk-000/file-000.parquet"
TASKS_FILE = "meta/tasks.parquet"
VIDEO_FILE = f"videos/{VIDEO_KEY}/chunk-000/file-000.mp4"

_CARD_FILE = pathlib.Path(__file__).with_name("lerobot_card.md")

_QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}

_TASKS_INDEX = {
    "index_columns": ["task"],
    "column_indexes": [],
    "columns": [
        {
            "name": name,
            "field_name": name,
            "pandas_type": kind,
            "numpy_type": array,
            "metadata": None,
        }
        for name, kind, array in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ],
    "pandas_version": "2.0.0",
}

_FEATURES: dict[str, dict[str, Any]] = {
    "observation.state": {"dtype": "float32"},
    "observation.endpoint": {"dtype": "float32", "shape": [2], "names": ["x", "y"]},
    "observation.endpoint_seen": {"dtype": "bool", "shape": [1], "names": None},
    "observation.cast": {"dtype": "float32", "shape": [5], "names": list(ACTION_NAMES)},
    "action": {"dtype": "float32"},
    "next.done": {"dtype": "bool", "shape": [1], "names": None},
    "next.success": {"dtype": "bool", "shape": [1], "names": None},
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    "frame_index": {"dtype": "int64", "shape": [1], "names": None},
    "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    "index": {"dtype": "int64", "shape": [1], "names": None},
    "task_index": {"dtype": "int64", "shape": [1], "names": None},
}
"""Features of a frame; those of the joints have as many values as the arm has joints."""

Episode = dict[str, NDArray]
"""Values of each feature of one cast, each of shape [frame, ...]."""


def episodes_of(dataset: Dataset, fps: int, *, with_films: bool = False) -> list[Episode]:
    """Return the episode of each cast.

    The track is sampled every 1/fps: interpolated between the samples of the rig, and kept where
    the endpoint was not seen. An episode starts with the track, or as many whole frames earlier as
    the motion does; with films it starts at time 0, as they do. The state is the reported joints,
    or the commanded ones where none were reported; the action is the commanded set point of the
    next frame, or the reported one where there is none. Joints keep still after the motion.

    Raises:
        DatasetError: A cast has no track or no joints.
    """
    episodes = []
    first = 0
    for row in range(len(dataset)):
        track = dataset.track(row)
        measured, commanded = dataset.measured_joints(row), dataset.commanded_joints(row)
        state, target = measured or commanded, commanded or measured
        if state is None or target is None:
            raise DatasetError(
                f"{dataset.path or 'the dataset'} holds no joints of trial {row}: a LeRobot "
                "episode needs them"
            )
        early = max(track.times[0] - target.times[0], 0.0)
        start = 0.0 if with_films else track.times[0] - np.floor(early * fps + 1e-6) / fps
        count = int(np.floor((track.times[-1] - start) * fps + 1e-6)) + 1
        timestamps = np.arange(count) / fps
        times = start + timestamps
        endpoint, seen = _resampled(track.times, track.endpoint_xy, times)
        done = np.arange(count) == count - 1
        columns = {
            "observation.state": joints_at(state, times),
            "observation.endpoint": endpoint,
            "observation.endpoint_seen": seen,
            "observation.cast": np.tile(np.nan_to_num(dataset.actions[row]), (count, 1)),
            "action": joints_at(target, times + 1.0 / fps),
            "next.done": done,
            "next.success": done & (track.status is TrialStatus.OK),
            "timestamp": timestamps,
            "frame_index": np.arange(count),
            "episode_index": np.full(count, row),
            "index": first + np.arange(count),
            "task_index": np.zeros(count, dtype=int),
        }
        first += count
        episodes.append(
            {n: np.asarray(values, dtype=_FEATURES[n]["dtype"]) for n, values in columns.items()}
        )
    return episodes


@dataclasses.dataclass(frozen=True, kw_only=True)
class Video:
    """Film of all episodes.

    Attributes:
        size: Height and width [pixel].
        colors: Number of pixels of each value of red, green and blue, shape [episode, 3, 256].
    """

    size: tuple[int, int]
    colors: NDArray[np.int64]

    def statistics(self, episode: int | None = None) -> dict[str, Any]:
        """Return what LeRobot keeps of an episode's pictures, or of all, in shares of white.

        Each has the shape [3, 1, 1], but for the number of frames.
        """
        rows = slice(None) if episode is None else slice(episode, episode + 1)
        counts = self.colors[rows].sum(axis=0)
        values = np.arange(256) / 255.0
        share = counts / counts.sum(axis=1, keepdims=True)
        mean = share @ values
        below = np.cumsum(share, axis=1)
        stats = {
            "min": values[np.argmax(counts > 0, axis=1)],
            "max": values[255 - np.argmax(counts[:, ::-1] > 0, axis=1)],
            "mean": mean,
            "std": np.sqrt(np.maximum(share @ values**2 - mean**2, 0.0)),
            **{k: values[np.argmax(below >= q, axis=1)] for k, q in _QUANTILES.items()},
        }
        height, width = self.size
        frames = {"count": [int(counts[0].sum()) // (height * width)]}
        return {name: row.reshape(3, 1, 1).tolist() for name, row in stats.items()} | frames


def write_tables(
    folder: pathlib.Path,
    dataset: Dataset,
    episodes: list[Episode],
    fps: int,
    video: Video | None,
    tasks: Sequence[str] = (),
) -> None:
    """Write everything but the films into an empty folder.

    Args:
        folder: The folder.
        dataset: Casts of the episodes, or of some of them.
        episodes: Values of each cast.
        fps: Frames per second.
        video: Film of all episodes, if there is one.
        tasks: Sentence of each task that episodes name by its index; one for all by default.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    for file in (DATA_FILE, EPISODES_FILE, TASKS_FILE):
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
    joined = {name: np.concatenate([episode[name] for episode in episodes]) for name in _FEATURES}
    pq.write_table(_frames_table(joined), folder / DATA_FILE, compression="snappy")
    tasks = tasks or (f"Cast the free end of {dataset.cable.name} onto the table.",)
    rows = [
        _episode_row(episode, tasks[int(episode["task_index"][0])], fps, video)
        for episode in episodes
    ]
    pq.write_table(pa.Table.from_pylist(rows), folder / EPISODES_FILE, compression="snappy")
    # LeRobot reads the tasks with pandas, where they are the index of the table.
    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": list(tasks)})
    table = table.replace_schema_metadata({"pandas": json.dumps(_TASKS_INDEX)})
    pq.write_table(table, folder / TASKS_FILE)
    arm = dataset.setup.arm
    joints = {"shape": [arm.joint_count], "names": list(arm.joint_names)}
    features = {name: {**joints, **feature} for name, feature in _FEATURES.items()}
    if video is not None:
        features[VIDEO_KEY] = {
            "dtype": "video",
            "shape": [*video.size, 3],
            "names": ["height", "width", "channels"],
            "info": {
                "video.fps": fps,
                "video.height": video.size[0],
                "video.width": video.size[1],
                "video.channels": 3,
                "video.codec": "h264",
                "video.pix_fmt": "yuv444p" if any(side % 2 for side in video.size) else "yuv420p",
                "video.is_depth_map": False,
                "has_audio": False,
            },
        }
    info = {
        "codebase_version": VERSION,
        "robot_type": arm.model,
        "total_episodes": len(episodes),
        "total_frames": len(joined["index"]),
        "total_tasks": len(tasks),
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None
        if video is None
        else "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
        "features": features,
    }
    stats: dict[str, Any] = {name: statistics(values) for name, values in joined.items()}
    if video is not None:
        stats[VIDEO_KEY] = video.statistics()
    write_json(folder / "meta/info.json", info)
    write_json(folder / "meta/stats.json", stats)
    write_text(folder / "README.md", lerobot_card(dataset, info))


def statistics(values: NDArray) -> dict[str, list[float]]:
    """Return what LeRobot keeps of a feature: range, mean, deviation, count and quantiles."""
    numbers = np.asarray(values, dtype=float).reshape(len(values), -1)
    stats = {
        "min": numbers.min(axis=0),
        "max": numbers.max(axis=0),
        "mean": numbers.mean(axis=0),
        "std": numbers.std(axis=0),
        "count": np.array([len(numbers)]),
        **{name: np.quantile(numbers, share, axis=0) for name, share in _QUANTILES.items()},
    }
    return {name: row.tolist() for name, row in stats.items()}


def lerobot_card(dataset: Dataset, info: Mapping[str, Any]) -> str:
    """Return the card of an exported data set."""
    cable, source = dataset.cable, dataset.info
    template = string.Template(_CARD_FILE.read_text(encoding="utf-8"))
    return template.substitute(
        cable=json.dumps(cable.name)[1:-1],
        length=f"{cable.length:g}",
        count=info["total_episodes"],
        kind=source["kind"],
        fingerprint=source["fingerprint"],
        rig=source["settings"].get("rig", {}).get("rig", "unknown"),
        fps=info["fps"],
    )


def _frames_table(joined: Mapping[str, NDArray]) -> Any:
    import pyarrow as pa

    arrays = {}
    for name, values in joined.items():
        size = values.size // len(values)
        flat = pa.array(values.ravel())
        arrays[name] = flat if size == 1 else pa.FixedSizeListArray.from_arrays(flat, size)
    return pa.table(arrays)


def _episode_row(episode: Episode, task: str, fps: int, video: Video | None) -> dict[str, Any]:
    first, length = int(episode["index"][0]), len(episode["index"])
    row: dict[str, Any] = {
        "episode_index": int(episode["episode_index"][0]),
        "tasks": [task],
        "length": length,
        "data/chunk_index": 0,
        "data/file_index": 0,
        "dataset_from_index": first,
        "dataset_to_index": first + length,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    if video is not None:
        # The films of all episodes lie one after the other in one file.
        row |= {
            f"videos/{VIDEO_KEY}/chunk_index": 0,
            f"videos/{VIDEO_KEY}/file_index": 0,
            f"videos/{VIDEO_KEY}/from_timestamp": first / fps,
            f"videos/{VIDEO_KEY}/to_timestamp": (first + length) / fps,
        }
        pictures = video.statistics(row["episode_index"])
        row |= {f"stats/{VIDEO_KEY}/{key}": value for key, value in pictures.items()}
    for name, values in episode.items():
        row |= {f"stats/{name}/{key}": value for key, value in statistics(values).items()}
    return row


def _resampled(known: Array, xy: Array, times: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the endpoint at other times, and whether it was seen about then."""
    finite = np.all(np.isfinite(xy), axis=1)
    if not np.any(finite):
        return np.zeros((len(times), 2)), np.zeros(len(times), dtype=bool)
    # Between two samples the endpoint counts as seen if it was in both, before the first it is not.
    seen = np.interp(times, known, finite.astype(float)) > 1.0 - 1e-6
    seen &= times >= known[0] - 1e-6
    resampled = np.stack([np.interp(times, known[finite], axis) for axis in xy[finite].T], axis=-1)
    last = np.maximum.accumulate(np.where(seen, np.arange(len(times)), -1))
    kept = resampled[np.maximum(last, 0)]
    return np.where(seen[:, None], resampled, kept), seen
