"""ManyCablesModel: one network from an action and the parameters of a cable to the endpoint.

For one cable the parameters are constants, which the first layer adds to its offset. What is left
is a forward model of that cable, which plans as any other does.
"""

import dataclasses
import functools
import json
import pathlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import CableParams
from cablecast.datasets.reader import settings_setup
from cablecast.errors import CheckpointError, InputError
from cablecast.models.cable_features import CABLE_FEATURES, cable_features
from cablecast.models.checkpoint import digest, read_checkpoint, write_checkpoint
from cablecast.models.features import FEATURE_COUNT, action_features
from cablecast.models.forward import ForwardModel
from cablecast.models.network import Weights, network_outputs, weight_tensors, weights_of_tensors
from cablecast.runs.settings import plain_settings
from cablecast.setup import SECTIONS, Setup

POINT_COUNT = 3
"""Points that the network predicts: the endpoint, and the corners of the box around its path."""

# Cables may lie this far beyond those of the training [share of a feature's range].
_BEYOND = 0.02

_ARRAYS = (
    "feature_mean",
    "feature_scale",
    "cable_low",
    "cable_high",
    "endpoint_mean",
    "margin_actions",
)

# What decides where a cast lands, besides the parameters. The size of the table and the arm do not.
_DECISIVE = (
    ("cable", "length"),
    ("cable", "diameter"),
    ("workspace", "reset_y"),
    ("workspace", "grip_height"),
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ManyCablesModel:
    """A network that has learned from casts of many cables, all of one length and diameter.

    It predicts the endpoint, and the corners of the box around the free end's path, which tell
    whether the cast stays on the table.

    Attributes:
        feature_mean: Mean of each feature of the actions, shape [4].
        feature_scale: Standard deviation of each of them, shape [4].
        cable_low: Least value of each feature of the cables, shape [cable feature].
        cable_high: Greatest value of each of them, shape [cable feature].
        endpoint_mean: Mean endpoint [m], shape [2].
        endpoint_scale: Scale of the endpoint [m], the same for x and y.
        margin_actions: Actions for which `for_cable` predicts the table margin, shape [row, 4].
        weights: Matrix and offset of each layer. SiLU follows every layer but the last.
        info: Configuration, metrics, learning curve, versions, and the settings of the casts.
    """

    feature_mean: NDArray[np.float64]
    feature_scale: NDArray[np.float64]
    cable_low: NDArray[np.float64]
    cable_high: NDArray[np.float64]
    endpoint_mean: NDArray[np.float64]
    endpoint_scale: float
    margin_actions: NDArray[np.float64]
    weights: Weights
    info: dict[str, Any] = dataclasses.field(default_factory=dict)

    FORMAT = "cablecast.many_cables_model"

    @functools.cached_property
    def setup(self) -> Setup:
        """Set-up of the training casts, with the cable around which theirs were drawn."""
        return settings_setup(self.info["dataset"], "the model")

    @property
    def metrics(self) -> dict[str, Any]:
        """Prediction errors, row counts and training time."""
        return self.info["metrics"]

    @functools.cached_property
    def fingerprint(self) -> str:
        """Short name of this model: the start of the SHA-256 of all its arrays."""
        return digest(self.tensors())

    def normalize(self, actions: ArrayLike, params: CableParams) -> NDArray[np.float32]:
        """Return the inputs of the network.

        Args:
            actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [row, 4].
            params: Parameters, shared by all rows or one value per row.

        Returns:
            Inputs, shape [row, 4 + cable feature].
        """
        action = (action_features(actions) - self.feature_mean) / self.feature_scale
        cable = np.broadcast_to(self._cable_inputs(params), (len(action), len(CABLE_FEATURES)))
        return np.hstack([action, cable]).astype(np.float32)

    def predict(self, actions: ArrayLike, params: CableParams) -> NDArray[np.float64]:
        """Predict where the free end comes to rest.

        Args:
            actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [row, 4].
            params: Parameters, shared by all rows or one value per row.

        Returns:
            Endpoints [m], shape [row, 2].
        """
        return self._points(self.normalize(actions, params))[:, 0]

    def for_cable(self, params: CableParams, setup: Setup | None = None) -> ForwardModel:
        """Return the forward model of one cable, without any training.

        Args:
            params: Parameters of the cable, as `tune` finds them.
            setup: Set-up with the cable; the one of the training where None.

        Raises:
            InputError: The parameters are those of several cables or lie outside the ranges of the
                training, or the set-up differs from that of the training in what decides landings.
        """
        setup = self.setup if setup is None else setup
        if params.world_count is not None:
            raise InputError("a forward model needs the parameters of one cable")
        self.check_setup(setup)
        self.check_params(params)
        (first, first_offset), *rest, (last, last_offset) = self.weights
        constant = self._cable_inputs(params)[0].astype(np.float32)
        model = ForwardModel(
            feature_mean=self.feature_mean,
            feature_scale=self.feature_scale,
            endpoint_mean=self.endpoint_mean,
            endpoint_scale=self.endpoint_scale,
            weights=(
                (first[:FEATURE_COUNT], first_offset + constant @ first[FEATURE_COUNT:]),
                *rest,
                (np.ascontiguousarray(last[:, :2]), last_offset[:2]),
            ),
            info=self._info_for(params, setup),
        )
        corners = self._points(self.normalize(self.margin_actions, params))[:, 1:]
        margins = setup.workspace.edge_distance(corners).min(axis=1)
        return dataclasses.replace(
            model,
            margin_features=model.normalize(self.margin_actions),
            margins=margins.astype(np.float32),
        )

    def check_setup(self, setup: Setup) -> None:
        """Refuse a set-up in which equal casts land elsewhere than in the training.

        Raises:
            InputError: It differs in what decides landings; names it and both values.
        """
        if setup.motion != self.setup.motion:
            raise InputError(
                f"the model of many cables was trained for {self.setup.motion}, not for "
                f"{setup.motion}"
            )
        here, there = (s.cable.material.to_dict() for s in (setup, self.setup))
        if here != there:
            raise InputError(
                f"the model of many cables was trained for the material {there}, not for {here}"
            )
        for section, name in _DECISIVE:
            here, there = (getattr(getattr(s, section), name) for s in (setup, self.setup))
            if here != there:
                raise InputError(
                    f"the model of many cables was trained with {section} {name} = {there:g} m, "
                    f"not with {here:g} m: train one for this set-up"
                )

    def check_params(self, params: CableParams) -> None:
        """Refuse a cable unlike those of the training.

        Raises:
            InputError: A feature of it lies outside their range; names it and the bound.
        """
        features = cable_features(params, self.setup.cable)
        slack = _BEYOND * (self.cable_high - self.cable_low)
        low, high = self.cable_low - slack, self.cable_high + slack
        for row, column in np.argwhere((features < low) | (features > high)):
            raise InputError(
                f"{CABLE_FEATURES[column]} of the cable is exp({features[row, column]:.2f}) and "
                f"outside [exp({low[column]:.2f}), exp({high[column]:.2f}]), the range of the "
                "cables that the model of many cables has learned from"
            )

    def _cable_inputs(self, params: CableParams) -> NDArray[np.float64]:
        """Return features of cables, scaled to deviation 1 over their range."""
        middle, width = (self.cable_low + self.cable_high) / 2, self.cable_high - self.cable_low
        features = cable_features(params, self.setup.cable)
        return np.sqrt(12.0) * (features - middle) / width

    def _points(self, inputs: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the predicted points [m], shape [row, point, 2]."""
        outputs = network_outputs(inputs, self.weights)
        points = outputs.reshape(len(inputs), POINT_COUNT, 2)
        return self.endpoint_mean + self.endpoint_scale * points

    def _info_for(self, params: CableParams, setup: Setup) -> dict[str, Any]:
        """Return the description of the model of one cable."""
        dataset = self.info["dataset"]
        parts = {name: setup.to_settings()[name] for name in SECTIONS}
        settings = dataset["settings"] | parts | {"params": params.to_dict()}
        return self.info | {
            "dataset": dataset | {"settings": plain_settings(settings)},
            "many_cables": {"fingerprint": self.fingerprint},
        }

    def save(self, folder: str | pathlib.Path) -> None:
        """Write the checkpoint.

        Args:
            folder: Folder for `model.safetensors` and `model.json`.
        """
        write_checkpoint(folder, self.FORMAT, self.tensors(), self.info)

    @classmethod
    def load(cls, folder: str | pathlib.Path) -> "ManyCablesModel":
        """Read a checkpoint.

        Args:
            folder: Folder given to `save`.

        Raises:
            CheckpointError: The file is missing, truncated, damaged, or of another kind.
        """
        checkpoint = read_checkpoint(folder)
        checkpoint.check(cls.FORMAT)
        tensors = checkpoint.tensors
        try:
            return cls(
                **{name: tensors[name] for name in _ARRAYS},
                endpoint_scale=float(tensors["endpoint_scale"][0]),
                weights=weights_of_tensors(tensors),
                info=json.loads(checkpoint.header["info"]),
            )
        except (KeyError, ValueError, InputError) as error:
            raise CheckpointError(f"{checkpoint.file} is incomplete: {error}") from None

    def tensors(self) -> dict[str, NDArray]:
        """Return all arrays by name, as stored in the checkpoint."""
        tensors: dict[str, NDArray] = {name: getattr(self, name) for name in _ARRAYS}
        tensors["endpoint_scale"] = np.array([self.endpoint_scale])
        tensors |= weight_tensors(self.weights)
        return {name: np.ascontiguousarray(value) for name, value in tensors.items()}
