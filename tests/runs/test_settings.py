import pytest

from cablecast.errors import InputError
from cablecast.runs.folder import fingerprint, plain_settings, settings_differences


def test_differences_name_nested_settings_and_absent_ones():
    phrases = settings_differences({"a": {"b": 1}, "old": 2}, {"a": {"b": 3}, "new": 4})
    assert phrases == [
        "a.b is 1 there and 3 here",
        "old is 2 there and '(absent)' here",
        "new is '(absent)' there and 4 here",
    ]


def test_settings_are_compared_as_json_stores_them():
    assert plain_settings({"grid": (1, 2), "a": {"b": None}}) == {"grid": [1, 2], "a": {"b": None}}


@pytest.mark.parametrize("value", [float("nan"), float("inf"), object(), {1, 2}])
def test_settings_that_json_cannot_hold_are_refused(value):
    with pytest.raises(InputError, match="plain, finite values"):
        plain_settings({"value": value})


def test_a_fingerprint_changes_with_the_values_and_with_the_bytes():
    names = {fingerprint({"a": 1}), fingerprint({"a": 2}), fingerprint({"a": 1}, b"x")}
    assert len(names) == 3
    assert fingerprint({"a": 1, "b": 2}) == fingerprint({"b": 2, "a": 1})
