"""ParamPosterior: what is known of a cable's parameters after some casts."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams
from cablecast.errors import InputError
from cablecast.tuning.prior import ParamPrior
from cablecast.tuning.search_space import SearchSpace

UNDETERMINED_SHARE = 0.7
"""A parameter whose deviation shrinks by less than this factor was not determined by the casts."""

BOUND_DISTANCE = 0.01
"""Distance from a face of the unit cube below which a parameter is at its bound."""

BELIEVED_MISFIT, BELIEVED_DISTANCE = 0.01, 0.03
"""Scale of the model's own error, and mean distance to the tracks, that are believed before any
cast [cable lengths]. The scale is that of fits to a few casts on the virtual rig. The distance is
somewhat more than theirs, so that landings lie in the stated regions about as often as stated."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ParamPosterior:
    """Gaussian over the unit coordinates of a search space, cut off at its faces.

    Attributes:
        space: Ranges of the parameters.
        prior: What was believed before the casts.
        mean: Best point, shape [10].
        covariance: Covariance about it, shape [10, 10].
        misfit: Scale of the model's own error, half the mean distance that the fit leaves [cable
            lengths].
        distance: Mean distance from the tracks to those of the best point [cable lengths].
        track_count: Number of casts.
    """

    space: SearchSpace
    prior: ParamPrior
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    misfit: float
    distance: float
    track_count: int

    @classmethod
    def before_casts(cls, cable: Cable) -> "ParamPosterior":
        """Return what is believed of a cable before any cast.

        Args:
            cable: Cable with its believed values and deviations.
        """
        space = SearchSpace.for_cable(cable)
        prior = ParamPrior.for_cable(cable, space)
        return cls(
            space=space,
            prior=prior,
            mean=prior.mean,
            covariance=np.diag(prior.deviation**2),
            misfit=BELIEVED_MISFIT,
            distance=BELIEVED_DISTANCE,
            track_count=0,
        )

    @property
    def deviation(self) -> NDArray[np.float64]:
        """Standard deviations in unit coordinates, shape [10]."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def params(self) -> CableParams:
        """Most likely parameters."""
        return self.space.to_params(self.mean)

    def draw(self, count: int, seed: int = 0) -> CableParams:
        """Draw parameters; the first set is the most likely one.

        Args:
            count: Number of sets.
            seed: Seed of the draws.
        """
        rng = np.random.default_rng([seed, 13])
        factor = np.linalg.cholesky(self.covariance)
        points = self.mean + rng.normal(size=(count, len(self.mean))) @ factor.T
        points[0] = self.mean
        # Reflected at the faces: a parameter at its bound would pile up there otherwise.
        points = np.abs(points)
        points = 1.0 - np.abs(1.0 - points)
        return self.space.to_params(np.clip(points, 0.0, 1.0))

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the parameters that ended at a face of the search space."""
        at = (self.mean < BOUND_DISTANCE) | (self.mean > 1.0 - BOUND_DISTANCE)
        return tuple(name for name, is_at in zip(CableParams.names(), at, strict=True) if is_at)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the parameters that are hardly better known than before the casts."""
        left = self.deviation > UNDETERMINED_SHARE * self.prior.deviation
        return tuple(
            name for name, is_left in zip(CableParams.names(), left, strict=True) if is_left
        )

    def sentences(self) -> list[str]:
        """Return what the casts leave open, in words."""
        lines = []
        frictions = {"lateral_friction", "worksurface_friction"}
        left = [name for name in self.undetermined if name not in frictions]
        if left:
            names = ", ".join(name.replace("_", " ") for name in left)
            lines.append(
                f"The casts do not determine {names}: the believed values still stand there."
            )
        product = self._product_deviation()
        if frictions & set(self.undetermined) and product < UNDETERMINED_SHARE:
            lines.append(
                "Of the two frictions the casts determine only the product, "
                f"{float(self.params.friction):.3f}."
            )
        for name in self.at_bound:
            value = float(getattr(self.params, name))
            lines.append(
                f"{name.replace('_', ' ')} = {value:.3g} lies at the end of its range: check "
                "what the cable's file says of it."
            )
        return lines

    def _product_deviation(self) -> float:
        """Return the deviation of the frictions' product over that before the casts."""
        names = CableParams.names()
        rows = [names.index(name) for name in ("lateral_friction", "worksurface_friction")]
        values = self.space.to_params(self.mean).to_array()[rows]
        # d(a b) = b da + a db, and both ranges are equally wide.
        weights = values[::-1]
        after = weights @ self.covariance[np.ix_(rows, rows)] @ weights
        before = weights**2 @ self.prior.deviation[rows] ** 2
        return float(np.sqrt(after / before))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values to store with the parameters."""
        return {
            "mean": self.mean.tolist(),
            "covariance": self.covariance.tolist(),
            "prior_mean": self.prior.mean.tolist(),
            "prior_deviation": self.prior.deviation.tolist(),
            "misfit": self.misfit,
            "distance": self.distance,
            "track_count": self.track_count,
            "undetermined": list(self.undetermined),
            "at_bound": list(self.at_bound),
        }

    @classmethod
    def from_dict(
        cls, values: Mapping[str, Any], search_range: Mapping[str, Any]
    ) -> "ParamPosterior":
        """Return the posterior that `to_dict` described.

        Args:
            values: What `to_dict` returned.
            search_range: What the `to_dict` of its space returned.

        Raises:
            InputError: A value is missing, or of another kind or shape.
        """
        try:
            rows = [search_range[name] for name in CableParams.names()]
            space = SearchSpace(
                low=np.array([float(row[0]) for row in rows]),
                high=np.array([float(row[1]) for row in rows]),
                logarithmic=np.array([row[2] == "log" for row in rows]),
            )
            arrays = {
                name: np.array(values[name], dtype=float)
                for name in ("mean", "covariance", "prior_mean", "prior_deviation")
            }
            size = space.dimension
            shapes = {"covariance": (size, size)}
            for name, array in arrays.items():
                if array.shape != shapes.get(name, (size,)) or not np.isfinite(array).all():
                    raise InputError(f"{name} has shape {array.shape}")
            return cls(
                space=space,
                prior=ParamPrior(mean=arrays["prior_mean"], deviation=arrays["prior_deviation"]),
                mean=arrays["mean"],
                covariance=arrays["covariance"],
                misfit=float(values["misfit"]),
                distance=float(values["distance"]),
                track_count=int(values["track_count"]),
            )
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"this is no posterior of a fit: {error}") from None
