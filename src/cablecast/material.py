"""Material: damping and curl of a cable, beside the ten parameters of the paper."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cablecast.checks import check_keys, check_number
from cablecast.errors import InputError

MATERIAL_BOUNDS: dict[str, tuple[float, float, str]] = {
    "damping_time": (0.0, 1.0, "s"),
    "rest_curvature": (-50.0, 50.0, "1/m"),
}
"""Allowed range of each value of a `Material`, bounds included."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Material:
    """A cable's material beside the ten parameters, which does nothing by default.

    Values are numbers shared by all worlds, or arrays with one value per world, shape [world].

    Attributes:
        damping_time: Time by which bending and twisting moments lead the bend: EI (curvature +
            time x its rate), as in Kelvin's and Voigt's solid [s].
        rest_curvature: Curvature that the cable has where nothing bends it, in the plane of the
            table and to the left of the gripper at the start; it rolls with the cable [1/m].
    """

    damping_time: float | NDArray[np.float64] = 0.0
    rest_curvature: float | NDArray[np.float64] = 0.0

    def __post_init__(self):
        for name, (low, high, unit) in MATERIAL_BOUNDS.items():
            value = np.asarray(getattr(self, name))
            if value.dtype.kind not in "iuf" or value.ndim > 1:
                raise InputError(f"{name} must be a number or one for each world")
            bad = ~(np.isfinite(value) & (value >= low) & (value <= high))
            if np.any(bad):
                worst = float(np.atleast_1d(value)[np.atleast_1d(bad)][0])
                raise InputError(f"{name} = {worst:g} {unit} is outside [{low:g}, {high:g}]")

    @property
    def world_count(self) -> int | None:
        """Number of worlds; None if all values are shared."""
        for name in MATERIAL_BOUNDS:
            if np.ndim(getattr(self, name)):
                return len(getattr(self, name))
        return None

    @property
    def remembers(self) -> bool:
        """True if the material does anything."""
        return any(np.any(getattr(self, name)) for name in MATERIAL_BOUNDS)

    def rows(self, worlds: NDArray[np.int_]) -> "Material":
        """Return the values of some worlds."""
        values = {name: getattr(self, name) for name in MATERIAL_BOUNDS}
        return Material(**{name: v if np.ndim(v) == 0 else v[worlds] for name, v in values.items()})

    @classmethod
    def from_dict(cls, values: Mapping[str, float]) -> "Material":
        """Return the material of `to_dict`; what is missing does nothing.

        Raises:
            InputError: A key is unknown, or a value is no number or out of bounds.
        """
        given = check_keys(values, set(MATERIAL_BOUNDS), "cable material")
        return cls(
            **{name: check_number(name, v, *MATERIAL_BOUNDS[name]) for name, v in given.items()}
        )

    def to_dict(self) -> dict[str, float]:
        """Return plain values for a file.

        Raises:
            InputError: The values differ from world to world.
        """
        if self.world_count is not None:
            raise InputError("only a material that all worlds share can be written to a file")
        return {name: float(getattr(self, name)) for name in MATERIAL_BOUNDS}
