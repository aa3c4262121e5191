"""Residuals: what real casts add to a simulated landing, from the first cast on.

The residual of a cast, measured minus simulated landing, is modelled as s g(a) + f h(a) + k(a) e. g
and h are Gaussian processes with Matern 3/2 kernels over the features of the action, the simulated
landing and the side of the table; e is scatter from cast to cast. The size s is a power of that of
`LocalSize` and of an ensemble: casts that land far away, or on which simulators disagree, miss by
more. f is the shift of the landing with the friction: an error that moves all casts like it, and so
reaches far. The scatter k follows the sensitivity of the landing to action and friction. Four
numbers are fitted (`ResidualScales`), each with a prior that a hundred casts overrule.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from cablecast.learning.kernel import matern


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArrayRows:
    """Base of records of arrays that are selected and joined together."""

    def __len__(self) -> int:
        return len(getattr(self, dataclasses.fields(self)[0].name))

    def __getitem__(self, rows) -> Self:
        return type(self)(
            **{field.name: getattr(self, field.name)[rows] for field in dataclasses.fields(self)}
        )

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return several as one."""
        return cls(
            **{
                field.name: np.concatenate([getattr(part, field.name) for part in parts])
                for field in dataclasses.fields(cls)
            }
        )


def length_scales(dimension: int = 2) -> NDArray[np.float64]:
    """Return the length scales of the process along the coordinates of a place.

    These are the five normalised features of the action, the normalised outcome of `dimension`
    components, and the side (+1 right, -1 left), which is 2 from one to the other.
    """
    return np.array([1.2, 1.2, 1.2, 1.5, 1.2, *[1.2] * dimension, 3.0])


FRICTION_SIZE, FRICTION_REACH = 0.05, 3.0
"""Typical standard deviation of h along each of x and y, as a relative change of the friction, and
its length scales over those of g. It stands for all errors that are magnified as friction's are."""

_JITTER = 1e-9


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResidualScales:
    """Parameters of the process.

    Attributes:
        amplitude: Standard deviation of g along each of x and y [cable lengths].
        noise: Standard deviation of the scatter e along each of x and y [cable lengths].
        length: Factor of all length scales.
        power: Exponent of the local size.
        friction: Standard deviation of h along each of x and y, as a relative change of the
            friction [-]; it is not fitted.
    """

    amplitude: float = 0.055
    noise: float = 0.04
    length: float = 0.8
    power: float = 0.9
    friction: float = FRICTION_SIZE

    def to_array(self) -> NDArray[np.float64]:
        """Return the unconstrained numbers of the fit, shape [4]."""
        return np.array(
            [np.log(self.amplitude), np.log(self.noise), np.log(self.length), self.power]
        )

    @classmethod
    def from_array(cls, values: NDArray[np.float64]) -> "ResidualScales":
        """Return the scales of unconstrained numbers."""
        amplitude, noise, length = np.exp(values[:3])
        return cls(
            amplitude=float(amplitude),
            noise=float(noise),
            length=float(length),
            power=float(values[3]),
        )


