"""Beliefs about the parameters of a cable: before any cast (`ParamPrior`), and after some."""

import dataclasses
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import DEFAULT_DEVIATIONS, Cable, CableParams
from cablecast.tuning.search_space import SearchSpace


class ParamBelief(Protocol):
    """Gaussian over the unit coordinates of a search space, as a fit needs it."""

    @property
    def precision(self) -> NDArray[np.float64]:
        """Inverse covariance, shape [10, 10]."""
        ...

    def cost(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return half the squared distance of points from the mean, shape [point]."""
        ...

    def slope(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gradient of the cost at a point, shape [10]."""
        ...


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class CorrelatedBelief:
    """Gaussian whose parameters depend on each other, as some casts leave them.

    Attributes:
        mean: Most likely point in unit coordinates, shape [10].
        precision: Inverse covariance about it, shape [10, 10].
    """

    mean: NDArray[np.float64]
    precision: NDArray[np.float64]

    def cost(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return half the squared distance of points from the mean, shape [point]."""
        offset = points - self.mean
        return 0.5 * np.einsum("pi,ij,pj->p", offset, self.precision, offset)

    def slope(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gradient of the cost at a point, shape [10]."""
        return self.precision @ (point - self.mean)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ParamPrior:
    """Gaussian over the unit coordinates of a search space, one deviation per parameter.

    Attributes:
        mean: Believed values in unit coordinates, shape [10].
        deviation: Standard deviations in unit coordinates, shape [10].
    """

    mean: NDArray[np.float64]
    deviation: NDArray[np.float64]

    @classmethod
    def for_cable(cls, cable: Cable, space: SearchSpace) -> "ParamPrior":
        """Return the beliefs of a cable's file in the coordinates of a search space.

        A parameter that is searched on a logarithmic scale has a factor as its deviation, another
        one a value in its own unit; see `Cable.deviations`.

        Args:
            cable: Cable with its believed values and deviations.
            space: Ranges of the search.
        """
        believed = DEFAULT_DEVIATIONS | dict(cable.deviations)
        values = np.array([believed[name] for name in CableParams.names()])
        low = np.where(space.logarithmic, space.low, 1.0)
        high = np.where(space.logarithmic, space.high, np.e)
        deviation = np.where(
            space.logarithmic,
            # An endpoint mass of zero is searched on a linear scale: its factor has no meaning.
            np.log(np.maximum(values, 1.0 + 1e-6)) / np.log(high / low),
            values / (space.high - space.low),
        )
        mass_free = ~space.logarithmic & (values > 1.0)
        return cls(mean=space.to_unit(cable.params), deviation=np.where(mass_free, 0.5, deviation))

    @property
    def precision(self) -> NDArray[np.float64]:
        """Inverse covariance, shape [10, 10]."""
        return np.diag(self.deviation**-2.0)

    def cost(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return half the squared distance of points from the mean, shape [point]."""
        return 0.5 * (((points - self.mean) / self.deviation) ** 2).sum(axis=1)

    def slope(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gradient of the cost at a point, shape [10]."""
        return self.deviation**-2.0 * (point - self.mean)

    def draw(self, count: int, seed: int) -> NDArray[np.float64]:
        """Draw points in the unit cube; the first one is the mean.

        Args:
            count: Number of points.
            seed: Seed of the draws.

        Returns:
            Unit coordinates, shape [count, 10].
        """
        rng = np.random.default_rng([seed, 11])
        points = self.mean + self.deviation * rng.normal(size=(count, len(self.mean)))
        points[0] = self.mean
        return np.clip(points, 0.0, 1.0)
