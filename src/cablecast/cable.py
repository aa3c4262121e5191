"""Material: damping, curl, yield, drag and grain of a cable, beside the ten of the paper.

Cables: geometry, the ten tuned parameters in SI units, three presets, and YAML files.
"""

import dataclasses
import enum
import os
import pathlib
from collections.abc import Mapping, Sequence

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import (
    InputError,
    UnknownNameError,
    UnreadableFileError,
    check_keys,
    check_name,
    check_number,
    check_ranges,
)
from cablecast.files import read_yaml, write_text

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


class Attachment(enum.Enum):
    """Attachment at the free end of the cable."""

    NONE = "none"
    HOOK = "hook"
    MAGNET = "magnet"


# Allowed range of each parameter, bounds included. The upper bounds are well above any rope, wire
# or hose of half a metre to a metre that a UR5 would cast.
PARAM_BOUNDS: dict[str, tuple[float, float]] = {
    "twist_stiffness": (0.0, 1.0),
    "bend_stiffness": (0.0, 0.1),
    "mass": (5e-4, 1.0),
    "endpoint_mass": (0.0, 0.5),
    "lateral_friction": (0.0, 2.0),
    "worksurface_friction": (0.0, 2.0),
    "spinning_friction": (0.0, 0.1),
    "rolling_friction": (0.0, 0.1),
    "linear_damping": (0.0, 5.0),
    "angular_damping": (0.0, 200.0),
}

PARAM_UNITS: dict[str, str] = {
    "twist_stiffness": "N·m²",
    "bend_stiffness": "N·m²",
    "mass": "kg",
    "endpoint_mass": "kg",
    "lateral_friction": "-",
    "worksurface_friction": "-",
    "spinning_friction": "m",
    "rolling_friction": "m",
    "linear_damping": "1/s",
    "angular_damping": "1/s",
}

DEFAULT_DEVIATIONS: dict[str, float] = {
    "twist_stiffness": 5.0,
    "bend_stiffness": 3.0,
    "mass": 1.1,
    "endpoint_mass": 1.3,
    "lateral_friction": 0.25,
    "worksurface_friction": 0.25,
    "spinning_friction": 10.0,
    "rolling_friction": 10.0,
    "linear_damping": 10.0,
    "angular_damping": 10.0,
}
"""Standard deviation of the truth about a believed value: a factor (1.1 is 10 % more or less), but
for the two frictions a value of their own unit. A kitchen scale tells masses; an
attachment is a point mass that stands for an extended body; stiffnesses are known to an order of
magnitude; dampings and lever arms are hardly known at all."""

_DIRECT_DEVIATIONS = ("lateral_friction", "worksurface_friction")


