"""Constants of a batch that follow from cables and resolution: substeps, attachment, factors.

Substeps. Leapfrog bears a wave of frequency w as long as (w dt)^2 < 4. With the filter of
elastic.py a wave feels w^2 / (1 + (w dt)^2 / 12), so that a straight cable is stable up to
(w dt)^2 = 6. On a curved cable what the filter takes from the force is no longer what the tension,
the table and the grippers expect of it, and the moment of a fold grows faster than that of a
straight rod. So no world takes a step with (w dt)^2 above `MOST_FILTERED`; worlds that would,
because they are stiff, light or finely divided, take the smallest number of `COUNTS` shorter steps
that suffices.

Attachment. A rod of length a and mass m that continues the cable moves like two point masses: m / 4
at the cable's end and 3 m / 4 at 2 a / 3 beyond it. They have its mass, its centre of mass and its
moment of inertia. So the chain has one more segment, rigid and clamped by the cable's end, whose
length, the arm, is its own. It is stretched to the length l of the others wherever bends are
measured; with s = l / arm the bend at its joint is x[i-1] - (1 + s) x[i] + s x[i+1]. Only the cable
bends there, along half a cell, so that the joint is twice as stiff as a node within the cable.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import AIR_DENSITY, Cable, CableParams
from cablecast.conventions import GRAVITY
from cablecast.engines.base import REFERENCE_SEGMENT_COUNT, CableRows, CableState
from cablecast.engines.warp_.elastic import IMPLICIT, SHARP_TORSION, filter_factors, spin_pivots
from cablecast.engines.warp_.material import MOST_SPRING, dashpot_factors

MOST_FILTERED = 2.4
"""Largest (w dt)^2 of a step, at which half of what leapfrog bears is left for folds and tension.
`python -m benchmarks stability` scans the search space for worlds whose energy grows all the
same."""

COUNTS = tuple(sorted({base * 2**power for base in (1, 3) for power in range(12)} - {3 * 2**11}))
"""Numbers of substeps: 1, 2, 3, 4, 6, 8, 12 and so on, so that a batch falls into few parts."""


def fastest_wave(
    bend_stiffness: NDArray[np.float64],
    segment_mass: NDArray[np.float64],
    segment_length: NDArray[np.float64] | float,
) -> NDArray[np.float64]:
    """Return w^2 of the fastest bending wave [1/s²], a bound for any shape of the chain.

    It bends each node against its neighbours: no row of the stiffness matrix sums up to more than
    16 EI / l^3 (Gershgorin). Stiffness [N·m²] and mass of a segment [kg] have shape [world].
    """
    return 16.0 * bend_stiffness / (segment_length**3 * segment_mass)


def substep_counts(
    fastest: NDArray[np.float64], damping_time: NDArray[np.float64], dt: float
) -> NDArray[np.int_]:
    """Return the number of substeps of each world, one of `COUNTS`.

    Args:
        fastest: w^2 [1/s²], shape [world].
        damping_time: Time by which moments lead the bend [s], same shape.
        dt: Longest step [s].
    """
    bearable = np.where(damping_time > 0.0, MOST_FILTERED - MOST_SPRING, MOST_FILTERED)
    needed = np.sqrt(fastest * dt**2 / bearable)
    index = np.searchsorted(COUNTS, needed * (1.0 - 1e-9))
    return np.array(COUNTS)[np.minimum(index, len(COUNTS) - 1)]


def rounding_of_friction(cable: Cable, segment_count: int) -> NDArray[np.float64]:
    """Return rounding in single precision over friction at a node [-].

    A position is rounded to 6e-8 of its size, here the cable's length L. Bending turns that into a
    force of 6e-8 L EI / l^3, which friction of at most mu m g / N must hold.

    Args:
        cable: Geometry and physics, shared or one value per world.
        segment_count: Number of segments N.
    """
    params = cable.params
    friction = params.lateral_friction * params.worksurface_friction
    held = friction * np.asarray(params.mass) * GRAVITY / segment_count
    force = 6e-8 * cable.length * np.asarray(params.bend_stiffness)
    force = force * (segment_count / cable.length) ** 3
    # A table without friction holds nothing.
    return np.where(held > 0.0, force / np.where(held > 0.0, held, 1.0), 0.0)


TIP_SHARE = 0.75
"""Share of the attachment's mass at the end of the arm."""

