"""Repeatability: scatter of the landings of repeated actions (sections IV-A, V-E and VI-B).

Each action is cast several times. Casts whose free end left the table are excluded from the scatter
and counted separately. The scatter of a combination of system parameters is the mean over its
actions, as in the paper. The paper's "standard deviation of the distance to the mean position" has
two readings, and both are measured.
"""

import dataclasses
import math
import pathlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.cast import TrialStatus
from cablecast.conventions import Ellipse, finite_or_none
from cablecast.data.dataset import Dataset
from cablecast.data.record import REPEAT_MAX, collect_dataset
from cablecast.errors import DatasetError, check_count, check_seed
from cablecast.evaluation.evaluate import rounded_cells
from cablecast.files import write_csv
from cablecast.motion.feasibility import feasible_of_grid
from cablecast.rigs.base import Rig
from cablecast.runs.progress import ProgressCallback, ignore
from cablecast.setup import Setup

CONFIDENCE = 0.95
"""Share of the landings of an action that are expected within its ellipse."""


def confidence_ellipse(xy: ArrayLike) -> Ellipse | None:
    """Return the ellipse that holds 95 % of the normal distribution fitted to landings [m].

    The square is of the chi-squared distribution, as in the paper's figures: 2.45 standard
    deviations, which neglects that the covariance comes from few casts. Landings of shape [cast, 2]
    with NaN are left out; fewer than three are too few for a covariance, and have none.
    """
    points = np.asarray(xy, dtype=float).reshape(-1, 2)
    points = points[np.all(np.isfinite(points), axis=1)]
    if len(points) < 3:
        return None
    square = -2.0 * math.log1p(-CONFIDENCE)
    return Ellipse.of_covariance(points.mean(axis=0), np.cov(points.T), square)


REPEAT_COUNT = 5
"""Number of casts of each action in the paper (section V-E)."""
REPEAT_GRID = (5, 5, 5)
"""Number of values of theta1, theta2 and r2 for the repeated actions of A1 (section V-E)."""
REPEAT_GRID_PSI = (3, 3, 3, 3)
"""Number of values of theta1, theta2, r2 and wrist turn for the actions of A2 (section V-E)."""

