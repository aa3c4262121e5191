"""True values of the virtual laboratory. Nothing outside rigs/virtual may read them.

The learning side has to find these values, or live with its error, as with a real cable. They
differ from the starting values in cable.py by what a careful person gets wrong who weighs the cable
with a kitchen scale and looks up the rest.

The first laboratory has all of `EFFECTS`, each other one a selection of them. In place of an effect
that is missing stands a simpler law: a damping time for strands that slip, second-order servos for
an arm of rigid bodies. docs/virtual-rig.md gives sizes with their sources.
"""

import dataclasses
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from cablecast.cable import Attachment, Cable, load_cable


@dataclasses.dataclass(frozen=True, kw_only=True)
class HiddenCable:
    """True properties of a cable.

    Attributes:
        mass: Mass of the cable without its attachment [kg].
        bend_stiffness: Bending stiffness EI [N·m²].
        twist_stiffness: Torsional stiffness GJ [N·m²].
        bend_damping: Internal damping as a multiple of the elastic stiffness [s].
        friction: Coulomb coefficient between cable and table, mean of all places [-].
        grain: Friction across the cable is higher by this share, along it lower [-].
        curl: Curvature of the cable at rest, as it came off its spool [1/m].
        yield_curvature: Sharper elastic bends leave a lasting one [1/m].
        yield_time: Time in which a bend yields [s].
        endpoint_mass: Mass of the attachment [kg].
        endpoint_share: Place of the attachment's centre of mass, as a share of its length from its
            near end [-].
        endpoint_offset: Distance of a hook's bend from the cable's axis [m].
        endpoint_radius: Radius of a magnet's disc, or of a hook's wire [m].
        endpoint_friction: Coulomb coefficient between attachment and table [-].
        drag: Coefficient of the air drag on the cable's normal velocity [-].
        linear_damping: Decay rate of velocities in addition to the drag [1/s].
        sleeve: Length of cable that the gripper's jaws hold straight [m].
        strand_share: Share of the bending stiffness that is lost where all strands slip [-]; 0 for
            a solid cable.
        slip_curvature: Bend at which friction between strands without tension gives way [1/m].
        slip_tension: Tension that doubles that friction [N]; 0 for none.
        stiffness_field: Standard deviation of the logarithm of the stiffness along the cable [-].
        mass_field: Standard deviation of the logarithm of the mass along the cable [-].
        field_seed: Seed of both.
        kink: Angle by which the cable is kinked, in its own plane of the curl [rad].
        kink_place: Place of the kink as a share of the length [-].
        play: Angle by which a hook swings freely in its loop [rad].
        pad_stiffness: Turning stiffness of the gripper's pads [N·m/rad]; 0 for rigid ones.
        reset_spread: Standard deviation of the heading after a reset [rad].
        static_excess: Static friction in excess of kinetic friction at a creep [-].
        stribeck_speed: Speed at which that excess has fallen to 1 / e [m/s].
        friction_rise: Rise of friction with the sliding speed [s/m].
    """

    mass: float
    bend_stiffness: float
    twist_stiffness: float
    bend_damping: float
    friction: float
    grain: float
    curl: float
    yield_curvature: float
    yield_time: float
    endpoint_mass: float
    endpoint_share: float
    endpoint_offset: float
    endpoint_radius: float
    endpoint_friction: float
    drag: float
    linear_damping: float
    sleeve: float = 0.006
    strand_share: float = 0.0
    slip_curvature: float = 1.0
    slip_tension: float = 0.0
    stiffness_field: float = 0.0
    mass_field: float = 0.0
    field_seed: int = 0
    kink: float = 0.0
    kink_place: float = 0.5
    play: float = 0.0
    pad_stiffness: float = 0.0
    reset_spread: float = 0.03
    static_excess: float = 0.0
    stribeck_speed: float = 0.1
    friction_rise: float = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class HiddenArm:
    """True servos of the arm's six joints.

    The first four are those of second-order servos, and of a gripper without joints; the others
    after `stretch_mass` are those of an arm of rigid bodies.

    Attributes:
        delay: Dead time from the set point to the motor [s].
        frequency: Undamped frequency of the closed position loop [Hz].
        damping_ratio: Damping ratio of the closed position loop [-].
        feedforward: Share of the commanded rate that is fed forward [-].
        torque: Torque of the standing base joint, less the friction of its gear [N·m].
        free_speed: Rate at which the base joint's motor has no torque left [rad/s].
        inertia: Moment of inertia of the folded arm about the base axis [kg·m²].
        stretch_mass: Growth of that moment with the square of the gripper's distance [kg].
        is_rigid_body: Whether the arm is simulated as rigid bodies.
        bandwidth: Undamped frequency of each position loop about the folded arm [Hz].
        integral: Rate at which the position loops integrate [1/s].
        inertia_factor: Factor of the maker's masses and inertias [-].
        payload: Mass of the gripper [kg].
        torque_share: Torque that the joints have, as a share of the maker's largest [-]; 0 for no
            limit.
        coulomb: Coulomb friction of each gear of a UR5 [N·m].
        viscous: Viscous friction of each gear of a UR5 [N·m·s/rad].
        stand_stiffness: Stiffness of the stand against tilts about x and y and a twist [N·m/rad];
            0 for one that stands still.
        stand_damping: Damping ratio of its sway [-].
    """

    delay: tuple[float, ...] = (0.012, 0.011, 0.011, 0.010, 0.010, 0.010)
    frequency: tuple[float, ...] = (6.5, 7.4, 7.8, 11.0, 12.0, 12.5)
    damping_ratio: tuple[float, ...] = (0.72, 0.80, 0.80, 0.85, 0.85, 0.80)
    feedforward: float = 0.45
    torque: float = 79.0
    free_speed: float = 3.8
    inertia: float = 1.4
    stretch_mass: float = 5.8
    is_rigid_body: bool = False
    bandwidth: tuple[float, ...] = (8.0, 8.0, 9.0, 12.0, 12.0, 12.0)
    integral: float = 3.0
    inertia_factor: float = 1.0
    payload: float = 1.0
    torque_share: float = 0.0
    coulomb: tuple[float, ...] = (0.0,) * 6
    viscous: tuple[float, ...] = (0.0,) * 6
    stand_stiffness: tuple[float, ...] = (0.0,) * 3
    stand_damping: float = 0.04


