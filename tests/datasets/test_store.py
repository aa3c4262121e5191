"""The store of casts that a session learns from: none is ever overlooked or overwritten."""

import pytest

from cablecast.datasets.schema import ACTION_COLUMNS, ENDPOINT_COLUMNS, EXTENT_COLUMNS
from cablecast.datasets.store import CastStore, StoredCast
from cablecast.errors import DamagedFileError
from cablecast.setup import Setup

SETUP = Setup()
COUNT = 4


def cast(number):
    values = dict.fromkeys((*ACTION_COLUMNS, *ENDPOINT_COLUMNS, *EXTENT_COLUMNS), 0.1 * number)
    return StoredCast(purpose="aim", values=values | {"status": "ok", "duration": 1.0})


@pytest.fixture
def folder(tmp_path):
    """Store some casts."""
    store = CastStore(SETUP, tmp_path)
    for number in range(COUNT):
        store.add(cast(number))
    return tmp_path


def test_stored_casts_come_back_in_their_order(folder):
    store = CastStore(SETUP, folder)
    assert [stored.values for stored in store.casts] == [cast(n).values for n in range(COUNT)]


def test_casts_behind_a_missing_one_are_neither_overlooked_nor_overwritten(folder):
    files = sorted((folder / "casts").iterdir())
    files[1].unlink()
    with pytest.raises(DamagedFileError, match=r"00001.json is missing, but 00002.json is there"):
        CastStore(SETUP, folder)
    # The way out that the message names.
    for file, free in zip(files[2:], files[1:], strict=False):
        file.rename(free)
    assert len(CastStore(SETUP, folder)) == COUNT - 1


def test_nobody_is_told_that_a_damaged_cast_is_made_again(folder):
    file = folder / "casts" / "00002.json"
    file.write_bytes(file.read_bytes().replace(b"0.2", b"0.3", 1))
    with pytest.raises(DamagedFileError, match=r"00002.json is damaged.*Restore it") as caught:
        CastStore(SETUP, folder)
    assert "makes it again" not in str(caught.value)
