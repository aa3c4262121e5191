"""The generations of a search on the disk: what was stored is answered, and nothing else."""

import json

import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.reading import seal
from cablecast.tuning.checkpoint import Checkpoint

CANDIDATES = np.random.default_rng(0).random((4, 10))
LOSSES = np.array([0.1, 0.2, 1 / 3, 0.4])


@pytest.fixture
def file(tmp_path):
    """Two generations on the disk."""
    checkpoint = Checkpoint(tmp_path / "generations.json")
    checkpoint.store("coarse", CANDIDATES, LOSSES, 1.5)
    checkpoint.store("fine", CANDIDATES / 2, LOSSES / 2, 0.5)
    return tmp_path / "generations.json"


def refusal(file):
    with pytest.raises(InputError) as caught:
        Checkpoint(file)
    text = str(caught.value)
    assert "\n" not in text
    assert str(file) in text
    assert "delete it to restart the search" in text
    return text


def test_stored_losses_are_answered_bit_by_bit(file):
    checkpoint = Checkpoint(file)
    assert checkpoint.seconds == 2.0
    np.testing.assert_array_equal(checkpoint.answer("coarse", CANDIDATES), LOSSES)
    np.testing.assert_array_equal(checkpoint.answer("fine", CANDIDATES / 2), LOSSES / 2)
    assert checkpoint.answer("fine", CANDIDATES) is None


def test_without_a_file_nothing_is_answered(tmp_path):
    assert Checkpoint(None).answer("coarse", CANDIDATES) is None
    assert Checkpoint(tmp_path / "none.json").answer("coarse", CANDIDATES) is None


def test_other_candidates_and_other_stages_are_refused(file):
    for stage, candidates in (("coarse", np.nextafter(CANDIDATES, 1.0)), ("fine", CANDIDATES)):
        with pytest.raises(InputError, match=r"generation 0 of .* holds other candidates"):
            Checkpoint(file).answer(stage, candidates)


def test_a_loss_that_was_changed_is_not_believed(file):
    values = json.loads(file.read_text())
    values["generations"][0]["losses"][2] = 1e-9
    file.write_text(json.dumps(values))
    assert "does not match its checksum" in refusal(file)


@pytest.mark.parametrize("kept", [0, 1, 100, -3])
def test_a_truncated_file_is_named(file, kept):
    file.write_bytes(file.read_bytes()[:kept])
    assert "is damaged" in refusal(file)


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "3",
        "[" * 100_000,
        '{"a":' * 100_000,
        '{"generations": [' + "[" * 900 + "]" * 900 + "]}",
    ],
    ids=["list", "number", "deep list", "deep mapping", "nested"],
)
def test_files_that_hold_something_else_are_named(file, text):
    file.write_text(text)
    refusal(file)


@pytest.mark.parametrize(
    "generations",
    [
        None,
        3,
        [3],
        [{"stage": "coarse"}],
        [{"stage": "coarse", "candidates": [["x"]], "losses": [0.1], "seconds": 1.0}],
        [{"stage": "coarse", "candidates": [[0.1], [0.2, 0.3]], "losses": [1, 2], "seconds": 1.0}],
        [{"stage": "coarse", "candidates": [[0.1]], "losses": [0.1, 0.2], "seconds": 1.0}],
        [{"stage": "coarse", "candidates": [[0.1]], "losses": 0.1, "seconds": 1.0}],
        [{"stage": "coarse", "candidates": [[10**400]], "losses": [0.1], "seconds": 1.0}],
    ],
    ids=str,
)
def test_content_that_is_no_search_is_refused_though_its_checksum_matches(file, generations):
    file.write_text(json.dumps(seal({"generations": generations})))
    refusal(file)