PRIOR_DEVIATIONS = np.array([0.5, 0.2, 0.4, 0.25])
"""Standard deviations of the numbers of `ResidualScales.to_array` about its defaults. The defaults
are near those of the residuals between two simulators of other parameters and resolution. That of
the noise is small: casts far from each other cannot tell an error of the simulator from scatter,
and with too much scatter corrections stop half-way. Where equal casts do scatter more, casts near
each other tell it (`Experience`)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Places(ArrayRows):
    """Coordinates of some actions for the process.

    Attributes:
        inputs: Coordinates, see `length_scales`, shape [action, 6 + k].
        log_sizes: Logarithm of the local size over that of a typical cast, shape [action].
        log_scatters: Logarithm of the scatter over that of a typical cast, shape [action].
        frictions: Shift of the landing per relative change of the friction [cable lengths], shape
            [action].
    """

    inputs: NDArray[np.float64]
    log_sizes: NDArray[np.float64]
    log_scatters: NDArray[np.float64]
    frictions: NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class FewCastResidual:
    """The process, conditioned on casts.

    Attributes:
        places: Places of the casts.
        residuals: Measured minus simulated outcomes [cable lengths], shape [cast, k].
        scatter: Factor of each cast's noise beyond that of `scales`, shape [cast].
        believed: Parameters that are expected before any cast.
        scales: Parameters of the process.
    """

    places: Places
    residuals: NDArray[np.float64]
    scatter: NDArray[np.float64]
    believed: ResidualScales = dataclasses.field(default_factory=ResidualScales)
    scales: ResidualScales = dataclasses.field(default_factory=ResidualScales)

    @classmethod
    def empty(cls, believed: ResidualScales | None = None, dimension: int = 2) -> "FewCastResidual":
        """Return the process of k = `dimension` before any cast, with expected parameters."""
        believed = believed or ResidualScales()
        return cls(
            places=Places(
                inputs=np.empty((0, len(length_scales(dimension)))),
                log_sizes=np.empty(0),
                log_scatters=np.empty(0),
                frictions=np.empty(0),
            ),
            residuals=np.empty((0, dimension)),
            scatter=np.empty(0),
            believed=believed,
            scales=believed,
        )

    def __len__(self) -> int:
        return len(self.residuals)

    def with_cast(
        self, place: Places, residual: NDArray[np.float64], scatter: float = 1.0
    ) -> "FewCastResidual":
        """Return the process with one more cast, its residual [cable lengths], shape [k]."""
        return dataclasses.replace(
            self,
            places=Places.join([self.places, place]),
            residuals=np.concatenate([self.residuals, np.reshape(residual, (1, -1))]),
            scatter=np.append(self.scatter, scatter),
        )

    def predict(self, places: Places) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return expected residuals [cable lengths], shape [action, k], and their variance.

        The variance is that along each axis, without scatter [square cable lengths], shape
        [action].
        """
        kernel = self._kernel(places)
        explained = np.einsum("ai,ai->a", kernel @ self._inverse, kernel)
        prior = (self._sizes(places) * self.scales.amplitude) ** 2
        prior = prior + (self.believed.friction * places.frictions) ** 2
        return kernel @ self._solved, np.maximum(prior - explained, 0.0)

    def means(self, places: Places) -> NDArray[np.float64]:
        """Return the expected residuals alone, for very many actions, shape [action, k]."""
        return self._kernel(places) @ self._solved

    def scatter_variance(self, places: Places) -> NDArray[np.float64]:
        """Return the variance of the scatter along each axis, shape [action]."""
        return (np.exp(places.log_scatters) * self.scales.noise) ** 2

    def correlation(self, places: Places, others: Places | None = None) -> NDArray[np.float64]:
        """Return the correlation of g with other places, or those of the casts, [action, other]."""
        others = self.places if others is None else others
        return _correlation(places, others, self.scales.length)

    def fitted(self, rows: NDArray[np.bool_] | None = None) -> "FewCastResidual":
        """Return the process with the most likely scales, given the prior and the casts.

        `rows` are the casts that tell the scales, shape [cast]; all if None. Those that the
        simulator was fitted to do not: their residuals are smaller than those of others will be.
        """
        chosen = np.ones(len(self), dtype=bool) if rows is None else rows
        if np.count_nonzero(chosen) < 2:
            return self
        from scipy.optimize import minimize

        informative = dataclasses.replace(
            self,
            places=self.places[chosen],
            residuals=self.residuals[chosen],
            scatter=self.scatter[chosen],
        )

        start = self.believed.to_array()
        found = minimize(informative._loss, start, method="L-BFGS-B", options={"maxiter": 60})
        values = found.x if np.all(np.isfinite(found.x)) else start
        return dataclasses.replace(self, scales=ResidualScales.from_array(values))

    def _loss(self, values: NDArray[np.float64]) -> float:
        """Return the negative log posterior density of the scales."""
        offset = (values - self.believed.to_array()) / PRIOR_DEVIATIONS
        prior = 0.5 * float(offset @ offset)
        if np.max(np.abs(offset)) > 8.0:
            return 1e6 + prior
        trial = dataclasses.replace(self, scales=ResidualScales.from_array(values))
        factor = np.linalg.cholesky(trial._covariance)
        whitened = np.linalg.solve(factor, self.residuals)
        volume = self.residuals.shape[1] * float(np.log(np.diag(factor)).sum())
        return 0.5 * float(np.sum(whitened**2)) + volume + prior

    def _kernel(self, places: Places) -> NDArray[np.float64]:
        """Return the covariance of residuals between places and casts, without scatter."""
        kernel = self.correlation(places)
        kernel *= (self.scales.amplitude**2 * self._sizes(places))[:, None]
        kernel *= self._sizes(self.places)
        # The factor of the length scales is that of g: it says nothing of h.
        wide = _correlation(places, self.places, FRICTION_REACH)
        wide *= (self.believed.friction**2 * places.frictions)[:, None]
        wide *= self.places.frictions
        return kernel + wide

    def _sizes(self, places: Places) -> NDArray[np.float64]:
        return np.exp(self.scales.power * places.log_sizes)

    @functools.cached_property
    def _covariance(self) -> NDArray[np.float64]:
        """Covariance of the residuals of the casts, shape [cast, cast]."""
        noise = self.scatter_variance(self.places) * self.scatter**2 + _JITTER
        return self._kernel(self.places) + np.diag(noise)

    @functools.cached_property
    def _inverse(self) -> NDArray[np.float64]:
        return np.asarray(np.linalg.inv(self._covariance), dtype=float)

    @functools.cached_property
    def _solved(self) -> NDArray[np.float64]:
        return self._inverse @ self.residuals


