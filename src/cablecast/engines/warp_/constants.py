"""The constants of a batch that follow from cables, parameters and resolution."""

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import AIR_DENSITY, Cable
from cablecast.engines.base import REFERENCE_SEGMENT_COUNT
from cablecast.engines.warp_.attachment import JOINT_CELLS, EndSegment
from cablecast.engines.warp_.bending import filter_factors
from cablecast.engines.warp_.material import LAG_RATIO, lag_ratios
from cablecast.engines.warp_.twist import SHAPE_TORSION, spin_pivots

NEVER_CURVED = 1e9
"""Curvature that no cable reaches [1/m]."""

MOST_VISCOSITY = 0.25
"""Share of a difference of velocity that damped rotation may exchange between neighbours in a step:
more would let short segments ring. The default resolution stays far below it."""


def model_constants(
    cable: Cable,
    segment_count: int,
    dt: float,
    far_is_held: bool,
    end: EndSegment | None = None,
) -> dict[str, NDArray[np.float64]]:
    """Return the lane values of `Model` (world.py), with units as there.

    Args:
        cable: Geometry and physics, shared or one value per world.
        segment_count: Number of segments.
        dt: Step [s].
        far_is_held: Whether a second gripper holds the far end.
        end: Attachment beyond the cable's end, if there is one.

    Returns:
        Values by attribute of `Model`, shape [world], [world, node] or [world, segment].
    """
    values = cable.params.to_columns()
    world_count = max(len(column) for column in values.values())
    last_ratio = np.ones(world_count) if end is None else np.broadcast_to(end.ratio, world_count)
    values = {name: np.broadcast_to(column, world_count) for name, column in values.items()}
    damping_time = values["damping_time"]
    yields = values["yield_curvature"] > 0.0
    yield_curvature = np.where(yields, values["yield_curvature"], NEVER_CURVED)
    segment_length = cable.length / segment_count
    segment_mass = values["mass"] / segment_count
    mass = np.repeat(segment_mass[:, None], segment_count + 1, axis=1)
    mass[:, -1] = 0.5 * segment_mass + values["endpoint_mass"]
    squared_lengths = np.full((world_count, segment_count), segment_length**2)
    if end is not None:
        mass[:, -1] = 0.5 * segment_mass + end.joint_mass
        mass = np.concatenate([mass, np.broadcast_to(end.tip_mass, world_count)[:, None]], axis=1)
        squared_lengths = np.pad(squared_lengths, [(0, 0), (0, 1)], constant_values=1.0)
        squared_lengths[:, -1] = end.arm**2
    mass[:, 0] = np.inf
    if far_is_held:
        mass[:, -1] = np.inf
    bending = values["bend_stiffness"] / segment_length**3
    lag_ratio = lag_ratios(damping_time)
    lag_time = np.maximum(damping_time / LAG_RATIO, 1e-9)
    diagonal, lower1, lower2 = filter_factors(
        bending * (1.0 + lag_ratio),
        mass,
        dt,
        None if end is None else (last_ratio, JOINT_CELLS),
    )
    torsion = values["twist_stiffness"] / segment_length
    most_torsion = SHAPE_TORSION * segment_mass * segment_length**2 / dt**2
    # Segments and endpoint are solid cylinders of the cable's radius.
    rolling_mass = np.repeat(segment_mass[:, None], segment_count, axis=1)
    if end is None:
        rolling_mass[:, -1] += values["endpoint_mass"]
    else:
        attached = np.broadcast_to(values["endpoint_mass"], world_count)[:, None]
        rolling_mass = np.concatenate([rolling_mass, attached], axis=1)
    spin_inertia = 0.5 * rolling_mass * cable.radius**2
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
    squared_time = dt * (dt + damping_time)
    held_inertia = spin_inertia + (2.0 * squared_time * torsion)[:, None]
    spin_response = 0.5 * segment_mass[:, None] * cable.radius / held_inertia
    # Spin per velocity that all nodes lose. Friction that reckoned with less would roll some
    # segment too far.
    response = np.maximum(
        2.0 * spin_response[:, 0], (near_ratio + mass_ratio[:, -1]) * spin_response[:, -1]
    )
    return {
        "last_ratio": last_ratio,
        "squared_length": squared_lengths,
        "inverse_mass": 1.0 / mass,
        "segment_mass": segment_mass,
        "bending": bending,
        "torsion": torsion,
        "torsion_time": dt + damping_time,
        "twist_damping_time": damping_time,
        "lag_ratio": lag_ratio,
        "lag_kept": np.exp(-dt / lag_time),
        "yield_bend": yield_curvature * segment_length**2,
        "yield_share": dt / (dt + values["yield_time"]),
        "shape_torsion": np.minimum(torsion, most_torsion),
        "friction": values["lateral_friction"] * values["worksurface_friction"],
        "last_friction": last_friction,
        "joint_friction": joint_friction,
        "rolling_friction": values["rolling_friction"] / cable.radius,
        "spinning_friction": values["spinning_friction"] * segment_mass / segment_length,
        "linear_damping": values["linear_damping"],
        "angular_damping": values["angular_damping"],
        "rotation_viscosity": rotation_viscosity(
            cable, segment_length, segment_mass, values["angular_damping"], dt
        ),
        "lateral_mass": 1.0 / (1.0 + response * cable.radius),
        "drag": AIR_DENSITY * values["drag_coefficient"] * cable.radius * segment_length,
        "friction_ratio": values["friction_ratio"],
        "mass_ratio": mass_ratio,
        "near_ratio": near_ratio,
        "spin_response": spin_response,
        "spin_pivot": spin_pivots(torsion, spin_inertia, squared_time, far_is_held),
        "filter_diagonal": diagonal,
        "filter_lower1": lower1,
        "filter_lower2": lower2,
    }


def rotation_viscosity(
    cable: Cable,
    segment_length: float,
    segment_mass: NDArray[np.float64],
    angular_damping: NDArray[np.float64],
    dt: float,
) -> NDArray[np.float64]:
    """Return the viscosity with which angular damping slows the turning of segments [kg/s].

    The torque on a segment of the reference length turns into a viscous exchange of velocity with
    diffusivity c l_ref^2 / 12 (a thin rod's moment of inertia).

    Args:
        cable: Geometry.
        segment_length: Length of a segment [m].
        segment_mass: Mass of a segment [kg], shape [world].
        angular_damping: c [1/s], shape [world].
        dt: Step [s].
    """
    reference = cable.length / REFERENCE_SEGMENT_COUNT
    diffusivity = angular_damping * reference**2 / 12
    viscosity = diffusivity * segment_mass / segment_length**2
    return np.minimum(viscosity, MOST_VISCOSITY * segment_mass / dt)
