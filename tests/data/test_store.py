"""The store of all casts of a cable: each is kept as it is made, none twice."""

import dataclasses

import numpy as np
import pytest
from tests.data.stick_rig import COUNT, SETUP, StickRig

from cablecast.data.record import collect_dataset
from cablecast.data.store import CastStore
from cablecast.errors import DamagedFileError, InputError, UnreadableFileError


@pytest.fixture(scope="module")
def casts(tmp_path_factory):
    path = tmp_path_factory.mktemp("store") / "casts"
    return collect_dataset(path, StickRig(), SETUP, purpose="tune", count=COUNT)


def test_casts_come_out_as_they_went_in(casts, tmp_path):
    store = CastStore(SETUP, tmp_path / "store")
    assert store.add_dataset(casts) == COUNT
    again = CastStore(SETUP, tmp_path / "store").dataset()
    np.testing.assert_array_equal(again.actions, casts.actions)
    np.testing.assert_array_equal(again.rest_xy, casts.rest_xy)
    assert list(again.status) == list(casts.status)
    for row in range(COUNT):
        there, here = casts.track(row), again.track(row)
        np.testing.assert_array_equal(here.endpoint_xy, there.endpoint_xy)
        joints, known = again.measured_joints(row), casts.measured_joints(row)
        np.testing.assert_array_equal(joints.q, known.q)
    assert again.fingerprint == store.dataset().fingerprint
    # A cast is kept once.
    assert store.add_dataset(casts) == 0
    assert CastStore(SETUP, tmp_path / "store").add_dataset(casts) == 0
    assert len(store) == COUNT


def test_casts_of_another_set_up_and_simulated_ones_are_refused(casts, tmp_path):
    other = SETUP.with_motion(v_max=1.2)
    with pytest.raises(InputError, match="another set-up"):
        CastStore(other).add_dataset(casts)
    simulated = dataclasses.replace(casts, info=casts.info | {"kind": "sim"})
    with pytest.raises(InputError, match="were simulated"):
        CastStore(SETUP).add_dataset(simulated)
    CastStore(SETUP, tmp_path).add_dataset(casts)
    with pytest.raises(InputError, match=r"v_max is 1\.5 there and 1\.2 here"):
        CastStore(other, tmp_path)


def test_two_that_add_to_one_folder_never_overwrite_each_other(casts, tmp_path):
    first, second = CastStore(SETUP, tmp_path), CastStore(SETUP, tmp_path)
    first.add_dataset(casts)
    with pytest.raises(InputError, match="another process has added casts"):
        second.add_dataset(casts)
    assert len(CastStore(SETUP, tmp_path)) == COUNT


def test_a_damaged_or_missing_cast_is_said_by_name(casts, tmp_path):
    CastStore(SETUP, tmp_path).add_dataset(casts)
    file = tmp_path / "casts" / "00002.parquet"
    whole = file.read_bytes()
    for damaged in (whole[: len(whole) // 2], b""):
        file.write_bytes(damaged)
        with pytest.raises(DamagedFileError, match=r"00002\.parquet.*Restore it from a copy"):
            CastStore(SETUP, tmp_path)
    # Another cast is not taken for it.
    file.write_bytes((tmp_path / "casts" / "00001.parquet").read_bytes())
    with pytest.raises(DamagedFileError, match="must hold the rows 2 to 2"):
        CastStore(SETUP, tmp_path)

    # One that cannot be read is not called damaged, and those behind a missing one are known.
    file.unlink()
    file.mkdir()
    with pytest.raises(UnreadableFileError, match=r"00002\.parquet cannot be read"):
        CastStore(SETUP, tmp_path)
    file.rmdir()
    file.write_bytes(whole)
    (tmp_path / "casts" / "00001.parquet").unlink()
    with pytest.raises(DamagedFileError, match=r"00001\.parquet is missing, but 00002\.parquet"):
        CastStore(SETUP, tmp_path)


def test_what_was_taken_back_is_known_again(casts, tmp_path):
    store = CastStore(SETUP, tmp_path)
    store.add_dataset(casts)
    store.undo(1)
    again = CastStore(SETUP, tmp_path)
    assert again.undone == {1}
    assert len(again.dataset()) == len(again) - 1
    (tmp_path / "undone.json").write_text('{"undone": []}')
    with pytest.raises(DamagedFileError, match=r"undone\.json .* Restore it, or delete it"):
        CastStore(SETUP, tmp_path)


def test_what_two_took_back_is_taken_back(casts, tmp_path):
    CastStore(SETUP, tmp_path).add_dataset(casts)
    one, other = CastStore(SETUP, tmp_path), CastStore(SETUP, tmp_path)
    one.undo(0)
    other.undo(2)
    assert CastStore(SETUP, tmp_path).undone == other.undone == {0, 2}