REPEAT_COLUMNS = (
    "action",
    "theta1_deg",
    "theta2_deg",
    "r2_m",
    "psi_deg",
    "pace",
    "casts",
    "landed",
    "off_table",
    "mean_x_m",
    "mean_y_m",
    "scatter_pct",
    "along_arc_share",
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ActionScatter:
    """Landings of the casts of one action.

    Attributes:
        action: theta1, theta2 [rad], r2 [m], psi [rad], pace [-], shape [5].
        landed_xy: Resting points of the casts that stayed on the table [m], shape [landing, 2].
        statuses: Status codes of all casts.
    """

    action: NDArray[np.float64]
    landed_xy: NDArray[np.float64]
    statuses: tuple[str, ...]

    @property
    def off_table_count(self) -> int:
        """Number of casts whose free end left the table."""
        return self.statuses.count(TrialStatus.OFF_TABLE.code)

    @property
    def mean_xy(self) -> NDArray[np.float64]:
        """Mean landing [m], shape [2]; NaN without landings."""
        return self.landed_xy.mean(axis=0) if len(self.landed_xy) else np.full(2, np.nan)

    @property
    def scatter(self) -> float:
        """Standard deviation of the landings about their mean [m]; NaN for fewer than two.

        sqrt(sum |p - mean|² / n), over both directions. Division by n - 1 would give 1.12 times as
        much for five casts. The paper does not state its divisor; n is NumPy's default.
        """
        if len(self.landed_xy) < 2:
            return math.nan
        distances = np.linalg.norm(self.landed_xy - self.mean_xy, axis=1)
        return float(np.sqrt(np.mean(distances**2)))

    @property
    def distance_sd(self) -> float:
        """Standard deviation of the distances from the mean landing [m]; NaN for fewer than two.

        These are the paper's words (section V-E). Taken literally they measure how unequal the
        distances are: two landings always have 0. `scatter` is the root mean square of the same
        distances.
        """
        if len(self.landed_xy) < 2:
            return math.nan
        return float(np.std(np.linalg.norm(self.landed_xy - self.mean_xy, axis=1)))

    @property
    def along_arc_share(self) -> float:
        """Share of the variance perpendicular to the direction from the base [-].

        0.5 for isotropic scatter, NaN for fewer than two landings.
        """
        if len(self.landed_xy) < 2:
            return math.nan
        offset = self.landed_xy - self.mean_xy
        outwards = self.mean_xy / np.linalg.norm(self.mean_xy)
        total = float(np.sum(offset**2))
        return 1.0 - float(np.sum((offset @ outwards) ** 2)) / total if total > 0 else math.nan

    @property
    def ellipse(self) -> Ellipse | None:
        """95 % confidence ellipse as drawn in the paper; None for fewer than three landings."""
        return confidence_ellipse(self.landed_xy)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Repeatability:
    """Scatter of repeated actions with one combination of system parameters.

    Attributes:
        setup: Cable, workspace, arm, and the combination of r0 and v_max.
        actions: Actions with their casts.
    """

    setup: Setup
    actions: tuple[ActionScatter, ...]

    @classmethod
    def from_dataset(cls, dataset: Dataset) -> "Repeatability":
        """Group the casts that `collect_dataset` made for the purpose "repeat" by action."""
        repeats = dataset.extra.get("repeat")
        if repeats is None:
            raise DatasetError(f"{dataset.path or 'the dataset'} holds no repeated casts")
        starts = [row for row, repeat in enumerate(repeats) if repeat == 0]
        landed = np.where(dataset.ok[:, None], dataset.rest_xy, np.nan)
        actions = []
        for start, end in zip(starts, [*starts[1:], len(dataset)], strict=True):
            xy = landed[start:end]
            actions.append(
                ActionScatter(
                    action=dataset.actions[start],
                    landed_xy=xy[np.all(np.isfinite(xy), axis=1)],
                    statuses=tuple(str(code) for code in dataset.status[start:end]),
                )
            )
        return cls(setup=dataset.setup, actions=tuple(actions))

    @property
    def cable(self) -> Cable:
        """Cable that was cast."""
        return self.setup.cable

    @property
    def with_psi(self) -> bool:
        """True if the wrist turns in any of the actions (action set A2)."""
        return any(abs(a.action[3]) - abs(a.action[1]) > 1e-6 for a in self.actions)

    @property
    def label(self) -> str:
        """Name of the combination in tables, e.g. "v_max 1.5 with psi"."""
        return f"v_max {self.setup.motion.v_max:g}" + " with psi" * self.with_psi

    @property
    def scatters_pct(self) -> NDArray[np.float64]:
        """Scatter of each action [% of cable length], shape [action]; NaN below two landings."""
        return 100.0 * np.array([a.scatter for a in self.actions]) / self.cable.length

    @property
    def scatter_pct(self) -> float:
        """Mean scatter over the actions [% of cable length]."""
        return _mean(self.scatters_pct)

    @property
    def distance_sd_pct(self) -> float:
        """Mean of `ActionScatter.distance_sd` [% of cable length], the paper's words."""
        return 100.0 * _mean(np.array([a.distance_sd for a in self.actions])) / self.cable.length

    @property
    def scatter_standard_error_pct(self) -> float:
        """Standard error of `scatter_pct` due to the choice of actions [% of cable length]."""
        known = self.scatters_pct[np.isfinite(self.scatters_pct)]
        return float(known.std(ddof=1) / math.sqrt(len(known))) if len(known) > 1 else math.nan

    @property
    def cast_count(self) -> int:
        """Number of casts."""
        return sum(len(a.statuses) for a in self.actions)

    @property
    def off_table_share(self) -> float:
        """Share of the casts whose free end left the table [-]."""
        return sum(a.off_table_count for a in self.actions) / max(self.cast_count, 1)

    @property
    def along_arc_share(self) -> float:
        """Mean of `ActionScatter.along_arc_share` over the actions [-]."""
        return _mean(np.array([a.along_arc_share for a in self.actions]))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for a JSON file; unknown values become None."""
        values = {
            "scatter_pct": self.scatter_pct,
            "scatter_standard_error_pct": self.scatter_standard_error_pct,
            "distance_sd_pct": self.distance_sd_pct,
            "off_table_share": self.off_table_share,
            "along_arc_share": self.along_arc_share,
        }
        return {
            "label": self.label,
            "r0": self.setup.motion.r0,
            "v_max": self.setup.motion.v_max,
            "with_psi": self.with_psi,
            "action_count": len(self.actions),
            "cast_count": self.cast_count,
        } | {name: finite_or_none(value) for name, value in values.items()}


def repeat_actions(
    setup: Setup,
    *,
    with_psi: bool,
    action_count: int | None = None,
    seed: int = 0,
) -> NDArray[np.float64]:
    """Return the feasible actions of the paper's grid, or some drawn at random, shape [action, 5].

    Raises:
        InputError: A count is out of bounds, or no action is feasible.
    """
    check_seed(seed)
    if action_count is not None:
        check_count("action_count", action_count)
    actions = feasible_of_grid(REPEAT_GRID_PSI if with_psi else REPEAT_GRID, setup)
    if action_count is not None and action_count < len(actions):
        chosen = np.random.default_rng(seed).choice(len(actions), action_count, replace=False)
        actions = actions[np.sort(chosen)]
    return actions


def measure_repeatability(
    path: str | pathlib.Path,
    rig: Rig,
    setup: Setup,
    *,
    actions: ArrayLike,
    repeats: int = REPEAT_COUNT,
    progress: ProgressCallback = ignore,
) -> Repeatability:
    """Cast each action, shape [action, 5], several times, and measure the scatter of its landings.

    Casts are stored as they are made. An interrupted run resumes; see `collect_dataset`. The rig is
    not closed.

    Raises:
        InputError: Fewer than two repeats, or an action is not feasible.
        RigError: A cast failed too often.
        DatasetError: The folder holds other casts.
    """
    check_count("repeats", repeats, 2, REPEAT_MAX)
    dataset = collect_dataset(
        path,
        rig,
        setup,
        purpose="repeat",
        actions=actions,
        repeats=repeats,
        progress=progress,
    )
    return Repeatability.from_dataset(dataset)


def save_actions(repeatability: Repeatability, path: pathlib.Path) -> None:
    """Write one line per action as CSV."""
    length, rows = repeatability.cable.length, []
    for number, a in enumerate(repeatability.actions):
        theta1, theta2, r2, psi, pace = a.action
        action = (math.degrees(theta1), math.degrees(theta2), r2, math.degrees(psi), pace)
        measured = (*a.mean_xy, 100.0 * a.scatter / length, a.along_arc_share)
        casts = (len(a.statuses), len(a.landed_xy), a.off_table_count)
        rows.append((number, *rounded_cells(action), *casts, *rounded_cells(measured)))
    write_csv(path, REPEAT_COLUMNS, rows)


def _mean(values: NDArray[np.float64]) -> float:
    """Return the mean of the finite values; NaN if there are none."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else math.nan