@dataclasses.dataclass(frozen=True, kw_only=True)
class HiddenTable:
    """True face of the table; each effect is relative to the mean friction.

    Attributes:
        seed: Seed of the drawing.
        wear: Standard deviation of the smooth part [-].
        wear_length: Distance over which the smooth part changes [m].
        wave_count: Number of waves that the smooth part is made of.
        board: Standard deviation from board to board [-].
        board_size: Size of one board along the table's width and depth [m].
        first_seam: Distance of the first seams from the corner of the table [m].
        seam_width: Width of the gap between boards and its frayed rims [m].
        seam: Additional friction on a seam [-].
        edge: Standard deviation of the height of the boards' faces [m].
        tilt: Slope of the table along x and y [rad].
        drift: Amplitude of the friction's change over the casts [-].
        drift_period: Casts in which it goes up and down once.
    """

    seed: int
    wear: float = 0.05
    wear_length: float = 0.25
    wave_count: int = 24
    board: float = 0.05
    board_size: tuple[float, float] = (0.92, 0.61)
    first_seam: tuple[float, float] = (0.43, 0.27)
    seam_width: float = 0.01
    seam: float = 0.35
    edge: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)
    drift: float = 0.0
    drift_period: float = 160.0


_PRESET_NAMES = ("cable_1", "cable_2", "cable_3")
_PRESETS = {
    "mass": (0.056, 0.0058, 0.081),
    "bend_stiffness": (5.9e-4, 3.4e-5, 1.12e-3),
    "twist_stiffness": (5.2e-4, 3.0e-5, 1.12e-3),
    "bend_damping": (0.012, 0.006, 0.005),
    "friction": (0.4, 0.24, 0.36),
    "grain": (0.04, 0.04, 0.05),
    "curl": (0.2, 0.5, 0.1),
    "yield_curvature": (25.0, 30.0, 30.0),
    "yield_time": (0.5, 0.5, 0.3),
    "endpoint_mass": (0.0155, 0.0033, 0.02),
    "endpoint_share": (0.6, 0.6, 0.5),
    "endpoint_offset": (0.008, 0.007, 0.0),
    "endpoint_radius": (0.0025, 0.0012, 0.006),
    "endpoint_friction": (0.41, 0.23, 0.36),
    "drag": (1.1, 1.15, 1.1),
    "linear_damping": (0.04, 0.05, 0.03),
}
"""True properties of each preset, in the order of their names."""