def _correlation(places: Places, others: Places, length: float) -> NDArray[np.float64]:
    """Return the correlation at some factor of all length scales, shape [action, other]."""
    scales = length * length_scales(places.inputs.shape[1] - len(length_scales(0)))
    return matern(places.inputs / scales, others.inputs / scales)


# Smaller values are taken for this share of the typical one: their logarithm would say too much.
_SHARE_MIN = 0.05
# Each value is known to a third or so only, from a handful of simulators.
_SMOOTHING = 10.0


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class LocalSize:
    """Smooth map of the size over the table.

    Attributes:
        landing_xy: Simulated landings of some actions to the right [m], shape [action, k].
        values: Size of a miss or sensitivity of these landings, in any unit, shape [action].
    """

    landing_xy: NDArray[np.float64]
    values: NDArray[np.float64]

    @property
    def typical(self) -> float:
        """Value of a typical action."""
        return float(np.median(self.values))

    def log_sizes(self, landing_xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the logarithm of size over typical size of landings to the right, [action]."""
        # Beyond the known landings the map would grow without bounds.
        found = self._map((landing_xy - self._middle) / self._scale)
        return np.asarray(np.clip(found, *self._bounds), dtype=float)

    @functools.cached_property
    def _logs(self) -> NDArray[np.float64]:
        return np.log(np.maximum(self.values / self.typical, _SHARE_MIN))

    @functools.cached_property
    def _bounds(self) -> tuple[float, float]:
        return float(self._logs.min()), float(self._logs.max())

    @functools.cached_property
    def _middle(self) -> NDArray[np.float64]:
        return self.landing_xy.mean(axis=0)

    @functools.cached_property
    def _scale(self) -> float:
        return max(float(self.landing_xy.std(axis=0).mean()), 1e-6)

    @functools.cached_property
    def _map(self):
        from scipy.interpolate import RBFInterpolator

        points = (self.landing_xy - self._middle) / self._scale
        return RBFInterpolator(points, self._logs, kernel="linear", smoothing=_SMOOTHING)


FAILURE_SHARE = 0.02
"""Share of casts without a landing that is expected before any cast."""

# Prior strength of scatter and failures [casts].
_SCATTER_CASTS, _FAILURE_CASTS = 2.0, 3.0
_SCATTER_MIN, _SCATTER_MAX = 0.25, 25.0
# A cast that the simulator was fitted to counts as if it scattered more, by this share.
_FITTED_NOISE = 0.5
# A drift is noticed where the normalised squared innovations of so many casts average this much (1
# is expected), each clipped, and not before there are enough casts. The noise of earlier casts then
# grows by a factor.
_DRIFT_CASTS, _DRIFT_INNOVATION, _INNOVATION_MAX, _DRIFT_FROM = 10, 2.0, 4.0, 20
_OLD_NOISE = 3.0


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Experience:
    """Residuals of the casts so far, and what they say of scatter, failures and drift.

    Arrays have one row for each cast with a landing.

    Attributes:
        residual: What real casts added to the simulated landings.
        innovations: Squared distance from expected to actual landing over the expected one [-].
        weights: Share of the scatter in the expected squared distance: the rest says nothing about
            scatter [-].
        fitted: Whether the simulator was fitted to the cast.
        aimed: Whether the cast was aimed at a target.
        ages: Factor of its noise, which a drift lets grow [-].
        drifts: Numbers of casts with a landing after which a drift was noticed.
        failed: Places of the casts without a landing.
        ended: Places of all casts.
    """

    residual: FewCastResidual
    innovations: NDArray[np.float64]
    weights: NDArray[np.float64]
    fitted: NDArray[np.bool_]
    aimed: NDArray[np.bool_]
    ages: NDArray[np.float64]
    drifts: tuple[int, ...] = ()
    failed: Places
    ended: Places

    @classmethod
    def empty(cls, believed: ResidualScales | None = None, dimension: int = 2) -> "Experience":
        """Return the experience of k = `dimension` before any cast, with expected scales."""
        residual = FewCastResidual.empty(believed, dimension)
        return cls(
            residual=residual,
            innovations=np.empty(0),
            weights=np.empty(0),
            fitted=np.empty(0, dtype=bool),
            aimed=np.empty(0, dtype=bool),
            ages=np.empty(0),
            failed=residual.places,
            ended=residual.places,
        )

    def with_cast(
        self,
        place: Places,
        residual: NDArray[np.float64] | None,
        *,
        fitted: bool = False,
        aimed: bool = True,
        age: float | None = None,
    ) -> "Experience":
        """Return the experience with one more cast.

        Args:
            place: Place of the cast.
            residual: Measured minus simulated outcome [cable lengths], shape [k]; None for a cast
                without one.
            fitted: Whether the simulator was fitted to the cast.
            aimed: Whether the cast was aimed at a target.
            age: Factor of its noise where it is known; drifts are noticed if None.
        """
        ended = Places.join([self.ended, place])
        if residual is None:
            return dataclasses.replace(self, ended=ended, failed=Places.join([self.failed, place]))
        mean, variance = self.residual.predict(place)
        scatter = self.residual.scatter_variance(place)
        total = float(variance[0] + scatter[0])
        innovation = float(np.sum((residual - mean[0]) ** 2) / (len(residual) * total))
        grown = dataclasses.replace(
            self,
            residual=self.residual.with_cast(place, residual),
            innovations=np.append(self.innovations, innovation),
            weights=np.append(self.weights, 0.0 if fitted else float(scatter[0]) / total),
            fitted=np.append(self.fitted, fitted),
            aimed=np.append(self.aimed, aimed),
            ages=np.append(self.ages, age or 1.0),
            ended=ended,
        )
        return (grown._aged() if age is None else grown)._with_scatter()

    def with_fitted_scales(self) -> "Experience":
        """Return the experience with the scales of the process fitted to the aimed casts.

        The others miss by less: a cast that is chosen for where it is expected to land is often one
        whose expected landing is wrong, and many targets are reached by delicate casts only.
        """
        residual = self.residual.fitted(self.aimed & ~self.fitted)
        return dataclasses.replace(self, residual=residual)._with_scatter()

    def scatter(self, places: Places) -> NDArray[np.float64]:
        """Return the variance of equal casts along each axis [square cable lengths], [action]."""
        return self.residual.scatter_variance(places) * self._scatter_factor(places)

    def failure_chance(self, places: Places) -> NDArray[np.float64]:
        """Return the chance of a cast without a landing, from casts nearby, shape [action]."""
        failed = (self.residual.correlation(places, self.failed) ** 4).sum(axis=1)
        ended = (self.residual.correlation(places, self.ended) ** 4).sum(axis=1)
        return (_FAILURE_CASTS * FAILURE_SHARE + failed) / (_FAILURE_CASTS + ended)

    def _scatter_factor(self, places: Places) -> NDArray[np.float64]:
        """Return the variance of the scatter over that expected, from innovations nearby."""
        near = self.residual.correlation(places) ** 4 * self.weights
        innovation = near @ self.innovations
        factor = (_SCATTER_CASTS + innovation) / (_SCATTER_CASTS + near.sum(axis=1))
        return np.clip(factor, _SCATTER_MIN, _SCATTER_MAX)

    def _with_scatter(self) -> "Experience":
        """Set the scatter of each cast to that of casts near it."""
        noise = np.sqrt(self._scatter_factor(self.residual.places)) * self.ages
        noise = noise + _FITTED_NOISE * self.fitted
        residual = dataclasses.replace(self.residual, scatter=noise)
        return dataclasses.replace(self, residual=residual)

    def _aged(self) -> "Experience":
        """Raise the noise of earlier casts where the last ones land farther off than expected."""
        count = len(self.ages)
        if count < _DRIFT_FROM or count - max(self.drifts, default=0) < _DRIFT_CASTS:
            return self
        last = np.minimum(self.innovations[-_DRIFT_CASTS:], _INNOVATION_MAX)
        if float(np.mean(last)) <= _DRIFT_INNOVATION:
            return self
        ages = self.ages.copy()
        ages[:-_DRIFT_CASTS] *= _OLD_NOISE
        return dataclasses.replace(self, ages=ages, drifts=(*self.drifts, count))
