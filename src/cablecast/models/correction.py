"""Correction of a forward model: a Gaussian process on the sim-to-real residual.

The residual of an action is modelled as r(a) = s(a) (g(a) + e). g is a Gaussian process over the
features of the action and the endpoint that the network predicts, and e is noise. The local size
s(a) = exp(w . h(a)) varies with the action, because a wide fast sweep misses by ten times as much
as a short one. The same fit yields the remaining spread about the corrected prediction.
"""

import dataclasses
import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.models.kernel import matern


@dataclasses.dataclass(frozen=True, kw_only=True)
class LandingCorrection:
    """A fitted correction.

    Attributes:
        changes: Perturbations for the sensitivity of an action, see `deviations`, shape
            [change, 4].
        inputs: Places of the real casts, see `ForwardModel.correction_inputs`, shape [cast, 6].
        length_scales: Length scale of the process along each place coordinate, shape [6].
        size_weights: Weights w of the local size, shape [5].
        amplitude: Standard deviation of g along each of x and y [m].
        noise: Standard deviation of the noise e along each of x and y [m].
        residuals: Endpoint on the rig minus that of the network, divided by the local size [m],
            shape [cast, 2].
    """

    changes: NDArray[np.float64]
    inputs: NDArray[np.float64]
    length_scales: NDArray[np.float64]
    size_weights: NDArray[np.float64]
    amplitude: float
    noise: float
    residuals: NDArray[np.float64]

    def shift(self, places: NDArray[np.float64], sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the expected endpoint on the rig minus that of the network.

        Args:
            places: Places of the actions, see `ForwardModel.correction_inputs`, shape [action, 6].
            sizes: Arguments h of their local size, shape [action, 5].

        Returns:
            Shifts [m], shape [action, 2].
        """
        means = self._kernel(places) @ (self._inverse @ self.residuals)
        return self._size(sizes)[:, None] * means

    def spread(
        self, places: NDArray[np.float64], sizes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the standard deviation of real endpoints about the corrected prediction.

        Args:
            places: Places of the actions, see `ForwardModel.correction_inputs`, shape [action, 6].
            sizes: Arguments h of their local size, shape [action, 5].

        Returns:
            Standard deviation along each of x and y, noise included [m], shape [action].
        """
        kernel = self._kernel(places)
        explained = np.einsum("ai,ai->a", kernel @ self._inverse, kernel)
        variance = np.maximum(self.amplitude**2 - explained, 0.0) + self.noise**2
        return self._size(sizes) * np.sqrt(variance)

    def _size(self, sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.exp(sizes @ self.size_weights)

    def _kernel(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the covariance of g between places and real casts [m²], shape [action, cast]."""
        return self.amplitude**2 * matern(
            places / self.length_scales, self.inputs / self.length_scales
        )

    @functools.cached_property
    def _inverse(self) -> NDArray[np.float64]:
        """Inverse covariance of the residuals, noise included [1/m²], shape [cast, cast]."""
        covariance = self._kernel(self.inputs) + self.noise**2 * np.eye(len(self.inputs))
        return np.asarray(np.linalg.inv(covariance), dtype=np.float64)

    def tensors(self) -> dict[str, NDArray]:
        """Return the arrays by name, as stored in a checkpoint."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {f"correction.{name}": np.atleast_1d(value) for name, value in values.items()}

    @classmethod
    def from_tensors(cls, tensors: dict[str, NDArray]) -> "LandingCorrection | None":
        """Return the correction stored by `tensors`, or None if there is none.

        Args:
            tensors: All arrays of a checkpoint by name.
        """
        if "correction.inputs" not in tensors:
            return None
        values: dict[str, Any] = {
            field.name: tensors[f"correction.{field.name}"] for field in dataclasses.fields(cls)
        }
        for name in ("amplitude", "noise"):
            values[name] = float(values[name][0])
        return cls(**values)