# What users believe of a cable of their own is off: least for what a scale tells, and most for
# stiffness.
_BELIEF_SPREAD = {
    "mass": 0.08,
    "bend_stiffness": 0.45,
    "twist_stiffness": 0.45,
    "friction": 0.20,
    "endpoint_mass": 0.20,
}
_FRICTION_MAX = 1.5
_ARM_SPREAD = 0.05

EFFECTS = (
    "strands",
    "tension",
    "uneven cable",
    "kink",
    "loop",
    "pads",
    "stribeck",
    "tilt",
    "edges",
    "drift",
    "arm",
    "torque limits",
    "gears",
    "stand",
    "light",
)
"""Effects of real cables, tables and arms that can be switched off."""

Strengths = Mapping[str, float]
"""Strength of each effect that is there; 1 is typical."""

# A careful guess and the truth differ by 10 to 40 %, but by less for what a scale tells.
_GUESS = (0.1, 0.34)
_GUESS_MASS = (0.03, 0.1)
_SCALED = ("mass", "endpoint_mass")
_DEFINITE = ("sleeve", "endpoint_share", "endpoint_radius", "endpoint_offset")
# In other laboratories than the first an effect is missing, typical, or twice as strong.
_STRENGTHS, _STRENGTH_ODDS = (0.0, 1.0, 2.0), (0.2, 0.6, 0.2)
# Draws whose first laboratory an engine with believed values misses as in the paper's table I.
_DRAWS, _TYPICAL_DRAW = {"cable_3": 8}, 9
# A cable whose strands stick is stiffer than a solid one, one whose strands slip is softer.
_STICK = 1.35
_RESIDUAL_DAMPING = 0.0015


def effect_strengths(lab_seed: int, without: tuple[str, ...] = ()) -> Strengths:
    """Return how strong each effect is in a laboratory, but for those that are switched off."""
    rng = np.random.default_rng([lab_seed, 5])
    strengths = {name: _strength(rng, lab_seed) * _factor(rng, _GUESS) for name in EFFECTS}
    # Every arm is one of rigid bodies.
    strengths["arm"] = 1.0
    return {name: s for name, s in strengths.items() if s > 0.0 and name not in without}


def _strength(rng: np.random.Generator, lab_seed: int) -> float:
    """Return the strength of an effect in a laboratory, before it is off by a guess."""
    return float(rng.choice(_STRENGTHS, p=_STRENGTH_ODDS)) if lab_seed else 1.0


def _factor(rng: np.random.Generator, size: tuple[float, float]) -> float:
    """Return a factor that is off by a guess: up or down, by shares between two bounds."""
    return float(np.exp(rng.choice([-1.0, 1.0]) * rng.uniform(*size)))


def _guessed(values: Any, rng: np.random.Generator, names: tuple[str, ...]) -> Any:
    """Return a record some of whose values are off by a guess, each by its own."""
    changed: dict[str, Any] = {}
    for name in names:
        value, size = getattr(values, name), _GUESS_MASS if name in _SCALED else _GUESS
        if isinstance(value, tuple):
            changed[name] = tuple(v * _factor(rng, size) for v in value)
        else:
            changed[name] = value * _factor(rng, size)
    return dataclasses.replace(values, **changed)


