"""Cables: geometry, physics in SI units, three presets, and YAML files.

The physics of a cable is one record, `CableParams`: the ten parameters that the paper tunes
(section IV-C), then the material parameters, which do nothing unless they are given. `PARAMS` holds
what is true of each number: its unit, bounds, default, the range that a fit searches, and its
uncertainty before any cast.
"""

import dataclasses
import enum
import os
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.conventions import GRAVITY
from cablecast.errors import (
    InputError,
    UnknownNameError,
    UnreadableFileError,
    check_keys,
    check_name,
    check_number,
    check_ranges,
)
from cablecast.files import read_yaml

ROD_ARM = 2.0 / 3.0
"""Arm of an attachment that is a uniform rod, over its length [-]."""

AIR_DENSITY = 1.2
"""Density of air at 20 degrees at sea level [kg/m³]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ParamInfo:
    """Facts about one number of a cable's physics.

    Attributes:
        unit: Unit; empty for a ratio.
        bounds: Allowed range, bounds included.
        default: Value that does nothing, for a cable whose file leaves it out; None where a file
            must give one.
        logarithmic: Whether a fit searches the logarithm.
        factor: Ratio of either end of the fit's range to the middle: the believed value, or for the
            arm of an attachment that of a uniform rod of its length; None where `search` says.
        search: Range of a fit; None where `factor` says, or no fit finds the number.
        usual: Most likely value for a real cable whose file leaves it out.
        deviation: Standard deviation of the truth about the believed value, unless a cable's file
            gives another: a factor (1.1 is 10 % more or less) where logarithmic, else in the unit.
        over_length: Whether `search` and `deviation` are to be divided by the cable's length.
    """

    unit: str
    bounds: tuple[float, float]
    default: float | None = None
    logarithmic: bool = True
    factor: float | None = None
    search: tuple[float, float] | None = None
    usual: float | None = None
    deviation: float | None = None
    over_length: bool = False


# The upper bounds are well above any rope, wire or hose of half a metre to a metre that a UR5 would
# cast. Deviations: a kitchen scale tells masses; an attachment is a point mass that stands for an
# extended body; stiffnesses are known to an order of magnitude; dampings and lever arms are barely
# known at all.
_FRICTION = ParamInfo(
    # The product of two such factors spans 0.02 to 2.
    unit="",
    bounds=(0.0, 2.0),
    logarithmic=False,
    search=(0.15, 1.4),
    deviation=0.25,
)
# A lever arm below a micrometre has no effect; beyond the cable's radius the contact would lie
# outside the cable, so a fit ends there.
_LEVER_ARM = ParamInfo(unit="m", bounds=(0.0, 0.1), search=(1e-6, 0.1), deviation=10.0)

PARAMS: dict[str, ParamInfo] = {
    # Ropes with sliding and with sticking strands differ by more than an order of magnitude.
    "twist_stiffness": ParamInfo(unit="N·m²", bounds=(0.0, 1.0), factor=30.0, deviation=5.0),
    "bend_stiffness": ParamInfo(unit="N·m²", bounds=(0.0, 0.1), factor=30.0, deviation=3.0),
    # A cable can be weighed, but the paper's search also spans 0.3 to 2.
    "mass": ParamInfo(unit="kg", bounds=(5e-4, 1.0), factor=2.0, deviation=1.1),
    "endpoint_mass": ParamInfo(unit="kg", bounds=(0.0, 0.5), factor=4.0, deviation=1.3),
    "lateral_friction": _FRICTION,
    "worksurface_friction": _FRICTION,
    "spinning_friction": _LEVER_ARM,
    "rolling_friction": _LEVER_ARM,
    # A light cable in air has about 1/s; 0.01/s has no effect on a cast of 2 s.
    "linear_damping": ParamInfo(unit="1/s", bounds=(0.0, 5.0), search=(1e-2, 5.0), deviation=10.0),
    # It stands for all bending losses, which are unknown beforehand.
    "angular_damping": ParamInfo(
        unit="1/s", bounds=(0.0, 200.0), search=(0.1, 200.0), deviation=10.0
    ),
    # Ropes lose their energy within some hundredths of a second.
    "damping_time": ParamInfo(
        unit="s", bounds=(0.0, 1.0), default=0.0, search=(1e-3, 0.1), usual=8e-3, deviation=2.0
    ),
    # In radians by which the whole cable turns.
    "rest_curvature": ParamInfo(
        unit="1/m",
        bounds=(-50.0, 50.0),
        default=0.0,
        logarithmic=False,
        search=(-1.5, 1.5),
        usual=0.0,
        deviation=0.3,
        over_length=True,
    ),
    # A smooth cylinder has 1 to 1.2.
    "drag_coefficient": ParamInfo(
        unit="", bounds=(0.0, 50.0), default=0.0, search=(0.2, 6.0), usual=1.1, deviation=1.3
    ),
    "friction_ratio": ParamInfo(
        unit="", bounds=(0.1, 10.0), default=1.0, search=(0.5, 2.0), usual=1.0, deviation=1.15
    ),
    # A rope that was bent about a finger keeps the bend.
    "yield_curvature": ParamInfo(
        unit="1/m",
        bounds=(0.0, 1000.0),
        default=0.0,
        search=(4.0, 250.0),
        usual=40.0,
        deviation=2.5,
    ),
    "attachment_arm": ParamInfo(
        unit="m", bounds=(0.0, 0.3), default=0.0, factor=3.0, deviation=1.5
    ),
    # Rubber pads turn by some degrees under the weight of a heavy cable, steel ones do not.
    "grip_compliance": ParamInfo(
        unit="rad/(N·m)",
        bounds=(0.0, 1000.0),
        default=0.0,
        search=(0.03, 30.0),
        usual=1.0,
        deviation=4.0,
    ),
    "yield_time": ParamInfo(unit="s", bounds=(0.0, 100.0), default=0.0),
    "attachment_friction_ratio": ParamInfo(unit="", bounds=(0.1, 10.0), default=1.0),
    "drag_ratio": ParamInfo(unit="", bounds=(0.0, 2.0), default=0.0),
}
"""What is true of each number of `CableParams`, in its order."""

PAPER_PARAMS = tuple(name for name, info in PARAMS.items() if info.default is None)
"""The ten parameters of the paper."""

FITTED_MATERIAL = tuple(
    name for name, info in PARAMS.items() if name not in PAPER_PARAMS and info.deviation is not None
)
"""Material parameters that a fit can find."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CableParams:
    """Physics of a cable in SI units: the ten parameters of the paper, and its material.

    Every value is a number shared by all worlds, or an array with one value per world, shape
    [world]. All but mass and bend stiffness do nothing by default, so that a cable in the air needs
    no friction. The values after the ten are the material, which `EngineWarp` alone simulates.

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
        damping_time: Time by which bending and twisting moments lead the bend: EI (curvature +
            time x its rate), as in Kelvin's and Voigt's solid [s].
        rest_curvature: Curvature that the cable has where nothing bends it, in the plane of the
            table and to the left of the gripper at the start; it rolls with the cable [1/m].
        drag_coefficient: Drag of the air on what moves across the cable: a length feels
            1/2 `AIR_DENSITY` x drag coefficient x diameter x speed². A smooth cylinder has 1 to 1.2
            [-].
        friction_ratio: Coulomb coefficient along the cable over that across it, which is the
            product of the two friction factors [-].
        yield_curvature: Elastic curvature beyond which a bend stays in the cable; 0 for a cable
            that springs back from every bend [1/m].
        attachment_arm: Two thirds of the length of an attachment that the cable's end clamps, a
            uniform rod that goes on as the cable ends; a point mass at the cable's end where 0. A
            rod moves like a quarter of its mass there and the rest an arm beyond [m].
        grip_compliance: Angle by which the cable turns in the gripper's pads over the bending
            moment there; 0 for a gripper that clamps it [rad/(N·m)].
        yield_time: Time in which all but 1 / e of the curvature beyond goes over into the cable's
            shape; 0 for at once [s].
        attachment_friction_ratio: Coulomb coefficient of the attachment over that of the cable [-].
        drag_ratio: Drag of the air on what moves along the cable over that across it at the same
            speed; a smooth cable has some hundredths, a chain of capsules a few tenths [-].
    """

    twist_stiffness: float | NDArray[np.float64] = 0.0
    bend_stiffness: float | NDArray[np.float64]
    mass: float | NDArray[np.float64]
    endpoint_mass: float | NDArray[np.float64] = 0.0
    lateral_friction: float | NDArray[np.float64] = 0.0
    worksurface_friction: float | NDArray[np.float64] = 0.0
    spinning_friction: float | NDArray[np.float64] = 0.0
    rolling_friction: float | NDArray[np.float64] = 0.0
    linear_damping: float | NDArray[np.float64] = 0.0
    angular_damping: float | NDArray[np.float64] = 0.0
    damping_time: float | NDArray[np.float64] = 0.0
    rest_curvature: float | NDArray[np.float64] = 0.0
    drag_coefficient: float | NDArray[np.float64] = 0.0
    friction_ratio: float | NDArray[np.float64] = 1.0
    yield_curvature: float | NDArray[np.float64] = 0.0
    attachment_arm: float | NDArray[np.float64] = 0.0
    grip_compliance: float | NDArray[np.float64] = 0.0
    yield_time: float | NDArray[np.float64] = 0.0
    attachment_friction_ratio: float | NDArray[np.float64] = 1.0
    drag_ratio: float | NDArray[np.float64] = 0.0

    def __post_init__(self):
        shapes = set()
        for name, info in PARAMS.items():
            try:
                value = np.asarray(getattr(self, name), dtype=float)
            except (TypeError, ValueError):
                raise InputError(f"{name} = {getattr(self, name)!r} is not a number") from None
            if value.ndim > 1:
                raise InputError(f"{name} has shape {value.shape}: it must be a number or [world]")
            shapes |= {value.shape} - {()}
            low, high = info.bounds
            bad = ~(np.isfinite(value) & (value >= low) & (value <= high))
            if np.any(bad):
                check_number(
                    name, float(np.atleast_1d(value)[np.atleast_1d(bad)][0]), low, high, info.unit
                )
        if len(shapes) > 1:
            raise InputError(f"parameters have different numbers of worlds: {sorted(shapes)}")

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of the values in the order of `to_array`, the ten of the paper first."""
        return tuple(PARAMS)

    @property
    def world_count(self) -> int | None:
        """Number of worlds; None if all values are shared."""
        for name in PARAMS:
            if np.ndim(getattr(self, name)):
                return len(getattr(self, name))
        return None

    @property
    def friction(self) -> float | NDArray[np.float64]:
        """Coulomb coefficient between cable and table [-], lateral times worksurface friction."""
        return self.lateral_friction * self.worksurface_friction

    @property
    def remembers_bends(self) -> bool:
        """Whether bends are remembered: bending is damped, or the cable is curled or yields."""
        return any(
            np.any(value)
            for value in (self.damping_time, self.rest_curvature, self.yield_curvature)
        )

    @property
    def has_material(self) -> bool:
        """Whether some value besides the ten does something."""
        other = set(PARAMS) - set(PAPER_PARAMS) - {"yield_time"}
        return any(np.any(np.asarray(getattr(self, n)) != PARAMS[n].default) for n in other)

    def without_material(self) -> "CableParams":
        """Return the ten parameters of the paper alone."""
        return CableParams(**{name: getattr(self, name) for name in PAPER_PARAMS})

    def rows(self, worlds: slice | NDArray[np.int_] | NDArray[np.bool_]) -> "CableParams":
        """Return the values of some worlds; those that all worlds share stay so."""
        values = {name: getattr(self, name) for name in PARAMS}
        # One world's parameters go with any number of worlds.
        return CableParams(
            **{name: v if np.size(v) == 1 else v[worlds] for name, v in values.items()}
        )

    @classmethod
    def stack(cls, params: "Sequence[CableParams]") -> "CableParams":
        """Return the parameters of several worlds as one; of a single one, those.

        Raises:
            InputError: One of several has values for each world already.
        """
        if len(params) == 1:
            return params[0]
        if any(one.world_count is not None for one in params):
            raise InputError("one of several cables has parameters for each world: give it one set")
        columns = {name: np.array([getattr(one, name) for one in params], float) for name in PARAMS}
        return cls(**{n: float(c[0]) if np.all(c == c[0]) else c for n, c in columns.items()})

    def to_columns(self) -> dict[str, NDArray[np.float64]]:
        """Return the values by name, shape [1] or [world]."""
        return {n: np.atleast_1d(np.asarray(getattr(self, n), dtype=float)) for n in PARAMS}

    def to_array(self) -> NDArray[np.float64]:
        """Return the values as an array in the order of `names`, shape [19] or [world, 19]."""
        columns = [np.asarray(getattr(self, name), dtype=float) for name in PARAMS]
        return np.stack(np.broadcast_arrays(*columns), axis=-1)

    @classmethod
    def from_array(cls, values: ArrayLike) -> "CableParams":
        """Make parameters from an array in the order of `names`, shape [19] or [world, 19]."""
        values = np.asarray(values, dtype=float)
        if values.ndim not in (1, 2) or values.shape[-1] != len(PARAMS):
            raise InputError(
                f"parameters have shape {values.shape}: it must be [{len(PARAMS)}] or [world, "
                f"{len(PARAMS)}]"
            )
        columns = [float(c) if c.ndim == 0 else c for c in np.moveaxis(values, -1, 0)]
        return cls(**dict(zip(PARAMS, columns, strict=True)))

    @classmethod
    def from_dict(cls, values: Any, what: str = "params") -> "CableParams":
        """Return the parameters of `to_dict`.

        Args:
            values: Values by name: the ten, and any of the others.
            what: Name of the mapping in an error.

        Raises:
            InputError: A key is unknown or missing, or a value is no number or out of bounds.
        """
        given = check_keys(values, set(PARAMS), what, required=set(PAPER_PARAMS))
        return cls(
            **{
                name: check_number(name, value, *PARAMS[name].bounds, PARAMS[name].unit)
                for name, value in given.items()
            }
        )

    def to_dict(self) -> dict[str, float]:
        """Return the values by name for a file, without those that do nothing.

        Raises:
            InputError: The parameters differ from world to world.
        """
        if self.world_count is not None:
            raise InputError("only parameters that all worlds share can be written to a file")
        values = {name: float(getattr(self, name)) for name in PARAMS}
        return {name: v for name, v in values.items() if v != PARAMS[name].default}


class Attachment(enum.Enum):
    """Attachment at the free end of the cable."""

    NONE = "none"
    HOOK = "hook"
    MAGNET = "magnet"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Cable:
    """A cable with its nominal parameters, before tuning.

    Attributes:
        name: Name of the cable.
        length: Length r_c from the grip to the endpoint [m]; errors are given in % of it.
        diameter: Outer diameter [m].
        attachment: Attachment at the free end.
        attachment_length: Length of the attachment beyond the cable [m].
        params: Physics: what is believed of it before tuning, what tuning found, or that of each
            world of a batch.
        deviations: Standard deviations of what is believed of some of the ten parameters, by name,
            as `ParamInfo.deviation`, which holds for the others.
    """

    name: str
    length: float
    diameter: float
    attachment: Attachment = Attachment.NONE
    attachment_length: float = 0.0
    params: CableParams
    deviations: Mapping[str, float] = dataclasses.field(default_factory=dict, hash=False)

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
        if not isinstance(self.params, CableParams):
            raise InputError(f"cable params must be CableParams, not {type(self.params).__name__}")
        given = check_keys(self.deviations, set(PAPER_PARAMS), "cable deviations")
        for name, value in given.items():
            low, high = (1.001, 1e3) if PARAMS[name].logarithmic else (1e-3, 2.0)
            check_number(f"deviation of {name}", value, low, high)
        object.__setattr__(self, "deviations", {name: float(v) for name, v in given.items()})

    @property
    def radius(self) -> float:
        """Half the diameter [m], the height of the axis of a lying cable."""
        return self.diameter / 2

    def with_params(self, params: CableParams | None = None, **values: Any) -> "Cable":
        """Return the cable with other physics.

        Args:
            params: The physics; that of the cable if None.
            **values: Values of `CableParams` that differ from it.
        """
        params = dataclasses.replace(params or self.params, **values)
        return dataclasses.replace(self, params=params)

    def to_dict(self) -> dict:
        """Return plain values for a config or YAML file."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        values |= {"attachment": self.attachment.value, "params": self.params.to_dict()}
        # Left out where empty, so that casts of a cable without them belong together.
        if not self.deviations:
            del values["deviations"]
        return values

    @classmethod
    def from_dict(cls, values: Mapping) -> "Cable":
        """Make a cable from plain values, as stored in a YAML file.

        Where `mass` stands beside length and diameter, what is missing of `params` is guessed for
        the `kind` of cable; see `guess_params`.

        Raises:
            InputError: A key is missing, unknown, or its value out of bounds.
        """
        known = {field.name for field in dataclasses.fields(cls)} | {"mass", "kind"}
        values = check_keys(values, known, "cable")
        physics = "params" if "params" in values else "mass"
        check_keys(values, known, "cable", required={"length", "diameter", physics})
        try:
            attachment = Attachment(values.pop("attachment", "none"))
        except ValueError as error:
            choices = ", ".join(a.value for a in Attachment)
            raise InputError(f"{str(error)[:80]}: one of {choices}") from None
        stated, kind = values.pop("params", {}), values.pop("kind", "rope")
        if "mass" in values:
            size = (values["length"], values["diameter"], values.pop("mass"))
            params, deviations = guess_params(*size, kind, attachment)
            stated = {**params, **check_keys(stated, set(PARAMS), "cable params")}
            given = check_keys(values.get("deviations", {}), set(PAPER_PARAMS), "cable deviations")
            values["deviations"] = {**deviations, **given}
        params = CableParams.from_dict(stated, "cable params")
        facts: dict[str, Any] = {"name": "cable", **values}
        return cls(**facts, attachment=attachment, params=params)


