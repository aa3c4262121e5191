"""SearchSpace: ranges of the ten parameters around the nominal values of a cable."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import PARAM_BOUNDS, Cable, CableParams
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
