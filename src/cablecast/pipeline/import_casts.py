"""import_casts: a dataset to tune with, from casts that others recorded."""

import json
import os
import pathlib
from collections.abc import Callable
from typing import Any

from cablecast.data.dataset import Dataset, read_dataset
from cablecast.data.mocap import MocapNames
from cablecast.data.recordings import Recording, file_digest, read_recordings
from cablecast.data.store import cast_row
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
                rows = [_row(number, one, rig) for number, one in enumerate(recordings)]
                names = dict.fromkeys(name for row in rows for name in row)
                writer.write_shard(0, {name: [row.get(name) for row in rows] for name in names})
                writer.finish()
        dataset = read_dataset(folder)
        if out is not None:
            record_run(folder, "import", dataset.settings.values, dataset.status_counts)
    return dataset


def _row(number: int, recording: Recording, rig: dict[str, Any]) -> dict[str, Any]:
    return {
        "index": number,
        **cast_row(recording.cast),
        "repeat": 0,
        "attempt": 0,
        "rig": json.dumps({**rig, "cast": recording.name}, sort_keys=True, ensure_ascii=False),
    }