def hidden_cable(cable: Cable, lab_seed: int, strengths: Strengths) -> HiddenCable:
    """Return the true cable of a laboratory behind what is believed of it.

    The truth of a user's own cable is drawn about its parameters.
    """
    if is_preset(cable):
        column = _PRESET_NAMES.index(cable.name)
        row: dict[str, Any] = {name: values[column] for name, values in _PRESETS.items()}
        truth = HiddenCable(**row)
    else:
        truth = _own(cable, np.random.default_rng([lab_seed, zlib.crc32(cable.name.encode())]))
    return _with_effects(truth, cable, lab_seed, strengths)


def _own(cable: Cable, rng: np.random.Generator) -> HiddenCable:
    """Draw the truth about a user's cable."""
    drawn = {
        name: float(getattr(cable.params, name)) * float(np.exp(spread * rng.normal()))
        for name, spread in _BELIEF_SPREAD.items()
    }
    hook = cable.attachment is Attachment.HOOK
    return HiddenCable(
        mass=drawn["mass"],
        bend_stiffness=drawn["bend_stiffness"],
        twist_stiffness=drawn["twist_stiffness"],
        bend_damping=float(rng.uniform(0.003, 0.008)),
        friction=min(drawn["friction"], _FRICTION_MAX),
        grain=float(rng.uniform(0.03, 0.08)),
        curl=float(rng.uniform(-0.8, 0.8)),
        yield_curvature=float(rng.uniform(8.0, 25.0)),
        yield_time=float(rng.uniform(0.3, 0.6)),
        endpoint_mass=drawn["endpoint_mass"],
        endpoint_share=float(rng.uniform(0.4, 0.7)),
        endpoint_offset=0.2 * cable.attachment_length if hook else 0.0,
        endpoint_radius=min(cable.radius, 0.0025) if hook else max(cable.radius, 0.006),
        endpoint_friction=float(rng.uniform(0.2, 0.35)),
        drag=float(rng.uniform(1.0, 1.2)),
        linear_damping=float(rng.uniform(0.02, 0.06)),
    )


def _with_effects(
    truth: HiddenCable, cable: Cable, lab_seed: int, strengths: Strengths
) -> HiddenCable:
    """Return a cable whose values are off by a guess, with effects of some strength."""
    draw = _DRAWS.get(cable.name, _TYPICAL_DRAW)
    rng = np.random.default_rng([draw, lab_seed, zlib.crc32(cable.name.encode())])
    # Those before the effects' own; attachments are measured, and slightly misjudged.
    names = [field.name for field in dataclasses.fields(truth)]
    plain = names[: names.index("sleeve")]
    truth = _guessed(truth, rng, tuple(name for name in plain if name not in _DEFINITE))
    curl = truth.curl * float(rng.choice([-1.0, 1.0])) * _strength(rng, lab_seed)
    signs = rng.choice([-1.0, 1.0], 2)
    draws = rng.uniform(size=4)
    get = strengths.get
    values: dict[str, Any] = {
        "curl": curl,
        "friction": min(truth.friction, _FRICTION_MAX),
        # Light cables lie less straight.
        "reset_spread": min(0.0075 / np.sqrt(truth.mass), 0.06) * _factor(rng, _GUESS),
        "field_seed": int(rng.integers(2**31)),
        "stiffness_field": 0.15 * get("uneven cable", 0.0),
        "mass_field": 0.06 * get("uneven cable", 0.0),
        "kink": float(signs[0]) * 0.2 * get("kink", 0.0),
        "kink_place": 0.25 + 0.5 * float(draws[0]),
        "play": min(0.5 * get("loop", 0.0), 1.0) if cable.attachment is Attachment.HOOK else 0.0,
        "static_excess": 0.2 * get("stribeck", 0.0),
        "stribeck_speed": 0.08 * (0.7 + 0.6 * float(draws[1])),
        "friction_rise": 0.06 * get("stribeck", 0.0),
    }
    if "pads" in strengths:
        values["pad_stiffness"] = 0.25 / strengths["pads"]
    if "strands" in strengths:
        values |= {
            "bend_stiffness": _STICK * truth.bend_stiffness,
            "bend_damping": _RESIDUAL_DAMPING,
            "strand_share": min(0.45 * strengths["strands"], 0.7),
            # Thin cables slip at sharper bends: friction acts at a radius.
            "slip_curvature": 0.03 / cable.diameter * (0.8 + 0.4 * float(draws[2])),
            "slip_tension": 1.5 / strengths["tension"] if "tension" in strengths else 0.0,
        }
    return dataclasses.replace(truth, **values)