CLAMP_CELLS = 2.0
"""Stiffness at a gripper that clamps the cable, over that of a node within it."""

JOINT_CELLS = 2.0
"""Stiffness of the joint over that of a node within the cable."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EndSegment:
    """Last segment of a chain that is an attachment.

    Attributes:
        arm: Length of the segment [m], shape [world].
        ratio: Length of the other segments over it [-], shape [world].
        joint_mass: Part of its mass at the cable's end [kg], shape [world].
        tip_mass: Part of its mass at the end of the arm [kg], shape [world].
    """

    arm: NDArray[np.float64]
    ratio: NDArray[np.float64]
    joint_mass: NDArray[np.float64]
    tip_mass: NDArray[np.float64]

    @classmethod
    def of(cls, segment_length: NDArray[np.float64] | float, params: CableParams) -> "EndSegment":
        """Return the attachments of some worlds; one that is no body has an endless arm."""
        arm = np.atleast_1d(np.asarray(params.attachment_arm, dtype=float))
        arm = np.where(arm > 0.0, arm, np.inf)
        mass = np.atleast_1d(np.asarray(params.endpoint_mass, dtype=float))
        return cls(
            arm=arm,
            ratio=segment_length / arm,
            joint_mass=(1.0 - TIP_SHARE) * mass,
            tip_mass=TIP_SHARE * mass,
        )

    def appended(self, state: CableState) -> CableState:
        """Return a state with the attachment, in line with the cable's last segment."""
        ratio = (1.0 / self.ratio)[:, None]
        rows = max(state.world_count, len(ratio))

        def with_tip(values: NDArray[np.float64]) -> NDArray[np.float64]:
            values = np.broadcast_to(values, (rows, *values.shape[1:]))
            tip = values[:, -1] + ratio * (values[:, -1] - values[:, -2])
            return np.concatenate([values, tip[:, None]], axis=1)

        def with_last(values: NDArray[np.float64]) -> NDArray[np.float64]:
            values = np.broadcast_to(values, (rows, *values.shape[1:]))
            return np.concatenate([values, values[:, -1:]], axis=1)

        return CableState(
            positions=with_tip(state.positions),
            velocities=with_tip(state.velocities),
            roll=with_last(state.roll),
            roll_rate=with_last(state.roll_rate),
        )


def has_end(params: CableParams) -> NDArray[np.bool_]:
    """Return whether the attachment is a body, one or shape [world]: it has an arm and a mass."""
    arm = np.atleast_1d(np.asarray(params.attachment_arm, dtype=float))
    return (arm > 0.0) & (np.atleast_1d(np.asarray(params.endpoint_mass, dtype=float)) > 0.0)


def fastest_at_end(
    bend_stiffness: NDArray[np.float64],
    segment_mass: NDArray[np.float64],
    segment_length: NDArray[np.float64],
    end: EndSegment,
) -> NDArray[np.float64]:
    """Return w^2 of the fastest wave at an attachment [1/s²], as `fastest_wave`.

    It is the largest sum of a row of the stiffness matrix over the mass of its node (Gershgorin).
    """
    s = end.ratio
    with np.errstate(divide="ignore", invalid="ignore"):
        tip = 2.0 * JOINT_CELLS * s * (1.0 + s) / end.tip_mass
        joint = end.joint_mass + 0.5 * segment_mass
        clamp = (2.0 * JOINT_CELLS * (1.0 + s) ** 2 + 4.0) / joint
        # The node before it feels the joint beside the nodes of the cable.
        before = (2.0 * JOINT_CELLS * (1.0 + s) + 12.0) / segment_mass
    fastest = np.maximum(np.maximum(tip, clamp), before)
    return bend_stiffness * fastest / segment_length**3


