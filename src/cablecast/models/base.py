"""What every model of landings has: features of actions, the table's margin, and a checkpoint.

Predicting takes NumPy alone; only training needs torch, so that planning starts at once.
"""

import dataclasses
import functools
import hashlib
import json
import pathlib
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.datasets.reader import Dataset, settings_object, settings_setup
from cablecast.errors import CheckpointError, InputError, MissingExtraError
from cablecast.files import write_bytes, write_json
from cablecast.setup import Setup

FORMAT_VERSION = 1
WEIGHTS_NAME = "model.safetensors"
CONFIG_NAME = "model.json"

MARGIN_NEIGHBORS = 8
"""Simulated actions around a new one whose table margins are interpolated."""

LEFT_TABLE_MARGIN = -0.05
"""Margin of a cast that is known to have left the table, though nobody saw by how much [m]."""

DEVIATION = np.array([np.radians(1.0), np.radians(1.0), 0.01, np.radians(1.0)])
"""What a rig may deviate by in (theta1, theta2, r2, psi): 1 degree and 1 cm."""

_SHARED = ("feature_mean", "feature_scale", "endpoint_mean", "margin_features", "margins")


def action_features(actions: ArrayLike) -> NDArray[np.float64]:
    """What a model sees of an action.

    The wrist's own turn psi - theta2 stands in for psi: it is what swings the cable after the arm
    has stopped, and unlike psi it does not move along with theta2.

    Args:
        actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [action, 4].

    Returns:
        (theta1, theta2, r2, psi - theta2), same shape.
    """
    features = np.array(actions, dtype=float)
    if features.ndim != 2 or features.shape[1] != 4:
        raise InputError(f"actions have shape {features.shape}: it must be [action, 4]")
    features[:, 3] -= features[:, 1]
    return features


def deviations(actions: NDArray[np.float64]) -> NDArray[np.float64]:
    """The changes of an action that are considered one by one, shape [change, 4].

    One of each variable; in an action set without psi, of which a model knows nothing else, psi
    goes along with theta2.

    Args:
        actions: All actions of the set, shape [action, 4].
    """
    changes = np.diag(DEVIATION)
    if np.allclose(actions[:, 3], actions[:, 1], rtol=0.0, atol=1e-9):
        changes[1] += changes[3]
        changes = changes[:3]
    return changes