@dataclasses.dataclass(frozen=True, kw_only=True)
class CableParams:
    """The ten parameters that tuning adjusts (paper, section IV-C), in SI units.

    Every value is a number shared by all worlds, or an array with one value per world, shape
    [world].

    Attributes:
        twist_stiffness: Torsional rigidity GJ [N·m²].
        bend_stiffness: Flexural rigidity EI [N·m²].
        mass: Mass of the whole cable without its attachment [kg].
        endpoint_mass: Mass of the attachment at the free end [kg].
        lateral_friction: Friction factor of the cable [-].
        worksurface_friction: Friction factor of the table [-]. The product of both is the Coulomb
            coefficient, as in Bullet.
        spinning_friction: Spinning friction as a lever arm [m].
        rolling_friction: Rolling friction as a lever arm [m].
        linear_damping: Decay rate of velocities [1/s].
        angular_damping: Decay rate of the rotation of cable segments [1/s].
    """

    twist_stiffness: float | NDArray[np.float64]
    bend_stiffness: float | NDArray[np.float64]
    mass: float | NDArray[np.float64]
    endpoint_mass: float | NDArray[np.float64]
    lateral_friction: float | NDArray[np.float64]
    worksurface_friction: float | NDArray[np.float64]
    spinning_friction: float | NDArray[np.float64]
    rolling_friction: float | NDArray[np.float64]
    linear_damping: float | NDArray[np.float64]
    angular_damping: float | NDArray[np.float64]

    def __post_init__(self):
        shapes = set()
        for name, (low, high) in PARAM_BOUNDS.items():
            try:
                value = np.asarray(getattr(self, name), dtype=float)
            except (TypeError, ValueError):
                raise InputError(f"{name} = {getattr(self, name)!r} is not a number") from None
            if value.ndim > 1:
                raise InputError(f"{name} has shape {value.shape}: it must be a number or [world]")
            shapes |= {value.shape} - {()}
            bad = ~(np.isfinite(value) & (value >= low) & (value <= high))
            if np.any(bad):
                offender = float(value[bad][0]) if value.ndim else float(value)
                raise InputError(
                    f"{name} = {offender:g} {PARAM_UNITS[name]} is outside [{low:g}, {high:g}]"
                )
        if len(shapes) > 1:
            raise InputError(f"parameters have different numbers of worlds: {sorted(shapes)}")

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of the ten parameters, in the order of `to_array`."""
        return tuple(field.name for field in dataclasses.fields(cls))

    @property
    def world_count(self) -> int | None:
        """Number of worlds; None if all values are shared."""
        for name in self.names():
            value = np.asarray(getattr(self, name))
            if value.ndim:
                return len(value)
        return None

    @property
    def friction(self) -> float | NDArray[np.float64]:
        """Coulomb coefficient between cable and table [-], lateral times worksurface friction."""
        return self.lateral_friction * self.worksurface_friction

    def rows(self, worlds: slice | NDArray[np.int_] | NDArray[np.bool_]) -> "CableParams":
        """Return the values of some worlds; those that all worlds share stay so."""
        if self.world_count is None:
            return self
        return CableParams.from_array(self.to_array()[worlds])

    def to_array(self) -> NDArray[np.float64]:
        """Return the values as an array, shape [10] or [world, 10]."""
        columns = [np.asarray(getattr(self, name), dtype=float) for name in self.names()]
        return np.stack(np.broadcast_arrays(*columns), axis=-1)

    @classmethod
    def from_array(cls, values: ArrayLike) -> "CableParams":
        """Make parameters from an array in the order of `names`, shape [10] or [world, 10]."""
        values = np.asarray(values, dtype=float)
        if values.ndim not in (1, 2) or values.shape[-1] != len(cls.names()):
            raise InputError(
                f"parameters have shape {values.shape}: it must be [10] or [world, 10]"
            )
        columns = [float(c) if c.ndim == 0 else c for c in np.moveaxis(values, -1, 0)]
        return cls(**dict(zip(cls.names(), columns, strict=True)))

    def to_dict(self) -> dict[str, float]:
        """Return the values by name, for a config file.

        Raises:
            InputError: The parameters differ from world to world.
        """
        if self.world_count is not None:
            raise InputError("only parameters that all worlds share can be written to a file")
        return {name: float(getattr(self, name)) for name in self.names()}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Cable:
    """A cable with its nominal parameters, before tuning.

    Attributes:
        name: Name of the cable.
        length: Length r_c from the grip to the endpoint [m]; errors are given in % of it.
        diameter: Outer diameter [m].
        attachment: Attachment at the free end.
        attachment_length: Length of the attachment beyond the cable [m].
        params: Believed values of the ten parameters, from which tuning starts.
        deviations: Believed deviations of some of them, by name, as in `DEFAULT_DEVIATIONS`, which
            holds for the others.
        material: Damping, curl, drag and grain; `EngineWarp` alone plays them.
    """

    name: str
    length: float
    diameter: float
    attachment: Attachment = Attachment.NONE
    attachment_length: float = 0.0
    params: CableParams
    deviations: Mapping[str, float] = dataclasses.field(default_factory=dict, hash=False)
    material: Material = dataclasses.field(default_factory=Material)

    def __post_init__(self):
        check_name(self.name, "cable")
        check_ranges(
            self,
            {
                "length": (0.05, 5.0, "m"),
                "diameter": (0.0005, 0.05, "m"),
                "attachment_length": (0.0, 0.3, "m"),
            },
            "cable",
        )
        if not isinstance(self.attachment, Attachment):
            raise InputError(f"cable attachment = {self.attachment!r} is not an Attachment")
        if not isinstance(self.material, Material):
            raise InputError(f"cable material = {self.material!r} is not a Material")
        if not isinstance(self.params, CableParams):
            raise InputError(f"cable params must be CableParams, not {type(self.params).__name__}")
        given = check_keys(self.deviations, set(CableParams.names()), "cable deviations")
        for name, value in given.items():
            low, high = (1e-3, 2.0) if name in _DIRECT_DEVIATIONS else (1.001, 1e3)
            check_number(f"deviation of {name}", value, low, high)
        object.__setattr__(self, "deviations", {name: float(v) for name, v in given.items()})

    @property
    def radius(self) -> float:
        """Half the diameter [m], the height of the axis of a lying cable."""
        return self.diameter / 2

    def with_material(self, material: Material | None) -> "Cable":
        """Return the cable with another material; as it is where None."""
        return self if material is None else dataclasses.replace(self, material=material)

    def to_dict(self) -> dict:
        """Return plain values for a config or YAML file."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        values |= {"attachment": self.attachment.value, "params": self.params.to_dict()}
        values["material"] = self.material.to_dict()
        # Left out where empty, so that casts of a cable without them belong together.
        if self.material.is_plain:
            del values["material"]
        if not self.deviations:
            del values["deviations"]
        return values

    @classmethod
    def from_dict(cls, values: Mapping) -> "Cable":
        """Make a cable from plain values, as stored in a YAML file.

        Raises:
            InputError: A key is missing, unknown, or its value out of bounds.
        """
        known = {field.name for field in dataclasses.fields(cls)}
        optional = {"attachment", "attachment_length", "deviations", "material"}
        values = check_keys(values, known, "cable", required=known - optional)
        names = set(CableParams.names())
        params = check_keys(values.pop("params"), names, "cable params", required=names)
        try:
            attachment = Attachment(values.pop("attachment", "none"))
        except ValueError as error:
            choices = ", ".join(a.value for a in Attachment)
            raise InputError(f"{str(error)[:80]}: one of {choices}") from None
        material = Material.from_dict(values.pop("material", {}))
        return cls(
            **values,
            attachment=attachment,
            params=CableParams(**params),
            material=material,
        )


