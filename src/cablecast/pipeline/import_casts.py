"""import_casts: a dataset to tune with, from casts that others recorded."""

import json
import os
import pathlib
from collections.abc import Callable
from typing import Any

from cablecast.cast import EndpointTrack
from cablecast.data.dataset import Dataset, read_dataset
from cablecast.data.mocap import MocapNames
from cablecast.data.recordings import Recording, file_digest, read_recordings
from cablecast.data.schema import SCHEMA_VERSION
from cablecast.data.store import track_row
from cablecast.data.writer import DatasetWriter
from cablecast.pipeline.places import folder_or_temporary
from cablecast.runs.folder import record_run
from cablecast.setup import Setup


def import_casts(
    table: str | os.PathLike[str],
    setup: Setup,
    *,
    out: str | os.PathLike[str] | None = None,
    report: Callable[[str], None] = lambda line: None,
    mocap: MocapNames | None = None,
) -> Dataset:
    """Make a dataset of kind "tune" of casts that were recorded elsewhere; see `read_recordings`.

    It is kept in a folder unless `out` is None. `mocap` names the points of takes of Motive or
    Vicon. `report` is told in one line what is left out.

    Raises:
        InputError: There is no such file, or it cannot be understood.
        DatasetError: The folder holds something else.
    """
    table = pathlib.Path(table)
    recordings = read_recordings(table, setup, report, mocap)
    rig = {"rig": "import", "file": table.name, "sha256": file_digest(table)}
    if mocap is not None:
        rig |= {"end": mocap.end, "grip": list(mocap.grip), "frame": file_digest(mocap.frame)}
    with folder_or_temporary(out) as folder:
        writer = DatasetWriter(
            folder,
            kind="tune",
            settings={
                "schema_version": SCHEMA_VERSION,
                **setup.to_settings(),
                "rig": rig,
                "count": len(recordings),
                "repeats": 1,
            },
            row_count=len(recordings),
            shard_rows=len(recordings),
        )
        with writer:
            if not writer.was_complete:
                rows = [_row(number, cast, rig) for number, cast in enumerate(recordings)]
                writer.write_shard(0, {name: [row[name] for row in rows] for name in rows[0]})
                writer.finish()
        dataset = read_dataset(folder)
        if out is not None:
            record_run(folder, "import", dataset.settings.values, dataset.status_counts)
    return dataset


def _row(number: int, cast: Recording, rig: dict[str, Any]) -> dict[str, Any]:
    track = EndpointTrack(times=cast.times, endpoint_xy=cast.endpoint_xy, status=cast.status)
    return {
        "index": number,
        **track_row(cast.action, cast.duration, track),
        "repeat": 0,
        "actual_times": cast.joint_times,
        "actual_q": None if cast.q is None else cast.q.ravel(),
        "grip_times": cast.grip_times,
        "grip_pose": None if cast.grip_poses is None else cast.grip_poses.ravel(),
        "attempt": 0,
        "rig": json.dumps({**rig, "cast": cast.name}, sort_keys=True, ensure_ascii=False),
    }
