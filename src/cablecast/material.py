"""Material: damping, curl, yield, drag and grain of a cable, beside the ten of the paper."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.checks import check_keys, check_number
from cablecast.errors import InputError

MATERIAL_BOUNDS: dict[str, tuple[float, float, str]] = {
    "damping_time": (0.0, 1.0, "s"),
    "rest_curvature": (-50.0, 50.0, "1/m"),
    "drag_coefficient": (0.0, 50.0, ""),
    "friction_ratio": (0.1, 10.0, ""),
    "attachment_arm": (0.0, 0.3, "m"),
    "attachment_friction_ratio": (0.1, 10.0, ""),
    "yield_curvature": (0.0, 1000.0, "1/m"),
    "yield_time": (0.0, 100.0, "s"),
}
"""Allowed range of each value of a `Material`, bounds included."""

ROD_ARM = 2.0 / 3.0
"""Arm of an attachment that is a uniform rod, over its length [-]."""

AIR_DENSITY = 1.2
"""Density of air at 20 degrees at sea level [kg/m³]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Material:
    """A cable's material and surface beside the ten parameters, which do nothing by default.

    Values are numbers shared by all worlds, or arrays with one value per world, shape [world].

    Attributes:
        damping_time: Time by which bending and twisting moments lead the bend: EI (curvature +
            time x its rate), as in Kelvin's and Voigt's solid [s].
        rest_curvature: Curvature that the cable has where nothing bends it, in the plane of the
            table and to the left of the gripper at the start; it rolls with the cable [1/m].
        drag_coefficient: Drag of the air on what moves across the cable: a length feels
            1/2 `AIR_DENSITY` x drag coefficient x diameter x speed². A smooth cylinder has 1 to 1.2
            [-].
        friction_ratio: Coulomb coefficient along the cable over that across it, which is the
            product of the two parameters [-].
        attachment_arm: Two thirds of the length of an attachment that the cable's end clamps, a
            uniform rod that goes on as the cable ends; a point mass at the cable's end where 0. A
            rod moves like a quarter of its mass there and the rest an arm beyond [m].
        attachment_friction_ratio: Coulomb coefficient of the attachment over that of the cable [-].
        yield_curvature: Elastic curvature beyond which a bend stays in the cable; 0 for a cable
            that springs back from every bend [1/m].
        yield_time: Time in which all but 1 / e of the curvature beyond goes over into the cable's
            shape; 0 for at once [s].
    """

    damping_time: float | NDArray[np.float64] = 0.0
    rest_curvature: float | NDArray[np.float64] = 0.0
    drag_coefficient: float | NDArray[np.float64] = 0.0
    friction_ratio: float | NDArray[np.float64] = 1.0
    attachment_arm: float | NDArray[np.float64] = 0.0
    attachment_friction_ratio: float | NDArray[np.float64] = 1.0
    yield_curvature: float | NDArray[np.float64] = 0.0
    yield_time: float | NDArray[np.float64] = 0.0

    def __post_init__(self):
        for name, (low, high, unit) in MATERIAL_BOUNDS.items():
            value = np.asarray(getattr(self, name))
            if value.dtype.kind not in "iuf" or value.ndim > 1:
                raise InputError(f"{name} must be a number or one for each world")
            bad = ~(np.isfinite(value) & (value >= low) & (value <= high))
            if np.any(bad):
                worst = float(np.atleast_1d(value)[np.atleast_1d(bad)][0])
                text = f"{name} = {worst:g} {unit}".strip()
                raise InputError(f"{text} is outside [{low:g}, {high:g}]")

    @property
    def world_count(self) -> int | None:
        """Number of worlds; None if all values are shared."""
        for name in MATERIAL_BOUNDS:
            if np.ndim(getattr(self, name)):
                return len(getattr(self, name))
        return None

    @property
    def remembers(self) -> bool:
        """True if bends are remembered: bending is damped, or the cable is curled or yields."""
        return any(
            np.any(value)
            for value in (self.damping_time, self.rest_curvature, self.yield_curvature)
        )

    @property
    def drags(self) -> bool:
        """True if the air resists with the square of the speed."""
        return bool(np.any(self.drag_coefficient))

    @property
    def is_grained(self) -> bool:
        """True if friction differs along and across the cable."""
        return bool(np.any(np.asarray(self.friction_ratio) != 1.0))

    @property
    def is_plain(self) -> bool:
        """True if the material does nothing."""
        rubs = bool(np.any(np.asarray(self.attachment_friction_ratio) != 1.0))
        has_arm = bool(np.any(self.attachment_arm))
        return not (self.remembers or self.drags or self.is_grained or has_arm or rubs)

    def to_columns(self) -> dict[str, NDArray[np.float64]]:
        """Return the values by name, shape [1] or [world]."""
        return {n: np.atleast_1d(np.asarray(getattr(self, n), float)) for n in MATERIAL_BOUNDS}

    def rows(self, worlds: slice | NDArray[np.int_] | NDArray[np.bool_]) -> "Material":
        """Return the values of some worlds."""
        values = {name: getattr(self, name) for name in MATERIAL_BOUNDS}
        return Material(**{name: v if np.ndim(v) == 0 else v[worlds] for name, v in values.items()})

    @classmethod
    def stack(cls, materials: Sequence["Material"]) -> "Material":
        """Return the materials of several worlds as one; of a single one, that.

        Raises:
            InputError: One of several has values for each world already.
        """
        if len(materials) == 1:
            return materials[0]
        if any(material.world_count is not None for material in materials):
            raise InputError("one of several cables has a material for each world: give it one")
        columns = {
            name: np.array([getattr(m, name) for m in materials]) for name in MATERIAL_BOUNDS
        }
        return cls(**{n: float(c[0]) if np.all(c == c[0]) else c for n, c in columns.items()})

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
        values = {name: float(getattr(self, name)) for name in MATERIAL_BOUNDS}
        # Left out where they do nothing, so that casts from before there were any still belong.
        plain = Material()
        for name in set(MATERIAL_BOUNDS) - {"damping_time", "rest_curvature"}:
            if values[name] == getattr(plain, name):
                del values[name]
        return values
