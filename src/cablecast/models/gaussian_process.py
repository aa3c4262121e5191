"""Gaussian process from an action to the endpoint, the learned baseline (paper, section VI-A)."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.models.features import FEATURE_COUNT
from cablecast.models.kernel import matern, scaled_distances, weighted_sums
from cablecast.models.landing import LandingModel

# Actions per block of predictions; a block against 36,000 casts takes 144 MB.
_CHUNK_ROWS = 1000

_OWN = ("inputs", "length_scales", "coefficients")


@dataclasses.dataclass(frozen=True, kw_only=True)
class GaussianProcessModel(LandingModel):
    """A Gaussian process with a Matern 3/2 kernel and one length scale per feature.

    Attributes:
        inputs: Normalised features of the training casts divided by the length scales, shape
            [cast, 4].
        length_scales: Length scale of each normalised feature, shape [4].
        coefficients: Weight of each cast in the normalised endpoint, shape [cast, 2].
    """

    inputs: NDArray[np.float32]
    length_scales: NDArray[np.float64]
    coefficients: NDArray[np.float64]

    FORMAT = "cablecast.gaussian_process"

    def predict(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Predict where the free end comes to rest; see `LandingModel.predict`."""
        points = self._points(actions)
        outputs = np.empty((len(points), 2))
        for start in range(0, len(points), _CHUNK_ROWS):
            rows = slice(start, start + _CHUNK_ROWS)
            outputs[rows] = weighted_sums(matern(points[rows], self.inputs), self.coefficients)
        return self.endpoint_mean + self.endpoint_scale * outputs

    def landing_shifts(
        self, actions: NDArray[np.float64], changes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the change of the endpoint for each change; see `LandingModel.landing_shifts`.

        The derivative of the kernel, dk/dx = -3 exp(-u) (x - x_i), gives all changes in one pass
        over the casts.
        """
        points = self._points(actions)
        weights = self.coefficients
        moments = np.hstack(
            [weights] + [weights * self.inputs[:, k : k + 1] for k in range(FEATURE_COUNT)]
        )
        slopes = np.empty((len(points), 2, FEATURE_COUNT))
        for start in range(0, len(points), _CHUNK_ROWS):
            rows = slice(start, start + _CHUNK_ROWS)
            decay = np.exp(-scaled_distances(points[rows], self.inputs))
            sums = weighted_sums(decay, moments).reshape(-1, 1 + FEATURE_COUNT, 2)
            centred = points[rows, :, None] * sums[:, :1] - sums[:, 1:]
            slopes[rows] = -3.0 * np.swapaxes(centred, 1, 2)
        # The features are the variables of the action, except for the last, psi - theta2.
        moves = changes.astype(float).copy()
        moves[:, 3] -= moves[:, 1]
        moves /= self.feature_scale * self.length_scales
        return self.endpoint_scale * slopes @ moves.T

    def _points(self, actions: ArrayLike) -> NDArray[np.float32]:
        return (self.normalize(actions) / self.length_scales).astype(np.float32)

    def _own_tensors(self) -> dict[str, NDArray]:
        return {f"process.{name}": getattr(self, name) for name in _OWN}

    @classmethod
    def _own_fields(cls, tensors: dict[str, NDArray]) -> dict[str, Any]:
        return {name: tensors[f"process.{name}"] for name in _OWN}
