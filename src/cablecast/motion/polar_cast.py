"""Polar casting: swing the hanging cable out in a vertical plane, then pull it back slowly.

This is the paper's baseline (section VI-A) and the last step of its reset (section V-A). From any
pose, the gripper lifts the cable until the free end hangs clear of the table, and waits until it is
at rest. A swing forward lays the cable out straight along the azimuth of the target. The gripper
then drags it towards the robot until the endpoint is as far from the base as the target.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.conventions import GRAVITY, xy_to_polar
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath
from cablecast.motion.plane_path import PlanePath
from cablecast.motion.polar_config import PolarCastConfig
from cablecast.motion.polar_reach import PolarReach
from cablecast.motion.trajectory import Trajectory, follow
from cablecast.setup import Setup
from cablecast.workspace import Workspace

Array = NDArray[np.float64]


def lift(path: PlanePath, cable: Cable, config: PolarCastConfig, azimuth: float = 0.0) -> PlanePath:
    """Append the lift, from any low pose to the cable hanging in the plane at an azimuth [rad].

    Args:
        path: Path to append to.
        cable: Cable with its nominal parameters.
        config: Settings of the lift; `rise_time` is that of its rise.
        azimuth: Azimuth of the plane, positive to the right [rad].
    """
    place = path.place
    rise = abs(config.carry_height - place["height"])
    path.move(max(config.carry_time_min, rise / config.carry_speed), height=config.carry_height)
    turned = config.carry_radius * (abs(azimuth - place["azimuth"]) + abs(place["turn"]) / 2)
    way = float(np.hypot(config.carry_radius - place["radius"], turned))
    path.move(
        max(config.carry_time_min, way / config.carry_speed),
        azimuth=azimuth,
        radius=config.carry_radius,
        turn=0.0,
    )
    path.move(config.draw_time, radius=config.draw_radius)
    hang_height = config.hang_height(cable)
    # The free end is dragged to the point below which it will hang, and stays there.
    bend_out, bend_up = bend_offsets(cable)
    end_radius = config.hang_radius + config.bend_out_share * bend_out
    length = cable.length + cable.attachment_length - config.bend_up_share * bend_up
    length = min(length, hang_height / config.arc_share)
    aside = end_radius - config.rise_radius
    path.move(
        config.rise_time,
        radius=config.rise_radius,
        height=float(np.sqrt(max(length**2 - aside**2, config.carry_height**2))),
    )
    share = np.linspace(0.0, 1.0, 7)[1:]
    first, last = (
        float(np.arcsin(min(way / length, 1.0))) for way in (aside, end_radius - config.hang_radius)
    )
    angle = first + (last - first) * share
    reach = length * (1.0 - (1.0 - config.arc_share) * share)
    path.through(
        (config.arc_time * share).tolist(),
        radius=(end_radius - reach * np.sin(angle)).tolist(),
        height=(reach * np.cos(angle)).tolist(),
    )
    return path.move(config.lift_time, radius=config.hang_radius, height=hang_height)


def bend_offsets(cable: Cable) -> tuple[float, float]:
    """Return the forward and upward shift of the free end due to the bend at the gripper.

    The gripper clamps the cable level. The cable is an elastica that turns from level to straight
    down under a tension T, the weight of the cable and its attachment. With b = sqrt(E I / T), its
    end hangs sqrt(2) b in front of the clamp and (2 - sqrt(2)) b higher than without a bend.

    Args:
        cable: Cable with its nominal parameters.

    Returns:
        Forward and upward shift [m].
    """
    params = cable.params
    tension = GRAVITY * (float(params.mass) + float(params.endpoint_mass))
    bend = float(np.sqrt(float(params.bend_stiffness) / tension))
    return float(np.sqrt(2.0)) * bend, (2.0 - float(np.sqrt(2.0))) * bend


def swing_out(
    path: PlanePath, radius: float, workspace: Workspace, config: PolarCastConfig
) -> PlanePath:
    """Append the swing: the gripper comes down at a radius [m], then the cable settles."""
    swing, place = config.swing, path.place
    low, near = workspace.grip_height, place["radius"]
    # For the cable to land taut, the gripper swings out beyond the radius where it comes down, but
    # stays within the arm's reach.
    farthest = max(radius, workspace.r_max - config.reach_margin)
    outer = [min(near + share * (radius - near), farthest) for share in swing.radii]
    path.through(
        np.cumsum(swing.durations).tolist(),
        radius=[near - swing.draw_back, *outer, radius],
        height=[low + s * (place["height"] - low) for s in (*swing.heights, 0.0)],
        pitch=[*swing.pitches, 0.0],
    )
    return path.hold(config.settle_time) if config.settle_time > 0 else path


def pull_back(path: PlanePath, radius: float, config: PolarCastConfig) -> PlanePath:
    """Append the slow pull along the table until the gripper is at a radius [m]."""
    way = abs(radius - path.place["radius"])
    if way < 1e-6:
        return path
    return path.move(max(config.pull_time_min, way / config.pull_speed), radius=radius)


def polar_cast_path(
    endpoint_xy: ArrayLike,
    setup: Setup,
    config: PolarCastConfig | None = None,
    start: ArrayLike | None = None,
) -> GripPath:
    """Return the whole motion that brings the endpoint to a point within `PolarReach`.

    Args:
        endpoint_xy: Resting point of the endpoint [m], shape [2].
        setup: Set-up with the cable, the table and the arm.
        config: Settings of the lift, the swing and the pull.
        start: Start pose: x, y, z [m], yaw, pitch [rad], shape [5]; the reset pose if None.

    Raises:
        InputError: The point lies outside the region.
    """
    cable, workspace = setup.cable, setup.workspace
    config = config or PolarCastConfig.of(workspace)
    reach = PolarReach.of(setup, config)
    endpoint_xy = np.asarray(endpoint_xy, dtype=float)
    # Rounding may put a point of the outline outside.
    if np.max(np.abs(reach.nearest(endpoint_xy) - endpoint_xy)) > 1e-6:
        x, y = endpoint_xy.tolist()
        raise InputError(
            f"polar casting does not reach ({x:.3f}, {y:.3f}) m: r must be at most "
            f"{reach.radius:.3f} m, and the gripper's y at least {reach.grip_y_min:.3f} m, on the "
            "table"
        )
    r, theta = xy_to_polar(endpoint_xy).tolist()
    path = PlanePath(reset_pose(workspace) if start is None else start)
    slow = dataclasses.replace(config, rise_time=config.cast_rise_time)
    lift(path, cable, slow, theta).hold(config.hang_time)
    swing_out(path, reach.landing_radius(theta) - cable.length, workspace, config)
    return pull_back(path, r - cable.length, config).grip_path()


def reset_pose(workspace: Workspace) -> Array:
    """Return x, y, z [m], yaw, pitch [rad] of the gripper after a reset, shape [5]."""
    return np.array([0.0, workspace.reset_y, workspace.grip_height, 0.0, 0.0])


def plan_polar_cast(
    endpoint_xy: ArrayLike, setup: Setup, config: PolarCastConfig | None = None
) -> Trajectory:
    """Plan a polar cast down to joint set points; see `polar_cast_path`.

    Raises:
        InputError: The point lies outside the region.
        JointLimitError: The arm cannot follow; the message names each limit with its value.
    """
    return follow(polar_cast_path(endpoint_xy, setup, config), setup, "this polar cast")
