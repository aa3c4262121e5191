"""SearchSpace: ranges of the ten parameters around the nominal values of a cable.

MaterialSpace: ranges and prior of the material that is fitted beside the ten parameters.

Of the ten, `angular_damping` stands for all bending losses: a rate at which segments stop turning.
A material loses energy where it bends instead (`Material.damping_time`), and a cable that was wound
on a reel keeps a curl (`rest_curvature`), which makes casts to the left and to the right differ. A
sharp bend that lasts stays in it (`yield_curvature`). The air drags on it, it may rub differently
along and across itself, and its attachment acts as a body that may be longer or shorter than it is
(`attachment_arm`). The fit searches these values together with the ten, each about what is usual:
casts that say nothing of a value leave it there.

Random cables within the ranges that `tune` searches.

Beliefs about the parameters of a cable: before any cast (`ParamPrior`), and after some.

ParamPosterior: what is known of a cable's parameters after some casts.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import (
    DEFAULT_DEVIATIONS,
    PARAM_BOUNDS,
    ROD_ARM,
    Attachment,
    Cable,
    CableParams,
    Material,
)
from cablecast.errors import InputError

STIFFNESS_FACTOR = 30.0
"""Range factor of bend and twist stiffness, which are known to an order of magnitude at best: ropes
with sliding and with sticking strands differ by more."""
MASS_FACTOR = 2.0
"""Range factor of the mass. A cable can be weighed, but the paper's search also spans 0.3 to 2."""
ENDPOINT_FACTOR = 4.0
"""Range factor of the endpoint mass, a point mass that stands for an extended body."""
FRICTION_RANGE = (0.15, 1.4)
"""Friction factors of the cable and of the table; their product spans 0.02 to 2."""
LEVER_ARM_MIN = 1e-6
"""Lever arm of rolling and spinning friction [m] below which neither has an effect."""
LINEAR_DAMPING_RANGE = (1e-2, 5.0)
"""Linear damping [1/s]. A light cable in air has about 1/s; 0.01/s has no effect on a 2 s cast."""
ANGULAR_DAMPING_RANGE = (0.1, 200.0)
"""Angular damping [1/s]. It stands for all bending losses, which are unknown beforehand."""


