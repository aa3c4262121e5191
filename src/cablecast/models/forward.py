"""The forward model f_forw: where the cable's free end comes to rest after an action.

Predicting takes NumPy alone; only training (see `training`) needs torch, so that planning starts at
once.
"""

import dataclasses
import functools
import hashlib
import json
import pathlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.datasets.reader import settings_object
from cablecast.errors import CheckpointError, InputError, MissingExtraError
from cablecast.files import write_bytes, write_json
from cablecast.workspace import Workspace

FORMAT = "cablecast.forward_model"
FORMAT_VERSION = 1
WEIGHTS_NAME = "model.safetensors"
CONFIG_NAME = "model.json"

MARGIN_NEIGHBORS = 8
"""Simulated actions around a new one whose table margins are interpolated."""

# Rows at once through the network: large enough for fast products, small enough for the cache.
_CHUNK_ROWS = 4096


def action_features(actions: ArrayLike) -> NDArray[np.float64]:
    """What the network sees of an action.

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class ForwardModel:
    """A trained network with everything needed to use it again.

    Attributes:
        weights: Matrix [in, out] and offset [out] of each layer; SiLU follows all but the last.
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

    weights: tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]
    feature_mean: NDArray[np.float64]
    feature_scale: NDArray[np.float64]
    endpoint_mean: NDArray[np.float64]
    endpoint_scale: float
    margin_features: NDArray[np.float32]
    margins: NDArray[np.float32]
    info: dict[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def metrics(self) -> dict[str, Any]:
        """Held-out errors and the like."""
        return self.info["metrics"]

    @property
    def cable(self) -> Cable:
        """The cable whose casts it has learned."""
        return settings_object(Cable.from_dict, self.info["dataset"], "cable", "the model")

    @property
    def workspace(self) -> Workspace:
        """The table and arm that its dataset was simulated for."""
        return settings_object(
            lambda values: Workspace(**values), self.info["dataset"], "workspace", "the model"
        )

    @property
    def motion_config(self):
        """The system parameters of its motions, a `MotionConfig`."""
        from cablecast.motion.action import MotionConfig

        return settings_object(
            lambda values: MotionConfig(**values), self.info["dataset"], "motion", "the model"
        )

    @functools.cached_property
    def fingerprint(self) -> str:
        """A short name for these weights: the start of the SHA-256 of all arrays."""
        return _digest(self._tensors())

    def normalize(self, actions: ArrayLike) -> NDArray[np.float32]:
        """Normalised features of actions, shape [action, 4]."""
        features = (action_features(actions) - self.feature_mean) / self.feature_scale
        return features.astype(np.float32)

    def predict(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Where the free end will come to rest.

        Args:
            actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [action, 4].

        Returns:
            Endpoints [m], shape [action, 2].
        """
        features = self.normalize(actions)
        outputs = np.empty((len(features), 2))
        for start in range(0, len(features), _CHUNK_ROWS):
            hidden = features[start : start + _CHUNK_ROWS]
            for layer, (matrix, offset) in enumerate(self.weights):
                hidden = hidden @ matrix + offset
                if layer < len(self.weights) - 1:
                    # exp overflows to infinity far below zero, where SiLU is rightly zero.
                    with np.errstate(over="ignore"):
                        hidden /= 1.0 + np.exp(-hidden)
            outputs[start : start + _CHUNK_ROWS] = hidden
        return self.endpoint_mean + self.endpoint_scale * outputs

    def predict_margin(self, actions: ArrayLike) -> NDArray[np.float64]:
        """How far the free end will stay within the table's edges on its way.

        Interpolated between the nearest simulated actions by inverse distance: the farthest swing
        has kinks where another edge becomes the nearest, which a small network would round off.

        Args:
            actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [action, 4].

        Returns:
            Margins [m], negative where the free end leaves the table, shape [action].
        """
        from scipy.spatial import KDTree

        neighbor_count = min(MARGIN_NEIGHBORS, len(self.margins))
        tree = KDTree(self.margin_features)
        distance, index = tree.query(self.normalize(actions), k=neighbor_count, workers=-1)
        distance, index = (np.reshape(a, (-1, neighbor_count)) for a in (distance, index))
        weight = 1.0 / np.maximum(distance, 1e-9)
        return np.sum(weight * self.margins[index], axis=1) / weight.sum(axis=1)

    def save(self, folder: str | pathlib.Path) -> None:
        """Write the checkpoint: the weights, and the same description once more for people.

        The weights' file holds everything, so that one rename replaces the whole checkpoint.

        Args:
            folder: Where to write `model.safetensors` and `model.json`.
        """
        folder = pathlib.Path(folder)
        tensors = self._tensors()
        header = {
            "format": FORMAT,
            "format_version": str(FORMAT_VERSION),
            "sha256": _digest(tensors),
            "info": json.dumps(self.info, ensure_ascii=False, allow_nan=False),
        }
        content = _safetensors("writing a model").save(tensors, metadata=header)
        write_bytes(folder / WEIGHTS_NAME, content)
        write_json(folder / CONFIG_NAME, {"format": FORMAT, "sha256": header["sha256"]} | self.info)

    @classmethod
    def load(cls, folder: str | pathlib.Path) -> "ForwardModel":
        """Read a checkpoint.

        Args:
            folder: The folder given to `save`.

        Raises:
            CheckpointError: It is missing, truncated, damaged, or not a forward model.
        """
        file = pathlib.Path(folder) / WEIGHTS_NAME
        try:
            content = file.read_bytes()
        except OSError as error:
            raise CheckpointError(f"no model at {file}: {error.strerror}") from None
        tensors, header = _parse(content, file)
        kind, version = header.get("format"), header.get("format_version")
        if kind != FORMAT or version != str(FORMAT_VERSION):
            raise CheckpointError(
                f"{file} holds {kind or 'something'} of version {version or '?'}: "
                f"it must be {FORMAT} of version {FORMAT_VERSION}"
            )
        if _digest(tensors) != header.get("sha256"):
            raise CheckpointError(f"{file} is damaged: its weights do not match their checksum")
        try:
            layer_count = sum(name.endswith(".matrix") for name in tensors)
            return cls(
                weights=tuple(
                    (tensors[f"layer{k}.matrix"], tensors[f"layer{k}.offset"])
                    for k in range(layer_count)
                ),
                feature_mean=tensors["feature_mean"],
                feature_scale=tensors["feature_scale"],
                endpoint_mean=tensors["endpoint_mean"],
                endpoint_scale=float(tensors["endpoint_scale"][0]),
                margin_features=tensors["margin_features"],
                margins=tensors["margins"],
                info=json.loads(header["info"]),
            )
        except (KeyError, ValueError) as error:
            raise CheckpointError(f"{file} is incomplete: {error}") from None

    def _tensors(self) -> dict[str, NDArray]:
        tensors: dict[str, NDArray] = {
            "feature_mean": self.feature_mean,
            "feature_scale": self.feature_scale,
            "endpoint_mean": self.endpoint_mean,
            "endpoint_scale": np.array([self.endpoint_scale]),
            "margin_features": self.margin_features,
            "margins": self.margins,
        }
        for k, (matrix, offset) in enumerate(self.weights):
            tensors |= {f"layer{k}.matrix": matrix, f"layer{k}.offset": offset}
        # The format takes the bytes as they lie, so a transposed view would be scrambled.
        return {name: np.ascontiguousarray(value) for name, value in tensors.items()}


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


def _parse(content: bytes, file: pathlib.Path) -> tuple[dict[str, NDArray], dict[str, str]]:
    """Arrays and text header of a safetensors file."""
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
    return tensors, header
