"""True values of the virtual laboratory. Nothing outside rigs/virtual may read them.

The learning side has to find these values, or live with its error, as with a real cable. They
differ from the starting values in cable.py by what a careful person gets wrong who weighs the cable
with a kitchen scale and looks up the rest.
"""

import dataclasses
import zlib

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class HiddenArm:
    """True servos of the arm's six joints.

    Attributes:
        delay: Dead time from the set point to the motor [s].
        frequency: Undamped frequency of the closed position loop [Hz].
        damping_ratio: Damping ratio of the closed position loop [-].
        feedforward: Share of the commanded rate that is fed forward [-].
        torque: Torque of the standing base joint, less the friction of its gear [N·m].
        free_speed: Rate at which the base joint's motor has no torque left [rad/s].
        inertia: Moment of inertia of the folded arm about the base axis [kg·m²].
        stretch_mass: Growth of that moment with the square of the gripper's distance [kg].
    """

    delay: tuple[float, ...] = (0.012, 0.011, 0.011, 0.010, 0.010, 0.010)
    frequency: tuple[float, ...] = (6.5, 7.4, 7.8, 11.0, 12.0, 12.5)
    damping_ratio: tuple[float, ...] = (0.72, 0.80, 0.80, 0.85, 0.85, 0.80)
    feedforward: float = 0.45
    torque: float = 79.0
    free_speed: float = 3.8
    inertia: float = 1.4
    stretch_mass: float = 5.8


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


_PRESET_NAMES = ("cable_1", "cable_2", "cable_3")
_PRESETS = {
    "mass": (0.056, 0.0058, 0.081),
    "bend_stiffness": (5.9e-4, 3.4e-5, 1.12e-3),
    "twist_stiffness": (5.2e-4, 3.0e-5, 1.12e-3),
    "bend_damping": (0.012, 0.006, 0.005),
    "friction": (0.335, 0.24, 0.36),
    "grain": (0.04, 0.04, 0.05),
    "curl": (0.2, 0.5, 0.1),
    "yield_curvature": (25.0, 30.0, 30.0),
    "yield_time": (0.5, 0.5, 0.3),
    "endpoint_mass": (0.0155, 0.0033, 0.02),
    "endpoint_share": (0.6, 0.6, 0.5),
    "endpoint_offset": (0.008, 0.007, 0.0),
    "endpoint_radius": (0.0025, 0.0012, 0.006),
    "endpoint_friction": (0.315, 0.23, 0.36),
    "drag": (1.1, 1.15, 1.1),
    "linear_damping": (0.04, 0.05, 0.03),
}
"""True properties of each preset, in the order of their names."""

# Copies of one product differ by a few per cent. What users believe of a cable of their own differs
# by more: least for what a scale tells, and most for stiffness.
_COPY_SPREAD = 0.03
_BELIEF_SPREAD = {
    "mass": 0.08,
    "bend_stiffness": 0.45,
    "twist_stiffness": 0.45,
    "friction": 0.20,
    "endpoint_mass": 0.20,
}
_FRICTION_MAX = 1.5
_ARM_SPREAD = 0.05


def hidden_cable(cable: Cable, lab_seed: int) -> HiddenCable:
    """Return the true cable behind what is believed of it.

    Args:
        cable: A preset, or a user's own, for which the truth is drawn about its parameters.
        lab_seed: Seed of the laboratory.
    """
    rng = np.random.default_rng([lab_seed, zlib.crc32(cable.name.encode())])
    if is_preset(cable):
        column = _PRESET_NAMES.index(cable.name)
        truth = HiddenCable(**{name: values[column] for name, values in _PRESETS.items()})
        if lab_seed == 0:
            return truth
        names = [*_BELIEF_SPREAD, "bend_damping"]
        factors = dict(zip(names, np.exp(_COPY_SPREAD * rng.normal(size=len(names))), strict=True))
        return dataclasses.replace(
            truth, **{name: getattr(truth, name) * float(f) for name, f in factors.items()}
        )
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


def hidden_arm(lab_seed: int) -> HiddenArm:
    """Return the true arm of a laboratory: servos differ from specimen to specimen by per cents."""
    arm = HiddenArm()
    if lab_seed == 0:
        return arm
    rng = np.random.default_rng([lab_seed, 1])

    def spread(values: tuple[float, ...]) -> tuple[float, ...]:
        factors = np.exp(_ARM_SPREAD * rng.normal(size=len(values)))
        return tuple(float(value * factor) for value, factor in zip(values, factors, strict=True))

    return dataclasses.replace(
        arm,
        delay=spread(arm.delay),
        frequency=spread(arm.frequency),
        damping_ratio=spread(arm.damping_ratio),
    )


def hidden_table(lab_seed: int) -> HiddenTable:
    """Return the true table of a laboratory."""
    return HiddenTable(seed=1000 + lab_seed)


def is_preset(cable: Cable) -> bool:
    """Return whether a cable is a preset by name and geometry; its params may have been tuned."""
    if cable.name not in _PRESET_NAMES:
        return False
    preset = load_cable(cable.name)
    return all(
        getattr(cable, name) == getattr(preset, name)
        for name in ("length", "diameter", "attachment", "attachment_length")
    )