def from_unit(
    unit: ArrayLike, low: ArrayLike, high: ArrayLike, logarithmic: ArrayLike
) -> NDArray[np.float64]:
    """Return the values at places in their ranges.

    Args:
        unit: Places, 0 at the low end and 1 at the high one; others are clipped.
        low: Lower bounds.
        high: Upper bounds.
        logarithmic: True for a logarithmic scale.
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
    """Return the places of values in their ranges; values outside are clipped.

    Args:
        values: Values.
        low: Lower bounds.
        high: Upper bounds.
        logarithmic: True for a logarithmic scale.
    """
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    values = np.clip(values, low, high)
    least, most = np.where(logarithmic, low, 1.0), np.where(logarithmic, high, np.e)
    places = np.log(np.where(logarithmic, values, 1.0) / least) / np.log(most / least)
    return np.where(logarithmic, places, (values - low) / (high - low))


@dataclasses.dataclass(frozen=True, kw_only=True)
class SearchSpace:
    """Box of parameters, mapped to the unit cube for the search.

    Attributes:
        low: Lower bounds in the order of `CableParams.names`, shape [10].
        high: Upper bounds, shape [10].
        logarithmic: Whether each parameter is searched on a logarithmic scale, shape [10].
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    logarithmic: NDArray[np.bool_]

    def __post_init__(self):
        for name, low, high, log in zip(
            CableParams.names(), self.low, self.high, self.logarithmic, strict=True
        ):
            least, most = PARAM_BOUNDS[name]
            if not (least <= low < high <= most) or (log and low <= 0.0):
                raise InputError(
                    f"search range of {name} [{low:g}, {high:g}] must ascend within "
                    f"[{least:g}, {most:g}]" + (" and be positive" if log else "")
                )

    @property
    def dimension(self) -> int:
        """Number of parameters."""
        return len(self.low)

    def to_params(self, unit: NDArray[np.float64]) -> CableParams:
        """Return the parameters of points in the unit cube, shape [10] or [candidate, 10]."""
        return CableParams.from_array(from_unit(unit, self.low, self.high, self.logarithmic))

    def to_unit(self, params: CableParams) -> NDArray[np.float64]:
        """Return points of the unit cube; parameters outside the range are clipped."""
        return to_unit(params.to_array(), self.low, self.high, self.logarithmic)

    def to_dict(self) -> dict[str, list]:
        """Return the range and scale of each parameter by name."""
        return {
            name: [float(low), float(high), "log" if log else "linear"]
            for name, low, high, log in zip(
                CableParams.names(), self.low, self.high, self.logarithmic, strict=True
            )
        }

    @classmethod
    def for_cable(cls, cable: Cable) -> "SearchSpace":
        """Return the search ranges for a cable, from its radius and its nominal parameters.

        Stiffnesses and masses span factors around the nominal values. Friction lever arms end at
        the cable's radius, beyond which the contact would lie outside the cable. If a nominal value
        is zero, a stiffness takes the range of the other stiffness, and the endpoint mass ranges up
        to half of the cable's mass.

        Raises:
            InputError: The cable's parameters are given per world.
        """
        believed = cable.params
        if believed.world_count is not None:
            raise InputError("a search starts from one set of parameters, not from one per world")
        values = believed.to_dict()
        ranges: dict[str, tuple[float, float, bool]] = {}
        for name in ("twist_stiffness", "bend_stiffness"):
            center = values[name] or values["bend_stiffness"] or values["twist_stiffness"] or 1e-4
            ranges[name] = (center / STIFFNESS_FACTOR, center * STIFFNESS_FACTOR, True)
        ranges["mass"] = (values["mass"] / MASS_FACTOR, values["mass"] * MASS_FACTOR, True)
        endpoint = values["endpoint_mass"]
        ranges["endpoint_mass"] = (
            (endpoint / ENDPOINT_FACTOR, endpoint * ENDPOINT_FACTOR, True)
            if endpoint > 0
            else (0.0, 0.5 * values["mass"], False)
        )
        for name in ("lateral_friction", "worksurface_friction"):
            ranges[name] = (*FRICTION_RANGE, False)
        for name in ("spinning_friction", "rolling_friction"):
            ranges[name] = (LEVER_ARM_MIN, cable.radius, True)
        ranges["linear_damping"] = (*LINEAR_DAMPING_RANGE, True)
        ranges["angular_damping"] = (*ANGULAR_DAMPING_RANGE, True)
        low, high, log = zip(*(ranges[name] for name in CableParams.names()), strict=True)
        least, most = np.array([PARAM_BOUNDS[name] for name in CableParams.names()]).T
        return cls(
            low=np.clip(low, least, most),
            high=np.clip(high, least, most),
            logarithmic=np.array(log),
        )


YIELD_TIME = 0.4
"""Time in which a bend beyond the yield curvature stays in the cable [s]."""