def hidden_arm(lab_seed: int, strengths: Strengths) -> HiddenArm:
    """Return the true arm of a laboratory: servos differ from specimen to specimen by per cents."""
    arm = HiddenArm()
    if lab_seed:
        rng = np.random.default_rng([lab_seed, 1])

        def spread(values: tuple[float, ...]) -> tuple[float, ...]:
            factors = np.exp(_ARM_SPREAD * rng.normal(size=len(values)))
            return tuple(float(v * factor) for v, factor in zip(values, factors, strict=True))

        arm = dataclasses.replace(
            arm,
            delay=spread(arm.delay),
            frequency=spread(arm.frequency),
            damping_ratio=spread(arm.damping_ratio),
        )
    if "arm" not in strengths:
        return arm
    rng = np.random.default_rng([5, lab_seed, 1])
    gears, stand = strengths.get("gears", 0.0), strengths.get("stand", 0.0)
    arm = dataclasses.replace(
        arm,
        is_rigid_body=True,
        torque_share=0.9 / max(strengths["torque limits"], 0.9)
        if "torque limits" in strengths
        else 0.0,
        coulomb=tuple(gears * value for value in (8.0, 9.0, 6.0, 1.6, 1.6, 1.4)),
        viscous=tuple(gears * value for value in (12.0, 12.0, 8.0, 1.8, 1.8, 1.6)),
        stand_stiffness=tuple(k / stand for k in (2.5e4, 2.5e4, 2.5e4)) if stand else (0.0,) * 3,
    )
    names = (
        "delay",
        "bandwidth",
        "integral",
        "coulomb",
        "viscous",
        "stand_stiffness",
        "feedforward",
    )
    arm = _guessed(arm, rng, names)
    return dataclasses.replace(
        arm,
        feedforward=min(arm.feedforward, 1.0),
        inertia_factor=_factor(rng, _GUESS_MASS),
        payload=_factor(rng, _GUESS),
    )


def hidden_table(lab_seed: int, strengths: Strengths) -> HiddenTable:
    """Return the true table of a laboratory."""
    rng = np.random.default_rng([5, lab_seed, 2])
    names = ("wear", "wear_length", "board", "board_size", "first_seam", "seam", "drift_period")
    table = _guessed(HiddenTable(seed=5000 + lab_seed), rng, names)
    board = _strength(rng, lab_seed)
    direction = rng.uniform(0.0, 2 * np.pi)
    tilt = 0.004 * strengths.get("tilt", 0.0) * np.array([np.cos(direction), np.sin(direction)])
    return dataclasses.replace(
        table,
        board=board * table.board,
        seam=board * table.seam,
        edge=3e-4 * strengths.get("edges", 0.0) * min(board, 1.0),
        tilt=(float(tilt[0]), float(tilt[1])),
        drift=0.06 * strengths.get("drift", 0.0),
    )


def hidden_camera(lab_seed: int, strengths: Strengths) -> dict[str, Any]:
    """Return troubles of a laboratory's camera: values of `CameraConfig` and of its light."""
    strength = strengths.get("light", 0.0)
    if strength == 0.0:
        return {}
    rng = np.random.default_rng([5, lab_seed, 3])
    cast = [float(np.exp(0.05 * strength * rng.normal())) for _ in range(3)]
    light = {"lamp_flicker": min(0.1 * strength, 0.5), "cast": tuple(cast)}
    return {"dropped": 0.01 * strength, "light": light}


def is_preset(cable: Cable) -> bool:
    """Return whether a cable is a preset by name and geometry; its params may have been tuned."""
    if cable.name not in _PRESET_NAMES:
        return False
    preset = load_cable(cable.name)
    return all(
        getattr(cable, name) == getattr(preset, name)
        for name in ("length", "diameter", "attachment", "attachment_length")
    )