NEVER_CURVED = 1e9
"""Curvature that no cable reaches [1/m]."""

MOST_VISCOSITY = 0.25
"""Share of a difference of velocity that damped rotation may exchange between neighbours in a step:
more would let short segments ring. The default resolution stays far below it."""


def clamp_cells(
    values: Mapping[str, NDArray[np.float64]], segment_length: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the bending stiffness at a gripper over that of a whole cell [-], shape [world].

    Half a cell of cable and the pads of the gripper turn one after the other: l / (2 EI) and the
    compliance add up.
    """
    pads = values["grip_compliance"] * values["bend_stiffness"] / segment_length
    return CLAMP_CELLS / (1.0 + CLAMP_CELLS * pads)


def model_constants(
    cables: CableRows,
    segment_count: int,
    dt: float,
    far_is_held: bool,
    end: EndSegment | None = None,
    hinged: bool = False,
) -> dict[str, NDArray[np.float64]]:
    """Return the lane values of `Model` (world.py) by attribute, with units as there.

    Shapes are [world], [world, node] or [world, segment]. A second gripper may hold the far end, or
    an attachment lie beyond it. Grippers clamp the cable, or are hinges without stiffness.
    """
    values = cables.params.to_columns()
    world_count = max(len(cables.length), *(len(column) for column in values.values()))
    last_ratio = np.ones(world_count) if end is None else np.broadcast_to(end.ratio, world_count)
    values = {name: np.broadcast_to(column, world_count) for name, column in values.items()}
    damping_time = values["damping_time"]
    yields = values["yield_curvature"] > 0.0
    yield_curvature = np.where(yields, values["yield_curvature"], NEVER_CURVED)
    length = np.broadcast_to(cables.length, world_count)
    radius = np.broadcast_to(cables.radius, world_count)
    segment_length = length / segment_count
    segment_mass = values["mass"] / segment_count
    mass = np.repeat(segment_mass[:, None], segment_count + 1, axis=1)
    mass[:, -1] = 0.5 * segment_mass + values["endpoint_mass"]
    squared_lengths = np.repeat(segment_length[:, None] ** 2, segment_count, axis=1)
    if end is not None:
        mass[:, -1] = 0.5 * segment_mass + end.joint_mass
        mass = np.concatenate([mass, np.broadcast_to(end.tip_mass, world_count)[:, None]], axis=1)
        squared_lengths = np.pad(squared_lengths, [(0, 0), (0, 1)], constant_values=1.0)
        squared_lengths[:, -1] = end.arm**2
    mass[:, 0] = np.inf
    if far_is_held:
        mass[:, -1] = np.inf
    bending = values["bend_stiffness"] / segment_length**3
    grip_cells = np.zeros(world_count) if hinged else clamp_cells(values, segment_length)
    joint = None if end is None else (last_ratio, JOINT_CELLS)
    diagonal, lower1, lower2 = filter_factors(bending, mass, dt, joint, grip_cells)
    yielding, *dashpots = dashpot_factors(bending, damping_time, mass, dt, grip_cells, joint)
    torsion = values["twist_stiffness"] / segment_length
    sharp_torsion = SHARP_TORSION * segment_mass * segment_length**2 / dt**2
    # Segments and endpoint are solid cylinders of the cable's radius.
    rolling_mass = np.repeat(segment_mass[:, None], segment_count, axis=1)
    if end is None:
        rolling_mass[:, -1] += values["endpoint_mass"]
    else:
        attached = np.broadcast_to(values["endpoint_mass"], world_count)[:, None]
        rolling_mass = np.concatenate([rolling_mass, attached], axis=1)
    spin_inertia = 0.5 * rolling_mass * radius[:, None] ** 2
    mass_ratio, near_ratio = np.ones_like(mass), np.ones(world_count)
    if end is None:
        mass_ratio[:, -1] = 1.0 + 2.0 * values["endpoint_mass"] / segment_mass
    else:
        # At the cable's end each part presses on its own segment.
        near_ratio = 2.0 * end.joint_mass / segment_mass
        mass_ratio[:, -1] = 2.0 * end.tip_mass / segment_mass
    # Where the attachment lies on a node together with the cable, each part rubs as it does.
    rubs_more = values["attachment_friction_ratio"] - 1.0
    joint_friction = np.ones(world_count)
    if end is None:
        attached = values["endpoint_mass"] / (values["endpoint_mass"] + 0.5 * segment_mass)
        last_friction = 1.0 + rubs_more * attached
    else:
        last_friction = 1.0 + rubs_more
        joint_friction += rubs_more * end.joint_mass / (end.joint_mass + 0.5 * segment_mass)
    # Friction that spins a segment within a step must overcome its inertia, and the neighbours that
    # torsion ties to it.
    torsion_time = IMPLICIT * dt + damping_time
    squared_time = dt * torsion_time
    held_inertia = spin_inertia + (2.0 * squared_time * torsion)[:, None]
    spin_response = 0.5 * segment_mass[:, None] * radius[:, None] / held_inertia
    # Spin per velocity that all nodes lose. Friction that reckoned with less would roll some
    # segment too far.
    response = np.maximum(
        2.0 * spin_response[:, 0], (near_ratio + mass_ratio[:, -1]) * spin_response[:, -1]
    )
    return {
        "segment_length": segment_length,
        "radius": radius,
        "last_ratio": last_ratio,
        "squared_length": squared_lengths,
        "inverse_mass": 1.0 / mass,
        "segment_mass": segment_mass,
        "bending": bending,
        "grip_cells": grip_cells,
        "torsion": torsion,
        "torsion_time": torsion_time,
        "twist_damping_time": damping_time,
        "dashpot_ratio": damping_time / dt,
        "dashpot_yielding": yielding,
        "dashpot_diagonal": dashpots[0],
        "dashpot_lower1": dashpots[1],
        "dashpot_lower2": dashpots[2],
        "yield_bend": yield_curvature * segment_length**2,
        "yield_share": dt / (dt + values["yield_time"]),
        "sharp_torsion": sharp_torsion,
        "friction": values["lateral_friction"] * values["worksurface_friction"],
        "last_friction": last_friction,
        "joint_friction": joint_friction,
        "rolling_friction": values["rolling_friction"] / radius,
        "spinning_friction": values["spinning_friction"] * segment_mass / segment_length,
        "linear_damping": values["linear_damping"],
        "angular_damping": values["angular_damping"],
        "rotation_viscosity": rotation_viscosity(
            length, segment_length, segment_mass, values["angular_damping"], dt
        ),
        "lateral_mass": 1.0 / (1.0 + response * radius),
        "drag": AIR_DENSITY * values["drag_coefficient"] * radius * segment_length,
        "drag_ratio": values["drag_ratio"],
        "friction_ratio": values["friction_ratio"],
        "mass_ratio": mass_ratio,
        "near_ratio": near_ratio,
        "spin_response": spin_response,
        "spin_inertia": spin_inertia,
        "spin_pivot": spin_pivots(torsion, spin_inertia, squared_time, far_is_held),
        "filter_diagonal": diagonal,
        "filter_lower1": lower1,
        "filter_lower2": lower2,
    }


def rotation_viscosity(
    length: NDArray[np.float64],
    segment_length: NDArray[np.float64],
    segment_mass: NDArray[np.float64],
    angular_damping: NDArray[np.float64],
    dt: float,
) -> NDArray[np.float64]:
    """Return the viscosity with which angular damping slows the turning of segments [kg/s].

    The torque on a segment of the reference length turns into a viscous exchange of velocity with
    diffusivity c l_ref^2 / 12 (a thin rod's moment of inertia); c is the angular damping [1/s].
    """
    reference = length / REFERENCE_SEGMENT_COUNT
    diffusivity = angular_damping * reference**2 / 12
    viscosity = diffusivity * segment_mass / segment_length**2
    return np.minimum(viscosity, MOST_VISCOSITY * segment_mass / dt)
