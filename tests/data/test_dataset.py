import dataclasses
import functools
import json
import random
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.dataset as pads
import pyarrow.parquet as pq
import pytest
import yaml
from tests.data import stick_engine, stick_rig
from tests.data.stick_engine import COUNT, SETUP, simulate
from tests.data.stick_rig import StickRig, collect
from tools.attack import damaged_bytes, damaged_json

from cablecast.data.dataset import read_dataset
from cablecast.data.schema import INFO_PATH
from cablecast.errors import CablecastError, DatasetError, UnreadableFileError
from cablecast.files import seal

SHARD = "data/chunk-000/file-002.parquet"


class MovedCameraRig(StickRig):
    """Equal by its description, but its camera has moved."""

    def _track(self, *arguments):
        track = super()._track(*arguments)
        return dataclasses.replace(track, endpoint_xy=track.endpoint_xy + 0.01)


@pytest.fixture
def copied(unbroken, tmp_path):
    return shutil.copytree(unbroken, tmp_path / "d")


def test_a_missing_dataset_is_named(tmp_path):
    with pytest.raises(DatasetError, match=r"nowhere is not a dataset: .*info.json is missing"):
        read_dataset(tmp_path / "nowhere")


def test_a_damaged_or_missing_shard_or_one_in_its_place_is_named(copied):
    shard = copied / SHARD
    whole = shard.read_bytes()
    for kept in (0, 3, 1000, -1):
        shard.write_bytes(whole[:kept])
        with pytest.raises(DatasetError, match=r"file-002.parquet is truncated or dam") as caught:
            read_dataset(copied)
        assert "\n" not in str(caught.value)
    shutil.copy(copied / "data/chunk-000/file-001.parquet", shard)
    with pytest.raises(DatasetError, match=r"file-002.parquet must hold the rows 120 to 179"):
        read_dataset(copied)
    shard.write_bytes(whole)
    change_rows(shard, "duration", lambda values: [2.0 * value for value in values])
    with pytest.raises(DatasetError, match=r"file-002.*its rows do not match their checksum"):
        read_dataset(copied)
    shard.unlink()
    with pytest.raises(DatasetError, match=r"file-002.parquet is missing"):
        read_dataset(copied)


@pytest.mark.parametrize("text", ["", "{", "7", "[" * 100_000, '{"complete": "no"}'])
def test_a_damaged_description_is_refused(copied, text):
    (copied / "meta/info.json").write_text(text)
    with pytest.raises(DatasetError, match=r"info.json is damaged") as caught:
        read_dataset(copied)
    assert "\n" not in str(caught.value)


def test_a_dataset_of_another_version_is_refused_by_its_version(copied):
    info = json.loads((copied / "meta/info.json").read_text())
    del info["sha256"]
    (copied / "meta/info.json").write_text(json.dumps(seal(info | {"schema_version": 99})))
    with pytest.raises(DatasetError, match=r"schema version 99: .*make the dataset anew"):
        read_dataset(copied)


def test_a_changed_description_is_refused(copied):
    file = copied / "meta/info.json"
    whole = json.loads(file.read_text())
    for change in (
        {"complete": "no"},
        {"shard_count": 10**9},
        {"shard_rows": 0},
        {"total_frames": True},
        {"settings": []},
        {"fingerprint": None},
    ):
        info = whole | change
        unsealed = {name: value for name, value in info.items() if name != "sha256"}
        for content in (info, seal(unsealed)):
            file.write_text(json.dumps(content))
            with pytest.raises(DatasetError, match="damaged"):
                read_dataset(copied)


def test_a_shard_of_a_dataset_of_equal_settings_is_detected_and_can_be_made_again(tmp_path):
    first = collect(tmp_path / "first", StickRig(), count=2)
    second = collect(tmp_path / "second", MovedCameraRig(), count=2)
    # The fingerprint is that of the rows, not of the settings alone.
    assert first.info["settings"] == second.info["settings"]
    assert first.fingerprint != second.fingerprint
    shard = tmp_path / "first/data/chunk-000/file-001.parquet"
    shutil.copy(tmp_path / "second/data/chunk-000/file-001.parquet", shard)
    for look in (read_dataset, lambda path: collect(path, count=2)):
        with pytest.raises(DatasetError, match=r"file-001.parquet is not the one"):
            look(tmp_path / "first")
    shard.unlink()
    np.testing.assert_array_equal(collect(tmp_path / "first", count=2).rest_xy, first.rest_xy)