@dataclasses.dataclass(frozen=True)
class _Belief:
    """Range of one value, and what is believed of it.

    Attributes:
        low: Least value.
        high: Largest value.
        usual: Most likely value.
        deviation: Standard deviation; a factor where the scale is logarithmic.
        logarithmic: True for a logarithmic scale.
    """

    low: float
    high: float
    usual: float
    deviation: float
    logarithmic: bool = True

    def to_unit(self, value: float) -> float:
        """Return the place of a value in the range, 0 at its low end and 1 at its high one."""
        return float(to_unit(value, self.low, self.high, self.logarithmic))

    def from_unit(self, unit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values at places in the range."""
        return from_unit(unit, self.low, self.high, self.logarithmic)

    @property
    def unit_deviation(self) -> float:
        """Standard deviation as a share of the range."""
        if self.logarithmic:
            return float(np.log(self.deviation) / np.log(self.high / self.low))
        return self.deviation / (self.high - self.low)


def _beliefs(cable: Cable) -> dict[str, _Belief]:
    """Return what is believed of the values of a material.

    Ropes lose their energy within some hundredths of a second. A smooth cylinder has a drag
    coefficient of 1 to 1.2. A rope that was bent about a finger keeps the bend. A curl turns the
    whole cable by so many radians.
    """
    curl, length = 1.0 / cable.length, ROD_ARM * cable.attachment_length
    beliefs = {
        "damping_time": _Belief(1e-3, 0.1, 8e-3, 2.0),
        "rest_curvature": _Belief(-1.5 * curl, 1.5 * curl, 0.0, 0.3 * curl, False),
        "drag_coefficient": _Belief(0.2, 6.0, 1.1, 1.3),
        "friction_ratio": _Belief(0.5, 2.0, 1.0, 1.15),
        "yield_curvature": _Belief(4.0, 250.0, 40.0, 2.5),
    }
    if cable.attachment is not Attachment.NONE and length > 0.0:
        beliefs["attachment_arm"] = _Belief(length / 3.0, length * 3.0, length, 1.5)
    return beliefs


FITTED = (
    "damping_time",
    "rest_curvature",
    "drag_coefficient",
    "friction_ratio",
    "yield_curvature",
    "attachment_arm",
)
"""Names of the values of a material that a fit can find."""


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


class MaterialSpace:
    """Box of values of a material, mapped to the unit cube for the search.

    A value that the cable's file gives is kept, and so is the arm of a cable without attachment.

    Args:
        cable: Cable with its material.
        names: Values to find, some of `FITTED`.

    Attributes:
        own: Material in the cable's file.
        names: Values that are searched; possibly none.

    Raises:
        InputError: A name is unknown.
    """

    def __init__(self, cable: Cable, names: Sequence[str]):
        check_names(names)
        self.own = cable.material
        plain, beliefs = Material(), _beliefs(cable)
        self._beliefs = {
            name: beliefs[name]
            for name in names
            if name in beliefs and np.all(getattr(self.own, name) == getattr(plain, name))
        }
        self.names = tuple(self._beliefs)

    def __len__(self) -> int:
        return len(self.names)

    def joined(self, prior: ParamPrior) -> ParamPrior:
        """Return what is believed of parameters and material, in this order.

        Args:
            prior: Prior of the ten parameters.
        """
        usual = [belief.to_unit(belief.usual) for belief in self._beliefs.values()]
        deviations = [belief.unit_deviation for belief in self._beliefs.values()]
        return ParamPrior(
            mean=np.append(prior.mean, usual), deviation=np.append(prior.deviation, deviations)
        )

    def to_material(self, unit: NDArray[np.float64]) -> Material:
        """Return the material of points in the unit cube, one value per point.

        Args:
            unit: Unit coordinates of the values, shape [point, value] or [value].
        """
        columns = np.moveaxis(unit, -1, 0)
        values = {
            name: belief.from_unit(column)
            for (name, belief), column in zip(self._beliefs.items(), columns, strict=True)
        }
        if "yield_curvature" in values:
            values["yield_time"] = np.full_like(values["yield_curvature"], YIELD_TIME)
        return dataclasses.replace(
            self.own, **{name: float(v) if np.ndim(v) == 0 else v for name, v in values.items()}
        )


def check_names(names: Sequence[str]) -> None:
    """Raise an error for a name that is none of `FITTED`.

    Raises:
        InputError: A name is unknown.
    """
    if unknown := sorted(set(names) - set(FITTED)):
        raise InputError(f"materials = {unknown[0]!r} is none of {', '.join(FITTED)}")


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
