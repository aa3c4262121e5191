"""Seeded damage to every file of a dataset: it is read as written, or refused in one line."""

import functools
import random
import shutil

import pytest
import stick_engine
import stick_rig
from tools.attack import damaged_bytes, damaged_json

from cablecast.data.dataset import read_dataset
from cablecast.data.schema import INFO_PATH
from cablecast.errors import CablecastError

# Each takes some 10 ms. A damage that went unnoticed in one file of thirty would be found.
DAMAGES = 60
# Choosing the actions anew takes a quarter of a second.
RESUMED_DAMAGES = 6


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
    columns = (dataset.actions, dataset.endpoint_xy, dataset.duration, dataset.extent)
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
        with pytest.raises(OSError, match="cannot be read") as caught:
            read(copy)
        for word in ("damaged", "delete", "missing"):
            assert word not in str(caught.value)
