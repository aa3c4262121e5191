"""Forward model f_forw: a neural network from an action to the endpoint (paper, section V-F)."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.models.correction import LandingCorrection
from cablecast.models.landing import LandingModel
from cablecast.models.network import Weights, network_outputs, weight_tensors, weights_of_tensors

# Lower bound of the relative shift, for its logarithm.
_SHIFT_MIN = 1e-6


@dataclasses.dataclass(frozen=True, kw_only=True)
class ForwardModel(LandingModel):
    """A trained network, with an optional correction from real casts.

    Attributes:
        weights: Matrix and offset of each layer. SiLU follows every layer but the last.
        correction: Correction fitted to real casts, if there is one.
    """

    weights: Weights
    correction: LandingCorrection | None = None

    FORMAT = "cablecast.forward_model"

    def predict(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Predict where the free end comes to rest; see `LandingModel.predict`."""
        endpoints = self.predict_uncorrected(actions)
        if self.correction is None:
            return endpoints
        inputs = self.correction_inputs(actions, self.correction.changes, endpoints)
        return endpoints + self.correction.shift(*inputs)

    def predict_uncorrected(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Predict the endpoints by the network alone.

        Args:
            actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [action, 4].

        Returns:
            Endpoints [m], shape [action, 2].
        """
        outputs = network_outputs(self.normalize(actions), self.weights)
        return self.endpoint_mean + self.endpoint_scale * outputs

    def predict_spread(self, actions: ArrayLike) -> NDArray[np.float64] | None:
        """Predict how far real landings scatter; see `LandingModel.predict_spread`."""
        if self.correction is None:
            return None
        return self.correction.spread(*self.correction_inputs(actions, self.correction.changes))

    def sensitivity(
        self, actions: NDArray[np.float64], changes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the sensitivity of the network alone; see `LandingModel.sensitivity`."""
        shifts = self.uncorrected.landing_shifts(actions, changes)
        return np.linalg.norm(shifts, axis=(1, 2))

    def correction_inputs(
        self,
        actions: ArrayLike,
        changes: NDArray[np.float64],
        endpoints: NDArray[np.float64] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the inputs of a correction for actions.

        Args:
            actions: Actions, shape [action, 4].
            changes: Perturbations of an action, see `deviations`, shape [change, 4].
            endpoints: Result of `predict_uncorrected`, if it is known already.

        Returns:
            Places, at which the process is evaluated: the normalised features and the normalised
            endpoint of the network, shape [action, 6]. Arguments of the local size: the features
            and the logarithm of the normalised sensitivity, shape [action, 5].
        """
        actions = np.asarray(actions, dtype=float)
        if endpoints is None:
            endpoints = self.predict_uncorrected(actions)
        features = self.normalize(actions).astype(float)
        shift = self.sensitivity(actions, changes)
        log_shift = np.log(np.maximum(shift / self.endpoint_scale, _SHIFT_MIN))
        places = np.hstack([features, self.normalize_endpoints(endpoints)])
        return places, np.hstack([features, log_shift[:, None]])

    @property
    def uncorrected(self) -> "ForwardModel":
        """Model without the correction."""
        return dataclasses.replace(self, correction=None)

    def _own_tensors(self) -> dict[str, NDArray]:
        tensors = weight_tensors(self.weights)
        if self.correction is not None:
            tensors |= self.correction.tensors()
        return tensors

    @classmethod
    def _own_fields(cls, tensors: dict[str, NDArray]) -> dict[str, Any]:
        return {
            "weights": weights_of_tensors(tensors),
            "correction": LandingCorrection.from_tensors(tensors),
        }
