"""Rows of a dataset that a model learns from, their table margins, and error statistics."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.datasets.reader import Dataset
from cablecast.errors import InputError

MIN_ROWS = 50
"""Minimum number of simulated casts; fewer cannot be split into training and held-out rows."""

MIN_REAL_ROWS = 15
"""Minimum number of real casts; with fewer, trend and scatter cannot be separated."""

LEFT_TABLE_MARGIN = -0.05
"""Margin assigned to a cast that left the table outside the camera's view [m]."""


def known_endpoint_rows(dataset: Dataset) -> NDArray[np.intp]:
    """Return the indices of the rows with a known endpoint.

    Args:
        dataset: Simulated casts.

    Raises:
        InputError: There are fewer than `MIN_ROWS`.
    """
    rows = np.flatnonzero(dataset.finite)
    if len(rows) < MIN_ROWS:
        raise InputError(
            f"{len(rows)} of {len(dataset)} rows have a known endpoint: training needs {MIN_ROWS}"
        )
    return rows


def known_margins(dataset: Dataset) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return the rows with a known table margin, and the margins.

    A camera loses an endpoint that leaves the table, so the recorded part of such a cast may lie
    within the edges. Its margin is then `LEFT_TABLE_MARGIN`.

    Args:
        dataset: Simulated or real casts.

    Returns:
        Indices, and margins [m], negative where the free end left the table; both of shape [row].
    """
    margins = dataset.table_margin()
    unseen = (dataset.status == "off_table") & ~((margins < 0) & np.isfinite(margins))
    margins = np.where(unseen, LEFT_TABLE_MARGIN, margins)
    rows = np.flatnonzero(np.isfinite(margins))
    return rows, margins[rows]


def dataset_summary(dataset: Dataset) -> dict[str, Any]:
    """Return the description of a dataset that is stored with a model."""
    return {
        "fingerprint": dataset.fingerprint,
        "kind": dataset.info.get("kind", ""),
        "row_count": len(dataset),
        "settings": dataset.info["settings"],
    }


def error_metrics(
    name: str,
    predicted_xy: NDArray[np.float64],
    endpoint_xy: NDArray[np.float64],
    cable_length: float,
) -> dict[str, float]:
    """Return the median, 90th percentile and mean of prediction errors [% of cable length].

    Args:
        name: Prefix of the keys, such as "held_out".
        predicted_xy: Predicted endpoints [m], shape [row, 2].
        endpoint_xy: Actual endpoints [m], shape [row, 2].
        cable_length: Length of the cable [m].
    """
    errors_pct = np.linalg.norm(predicted_xy - endpoint_xy, axis=1) / cable_length * 100
    return {
        f"{name}_median_pct": float(np.median(errors_pct)),
        f"{name}_p90_pct": float(np.percentile(errors_pct, 90)),
        f"{name}_mean_pct": float(np.mean(errors_pct)),
    }