# What is guessed of a kind of cable: the lateral friction factor, the torsional over the bending
# rigidity (an isotropic rod of Poisson's ratio 0.5, as rubber, has 2/3), and the deviation of the
# bending rigidity.
_KINDS = {
    "rope": {"friction": 0.8, "twist": 1.0, "deviation": 4.0},
    "hose": {"friction": 1.0, "twist": 2.0 / 3.0, "deviation": 3.0},
    "wire": {"friction": 0.7, "twist": 0.8, "deviation": 5.0},
    "chain": {"friction": 0.6, "twist": 1.0, "deviation": 5.0},
}

KIND_NAMES = tuple(_KINDS)
"""Kinds of cable whose physics can be guessed."""

# Bending rigidity of a rope over the area of its section [N]: that of the presets is 3 to 6, some
# ten times that of free fibres (polyester, 10 GPa, 25 um: E d² / 16 = 0.4 N).
_ROPE_STIFFNESS = 4.0
# Young's modulus and density of silicone, rubber and soft PVC: 2 to 15 MPa, 1.1 to 1.3 kg/l
# (makers' data sheets, Shore A 50 to 80).
_RUBBER, _RUBBER_DENSITY = 5e6, 1200.0
# Strands of iron or copper of 0.2 mm that slide (IEC 60228, class 5), in soft PVC.
_METAL, _METAL_DENSITY, _STRAND, _SHEATH = 1.5e11, 8300.0, 2e-4, 1.5e7
# A chain turns freely at its links, about two diameters apart.
_LINK = 2.0
# Mass of an attachment over that of its cable: the presets have 0.2 to 0.8.
_ATTACHMENT_MASS, _ATTACHMENT_DEVIATION = 0.3, 2.0
# Lever arms of rolling and spinning friction over the diameter: the presets have 1/14 to 1/4.
_LEVER = 0.1


