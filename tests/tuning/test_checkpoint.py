"""The generations of a search on the disk: what was stored is answered, and nothing else."""

import json

import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.files import seal
from cablecast.runs.folder import Parts
from cablecast.tuning.search import StoredSteps

CANDIDATES = np.random.default_rng(0).random((4, 10))
LOSSES = np.array([0.1, 0.2, 1 / 3, 0.4])


def refuse(candidates):
    raise AssertionError("a stored generation was evaluated again")


def answer(checkpoint, stage="coarse", candidates=CANDIDATES, evaluate=refuse):
    return checkpoint.losses(stage, candidates, evaluate)


@pytest.fixture
def parts(tmp_path):
    """Two generations on the disk."""
    parts = Parts(tmp_path / "generations")
    checkpoint = StoredSteps(parts)
    answer(checkpoint, evaluate=lambda _: LOSSES)
    answer(checkpoint, "fine", CANDIDATES / 2, lambda _: LOSSES / 2)
    return parts


@pytest.fixture
def file(parts):
    """Return the first generation."""
    return parts.file("0000")


def refusal(file):
    with pytest.raises(InputError) as caught:
        answer(StoredSteps(Parts(file.parent)))
    text = str(caught.value)
    assert "\n" not in text
    assert str(file) in text
    assert "Delete it, and the same command makes it again" in text
    return text


def test_stored_losses_are_answered_bit_by_bit(parts):
    checkpoint = StoredSteps(parts)
    for stage, candidates, expected in (
        ("coarse", CANDIDATES, LOSSES),
        ("fine", CANDIDATES / 2, LOSSES / 2),
    ):
        losses, is_new = answer(checkpoint, stage, candidates)
        np.testing.assert_array_equal(losses, expected)
        assert not is_new
    assert checkpoint.seconds == sum(parts.get(name)["seconds"] for name in ("0000", "0001"))
    assert answer(checkpoint, "fine", evaluate=lambda _: LOSSES)[1]


def test_without_a_folder_nothing_is_stored():
    for checkpoint in (StoredSteps(None), StoredSteps(None)):
        assert answer(checkpoint, evaluate=lambda _: LOSSES)[1]


def test_a_generation_that_is_missing_is_evaluated_again(parts, file):
    file.unlink()
    assert answer(StoredSteps(parts), evaluate=lambda _: LOSSES)[1]
    assert not answer(StoredSteps(parts))[1]


def test_other_candidates_and_other_stages_are_refused(parts):
    for stage, candidates in (("coarse", np.nextafter(CANDIDATES, 1.0)), ("fine", CANDIDATES)):
        with pytest.raises(InputError, match=r"generation 0 in .* holds other candidates"):
            answer(StoredSteps(parts), stage, candidates)


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"stage": "coarse"},
        {"stage": "fine", "candidates": [], "seconds": "long"},
        {"stage": "coarse", "candidates": CANDIDATES.tolist(), "losses": [0.1], "seconds": 1.0},
        {"stage": "coarse", "candidates": CANDIDATES.tolist(), "losses": ["x"], "seconds": 1.0},
        {"stage": "coarse", "candidates": CANDIDATES.tolist(), "losses": [10**400] * 4},
        {"stage": "coarse", "candidates": CANDIDATES.tolist(), "losses": LOSSES.tolist()},
    ],
    ids=str,
)
def test_content_that_is_no_generation_is_refused_though_its_checksum_matches(file, values):
    file.write_text(json.dumps(seal(values)))
    refusal(file)
