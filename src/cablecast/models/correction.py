"""What real casts teach a model: how far the rig's landings lie from those that it predicts.

The difference is modelled as r(a) = s(a) g(a). g is a Gaussian process over the action's features
and the endpoint that the network predicts; s(a) = exp(w . h(a)) is its local size, for a wide fast
sweep misses by ten times as much as a short one. Both are found together by the marginal
likelihood of the real casts, so the process also knows how far to trust itself at each action.
"""

import dataclasses
import functools
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from cablecast.models.forward import ForwardModel

MIN_REAL_ROWS = 15
"""Fewer real landings than this cannot tell the size of their own scatter from their trend."""

# Standard deviation of the logarithm of a length scale and of a weight of the size, before any
# cast is seen. Weak, but with a few dozen casts it keeps a variable that does not matter from
# being blown up.
_PRIOR_DEVIATION = 2.0

# The noise is at least this share of the amplitude, for a well-conditioned kernel.
_NOISE_MIN = 0.01

_STEP_COUNT = 200


@dataclasses.dataclass(frozen=True, kw_only=True)
class LandingCorrection:
    """A fitted correction.

    Attributes:
        changes: Deviations of an action by which its sensitivity was measured, shape [change, 4].
        inputs: Where the real casts lie, see `ForwardModel.correction_inputs`, shape [cast, 6].
        length_scales: Over which the correction varies in each of them, shape [6].
        size_weights: w of the local size, shape [5].
        amplitude: Deviation of g, one number for x and y [m].
        noise: Deviation of what does not repeat, in the same unit as g [m].
        residuals: g at the casts: rig minus network, divided by the size [m], shape [cast, 2].
    """

    changes: NDArray[np.float64]
    inputs: NDArray[np.float64]
    length_scales: NDArray[np.float64]
    size_weights: NDArray[np.float64]
    amplitude: float
    noise: float
    residuals: NDArray[np.float64]

    def shift(self, places: NDArray[np.float64], sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rig minus network [m], shape [action, 2].

        Args:
            places: First of what `ForwardModel.correction_inputs` returns, shape [action, 6].
            sizes: Second of it, shape [action, 5].
        """
        means = self._kernel(places) @ (self._inverse @ self.residuals)
        return self._size(sizes)[:, None] * means

    def spread(
        self, places: NDArray[np.float64], sizes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Standard deviation along each axis of what the shift leaves [m], shape [action].

        Args:
            places: As in `shift`.
            sizes: As in `shift`.
        """
        kernel = self._kernel(places)
        explained = np.einsum("ai,ai->a", kernel @ self._inverse, kernel)
        variance = np.maximum(self.amplitude**2 - explained, 0.0) + self.noise**2
        return self._size(sizes) * np.sqrt(variance)

    def _size(self, sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.exp(sizes @ self.size_weights)

    def _kernel(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.amplitude**2 * matern(
            places / self.length_scales, self.inputs / self.length_scales
        )

    @functools.cached_property
    def _inverse(self) -> NDArray[np.float64]:
        covariance = self._kernel(self.inputs) + self.noise**2 * np.eye(len(self.inputs))
        return np.asarray(np.linalg.inv(covariance), dtype=np.float64)

    def tensors(self) -> dict[str, NDArray]:
        """The arrays by name, for a checkpoint."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {f"correction.{name}": np.atleast_1d(value) for name, value in values.items()}

    @classmethod
    def from_tensors(cls, tensors: dict[str, NDArray]) -> "LandingCorrection | None":
        """The reverse of `tensors`; None where a checkpoint holds no correction."""
        if "correction.inputs" not in tensors:
            return None
        values: dict[str, Any] = {
            field.name: tensors[f"correction.{field.name}"] for field in dataclasses.fields(cls)
        }
        for name in ("amplitude", "noise"):
            values[name] = float(values[name][0])
        return cls(**values)


def matern(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """The Matern 3/2 kernel of unit length scale and amplitude, shape [first, second].

    Args:
        first: Points, shape [first, dimension].
        second: Points, shape [second, dimension].
    """
    squares = np.sum(first**2, axis=1)[:, None] + np.sum(second**2, axis=1) - 2 * first @ second.T
    distance = np.sqrt(3.0 * np.maximum(squares, 0.0))
    return (1.0 + distance) * np.exp(-distance)


def fit_correction(
    model: "ForwardModel",
    actions: NDArray[np.float64],
    endpoint_xy: NDArray[np.float64],
    changes: NDArray[np.float64],
) -> LandingCorrection:
    """Fit a correction of a model to real landings.

    Args:
        model: The model; a correction that it already has is not used.
        actions: Real casts, shape [cast, 4].
        endpoint_xy: Where they landed [m], shape [cast, 2].
        changes: See `deviations`, shape [change, 4].

    Raises:
        InputError: Too few casts.
        MissingExtraError: torch is not installed.
    """
    if len(actions) < MIN_REAL_ROWS:
        raise InputError(
            f"{len(actions)} real casts have a known endpoint: a correction needs {MIN_REAL_ROWS}"
        )
    base = model.uncorrected
    predicted = base.predict(actions)
    places, sizes = base.correction_inputs(actions, changes, predicted)
    residuals = endpoint_xy - predicted
    log_scales, weights, amplitude, noise = _maximise_likelihood(places, sizes, residuals)
    return LandingCorrection(
        changes=changes,
        inputs=places,
        length_scales=np.exp(log_scales),
        size_weights=weights,
        amplitude=amplitude,
        noise=noise,
        residuals=residuals * np.exp(-sizes @ weights)[:, None],
    )


def _maximise_likelihood(places, sizes, residuals):
    """Logarithms of the length scales, weights of the size, amplitude and noise."""
    try:
        import torch
    except ImportError:
        raise MissingExtraError("torch", "learn", "learning from real casts") from None

    place_count, size_count = places.shape[1], sizes.shape[1]
    x, h, r = (torch.tensor(a, dtype=torch.float64) for a in (places, sizes, residuals))
    eye = torch.eye(len(x), dtype=torch.float64)
    scale = float(np.std(residuals)) or 1e-6
    start = np.zeros(place_count + size_count + 2)
    start[-2:] = np.log(scale), np.log(0.2)
    unknowns = torch.tensor(start, requires_grad=True)

    def parts():
        log_scales, weights, amplitude, ratio = torch.split(
            unknowns, [place_count, size_count, 1, 1]
        )
        # The noise's share of the amplitude, kept off zero.
        return log_scales, weights, torch.exp(amplitude), torch.exp(ratio) + _NOISE_MIN

    def loss():
        log_scales, weights, amplitude, ratio = parts()
        points = x * torch.exp(-log_scales)
        squares = ((points[:, None] - points[None]) ** 2).sum(-1)
        # The root has no slope at zero: the diagonal is kept off it.
        distance = torch.sqrt(3.0 * squares + 1e-12)
        kernel = (1.0 + distance) * torch.exp(-distance) + ratio**2 * eye
        factor = torch.linalg.cholesky(kernel)
        log_size = h @ weights + torch.log(amplitude)
        g = r * torch.exp(-log_size)[:, None]
        fit = 0.5 * (g * torch.cholesky_solve(g, factor)).sum()
        # Two outputs share the kernel, and the size scales both.
        volume = 2 * torch.log(torch.diagonal(factor)).sum() + 2 * log_size.sum()
        prior = ((log_scales**2).sum() + (weights**2).sum()) / (2 * _PRIOR_DEVIATION**2)
        return fit + volume + prior

    optimizer = torch.optim.LBFGS([unknowns], max_iter=_STEP_COUNT, line_search_fn="strong_wolfe")

    def closure():
        optimizer.zero_grad()
        value = loss()
        value.backward()
        return value

    optimizer.step(closure)
    with torch.no_grad():
        log_scales, weights, amplitude, ratio = (part.numpy() for part in parts())
    if not all(np.all(np.isfinite(part)) for part in (log_scales, weights, amplitude, ratio)):
        raise InputError("the correction found no finite fit to the real casts")
    return log_scales, weights, float(amplitude[0]), float(amplitude[0] * ratio[0])