@dataclasses.dataclass(frozen=True, kw_only=True)
class LandingModel:
    """Base of the models that predict where the free end comes to rest.

    Attributes:
        feature_mean: Mean of each feature over the training rows, shape [4].
        feature_scale: Deviation of each feature, shape [4].
        endpoint_mean: Mean endpoint [m], shape [2].
        endpoint_scale: One scale for x and y [m], so that distances keep their shape.
        margin_features: Normalised features of the simulated rows, shape [row, 4].
        margins: How far the free end stayed within the table's edges on its way in these rows,
            negative where it left the table [m], shape [row].
        info: Configuration, metrics, learning curve, versions, and the settings and fingerprint of
            the dataset.
    """

    feature_mean: NDArray[np.float64]
    feature_scale: NDArray[np.float64]
    endpoint_mean: NDArray[np.float64]
    endpoint_scale: float
    margin_features: NDArray[np.float32]
    margins: NDArray[np.float32]
    info: dict[str, Any] = dataclasses.field(default_factory=dict)

    FORMAT: ClassVar[str]

    def predict(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Where the free end will come to rest.

        Args:
            actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [action, 4].

        Returns:
            Endpoints [m], shape [action, 2].
        """
        raise NotImplementedError

    def predict_spread(self, actions: ArrayLike) -> NDArray[np.float64] | None:
        """How far real landings are expected to lie from the predicted ones.

        Args:
            actions: Shape [action, 4].

        Returns:
            Standard deviation along each of x and y [m], shape [action]; None where the model has
            seen no real cast that would tell.
        """
        del actions
        return None

    def landing_shifts(
        self, actions: NDArray[np.float64], changes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """How the predicted landing moves when an action changes.

        Args:
            actions: Shape [action, 4].
            changes: See `deviations`, shape [change, 4].

        Returns:
            Shift for each change, by central differences [m], shape [action, 2, change].
        """
        shifts = [
            (self.predict(actions + change) - self.predict(actions - change)) / 2
            for change in changes
        ]
        return np.stack(shifts, axis=2)

    def sensitivity(
        self, actions: NDArray[np.float64], changes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Root of the summed squares of the shifts of each action's landing [m], shape [action].

        Args:
            actions: Shape [action, 4].
            changes: See `deviations`, shape [change, 4].
        """
        return np.linalg.norm(self.landing_shifts(actions, changes), axis=(1, 2))

    @property
    def metrics(self) -> dict[str, Any]:
        """Held-out errors and the like."""
        return self.info["metrics"]

    @property
    def cable(self) -> Cable:
        """The cable whose casts it has learned."""
        return settings_object(Cable.from_dict, self.info["dataset"], "cable", "the model")

    @functools.cached_property
    def setup(self) -> Setup:
        """Cable, workspace, arm and motion settings of the casts that it has learned."""
        return settings_setup(self.info["dataset"], "the model")

    @property
    def action_ranges(self):
        """The ranges that its dataset's actions were chosen from, an `ActionRanges`.

        Those that suit its motions where the actions were given one by one.
        """
        from cablecast.motion.action import ActionRanges

        known = self.info["dataset"]["settings"].get("ranges")
        if known is None:
            return ActionRanges.for_config(self.setup.motion)
        return settings_object(
            lambda values: ActionRanges(**{k: tuple(v) for k, v in values.items()}),
            self.info["dataset"],
            "ranges",
            "the model",
        )

    @functools.cached_property
    def fingerprint(self) -> str:
        """A short name for this model: the start of the SHA-256 of all arrays."""
        return _digest(self.tensors())

    def normalize(self, actions: ArrayLike) -> NDArray[np.float32]:
        """Normalised features of actions, shape [action, 4]."""
        features = (action_features(actions) - self.feature_mean) / self.feature_scale
        return features.astype(np.float32)

    def predict_margin(self, actions: ArrayLike) -> NDArray[np.float64]:
        """How far the free end will stay within the table's edges on its way.

        Interpolated between the nearest simulated actions by inverse distance: the farthest swing
        has kinks where another edge becomes the nearest, which a small network would round off.

        Args:
            actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [action, 4].

        Returns:
            Margins [m], negative where the free end leaves the table, shape [action].
        """
        neighbor_count = min(MARGIN_NEIGHBORS, len(self.margins))
        distance, index = self._margin_tree.query(
            self.normalize(actions), k=neighbor_count, workers=-1
        )
        distance, index = (np.reshape(a, (-1, neighbor_count)) for a in (distance, index))
        weight = 1.0 / np.maximum(distance, 1e-9)
        return np.sum(weight * self.margins[index], axis=1) / weight.sum(axis=1)

    @functools.cached_property
    def _margin_tree(self):
        from scipy.spatial import KDTree

        return KDTree(self.margin_features)

    def save(self, folder: str | pathlib.Path) -> None:
        """Write the checkpoint: the arrays, and the same description once more for people.

        The arrays' file holds everything, so that one rename replaces the whole checkpoint.

        Args:
            folder: Where to write `model.safetensors` and `model.json`.
        """
        folder = pathlib.Path(folder)
        tensors = self.tensors()
        header = {
            "format": self.FORMAT,
            "format_version": str(FORMAT_VERSION),
            "sha256": _digest(tensors),
            "info": json.dumps(self.info, ensure_ascii=False, allow_nan=False),
        }
        content = _safetensors("writing a model").save(tensors, metadata=header)
        write_bytes(folder / WEIGHTS_NAME, content)
        description = {"format": self.FORMAT, "sha256": header["sha256"]} | self.info
        write_json(folder / CONFIG_NAME, description)

    @classmethod
    def load(cls, folder: str | pathlib.Path) -> Self:
        """Read a checkpoint of this kind of model; see `load_model` for any kind.

        Args:
            folder: The folder given to `save`.

        Raises:
            CheckpointError: It is missing, truncated, damaged, or of another kind.
        """
        return cls.from_checkpoint(*read_checkpoint(folder))

    @classmethod
    def from_checkpoint(
        cls, file: pathlib.Path, tensors: dict[str, NDArray], header: dict[str, str]
    ) -> Self:
        """A model from what `read_checkpoint` returns."""
        kind, version = header.get("format"), header.get("format_version")
        if kind != cls.FORMAT or version != str(FORMAT_VERSION):
            raise CheckpointError(
                f"{file} holds {kind or 'something'} of version {version or '?'}: "
                f"it must be {cls.FORMAT} of version {FORMAT_VERSION}"
            )
        if _digest(tensors) != header.get("sha256"):
            raise CheckpointError(f"{file} is damaged: its arrays do not match their checksum")
        try:
            shared: dict[str, Any] = {name: tensors[name] for name in _SHARED}
            return cls(
                **shared,
                endpoint_scale=float(tensors["endpoint_scale"][0]),
                info=json.loads(header["info"]),
                **cls._own_fields(tensors),
            )
        except (KeyError, ValueError, InputError) as error:
            raise CheckpointError(f"{file} is incomplete: {error}") from None

    def tensors(self) -> dict[str, NDArray]:
        """All arrays by name, as the checkpoint holds them."""
        tensors: dict[str, NDArray] = {name: getattr(self, name) for name in _SHARED}
        tensors["endpoint_scale"] = np.array([self.endpoint_scale])
        tensors |= self._own_tensors()
        # The format takes the bytes as they lie, so a transposed view would be scrambled.
        return {name: np.ascontiguousarray(value) for name, value in tensors.items()}

    def _own_tensors(self) -> dict[str, NDArray]:
        """Arrays of a kind of model beyond those that all have."""
        raise NotImplementedError

    @classmethod
    def _own_fields(cls, tensors: dict[str, NDArray]) -> dict[str, Any]:
        """The reverse of `_own_tensors`, as arguments of the class."""
        raise NotImplementedError


def load_model(folder: str | pathlib.Path) -> LandingModel:
    """Read a checkpoint of any kind of model.

    Args:
        folder: The folder that the model was saved to.

    Raises:
        CheckpointError: It is missing, truncated, damaged, or no model.
    """
    from cablecast.models.forward import ForwardModel
    from cablecast.models.gaussian_process import GaussianProcessModel

    file, tensors, header = read_checkpoint(folder)
    kinds: dict[str, type[LandingModel]] = {
        kind.FORMAT: kind for kind in (ForwardModel, GaussianProcessModel)
    }
    kind = kinds.get(header.get("format", ""), ForwardModel)
    return kind.from_checkpoint(file, tensors, header)


def known_margins(dataset: Dataset) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Rows of a dataset whose table margin is known, and the margins [m].

    A camera loses an endpoint that leaves the table, so what a rig saw of such a cast may lie
    wholly within the edges: its margin is then `LEFT_TABLE_MARGIN`.

    Args:
        dataset: Simulated or real casts.
    """
    margins = dataset.table_margin()
    unseen = (dataset.status == "off_table") & ~((margins < 0) & np.isfinite(margins))
    margins = np.where(unseen, LEFT_TABLE_MARGIN, margins)
    rows = np.flatnonzero(np.isfinite(margins))
    return rows, margins[rows]


def dataset_summary(dataset: Dataset) -> dict[str, Any]:
    """What a model remembers of a dataset it was made from."""
    return {
        "fingerprint": dataset.fingerprint,
        "kind": dataset.info.get("kind", ""),
        "row_count": len(dataset),
        "settings": dataset.info["settings"],
    }


def read_checkpoint(
    folder: str | pathlib.Path,
) -> tuple[pathlib.Path, dict[str, NDArray], dict[str, str]]:
    """The file of a checkpoint, its arrays and its text header.

    Raises:
        CheckpointError: It is missing or truncated.
    """
    file = pathlib.Path(folder) / WEIGHTS_NAME
    try:
        content = file.read_bytes()
    except OSError as error:
        raise CheckpointError(f"no model at {file}: {error.strerror}") from None
    module = _safetensors("reading a model")
    from safetensors import SafetensorError

    try:
        tensors = module.load(content)
        # The library reads the text header only from a path; the format begins with its length.
        length = int.from_bytes(content[:8], "little")
        header = json.loads(content[8 : 8 + length]).get("__metadata__", {})
    except (SafetensorError, ValueError, KeyError) as error:
        raise CheckpointError(
            f"{file} is truncated or not a safetensors file ({str(error).splitlines()[0]})"
        ) from None
    return file, tensors, header


def _digest(tensors: dict[str, NDArray]) -> str:
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(f"{name} {tensors[name].dtype} {tensors[name].shape}".encode())
        digest.update(tensors[name].tobytes())
    return digest.hexdigest()[:32]


def _safetensors(purpose: str):
    try:
        import safetensors.numpy
    except ImportError:
        raise MissingExtraError("safetensors", "learn", purpose) from None
    return safetensors.numpy
