"""Settings of a run as plain values: comparison and fingerprint."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from cablecast.errors import InputError

ABSENT = "(absent)"


def plain_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings as JSON stores them: tuples become lists.

    Raises:
        InputError: A value is not plain or not finite.
    """
    try:
        return json.loads(json.dumps(dict(settings), allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(f"settings must hold plain, finite values: {error}") from None


def settings_differences(
    stored: Mapping[str, Any], wanted: Mapping[str, Any], prefix: str = ""
) -> list[str]:
    """Return a phrase for each setting in which two runs differ, with both values.

    Args:
        stored: Settings on the disk.
        wanted: Settings of this run.
        prefix: Path of the nested settings, ending in a dot.

    >>> settings_differences({"arm": {"model": "ur5"}}, {"arm": {"model": "ur5e"}})
    ["arm.model is 'ur5' there and 'ur5e' here"]
    """
    phrases = []
    for key in (*stored, *(key for key in wanted if key not in stored)):
        there, here = stored.get(key, ABSENT), wanted.get(key, ABSENT)
        if isinstance(there, Mapping) and isinstance(here, Mapping):
            phrases += settings_differences(there, here, f"{prefix}{key}.")
        elif there != here:
            phrases.append(f"{prefix}{key} is {_short(there)} there and {_short(here)} here")
    return phrases


def flat_settings(settings: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Return the leaves of nested settings with dotted names.

    Args:
        settings: Settings.
        prefix: Text that all names begin with.
    """
    rows = []
    for key, value in settings.items():
        if isinstance(value, Mapping):
            rows += flat_settings(value, f"{prefix}{key}.")
        else:
            rows.append((f"{prefix}{key}", value))
    return rows


def fingerprint(values: Any, *more: bytes) -> str:
    """Return a fingerprint of some content: the start of its SHA-256.

    Args:
        values: Plain values, hashed as canonical JSON.
        *more: Further bytes of the content.
    """
    digest = hashlib.sha256(json.dumps(values, sort_keys=True, ensure_ascii=False).encode())
    for content in more:
        digest.update(content)
    return digest.hexdigest()[:16]


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 120 else f"{text[:117]}..."
