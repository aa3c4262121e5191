import datetime
import pickle

import numpy as np
import pytest

from cablecast.errors import (
    COUNT_MAX,
    InputError,
    MissingExtraError,
    check_count,
    check_keys,
    check_name,
    check_number,
    check_seed,
)


@pytest.mark.parametrize("value", [0.05, 5.0, 1, np.float32(1.5), np.int64(2)])
def test_a_number_within_its_bounds_is_returned_as_a_float(value):
    assert check_number("v_max", value, 0.05, 5.0, "m/s") == pytest.approx(float(value))


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (5.1, "v_max = 5.1 m/s is outside [0.05, 5]"),
        (float("nan"), "v_max = nan m/s is outside"),
        (float("inf"), "v_max = inf m/s is outside"),
        (10**400, "v_max = inf m/s is outside"),
        ("fast", "v_max = 'fast' is not a number"),
        (True, "v_max = True is not a number"),
        (None, "v_max = None is not a number"),
        ([1.0], "v_max = [1.0] is not a number"),
    ],
    ids=lambda value: str(type(value)),
)
def test_a_number_out_of_bounds_or_of_another_kind_is_refused(value, words):
    with pytest.raises(InputError) as caught:
        check_number("v_max", value, 0.05, 5.0, "m/s")
    assert words in str(caught.value)


@pytest.mark.parametrize("value", [0, -1, COUNT_MAX + 1, 10**22, 10**300, 1.5, "7", None, True])
def test_a_count_out_of_bounds_or_of_another_kind_is_refused(value):
    with pytest.raises(InputError, match="count = ") as caught:
        check_count("count", value)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("seed", [-1, 2**32, 1.0, "0"])
def test_a_seed_is_a_whole_number_of_32_bits(seed):
    assert check_seed(2**32 - 1) == 2**32 - 1
    with pytest.raises(InputError, match="seed = "):
        check_seed(seed)


@pytest.mark.parametrize(
    "name",
    [datetime.date(2026, 1, 1), None, ["a"], 7, "", "a\nb", "x" * 10**6, "\x1b[31m", "   "],
    ids=lambda value: repr(value)[:12],
)
def test_a_name_is_text_that_fits_on_a_line(name):
    assert check_name("Kabel 3 [weiß]", "cable") == "Kabel 3 [weiß]"
    with pytest.raises(InputError, match="cable name") as caught:
        check_name(name, "cable")
    assert len(str(caught.value)) < 200
    assert "\n" not in str(caught.value)


def test_keys_that_are_unknown_or_missing_are_named():
    assert check_keys({"a": 1}, {"a", "b"}, "arm") == {"a": 1}
    with pytest.raises(InputError, match=r"arm has unknown keys \['c'\]: known are \['a', 'b'\]"):
        check_keys({"c": 1}, {"a", "b"}, "arm")
    with pytest.raises(InputError, match=r"arm lacks the keys \['b'\]"):
        check_keys({"a": 1}, {"a", "b"}, "arm", required={"b"})
    with pytest.raises(InputError, match="arm must be a mapping"):
        check_keys([1], {"a"}, "arm")


def test_a_missing_library_is_named_by_a_worker_process_as_by_its_own():
    error = MissingExtraError("torch", "learn", "training")
    said = "training needs torch, which is not installed: pip install 'cablecast[learn]'"
    assert str(error) == str(pickle.loads(pickle.dumps(error))) == said
