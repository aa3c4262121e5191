"""Numbers and settings as text: one way of writing each, for pages, tables and the terminal."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from cablecast.evaluation.published import PublishedRow

FIVE_NUMBERS = (
    "median_pct",
    "first_quartile_pct",
    "third_quartile_pct",
    "min_pct",
    "max_pct",
)
FIVE_HEADS = ("median", "1st quartile", "3rd quartile", "min", "max")


def pct(value: float | None, digits: int = 1) -> str:
    """Return a percentage, a dash for a missing value, "miss" for an infinite one.

    Args:
        value: Value [%]; missing where None or NaN.
        digits: Number of decimals.

    >>> pct(12.345), pct(None), pct(math.inf)
    ('12.3', '–', 'miss')
    """
    if value is None or math.isnan(value):
        return "–"
    return "miss" if math.isinf(value) else f"{value:.{digits}f}"


def share_pct(value: float | None) -> str:
    """Return a part of a whole as a percentage with its sign, a dash for a missing value.

    >>> share_pct(0.129), share_pct(None)
    ('12.9 %', '–')
    """
    return pct(value) if value is None or math.isnan(value) else f"{pct(100 * value)} %"


def five_cells(summary: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the five numbers of a summary of errors.

    JSON has no infinity: where there are errors but a number is missing, a miss decides it.

    Args:
        summary: Summary as `ErrorSummary.to_dict` and metrics.json hold it.
    """
    missing = math.inf if summary["count"] else math.nan
    values = (summary[name] for name in FIVE_NUMBERS)
    return tuple(pct(missing if value is None else value) for value in values)


def published_cells(row: PublishedRow) -> tuple[str, ...]:
    """Return the five numbers of a row of the paper, which prints whole percents."""
    return tuple(f"{getattr(row, name):.0f}" for name in FIVE_NUMBERS)


def flatten_settings(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Return nested settings as lines of a table: dotted names and readable values.

    Args:
        values: Plain values, nested to any depth.
        prefix: Text before each name.

    >>> flatten_settings({"arm": {"model": "ur5"}, "seed": 0})
    [('arm.model', 'ur5'), ('seed', '0')]
    """
    lines: list[tuple[str, str]] = []
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            lines += flatten_settings(value, f"{name}.")
        elif isinstance(value, Sequence) and not isinstance(value, str):
            lines.append((name, ", ".join(_plain(item) for item in value)))
        else:
            lines.append((name, _plain(value)))
    return lines


def _plain(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
