import numpy as np
import pytest

from cablecast.data.dataset import read_dataset
from cablecast.data.schema import COLUMNS, track_extent
from cablecast.data.writer import DatasetWriter
from cablecast.errors import DatasetError


def some_columns(count):
    columns = {column.name: np.linspace(0.1, 0.2, count) for column in COLUMNS}
    return columns | {"index": np.arange(count), "status": ["occluded"] * count}


def test_the_extent_of_a_track_skips_what_was_not_seen():
    track = np.array([[[0.0, 1.0], [np.nan, np.nan], [-0.5, 1.2]], np.full((3, 2), np.nan)])
    extent = track_extent(track)
    np.testing.assert_array_equal(extent[0], [-0.5, 0.0, 1.0, 1.2])
    assert np.all(np.isnan(extent[1]))


def test_a_shard_of_the_wrong_size_is_not_written_and_settings_without_a_cable_are_named(tmp_path):
    writer = DatasetWriter(tmp_path / "d", kind="sim", settings={}, row_count=2, shard_rows=2)
    with writer:
        with pytest.raises(DatasetError, match="shard 0 needs 2 rows, not 3"):
            writer.write_shard(0, some_columns(3))
        writer.write_shard(0, some_columns(2))
        writer.finish()
    with pytest.raises(DatasetError, match=r"the settings of .* lack cable"):
        _ = read_dataset(tmp_path / "d").cable