# Lengths, diameters and attachments are the paper's (figure 3). The paper gives no material
# constants in SI units. Masses follow from the linear density of polyester rope (about 80 g/m at
# 11 mm and 6 g/m with a core at 2 mm) and of braided iron wire. Bend stiffnesses follow from
# bending lengths of a few centimetres, endpoint masses from the mass ratios that the paper's tuning
# found (3.5 to 4.3 of 18 segments).
_PRESETS = {
    "cable_1": Cable(
        name="cable_1",
        length=0.62,
        diameter=0.011,
        attachment=Attachment.HOOK,
        attachment_length=0.05,
        params=CableParams(
            twist_stiffness=3e-4,
            bend_stiffness=3e-4,
            mass=0.050,
            endpoint_mass=0.012,
            lateral_friction=0.8,
            worksurface_friction=0.5,
            spinning_friction=0.001,
            rolling_friction=0.001,
            linear_damping=0.1,
            angular_damping=5.0,
        ),
    ),
    "cable_2": Cable(
        name="cable_2",
        length=0.65,
        diameter=0.002,
        attachment=Attachment.HOOK,
        attachment_length=0.03,
        params=CableParams(
            twist_stiffness=2e-5,
            bend_stiffness=2e-5,
            mass=0.005,
            endpoint_mass=0.004,
            lateral_friction=0.8,
            worksurface_friction=0.4,
            spinning_friction=0.0005,
            rolling_friction=0.0003,
            linear_damping=0.2,
            angular_damping=5.0,
        ),
    ),
    "cable_3": Cable(
        name="cable_3",
        length=0.67,
        diameter=0.007,
        attachment=Attachment.MAGNET,
        attachment_length=0.01,
        params=CableParams(
            twist_stiffness=2e-3,
            bend_stiffness=2e-3,
            mass=0.090,
            endpoint_mass=0.018,
            lateral_friction=0.7,
            worksurface_friction=0.5,
            spinning_friction=0.001,
            rolling_friction=0.0005,
            linear_damping=0.1,
            angular_damping=5.0,
        ),
    ),
}

CABLE_NAMES = tuple(_PRESETS)


def load_cable(name_or_path: str | os.PathLike[str]) -> Cable:
    """Return a preset by name, or a cable from a YAML file.

    Args:
        name_or_path: One of `CABLE_NAMES`, or a path that ends in .yaml or .yml.

    Raises:
        UnknownNameError: Neither a preset nor an existing file.
        InputError: The file does not describe a cable.
    """
    name = os.fspath(name_or_path)
    if name in _PRESETS:
        return _PRESETS[name]
    path = pathlib.Path(name)
    if path.suffix not in (".yaml", ".yml") or not path.is_file():
        raise UnknownNameError(
            f"unknown cable {name[:200]!r}: one of {', '.join(CABLE_NAMES)}, or a YAML file"
        )
    try:
        return Cable.from_dict(read_yaml(path))
    except UnreadableFileError:
        raise
    except InputError as error:
        text = str(error)
        raise InputError(text if str(path) in text else f"{path}: {text}") from None


def save_cable(cable: Cable, path: pathlib.Path) -> None:
    """Write a cable as YAML that `load_cable` reads."""
    write_text(path, yaml.safe_dump(cable.to_dict(), sort_keys=False, allow_unicode=True))