def test_a_shard_of_a_dataset_of_other_settings_is_detected(copied, tmp_path):
    simulate(tmp_path / "other", setup=SETUP.with_motion(v_max=1.2))
    shutil.copy(tmp_path / "other" / SHARD, copied / SHARD)
    with pytest.raises(DatasetError, match="belongs to a dataset of other settings"):
        read_dataset(copied)


def change_rows(file, name, change):
    """Write a shard again with one column changed, as a spreadsheet would."""
    table = pq.read_table(file)
    column = pa.array(change(table[name].to_pylist()))
    table = table.set_column(table.schema.get_field_index(name), name, column)
    pq.write_table(table, file)


def test_card_statistics_and_description_are_those_of_the_rows(unbroken):
    # Parquet readers see one table of all shards.
    table = pads.dataset(unbroken / "data", format="parquet").to_table()
    assert sorted(table["index"].to_pylist()) == list(range(COUNT))
    _, front, body = (unbroken / "README.md").read_text().split("---\n", 2)
    values = yaml.safe_load(front)
    assert values["configs"] == [{"config_name": "default", "data_files": "data/*/*.parquet"}]
    assert "| `theta1` | rad |" in body
    stats = json.loads((unbroken / "meta/stats.json").read_text())
    dataset = read_dataset(unbroken)
    assert stats["theta2"]["min"] == [dataset.actions[:, 1].min()]
    assert stats["endpoint_x"]["mean"] == [np.mean(dataset.rest_xy[:, 0])]
    assert stats["index"]["count"] == [COUNT]
    # As LeRobot has it.
    info = json.loads((unbroken / "meta/info.json").read_text())
    first = info["data_path"].format(chunk_index=0, file_index=0)
    assert (unbroken / first).is_file()
    assert info["total_frames"] == COUNT
    assert info["splits"] == {"train": f"0:{COUNT}"}
    assert set(info["features"]) >= {"theta1", "endpoint_x", "status"}


def test_settings_of_another_version_are_refused_in_one_line(copied):
    dataset = read_dataset(copied)
    settings = dataset.info["settings"] | {"motion": {"warp_factor": 9}}
    dataset = dataclasses.replace(dataset, info=dataset.info | {"settings": settings})
    with pytest.raises(DatasetError, match=r"made by cablecast .*warp_factor.*make it anew"):
        _ = dataset.setup


def test_rows_are_those_of_a_mask_or_of_indices(unbroken):
    whole = read_dataset(unbroken)
    order = [4, 1, 4]
    some = whole.rows(order)
    for name in ("actions", "rest_xy", "status", "duration", "extent"):
        np.testing.assert_array_equal(getattr(some, name), getattr(whole, name)[order])
    assert (len(some), some.info["settings"]["count"], some.path) == (3, 3, None)
    assert (some.kind, some.setup) == (whole.kind, whole.setup)
    masked = whole.rows(np.arange(len(whole)) < 2)
    assert masked.fingerprint == whole.rows([0, 1]).fingerprint
    assert len({whole.fingerprint, some.fingerprint, masked.fingerprint}) == 3
    assert len(whole.rows([])) == 0
    for lacking in ([COUNT], [True, False]):
        with pytest.raises(DatasetError, match=f"has {COUNT} rows"):
            whole.rows(lacking)


def test_every_column_of_chosen_rows_is_theirs(tmp_path):
    collect(tmp_path, StickRig())
    whole = read_dataset(tmp_path)
    some = whole.rows([2, 0])
    assert some.extra.keys() == whole.extra.keys()
    assert [some.extra["times"][k] for k in (0, 1)] == [whole.extra["times"][k] for k in (2, 0)]


# Each takes some 10 ms. A damage that went unnoticed in one file of fifteen would be found.
DAMAGES = 30
# Choosing the actions anew takes a quarter of a second.
RESUMED_DAMAGES = 4


