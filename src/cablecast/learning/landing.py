"""LandingModel: base class of the models that predict the outcome of a cast from its action.

The outcome is that of a task, a landing unless said otherwise, over `Task.units`: a cable length of
any component is a cable length [m] for all that learns from it.

Prediction needs only NumPy; torch is needed only for training, so planning starts at once.
"""

import dataclasses
import functools
import json
import pathlib
from collections.abc import Callable
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cast import TrialStatus
from cablecast.data.dataset import Dataset, StoredSettings
from cablecast.errors import CheckpointError, InputError
from cablecast.learning.checkpoint import Checkpoint, digest, read_checkpoint, write_checkpoint
from cablecast.motion.action import ACTION_SIZE, ActionRanges, action_rows
from cablecast.motion.feasibility import feasible_ranges
from cablecast.setup import Setup
from cablecast.task import LANDING, Landing, Task

FEATURE_COUNT = ACTION_SIZE

DEVIATION = np.array([np.radians(1.0), np.radians(1.0), 0.01, np.radians(1.0), 0.01])
"""Execution error assumed in (theta1, theta2, r2, psi, pace): 1 degree, 1 cm and 1 % of v_max."""

# A spread below this is rounding, which division by it would amplify.
_SCALE_MIN = 1e-9
_ENDPOINT_SCALE_MIN = 1e-6


def action_features(actions: ArrayLike) -> NDArray[np.float64]:
    """Return the features of actions.

    psi is replaced by the turn of the wrist relative to the arm, psi - theta2. This turn swings the
    cable after the arm has stopped and, unlike psi, does not vary along with theta2. Of the pace
    the logarithm is taken: what the cable slides by itself grows with a power of it.

    Args:
        actions: (theta1, theta2, r2, psi, pace) [rad, rad, m, rad, -], shape [action, 5].

    Returns:
        (theta1, theta2, r2, psi - theta2, log pace), shape [action, 5].

    Raises:
        ActionError: The array has another shape.
    """
    features = action_rows(actions).copy()
    features[:, 3] -= features[:, 1]
    features[:, 4] = np.log(features[:, 4])
    return features


def is_paced(actions: NDArray[np.float64]) -> bool:
    """Return whether the pace of actions, shape [action, 5], varies."""
    return bool(np.ptp(actions[:, 4]) > 0.0)


