"""What is believed of a cable's parameters, before any cast and after some.

A fit searches a `SearchSpace`, the unit cube over the ranges of some parameters; the others keep
their values. It starts from a prior and leaves a `ParamPosterior`, Gaussians over the cube. The ten
parameters of the paper are believed to be what the cable's file states. Of the material parameters,
which a file may leave out, a fit finds those that it leaves out, each about what is typical: casts
that say nothing of a value leave it there.

Of the ten, `angular_damping` stands for all bending losses: a rate at which segments stop turning.
A real cable loses energy where it bends instead (`damping_time`), and one that was wound on a reel
keeps a curl (`rest_curvature`), which makes casts to the left and to the right differ. A sharp bend
that lasts stays in it (`yield_curvature`). The air drags on it, it may rub differently along and
across itself, and its attachment acts as a body that may be longer or shorter than it is
(`attachment_arm`), and the gripper's pads give (`grip_compliance`).
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import (
    FITTED_MATERIAL,
    PAPER_PARAMS,
    PARAMS,
    ROD_ARM,
    Attachment,
    Cable,
    CableParams,
)
from cablecast.conventions import stream
from cablecast.errors import InputError, check_count, check_number, check_seed

YIELD_TIME = 0.4
"""Time in which a bend beyond a fitted yield curvature stays in the cable [s]."""


def from_unit(
    unit: ArrayLike, low: ArrayLike, high: ArrayLike, logarithmic: ArrayLike
) -> NDArray[np.float64]:
    """Return the values at places in ranges, 0 at the low end and 1 at the high one.

    Other places are clipped.
    """
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    unit = np.clip(unit, 0.0, 1.0)
    # If the range is not logarithmic, any positive numbers will do.
    least, most = (np.where(logarithmic, bound, 1.0) for bound in (low, high))
    values = np.where(logarithmic, least * (most / least) ** unit, low + (high - low) * unit)
    # Powers may leave the range by rounding.
    return np.clip(values, low, high)


def to_unit(
    values: ArrayLike, low: ArrayLike, high: ArrayLike, logarithmic: ArrayLike
) -> NDArray[np.float64]:
    """Return the places of values in ranges, as `from_unit`; values outside are clipped."""
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    values = np.clip(values, low, high)
    least, most = np.where(logarithmic, low, 1.0), np.where(logarithmic, high, np.e)
    places = np.log(np.where(logarithmic, values, 1.0) / least) / np.log(most / least)
    return np.where(logarithmic, places, (values - low) / (high - low))


@dataclasses.dataclass(frozen=True, kw_only=True)
class SearchSpace:
    """Box of some parameters, mapped to the unit cube for the search.

    Attributes:
        names: Names of the parameters; the ten of the paper come first.
        low: Lower bounds, shape [name].
        high: Upper bounds, shape [name].
        logarithmic: Whether each parameter is searched on a logarithmic scale, shape [name].
        base: Gives the values of all others.
    """

    names: tuple[str, ...]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    logarithmic: NDArray[np.bool_]
    base: CableParams

    def __post_init__(self):
        for name, low, high, log in self._rows():
            least, most = PARAMS[name].bounds
            if not (least <= low < high <= most) or (log and low <= 0.0):
                raise InputError(
                    f"search range of {name} [{low:g}, {high:g}] must ascend within "
                    f"[{least:g}, {most:g}]" + (" and be positive" if log else "")
                )

    def _rows(self) -> Any:
        return zip(self.names, self.low, self.high, self.logarithmic, strict=True)

    @property
    def dimension(self) -> int:
        """Number of parameters."""
        return len(self.names)

    def to_params(self, unit: NDArray[np.float64]) -> CableParams:
        """Return the parameters of points in the unit cube, shape [name] or [candidate, name]."""
        values = from_unit(unit, self.low, self.high, self.logarithmic)
        columns = [float(c) if c.ndim == 0 else c for c in np.moveaxis(values, -1, 0)]
        return dataclasses.replace(self.base, **dict(zip(self.names, columns, strict=True)))

    def to_unit(self, params: CableParams) -> NDArray[np.float64]:
        """Return points of the unit cube; parameters outside the range are clipped."""
        columns = [np.asarray(getattr(params, name), dtype=float) for name in self.names]
        values = np.stack(np.broadcast_arrays(*columns), axis=-1)
        return to_unit(values, self.low, self.high, self.logarithmic)

    def of_paper(self, base: CableParams | None = None) -> "SearchSpace":
        """Return the space of the ten parameters of the paper; `base` gives all others."""
        ten = len(PAPER_PARAMS)
        return SearchSpace(
            names=PAPER_PARAMS,
            low=self.low[:ten],
            high=self.high[:ten],
            logarithmic=self.logarithmic[:ten],
            base=base or self.base,
        )

    def to_dict(self) -> dict[str, list]:
        """Return the range and scale of each parameter by name."""
        return {
            name: [float(low), float(high), "log" if log else "linear"]
            for name, low, high, log in self._rows()
        }

    @classmethod
    def for_cable(cls, cable: Cable, materials: Sequence[str] = ()) -> "SearchSpace":
        """Return the search ranges for a cable, from its geometry and its believed parameters.

        If a believed value is zero, a stiffness takes the range of the other stiffness, and the
        endpoint mass ranges up to half of the cable's mass.

        Materials are parameters to find besides the ten, some of `FITTED_MATERIAL`. One that the
        cable's file gives is kept, and so is the arm of a cable without attachment.

        Raises:
            InputError: The cable's parameters are given per world, or a name is unknown.
        """
        check_materials(materials)
        params = cable.params
        if params.world_count is not None:
            raise InputError("a search starts from one set of parameters, not from one per world")
        free = (n for n in materials if getattr(params, n) == PARAMS[n].default)
        names = (*PAPER_PARAMS, *(n for n in free if n != "attachment_arm" or _rod_arm(cable)))
        ranges = {name: _search_range(cable, name) for name in names}
        low, high = np.array(list(ranges.values())).T
        least, most = np.array([bounds(cable, name) for name in names]).T
        logarithmic = [PARAMS[n].logarithmic and ranges[n][0] > 0.0 for n in names]
        if "yield_curvature" in names:
            params = dataclasses.replace(params, yield_time=YIELD_TIME)
        return cls(
            names=names,
            low=np.clip(low, least, most),
            high=np.clip(high, least, most),
            logarithmic=np.array(logarithmic),
            base=params,
        )


def bounds(cable: Cable, name: str) -> tuple[float, float]:
    """Return the allowed range of a parameter of a cable, bounds included."""
    low, high = PARAMS[name].bounds
    if name in ("spinning_friction", "rolling_friction"):
        # Beyond the cable's radius the contact would lie outside the cable.
        high = min(high, cable.radius)
    return low, high


def _rod_arm(cable: Cable) -> float:
    """Return the arm of the attachment if it is a uniform rod [m]; 0 without one."""
    return 0.0 if cable.attachment is Attachment.NONE else ROD_ARM * cable.attachment_length


def _search_range(cable: Cable, name: str) -> tuple[float, float]:
    """Return the range that a fit searches; its low end is 0 for an endpoint mass of 0."""
    info, params = PARAMS[name], cable.params
    if info.factor is None:
        low, high = info.search or info.bounds
        scale = 1.0 / cable.length
        return (low * scale, high * scale) if info.over_length else (low, high)
    middle = _rod_arm(cable) if name == "attachment_arm" else float(getattr(params, name))
    if name in ("twist_stiffness", "bend_stiffness"):
        middle = float(middle or params.bend_stiffness or params.twist_stiffness or 1e-4)
    if middle == 0.0:
        return 0.0, 0.5 * float(params.mass)
    return middle / info.factor, middle * info.factor


def check_materials(names: Sequence[str]) -> None:
    """Raise an error for a name that is none of `FITTED_MATERIAL`.

    Raises:
        InputError: A name is unknown.
    """
    if unknown := sorted(set(names) - set(FITTED_MATERIAL)):
        raise InputError(f"materials = {unknown[0]!r} is none of {', '.join(FITTED_MATERIAL)}")


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Gaussian:
    """Gaussian over the unit coordinates of a search space whose parameters are correlated.

    Attributes:
        mean: Most likely point, shape [name].
        precision: Inverse covariance about it, shape [name, name].
    """

    mean: NDArray[np.float64]
    precision: NDArray[np.float64]

    def cost(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return half the squared distance of points from the mean, shape [point]."""
        offset = points - self.mean
        return 0.5 * np.einsum("pi,ij,pj->p", offset, self.precision, offset)

    def slope(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gradient of the cost at a point, shape [name]."""
        return self.precision @ (point - self.mean)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ParamPrior:
    """Gaussian over the unit coordinates of a search space, one deviation per parameter.

    Attributes:
        mean: Believed values in unit coordinates, shape [name].
        deviation: Standard deviations in unit coordinates, shape [name].
    """

    mean: NDArray[np.float64]
    deviation: NDArray[np.float64]

    @property
    def precision(self) -> NDArray[np.float64]:
        """Inverse covariance, shape [name, name]."""
        return np.diag(self.deviation**-2.0)

    def cost(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return half the squared distance of points from the mean, shape [point]."""
        return 0.5 * (((points - self.mean) / self.deviation) ** 2).sum(axis=1)

    def slope(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gradient of the cost at a point, shape [name]."""
        return self.deviation**-2.0 * (point - self.mean)

    @classmethod
    def for_cable(cls, cable: Cable, space: SearchSpace) -> "ParamPrior":
        """Return what is believed of a cable before any cast, in the coordinates of a space."""
        typical, deviation = {}, []
        for name in space.names:
            info = PARAMS[name]
            if name == "attachment_arm":
                typical[name] = _rod_arm(cable)
            elif info.usual is not None:
                typical[name] = info.usual
            given = cable.deviations.get(name, info.deviation or 1.0)
            deviation.append(given * (1.0 / cable.length) if info.over_length else given)
        values = np.array(deviation, dtype=float)
        low = np.where(space.logarithmic, space.low, 1.0)
        high = np.where(space.logarithmic, space.high, np.e)
        unit = np.where(
            space.logarithmic,
            np.log(np.maximum(values, 1.0 + 1e-6)) / np.log(high / low),
            values / (space.high - space.low),
        )
        # An endpoint mass of zero is searched on a linear scale: its factor has no meaning.
        free = ~space.logarithmic & [PARAMS[name].logarithmic for name in space.names]
        return cls(
            mean=space.to_unit(dataclasses.replace(cable.params, **typical)),
            deviation=np.where(free, 0.5, unit),
        )

    def draw(self, count: int, seed: int) -> NDArray[np.float64]:
        """Draw points in the unit cube, shape [count, name]; the first one is the mean."""
        rng = stream(seed, "prior")
        points = self.mean + self.deviation * rng.normal(size=(count, len(self.mean)))
        points[0] = self.mean
        return _reflected(points)


def _reflected(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points reflected at the faces of the unit cube: clipped, they would pile up there."""
    points = 1.0 - np.abs(1.0 - np.abs(points))
    return np.clip(points, 0.0, 1.0)


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
    """Gaussian over the ten parameters in unit coordinates, cut off at the faces of the cube.

    Attributes:
        space: Ranges of the ten parameters; its base gives the material.
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
        """Return what is believed of a cable before any cast."""
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
        """Draw a number of sets of parameters; the first one is the most likely."""
        check_count("count", count)
        rng = stream(check_seed(seed), "posterior")
        factor = np.linalg.cholesky(self.covariance)
        points = self.mean + rng.normal(size=(count, len(self.mean))) @ factor.T
        points[0] = self.mean
        return self.space.to_params(_reflected(points))

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the parameters that ended at a face of the search space."""
        at = (self.mean < BOUND_DISTANCE) | (self.mean > 1.0 - BOUND_DISTANCE)
        return tuple(name for name, is_at in zip(self.space.names, at, strict=True) if is_at)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the parameters that are barely better known than before the casts."""
        left = self.deviation > UNDETERMINED_SHARE * self.prior.deviation
        return tuple(name for name, is_left in zip(self.space.names, left, strict=True) if is_left)

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
        rows = [self.space.names.index(n) for n in ("lateral_friction", "worksurface_friction")]
        params = self.params
        # d(a b) = b da + a db, and both ranges are equally wide.
        weights = np.array([params.worksurface_friction, params.lateral_friction])
        after = weights @ self.covariance[np.ix_(rows, rows)] @ weights
        before = weights**2 @ self.prior.deviation[rows] ** 2
        return float(np.sqrt(after / max(before, 1e-12)))

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
        cls, values: Mapping[str, Any], search_range: Mapping[str, Any], params: CableParams
    ) -> "ParamPosterior":
        """Return the posterior that `to_dict` described, and that of its space.

        The parameters that were found give the material.

        Raises:
            InputError: A value is missing, or of another kind or shape.
        """
        try:
            rows = [search_range[name] for name in PAPER_PARAMS]
            space = SearchSpace(
                names=PAPER_PARAMS,
                base=params,
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
            covariance = arrays["covariance"]
            if (
                not np.array_equal(covariance, covariance.T)
                or np.linalg.eigvalsh(covariance)[0] <= 0
            ):
                raise InputError("its covariance is not positive definite")
            if np.any(np.abs(arrays["mean"] - 0.5) > 0.5) or np.any(arrays["prior_deviation"] <= 0):
                raise InputError("a mean lies outside its range, or a deviation is not positive")
            return cls(
                space=space,
                prior=ParamPrior(mean=arrays["prior_mean"], deviation=arrays["prior_deviation"]),
                mean=arrays["mean"],
                covariance=arrays["covariance"],
                misfit=check_number("misfit", values["misfit"], 1e-9, 1e9),
                distance=check_number("distance", values["distance"], 0.0, 1e9),
                track_count=check_count("track_count", values["track_count"], 0),
            )
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"this is no posterior of a fit: {error}") from None
