"""The forward model f_forw: a network from an action to where the free end comes to rest."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.models.base import LandingModel
from cablecast.models.correction import LandingCorrection

# Rows at once through the network: large enough for fast products, small enough for the cache.
_CHUNK_ROWS = 4096


@dataclasses.dataclass(frozen=True, kw_only=True)
class ForwardModel(LandingModel):
    """A trained network with everything needed to use it again.

    Attributes:
        weights: Matrix [in, out] and offset [out] of each layer; SiLU follows all but the last.
        correction: What real casts have taught beyond the network, if they have.
    """

    weights: tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]
    correction: LandingCorrection | None = None

    FORMAT = "cablecast.forward_model"

    def predict(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Where the free end will come to rest.

        Args:
            actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [action, 4].

        Returns:
            Endpoints [m], shape [action, 2].
        """
        endpoints = self.predict_uncorrected(actions)
        if self.correction is None:
            return endpoints
        inputs = self.correction_inputs(actions, self.correction.changes, endpoints)
        return endpoints + self.correction.shift(*inputs)

    def predict_uncorrected(self, actions: ArrayLike) -> NDArray[np.float64]:
        """What the network alone says of the endpoints [m], shape [action, 2]."""
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

    def predict_spread(self, actions: ArrayLike) -> NDArray[np.float64] | None:
        """How far real landings are expected to lie from the predicted ones; see the base class."""
        if self.correction is None:
            return None
        return self.correction.spread(*self.correction_inputs(actions, self.correction.changes))

    def sensitivity(
        self, actions: NDArray[np.float64], changes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """How far the network alone says that landings move; see the base class."""
        shifts = self.uncorrected.landing_shifts(actions, changes)
        return np.linalg.norm(shifts, axis=(1, 2))

    def correction_inputs(
        self,
        actions: ArrayLike,
        changes: NDArray[np.float64],
        endpoints: NDArray[np.float64] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What a correction sees of actions.

        Args:
            actions: Shape [action, 4].
            changes: Deviations of an action, shape [change, 4]; see `deviations`.
            endpoints: What `predict_uncorrected` says of them, if it is known already.

        Returns:
            Where the correction is looked up: normalised features and the normalised endpoint that
            the network predicts, shape [action, 6]. What its size depends on: the features, and the
            logarithm of how far the endpoint moves when the action deviates, shape [action, 5].
        """
        actions = np.asarray(actions, dtype=float)
        if endpoints is None:
            endpoints = self.predict_uncorrected(actions)
        features = self.normalize(actions).astype(float)
        place = (endpoints - self.endpoint_mean) / self.endpoint_scale
        shift = self.sensitivity(actions, changes)
        size = np.log(np.maximum(shift / self.endpoint_scale, 1e-6))
        return np.hstack([features, place]), np.hstack([features, size[:, None]])

    @property
    def uncorrected(self) -> "ForwardModel":
        """The network alone."""
        return dataclasses.replace(self, correction=None)

    def _own_tensors(self) -> dict[str, NDArray]:
        tensors: dict[str, NDArray] = {}
        for k, (matrix, offset) in enumerate(self.weights):
            tensors |= {f"layer{k}.matrix": matrix, f"layer{k}.offset": offset}
        if self.correction is not None:
            tensors |= self.correction.tensors()
        return tensors

    @classmethod
    def _own_fields(cls, tensors: dict[str, NDArray]) -> dict[str, Any]:
        layer_count = sum(name.endswith(".matrix") for name in tensors)
        return {
            "weights": tuple(
                (tensors[f"layer{k}.matrix"], tensors[f"layer{k}.offset"])
                for k in range(layer_count)
            ),
            "correction": LandingCorrection.from_tensors(tensors),
        }
