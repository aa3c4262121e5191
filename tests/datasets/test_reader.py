import json
import shutil

import numpy as np
import pytest
import yaml
from stick_engine import COUNT

from cablecast.datasets import read_dataset
from cablecast.errors import DatasetError

SHARD = "data/chunk-000/file-002.parquet"


@pytest.fixture
def copied(unbroken, tmp_path):
    return shutil.copytree(unbroken, tmp_path / "d")


def test_a_missing_dataset_is_named(tmp_path):
    with pytest.raises(DatasetError, match=r"nowhere is not a dataset: .*info.json is missing"):
        read_dataset(tmp_path / "nowhere")


@pytest.mark.parametrize("kept", [0, 3, 1000, -1])
def test_a_truncated_shard_is_named(copied, kept):
    shard = copied / SHARD
    shard.write_bytes(shard.read_bytes()[:kept])
    with pytest.raises(DatasetError, match=r"file-002.parquet is truncated or damaged") as caught:
        read_dataset(copied)
    assert "\n" not in str(caught.value)


def test_a_flipped_bit_in_the_data_is_detected(copied):
    shard = copied / SHARD
    content = bytearray(shard.read_bytes())
    content[600] ^= 0x10
    shard.write_bytes(content)
    with pytest.raises(DatasetError, match=r"file-002.parquet"):
        read_dataset(copied)


def test_a_missing_shard_is_named(copied):
    (copied / SHARD).unlink()
    with pytest.raises(DatasetError, match=r"file-002.parquet is missing"):
        read_dataset(copied)


def test_a_shard_in_the_place_of_another_is_detected(copied):
    shutil.copy(copied / "data/chunk-000/file-001.parquet", copied / SHARD)
    with pytest.raises(DatasetError, match=r"file-002.parquet must hold the rows 120 to 179"):
        read_dataset(copied)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"schema_version": 99}'])
def test_a_damaged_or_newer_description_is_refused(copied, text):
    (copied / "meta/info.json").write_text(text)
    with pytest.raises(DatasetError, match=r"info.json is damaged|schema version 99"):
        read_dataset(copied)


def test_an_unknown_status_is_refused(copied):
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(copied / SHARD)
    column = table.schema.get_field_index("status")
    table = table.set_column(column, "status", pa.array(["lost"] * len(table)))
    pq.write_table(table, copied / SHARD)
    with pytest.raises(DatasetError, match="unknown trial status 'lost'"):
        read_dataset(copied)


def test_parquet_readers_see_one_table_of_all_shards(unbroken):
    import pyarrow.dataset as pads

    table = pads.dataset(unbroken / "data", format="parquet").to_table()
    assert len(table) == COUNT
    assert sorted(table["index"].to_pylist()) == list(range(COUNT))


def test_the_card_begins_with_front_matter_that_points_to_the_shards(unbroken):
    _, front, body = (unbroken / "README.md").read_text().split("---\n", 2)
    values = yaml.safe_load(front)
    assert values["configs"] == [{"config_name": "default", "data_files": "data/*/*.parquet"}]
    assert "| `theta1` | rad |" in body


def test_the_statistics_are_those_of_the_rows(unbroken):
    stats = json.loads((unbroken / "meta/stats.json").read_text())
    dataset = read_dataset(unbroken)
    assert stats["theta2"]["min"] == [dataset.actions[:, 1].min()]
    assert stats["endpoint_x"]["mean"] == [np.mean(dataset.endpoint_xy[:, 0])]
    assert stats["index"]["count"] == [COUNT]


def test_the_description_follows_the_layout_of_lerobot(unbroken):
    info = json.loads((unbroken / "meta/info.json").read_text())
    first = info["data_path"].format(chunk_index=0, file_index=0)
    assert (unbroken / first).is_file()
    assert info["total_frames"] == COUNT
    assert info["splits"] == {"train": f"0:{COUNT}"}
    assert set(info["features"]) >= {"theta1", "endpoint_x", "status"}


def test_settings_of_another_version_are_refused_in_one_line(copied):
    info = json.loads((copied / "meta/info.json").read_text())
    info["settings"]["motion"] = {"warp_factor": 9}
    (copied / "meta/info.json").write_text(json.dumps(info))
    dataset = read_dataset(copied)
    with pytest.raises(DatasetError, match=r"made by cablecast .*warp_factor.*simulate it again"):
        _ = dataset.motion_config