def deviations(actions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the perturbations by which the sensitivity of an action is measured.

    There is one for each variable. In an action set without psi, psi always equals theta2, so a
    perturbation of theta2 includes psi and there is none of psi alone. Nor is there one of the pace
    in a set of one pace.

    Args:
        actions: All actions of the set, shape [action, 5].

    Returns:
        Changes of (theta1, theta2, r2, psi, pace) [rad, rad, m, rad, -], shape [change, 5].
    """
    changes = np.diag(DEVIATION)
    varies = np.ones(len(changes), dtype=bool)
    varies[4] = is_paced(actions)
    if np.allclose(actions[:, 3], actions[:, 1], rtol=0.0, atol=1e-9):
        changes[1] += changes[3]
        varies[3] = False
    return changes[varies]


def normalization(actions: NDArray[np.float64], endpoint_xy: NDArray[np.float64]) -> dict[str, Any]:
    """Return the means and scales of training rows, as arguments of a `LandingModel`.

    A feature that does not vary has the scale 1: psi - theta2 in an action set without psi, and the
    pace in one of the paper's motions.

    Args:
        actions: Training actions, shape [row, 5].
        endpoint_xy: Their endpoints [m], shape [row, 2].
    """
    features = action_features(actions)
    scale = features.std(axis=0)
    return {
        "feature_mean": features.mean(axis=0),
        "feature_scale": np.where(scale > _SCALE_MIN, scale, 1.0),
        "endpoint_mean": endpoint_xy.mean(axis=0),
        "endpoint_scale": max(float(endpoint_xy.std(axis=0).mean()), _ENDPOINT_SCALE_MIN),
    }


MIN_ROWS = 50
"""Minimum number of simulated casts; fewer cannot be split into training and held-out rows."""

MIN_REAL_ROWS = 15
"""Minimum number of real casts; with fewer, trend and scatter cannot be separated."""

LEFT_TABLE_MARGIN = -0.05
"""Margin assigned to a cast that left the table outside the camera's view [m]."""


def known_endpoint_rows(dataset: Dataset, task: Task = LANDING) -> NDArray[np.intp]:
    """Return the indices of the rows with a known endpoint on the table, and outcome in a task.

    Where a cable falls to that has left the table says little of those that stay.

    Args:
        dataset: Simulated casts.
        task: Task.

    Raises:
        InputError: There are fewer than `MIN_ROWS`.
    """
    known = np.hstack([dataset.outcomes(task), dataset.actions])
    is_known = dataset.finite & np.isfinite(known).all(axis=1)
    rows = np.flatnonzero(is_known & (dataset.status != TrialStatus.OFF_TABLE.code))
    if len(rows) < MIN_ROWS:
        raise InputError(
            f"{len(rows)} of {len(dataset)} rows have a known end on the table: training needs "
            f"{MIN_ROWS}"
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
    rows = np.flatnonzero(np.isfinite(margins) & np.isfinite(dataset.actions).all(axis=1))
    return rows, margins[rows]


def dataset_summary(dataset: Dataset) -> dict[str, Any]:
    """Return the description of a dataset that is stored with a model."""
    return {
        "fingerprint": dataset.fingerprint,
        "kind": dataset.kind,
        "row_count": len(dataset),
        "settings": dataset.settings.values,
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


MARGIN_NEIGHBORS = 8
"""Number of nearest training actions from which the table margin is interpolated."""

_SHARED = ("feature_mean", "feature_scale", "endpoint_mean", "margin_features", "margins")


def central_shifts(
    predict: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    actions: NDArray[np.float64],
    changes: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the change of a predicted outcome for each change of an action.

    Args:
        predict: Predicts outcomes [m], shape [row, k], of actions, shape [row, 5].
        actions: Actions, shape [action, 5].
        changes: Perturbations of an action, see `deviations`, shape [change, 5].

    Returns:
        Shift of the outcome by central differences [m], shape [action, k, change].
    """
    # One call for all of them: a network takes barely longer for many rows than for a few.
    rows = (actions + np.stack([changes, -changes])[:, :, None]).reshape(-1, actions.shape[1])
    predicted = predict(rows)
    ahead, back = predicted.reshape(2, len(changes), len(actions), predicted.shape[1])
    return np.asarray(np.moveaxis(ahead - back, 0, -1) / 2)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LandingModel:
    """Predict the outcome of a cast from its action.

    Attributes:
        feature_mean: Mean of each feature over the training rows, shape [5].
        feature_scale: Standard deviation of each feature, shape [5].
        endpoint_mean: Mean outcome [m], shape [k].
        endpoint_scale: Scale of the outcome [m], the same for x and y to preserve distances.
        margin_features: Normalised features of the rows with a known table margin, shape [row, 5].
        margins: Least distance of the free end from the table's edges during these casts, negative
            where it left the table [m], shape [row].
        info: Configuration, metrics, learning curve, versions, and the settings and fingerprint of
            the dataset.
        lab: Set-up of the same settings whose robot bounds the motions; None for that of the casts.
        task: Task whose outcomes it predicts.
        rest_xy: Resting points of the rows with a known table margin [m], shape [row, 2]; not used
            by a model of landings.
    """

    feature_mean: NDArray[np.float64]
    feature_scale: NDArray[np.float64]
    endpoint_mean: NDArray[np.float64]
    endpoint_scale: float
    margin_features: NDArray[np.float32] = dataclasses.field(
        default_factory=lambda: np.empty((0, FEATURE_COUNT), dtype=np.float32)
    )
    margins: NDArray[np.float32] = dataclasses.field(
        default_factory=lambda: np.empty(0, dtype=np.float32)
    )
    info: dict[str, Any] = dataclasses.field(default_factory=dict)
    lab: Setup | None = None
    task: Task = LANDING
    rest_xy: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.empty((0, 2)))

    FORMAT: ClassVar[str]

    def predict(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Predict the outcome of casts, by default where the free end comes to rest.

        Args:
            actions: (theta1, theta2, r2, psi, pace) [rad, rad, m, rad, -], shape [action, 5].

        Returns:
            Outcomes over `units` [m], shape [action, k].
        """
        raise NotImplementedError

    def landing_shifts(
        self, actions: NDArray[np.float64], changes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the change of the outcome for each change of an action; see `central_shifts`."""
        return central_shifts(self.predict, actions, changes)

    def sensitivity(
        self, actions: NDArray[np.float64], changes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the root of the summed squares of `landing_shifts` [m], shape [action]."""
        return np.linalg.norm(self.landing_shifts(actions, changes), axis=(1, 2))

    @property
    def metrics(self) -> dict[str, Any]:
        """Prediction errors, row counts and training time."""
        return self.info["metrics"]

    @functools.cached_property
    def settings(self) -> StoredSettings:
        """Settings that the training casts were made with."""
        return StoredSettings(self.info.get("dataset", {}), "the model")

    @property
    def dataset_fingerprint(self) -> str:
        """Fingerprint of the dataset that the model was trained on; empty where unknown."""
        return self.info.get("dataset", {}).get("fingerprint", "")

    @property
    def has_real_casts(self) -> bool:
        """Whether the model has been trained on casts of a rig, alone or after simulated ones."""
        return "adaptation" in self.info or self.info.get("dataset", {}).get("kind") == "real"

    @property
    def setup(self) -> Setup:
        """Cable, workspace, arm and motion settings of the training casts, or of `lab`."""
        return self.settings.setup if self.lab is None else self.lab

    @property
    def units(self) -> NDArray[np.float64]:
        """Change of each component of an outcome that counts as one metre, shape [k]."""
        return self.task.units(self.setup)

    def in_lab(self, setup: Setup) -> Self:
        """Return the model for a set-up of the same settings, whose robot bounds the motions."""
        return dataclasses.replace(self, lab=setup)

    @property
    def action_ranges(self) -> ActionRanges:
        """Ranges of the training actions; those that suit the set-up for a dataset without any."""
        return self.settings.ranges or feasible_ranges(self.setup)

    @functools.cached_property
    def fingerprint(self) -> str:
        """Short name of this model: the start of the SHA-256 of all its arrays."""
        return digest(self.tensors())

    def normalize(self, actions: ArrayLike) -> NDArray[np.float32]:
        """Return the normalised features of actions, shape [action, 5]."""
        features = (action_features(actions) - self.feature_mean) / self.feature_scale
        return features.astype(np.float32)

    def normalize_endpoints(self, endpoint_xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return normalised outcomes, shape [action, k], of those over `units` [m]."""
        return (endpoint_xy - self.endpoint_mean) / self.endpoint_scale

    def predict_margin(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Predict the least distance of the free end from the table's edges during a cast.

        The margin is interpolated between the nearest training actions by inverse distance. It has
        kinks where another edge becomes the nearest, which a small network would round off.

        Args:
            actions: (theta1, theta2, r2, psi, pace) [rad, rad, m, rad, -], shape [action, 5].

        Returns:
            Margins [m], negative where the free end leaves the table, shape [action].
        """
        return self._interpolated(actions, self.margins)

    def rest(self, actions: ArrayLike, outcomes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where the free end comes to rest in casts of some outcomes [m], shape [action, 2].

        That is the outcome of a landing itself. For another task it is interpolated, as a margin.
        """
        if isinstance(self.task, Landing):
            return outcomes
        return np.stack([self._interpolated(actions, xy) for xy in self.rest_xy.T], axis=-1)

    def _interpolated(self, actions: ArrayLike, values: NDArray) -> NDArray[np.float64]:
        neighbor_count = min(MARGIN_NEIGHBORS, len(values))
        distance, index = self._margin_tree.query(
            self.normalize(actions), k=neighbor_count, workers=-1
        )
        distance, index = (np.reshape(a, (-1, neighbor_count)) for a in (distance, index))
        weight = 1.0 / np.maximum(distance, 1e-9)
        return np.sum(weight * values[index], axis=1) / weight.sum(axis=1)

    @functools.cached_property
    def _margin_tree(self):
        from scipy.spatial import KDTree

        return KDTree(self.margin_features)

    def with_margins(self, dataset: Dataset) -> Self:
        """Return this model with the table margins and resting points of a dataset.

        Args:
            dataset: Simulated or real casts.
        """
        rows, margins = known_margins(dataset)
        return dataclasses.replace(
            self,
            margin_features=self.normalize(dataset.actions[rows]),
            margins=margins.astype(np.float32),
            rest_xy=dataset.rest_xy[rows],
        )

    def save(self, folder: str | pathlib.Path) -> None:
        """Write the checkpoint.

        Args:
            folder: Folder for `model.safetensors` and `model.json`.

        Raises:
            InputError: The model is one of another task than a landing.
        """
        if not isinstance(self.task, Landing):
            raise InputError(f"a model of {self.task.name} has no checkpoint: those of landings do")
        write_checkpoint(folder, self.FORMAT, self.tensors(), self.info)

    @classmethod
    def load(cls, folder: str | pathlib.Path) -> Self:
        """Read a checkpoint of this kind of model; see `load_model` for any kind.

        Args:
            folder: Folder given to `save`.

        Raises:
            CheckpointError: The file is missing, truncated, damaged, or of another kind.
        """
        return cls.from_checkpoint(read_checkpoint(folder))

    @classmethod
    def from_checkpoint(cls, checkpoint: Checkpoint) -> Self:
        """Verify a checkpoint and build the model from it.

        Args:
            checkpoint: Contents of the file.

        Raises:
            CheckpointError: The file is damaged, incomplete, or of another kind.
        """
        checkpoint.check(cls.FORMAT)
        tensors = checkpoint.tensors
        try:
            shared: dict[str, Any] = {name: tensors[name] for name in _SHARED}
            return cls(
                **shared,
                endpoint_scale=float(tensors["endpoint_scale"][0]),
                info=json.loads(checkpoint.header["info"]),
                **cls._own_fields(tensors),
            )
        except (KeyError, ValueError, InputError) as error:
            raise CheckpointError(f"{checkpoint.file} is incomplete: {error}") from None

    def tensors(self) -> dict[str, NDArray]:
        """Return all arrays by name, as stored in the checkpoint."""
        tensors: dict[str, NDArray] = {name: getattr(self, name) for name in _SHARED}
        tensors["endpoint_scale"] = np.array([self.endpoint_scale])
        tensors |= self._own_tensors()
        # safetensors writes the bytes in memory order, which would scramble a transposed view.
        return {name: np.ascontiguousarray(value) for name, value in tensors.items()}

    def _own_tensors(self) -> dict[str, NDArray]:
        """Return the arrays of this kind of model beyond the shared ones."""
        raise NotImplementedError

    @classmethod
    def _own_fields(cls, tensors: dict[str, NDArray]) -> dict[str, Any]:
        """Return the fields stored by `_own_tensors`, as arguments of the class."""
        raise NotImplementedError
