"""Fit of a correction to real casts by the marginal likelihood of their residuals."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.models.correction import LandingCorrection
from cablecast.models.forward import ForwardModel
from cablecast.models.kernel import minimize, negative_log_likelihood
from cablecast.models.rows import MIN_REAL_ROWS
from cablecast.models.torch_ import import_torch, one_thread

# Prior standard deviation of the logarithm of a length scale and of a size weight. It is weak, but
# with a few dozen casts it keeps the effect of an irrelevant variable from growing without bound.
_PRIOR_DEVIATION = 2.0

# Minimum of the noise relative to the amplitude, which keeps the covariance well conditioned.
_NOISE_MIN = 0.01

_NOISE_START = 0.2
_STEP_COUNT = 200


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResidualProcess:
    """Parameters of the process on the residuals; see `LandingCorrection`.

    Attributes:
        length_scales: Length scale along each place coordinate, shape [place].
        size_weights: Weights of the local size, shape [size].
        amplitude: Standard deviation of g [m].
        noise: Standard deviation of the noise e [m].
    """

    length_scales: NDArray[np.float64]
    size_weights: NDArray[np.float64]
    amplitude: float
    noise: float


def fit_correction(
    model: ForwardModel,
    actions: NDArray[np.float64],
    endpoint_xy: NDArray[np.float64],
    changes: NDArray[np.float64],
) -> LandingCorrection:
    """Fit a correction of a model to real casts.

    Args:
        model: Forward model. A correction that it already has is ignored.
        actions: Actions of the real casts, shape [cast, 4].
        endpoint_xy: Endpoints of the real casts [m], shape [cast, 2].
        changes: Perturbations of an action, see `deviations`, shape [change, 4].

    Raises:
        InputError: There are too few casts, or no finite fit.
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
    process = fit_process(places, sizes, residuals)
    return LandingCorrection(
        changes=changes,
        inputs=places,
        residuals=residuals * np.exp(-sizes @ process.size_weights)[:, None],
        **vars(process),
    )


def fit_process(
    places: NDArray[np.float64], sizes: NDArray[np.float64], residuals: NDArray[np.float64]
) -> ResidualProcess:
    """Maximise the posterior density of the process parameters.

    Args:
        places: Places of the casts, shape [cast, place].
        sizes: Arguments of their local size, shape [cast, size].
        residuals: Endpoint on the rig minus that of the network [m], shape [cast, 2].

    Raises:
        InputError: The fit is not finite.
        MissingExtraError: torch is not installed.
    """
    torch = import_torch("learning from real casts")
    x, h, r = (torch.tensor(a, dtype=torch.float64) for a in (places, sizes, residuals))
    widths = [places.shape[1], sizes.shape[1], 1, 1]

    def split(unknowns):
        log_scales, weights, log_amplitude, log_ratio = torch.split(unknowns, widths)
        return log_scales, weights, log_amplitude, torch.exp(log_ratio) + _NOISE_MIN

    def loss(unknowns):
        log_scales, weights, log_amplitude, ratio = split(unknowns)
        prior = ((log_scales**2).sum() + (weights**2).sum()) / (2 * _PRIOR_DEVIATION**2)
        points = x * torch.exp(-log_scales)
        return negative_log_likelihood(points, r, h @ weights + log_amplitude, ratio) + prior

    start = np.zeros(sum(widths))
    start[-2:] = np.log(float(np.std(residuals)) or 1e-6), np.log(_NOISE_START)
    # A few hundred casts are too few to share among threads.
    with one_thread():
        found = torch.tensor(minimize(loss, start, _STEP_COUNT))
    log_scales, weights, log_amplitude, ratio = (part.numpy() for part in split(found))
    amplitude = float(np.exp(log_amplitude[0]))
    return ResidualProcess(
        length_scales=np.exp(log_scales),
        size_weights=weights,
        amplitude=amplitude,
        noise=amplitude * float(ratio[0]),
    )