def guess_params(
    length: float,
    diameter: float,
    mass: float,
    kind: str = "rope",
    attachment: Attachment = Attachment.NONE,
) -> tuple[dict[str, float], dict[str, float]]:
    """Guess the ten parameters of a cable of which little is known.

    Args:
        length: Length of the cable [m].
        diameter: Outer diameter [m].
        mass: Mass of the cable without its attachment [kg].
        kind: One of `KIND_NAMES`. The rigidity of a rope grows with its section, that of a hose is
            that of a rubber tube of this mass, that of a wire is that of its sliding strands and
            its sheath, and a chain has almost none.
        attachment: Attachment at the free end.

    Returns:
        Parameters by name, and how far the truth may lie from the guessed ones, as
        `Cable.deviations`.

    Raises:
        InputError: There is no such kind, or a number is out of bounds.
    """
    if not isinstance(kind, str) or kind not in _KINDS:
        raise InputError(f"cable kind = {str(kind)[:40]!r} must be one of {', '.join(_KINDS)}")
    length = check_number("cable length", length, 0.05, 5.0, "m")
    d = check_number("cable diameter", diameter, 0.0005, 0.05, "m")
    mass = check_number("cable mass", mass, *PARAMS["mass"].bounds, "kg")
    facts, section, per_length = _KINDS[kind], np.pi * d**2 / 4, mass / length
    round_moment = np.pi * d**4 / 64
    if kind == "rope":
        stiffness = _ROPE_STIFFNESS * section
    elif kind == "hose":
        wall = min(per_length / _RUBBER_DENSITY, section)
        stiffness = _RUBBER * (round_moment - (section - wall) ** 2 / (4 * np.pi))
    elif kind == "wire":
        metal = min(per_length / _METAL_DENSITY, section)
        stiffness = _METAL * metal * min(_STRAND, d) ** 2 / 16 + _SHEATH * round_moment
    else:
        stiffness = GRAVITY * per_length * (_LINK * d) ** 3
    lever = min(_LEVER * d, d / 2)

    def within(name: str, value: float) -> float:
        return float(np.clip(value, *PARAMS[name].bounds))

    hangs = attachment is not Attachment.NONE
    params = {
        "twist_stiffness": within("twist_stiffness", facts["twist"] * stiffness),
        "bend_stiffness": within("bend_stiffness", stiffness),
        "mass": mass,
        "endpoint_mass": within("endpoint_mass", _ATTACHMENT_MASS * mass * hangs),
        "lateral_friction": facts["friction"],
        "worksurface_friction": 0.5,
        "spinning_friction": lever,
        "rolling_friction": lever,
        "linear_damping": 0.1,
        "angular_damping": 5.0,
    }
    deviations = {"bend_stiffness": facts["deviation"]}
    return params, deviations | ({"endpoint_mass": _ATTACHMENT_DEVIATION} if hangs else {})