@pytest.fixture(scope="module", params=["simulated", "collected"])
def whole(request, tmp_path_factory):
    """Return a small dataset, a function that resumes it, and what it holds."""
    path = tmp_path_factory.mktemp(request.param) / "d"
    if request.param == "simulated":
        resume = functools.partial(stick_engine.simulate, count=40, shard_rows=20)
    else:
        resume = functools.partial(stick_rig.collect, count=2)
    resume(path)
    return path, resume, rows(read_dataset(path))


def rows(dataset):
    """All values of a dataset, comparable."""
    columns = (dataset.actions, dataset.rest_xy, dataset.duration, dataset.extent)
    arrays = [column.tolist() for column in columns]
    return repr((arrays, dataset.status.tolist(), dataset.extra, dataset.info["settings"]))


def damages(whole, tmp_path, pattern, seed, count=DAMAGES):
    """Yield copies of a dataset, each with one damaged file, and the name of the damage."""
    path, _, _ = whole
    rng = random.Random(seed)
    files = sorted(path.glob(pattern))
    assert files
    for number in range(count):
        copy = tmp_path / str(number)
        shutil.copytree(path, copy)
        file = rng.choice(files)
        damage = damaged_json if file.suffix == ".json" and number % 2 else damaged_bytes
        label, content = damage(file.read_bytes(), rng)
        (copy / file.relative_to(path)).write_bytes(content)
        yield copy, f"{file.name}: {label}"
        shutil.rmtree(copy)


def read_or_refuse(read, copy, label):
    """Return the rows of a damaged dataset; None where it was refused in one line."""
    try:
        return rows(read(copy))
    except CablecastError as error:
        text = str(error)
    assert text, label
    assert "\n" not in text, label
    assert len(text) < 1000, label
    return None


@pytest.mark.parametrize("pattern", ["meta/info.json", "data/**/*.parquet"])
def test_a_damaged_dataset_is_read_as_it_was_or_refused(whole, tmp_path, pattern):
    _, _, good = whole
    refused = 0
    for copy, label in damages(whole, tmp_path, pattern, seed=1):
        found = read_or_refuse(read_dataset, copy, label)
        assert found in (None, good), label
        refused += found is None
    # A bit in the padding of a file may mean nothing; most bits mean something.
    assert refused > DAMAGES / 2


def test_a_damaged_unfinished_dataset_is_resumed_as_it_was_or_refused(whole, tmp_path):
    path, resume, good = whole
    last = sorted(path.glob("data/**/*.parquet"))[-1].relative_to(path)
    for copy, label in damages(whole, tmp_path, "data/**/*-000.parquet", 2, RESUMED_DAMAGES):
        (copy / last).unlink()
        assert read_or_refuse(resume, copy, label) in (None, good), label


def test_a_damaged_description_is_never_resumed_with_other_rows(whole, tmp_path):
    _, resume, good = whole
    for copy, label in damages(whole, tmp_path, str(INFO_PATH), 3, RESUMED_DAMAGES):
        assert read_or_refuse(resume, copy, label) in (None, good), label


@pytest.mark.parametrize("name", ["README.md", "meta/stats.json"])
def test_files_for_people_decide_nothing(whole, tmp_path, name):
    _, _, good = whole
    for copy, label in damages(whole, tmp_path, name, 4, RESUMED_DAMAGES):
        assert rows(read_dataset(copy)) == good, label


@pytest.mark.parametrize("name", [str(INFO_PATH), "data/chunk-000/file-000.parquet"])
def test_a_file_that_the_system_refuses_is_not_called_damaged(whole, tmp_path, name):
    path, resume, _ = whole
    copy = tmp_path / "d"
    shutil.copytree(path, copy)
    file = copy / name
    file.unlink()
    # Whoever runs the tests may read everything, but nobody reads a folder as a file.
    file.mkdir()
    for read in (read_dataset, resume):
        with pytest.raises(UnreadableFileError, match="cannot be read: Is a dir") as caught:
            read(copy)
        for word in ("damaged", "delete", "missing"):
            assert word not in str(caught.value)
