"""Repeatability: how far apart equal actions land (sections IV-A, V-E and VI-B).

Each action is made several times. Casts whose free end left the table are left out of the scatter
and counted on their own. The scatter of a combination of system parameters is the mean over its
actions, as in the paper.
"""

import csv
import dataclasses
import io
import math
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.conventions import xy_to_polar
from cablecast.datasets.collect import collect_dataset
from cablecast.datasets.reader import Dataset
from cablecast.errors import DatasetError, InputError
from cablecast.files import write_text
from cablecast.motion.action import ActionRanges, MotionConfig, grid_actions
from cablecast.motion.feasibility import check_actions
from cablecast.rigs.base import Rig
from cablecast.track import TrialStatus
from cablecast.workspace import Workspace

REPEAT_COUNT = 5
"""How often the paper makes each action (section V-E)."""
REPEAT_GRID = (5, 5, 5)
"""Values of theta1, theta2 and r2 of the repeated actions of A1 (section V-E)."""
REPEAT_GRID_PSI = (3, 3, 3, 3)
"""Values of theta1, theta2, r2 and the wrist turn of the repeated actions of A2 (section V-E)."""

CONFIDENCE = 0.95
"""Part of the landings of an action that its ellipse stands for."""

REPEAT_COLUMNS = (
    "action",
    "theta1_deg",
    "theta2_deg",
    "r2_m",
    "psi_deg",
    "casts",
    "landed",
    "off_table",
    "mean_x_m",
    "mean_y_m",
    "scatter_pct",
    "scatter_of_distances_pct",
    "along_arc_share",
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ConfidenceEllipse:
    """The ellipse that a normal distribution of the same mean and covariance would fill.

    Attributes:
        center_xy: Mean [m], shape [2].
        semi_axes: The longer and the shorter [m], shape [2].
        angle: Direction of the longer axis from x towards y [rad].
    """

    center_xy: NDArray[np.float64]
    semi_axes: NDArray[np.float64]
    angle: float

    def contains(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """Which points lie within, shape [...], for points of shape [..., 2]."""
        offset = np.asarray(xy, dtype=float) - self.center_xy
        c, s = math.cos(self.angle), math.sin(self.angle)
        along = offset[..., 0] * c + offset[..., 1] * s
        across = offset[..., 1] * c - offset[..., 0] * s
        return np.hypot(along / self.semi_axes[0], across / self.semi_axes[1]) <= 1.0

    def outline(self, point_count: int = 73) -> NDArray[np.float64]:
        """Points around it, the last equal to the first [m], shape [point, 2]."""
        turn = np.linspace(0.0, 2.0 * np.pi, point_count)
        along, across = self.semi_axes[0] * np.cos(turn), self.semi_axes[1] * np.sin(turn)
        c, s = math.cos(self.angle), math.sin(self.angle)
        return self.center_xy + np.stack([along * c - across * s, along * s + across * c], axis=-1)


def confidence_ellipse(
    xy: ArrayLike, level: float = CONFIDENCE, *, small_sample: bool = False
) -> ConfidenceEllipse | None:
    """The ellipse in which landings of one action are expected.

    Args:
        xy: Landings [m], shape [cast, 2]; those with NaN are left out.
        level: Part of the landings that it stands for.
        small_sample: Scale by Hotelling's distribution, which knows that the covariance is itself
            estimated from these few points (5.05 standard deviations for five points at 95 %).
            Otherwise by the chi-squared distribution, as the paper's figures (2.45).

    Returns:
        None for fewer than three landings, which have no covariance to speak of.
    """
    if not 0.0 < level < 1.0:
        raise InputError(f"level = {level} must lie between 0 and 1")
    points = np.asarray(xy, dtype=float).reshape(-1, 2)
    points = points[np.all(np.isfinite(points), axis=1)]
    count = len(points)
    if count < 3:
        return None
    from scipy import stats

    scale = float(stats.chi2.ppf(level, 2))
    if small_sample:
        scale = 2.0 * (count - 1) / (count - 2) * float(stats.f.ppf(level, 2, count - 2))
    variances, axes = np.linalg.eigh(np.cov(points.T))
    return ConfidenceEllipse(
        center_xy=points.mean(axis=0),
        semi_axes=np.sqrt(scale * np.maximum(variances[::-1], 0.0)),
        angle=float(np.arctan2(axes[1, 1], axes[0, 1])),
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class ActionScatter:
    """What came of the casts of one action.

    Attributes:
        action: theta1, theta2 [rad], r2 [m], psi [rad], shape [4].
        landed_xy: Where those came to rest that stayed on the table [m], shape [landing, 2].
        statuses: Codes of the trial statuses of all casts.
    """

    action: NDArray[np.float64]
    landed_xy: NDArray[np.float64]
    statuses: tuple[str, ...]

    @property
    def off_table_count(self) -> int:
        """Casts whose free end left the table."""
        return self.statuses.count(TrialStatus.OFF_TABLE.code)

    @property
    def mean_xy(self) -> NDArray[np.float64]:
        """Mean landing [m], NaN without one, shape [2]."""
        return self.landed_xy.mean(axis=0) if len(self.landed_xy) else np.full(2, np.nan)

    @property
    def distances(self) -> NDArray[np.float64]:
        """Distance of each landing from the mean [m], shape [landing]."""
        return np.linalg.norm(self.landed_xy - self.mean_xy, axis=1)

    @property
    def scatter(self) -> float:
        """Standard deviation of the landings about their mean [m]; NaN for fewer than two.

        sqrt(sum |p - mean|² / n), over both directions. Dividing by n - 1 would give 1.12 times as
        much for five casts; the paper does not say, and n is NumPy's way.
        """
        return float(np.sqrt(np.mean(self.distances**2))) if len(self.landed_xy) > 1 else math.nan

    @property
    def scatter_of_distances(self) -> float:
        """Standard deviation of the distances from the mean [m], the other reading of section V-E.

        It is smaller: casts that all land equally far from their mean have none.
        """
        return float(np.std(self.distances)) if len(self.landed_xy) > 1 else math.nan

    @property
    def along_arc_share(self) -> float:
        """Part of the variance that lies across the direction from the base [-], 0.5 where round.

        NaN for fewer than two landings.
        """
        if len(self.landed_xy) < 2:
            return math.nan
        offset = self.landed_xy - self.mean_xy
        outwards = self.mean_xy / np.linalg.norm(self.mean_xy)
        total = float(np.sum(offset**2))
        return 1.0 - float(np.sum((offset @ outwards) ** 2)) / total if total > 0 else math.nan

    @property
    def ellipse(self) -> ConfidenceEllipse | None:
        """The 95 % confidence ellipse as the paper draws it; None for fewer than three landings."""
        return confidence_ellipse(self.landed_xy)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Repeatability:
    """How far apart equal actions land with one combination of system parameters.

    Attributes:
        cable: The cable that was cast.
        config: The combination: r0 and v_max.
        rig: What the rig says of itself.
        actions: Its actions with their casts.
    """

    cable: Cable
    config: MotionConfig
    rig: dict[str, Any]
    actions: tuple[ActionScatter, ...]

    @classmethod
    def from_dataset(cls, dataset: Dataset) -> "Repeatability":
        """What a dataset of repeated casts says.

        Args:
            dataset: Made by `collect_dataset` with the purpose "repeat".

        Raises:
            DatasetError: It holds no repeats.
        """
        repeats = dataset.extra.get("repeat")
        if repeats is None:
            raise DatasetError(f"{dataset.path or 'the dataset'} holds no repeated casts")
        starts = [row for row, repeat in enumerate(repeats) if repeat == 0]
        landed = np.where(dataset.ok[:, None], dataset.endpoint_xy, np.nan)
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
        return cls(
            cable=dataset.cable,
            config=dataset.motion_config,
            rig=dict(dataset.info["settings"]["rig"]),
            actions=tuple(actions),
        )

    @property
    def with_psi(self) -> bool:
        """Whether the wrist turns in any of the actions (the action set A2)."""
        return any(a.action[3] - a.action[1] > 1e-6 for a in self.actions)

    @property
    def label(self) -> str:
        """How a table calls the combination."""
        return combination_label(self.config.v_max, self.with_psi)

    @property
    def scatters_pct(self) -> NDArray[np.float64]:
        """Scatter of each action [% of cable length], NaN below two landings, shape [action]."""
        return 100.0 * np.array([a.scatter for a in self.actions]) / self.cable.length

    @property
    def _known_scatters_pct(self) -> NDArray[np.float64]:
        return self.scatters_pct[np.isfinite(self.scatters_pct)]

    @property
    def scatter_pct(self) -> float:
        """Mean scatter over the actions [% of cable length]: the paper's measure."""
        return _mean(self.scatters_pct)

    @property
    def scatter_standard_error_pct(self) -> float:
        """Standard error of that mean, for the choice of actions [% of cable length]."""
        known = self._known_scatters_pct
        return float(known.std(ddof=1) / math.sqrt(len(known))) if len(known) > 1 else math.nan

    @property
    def scatter_of_distances_pct(self) -> float:
        """Mean over the actions of the deviation of the distances [% of cable length]."""
        values = [100.0 * a.scatter_of_distances / self.cable.length for a in self.actions]
        return _mean(np.array(values))

    @property
    def cast_count(self) -> int:
        """How many casts were made."""
        return sum(len(a.statuses) for a in self.actions)

    @property
    def off_table_share(self) -> float:
        """Part of the casts whose free end left the table [-]."""
        return sum(a.off_table_count for a in self.actions) / max(self.cast_count, 1)

    @property
    def along_arc_share(self) -> float:
        """Part of the variance across the direction from the base, mean over the actions [-]."""
        return _mean(np.array([a.along_arc_share for a in self.actions]))

    def growth(self) -> dict[str, float]:
        """Rank correlation of the scatter with where an action lands: NaN below three actions.

        `distance` is that with the distance from the base, `width` that with the angle from the
        workspace axis.
        """
        known = np.isfinite(self.scatters_pct)
        if known.sum() < 3:
            return {"distance": math.nan, "width": math.nan}
        from scipy import stats

        polar = xy_to_polar([a.mean_xy for a in self.actions])[known]
        scatter = self.scatters_pct[known]
        places = {"distance": polar[:, 0], "width": np.abs(polar[:, 1])}
        return {
            name: float(stats.spearmanr(values, scatter)[0])  # pyright: ignore[reportArgumentType]
            if np.ptp(values) > 0 and np.ptp(scatter) > 0
            else math.nan
            for name, values in places.items()
        }

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a JSON file; what is unknown becomes None."""
        known = self._known_scatters_pct
        quartiles = np.quantile(known, [0.25, 0.5, 0.75]) if len(known) else [math.nan] * 3
        values = {
            "scatter_pct": self.scatter_pct,
            "scatter_standard_error_pct": self.scatter_standard_error_pct,
            "scatter_quartiles_pct": [_plain(value) for value in quartiles],
            "scatter_of_distances_pct": self.scatter_of_distances_pct,
            "off_table_share": self.off_table_share,
            "along_arc_share": self.along_arc_share,
            **{f"growth_with_{name}": value for name, value in self.growth().items()},
        }
        return {
            "label": self.label,
            "r0": self.config.r0,
            "v_max": self.config.v_max,
            "with_psi": self.with_psi,
            "action_count": len(self.actions),
            "cast_count": self.cast_count,
            "scattered_action_count": len(known),
        } | {
            name: _plain(value) if isinstance(value, float) else value
            for name, value in values.items()
        }


def combination_label(v_max: float, with_psi: bool) -> str:
    """How tables and folders call a speed and an action set, e.g. "v_max 1.5 with psi"."""
    return f"v_max {v_max:g}{' with psi' if with_psi else ''}"


def repeat_actions(
    config: MotionConfig,
    workspace: Workspace,
    *,
    with_psi: bool,
    counts: tuple[int, ...] | None = None,
    action_count: int | None = None,
    seed: int = 0,
) -> NDArray[np.float64]:
    """The actions of the paper's grid that the arm can make, shape [action, 4].

    Args:
        config: System parameters.
        workspace: Table and arm.
        with_psi: Whether the wrist turns, too.
        counts: Values of each action variable; by default the paper's 5 x 5 x 5, or 3 x 3 x 3 x 3
            with psi.
        action_count: Only as many, chosen by chance; all where None or where there are fewer.
        seed: Of this choice.
    """
    counts = counts or (REPEAT_GRID_PSI if with_psi else REPEAT_GRID)
    if len(counts) != (4 if with_psi else 3):
        raise InputError(f"grid counts {counts} must be {'four' if with_psi else 'three'} numbers")
    if action_count is not None and action_count < 1:
        raise InputError(f"action_count = {action_count} must be at least 1")
    grid = grid_actions(ActionRanges.for_config(config), counts)
    actions = grid[check_actions(grid, config, workspace).mask]
    if not len(actions):
        raise InputError(f"the arm can make none of the {len(grid)} actions of the grid {counts}")
    if action_count is not None and action_count < len(actions):
        chosen = np.random.default_rng(seed).choice(len(actions), action_count, replace=False)
        actions = actions[np.sort(chosen)]
    return actions


def measure_repeatability(
    path: str | pathlib.Path,
    rig: Rig,
    cable: Cable,
    config: MotionConfig,
    workspace: Workspace,
    *,
    actions: ArrayLike,
    repeats: int = REPEAT_COUNT,
    progress: Callable[[int, int], None] | None = None,
) -> Repeatability:
    """Make each of some actions several times, and measure how far apart they land.

    The casts are stored as they are made, and a run that was stopped goes on; see
    `collect_dataset`. The rig is not closed.

    Args:
        path: Folder of the casts.
        rig: Carries them out.
        cable: The cable in the gripper.
        config: System parameters.
        workspace: Table and arm.
        actions: What to make, shape [action, 4].
        repeats: How often each.
        progress: Told how many casts are done and how many there are.
    """
    if repeats < 2:
        raise InputError(f"repeats = {repeats} must be at least 2")
    dataset = collect_dataset(
        path,
        rig,
        cable,
        config,
        workspace,
        purpose="repeat",
        actions=actions,
        repeats=repeats,
        progress=progress,
    )
    return Repeatability.from_dataset(dataset)


def save_actions(repeatability: Repeatability, path: pathlib.Path) -> None:
    """Write one line per action as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(REPEAT_COLUMNS)
    length = repeatability.cable.length
    for number, a in enumerate(repeatability.actions):
        theta1, theta2, r2, psi = a.action
        numbers = (
            *(math.degrees(theta1), math.degrees(theta2), r2, math.degrees(psi)),
            *a.mean_xy,
            *(100.0 * value / length for value in (a.scatter, a.scatter_of_distances)),
            a.along_arc_share,
        )
        # Four decimals, 0.1 mm; an unknown value is an empty cell.
        cells = [round(float(v), 4) if math.isfinite(v) else "" for v in numbers]
        casts = (len(a.statuses), len(a.landed_xy), a.off_table_count)
        writer.writerow([number, *cells[:4], *casts, *cells[4:]])
    write_text(path, text.getvalue())


def _mean(values: NDArray[np.float64]) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else math.nan


def _plain(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