# Lengths, diameters and attachments are the paper's (figure 3). The paper gives no material
# constants in SI units. Masses follow from the linear density of polyester rope (about 80 g/m at
# 11 mm and 6 g/m with a core at 2 mm) and of braided iron wire. Bend stiffnesses follow from
# bending lengths of a few centimetres, endpoint masses from the mass ratios that the paper's tuning
# found (3.5 to 4.3 of 18 segments).
#
# The ten values are in the order of PAPER_PARAMS.
_PRESETS = {
    name: Cable(
        name=name,
        length=length,
        diameter=diameter,
        attachment=attachment,
        attachment_length=attachment_length,
        params=CableParams(**dict(zip(PAPER_PARAMS, ten, strict=True))),
    )
    for name, length, diameter, attachment, attachment_length, ten in (
        ("cable_1", 0.62, 0.011, Attachment.HOOK, 0.05,
         (3e-4, 3e-4, 0.050, 0.012, 0.8, 0.5, 0.001, 0.001, 0.1, 5.0)),
        ("cable_2", 0.65, 0.002, Attachment.HOOK, 0.03,
         (2e-5, 2e-5, 0.005, 0.004, 0.8, 0.4, 0.0005, 0.0003, 0.2, 5.0)),
        ("cable_3", 0.67, 0.007, Attachment.MAGNET, 0.01,
         (2e-3, 2e-3, 0.090, 0.018, 0.7, 0.5, 0.001, 0.0005, 0.1, 5.0)),
    )
}  # fmt: skip

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
    if path.suffix not in (".yaml", ".yml"):
        raise UnknownNameError(
            f"unknown cable {name[:200]!r}: one of {', '.join(CABLE_NAMES)}, or a file whose name "
            "ends in .yaml"
        )
    if not path.is_file():
        raise UnknownNameError(f"there is no cable file {name[:200]}")
    try:
        return Cable.from_dict({"name": path.stem, **read_yaml(path)})
    except UnreadableFileError:
        raise
    except InputError as error:
        text = str(error)
        raise InputError(text if str(path) in text else f"{path}: {text}") from None
