"""Code of the script that adds an exported cable to a model of Newton, on its own."""

import math
from typing import Any

import numpy as np

VALUES: dict[str, Any] = {}


def add_cable(builder: Any, points: Any = None) -> tuple[list[int], list[int]]:
    """Add the cable to a newton.ModelBuilder, for SolverVBD, and return its bodies and joints.

    Call `builder.color()` before `finalize`. The first body is the grip, which is not moved by
    forces: write its pose into `state.body_q` of both states before each step. Its segment lies
    behind the cable, as long as the others.

    Args:
        builder: The model, with z up.
        points: Ends of the segments [m], the grip's first, shape [segment + 2, 3]; straight along y
            on a table at z = 0 by default.
    """
    import newton
    import warp as wp

    v = VALUES
    length, radius = v["segment_length"], v["radius"]
    straight = np.zeros((v["segment_count"] + 2, 3))
    straight[:, 1] = length * np.arange(-1, v["segment_count"] + 1)
    straight[:, 2] = radius
    rod = newton.Rod(
        straight if points is None else np.asarray(points, dtype=float),
        radius=radius,
        rest_straight=True,
        stretch_rigidity=v["stretch_rigidity"],
        shear_rigidity=v["stretch_rigidity"],
        bend_rigidity=v["bend_stiffness"],
        twist_rigidity=v["twist_stiffness"],
    )
    # The caps of a capsule lie within its neighbours: the mass is that of its own length.
    volume = math.pi * radius**2 * (length + 4.0 * radius / 3.0)
    bodies, joints = builder.add_rod(
        rod=rod,
        cfg=surface(newton, v["segment_mass"] / volume),
        bend_damping=v["damping_time"] * v["bend_stiffness"] / length,
        twist_damping=v["damping_time"] * v["twist_stiffness"] / length,
        body_frame_origin="com",
    )
    first = builder.joint_qd_start[joints[0]]
    for axis in (3, 4, 5):
        # Half a segment bends and twists between the grip and the middle of the first one.
        builder.joint_target_ke[first + axis] *= 2.0
        builder.joint_target_kd[first + axis] *= 2.0
    if v["endpoint_mass"]:
        weight = surface(newton, v["endpoint_mass"] / (4.0 / 3.0 * math.pi * radius**3))
        weight.has_shape_collision = False
        end = wp.transform(wp.vec3(0.0, 0.0, 0.5 * length), wp.quat_identity())
        builder.add_shape_sphere(bodies[-1], xform=end, radius=radius, cfg=weight)
    builder.body_mass[bodies[0]] = builder.body_inv_mass[bodies[0]] = 0.0
    builder.body_inertia[bodies[0]] = builder.body_inv_inertia[bodies[0]] = wp.mat33(0.0)
    return list(bodies), list(joints)


def surface(newton: Any, density: float = 0.0) -> Any:
    """Return the surface of cable and table: pass it to `builder.add_ground_plane(cfg=...)`."""
    v = VALUES
    return newton.ModelBuilder.ShapeConfig(
        density=density,
        ke=v["contact_stiffness"],
        kd=0.0,
        mu=v["friction"],
        mu_torsional=v["spinning_friction"],
        mu_rolling=v["rolling_friction"],
    )
