"""Code of the script that makes an exported cable a rod of PyElastica, on its own."""

from typing import Any

import numpy as np

VALUES: dict[str, Any] = {}


def make_rod(start: Any = (0.0, 0.0, 0.0), direction: Any = (0.0, 1.0, 0.0), **options: Any) -> Any:
    """Return the cable as a straight elastica.CosseratRod, whose first element is the grip.

    The grip's element lies behind the cable, as long as the others. Its two nodes and its frame are
    to be held by a constraint.

    Args:
        start: End of the grip's element [m].
        direction: Direction of the cable, level.
        **options: Further arguments of `CosseratRod.straight_rod`, such as `position`, `directors`.
    """
    import elastica as ea

    v = VALUES
    count, radius = v["segment_count"] + 1, v["radius"]
    tangent = np.array(direction, dtype=float)
    rod = ea.CosseratRod.straight_rod(
        count,
        np.array(start, dtype=float),
        tangent,
        np.cross(tangent, [0.0, 0.0, 1.0]),
        v["segment_length"] * count,
        radius,
        v["segment_mass"] / (v["segment_length"] * np.pi * radius**2),
        youngs_modulus=v["bend_stiffness"] / (0.25 * np.pi * radius**4),
        **options,
    )
    rod.shear_matrix[:] = np.eye(3)[..., None] * v["stretch_rigidity"]
    bend, twist = v["bend_stiffness"], v["twist_stiffness"]
    rod.bend_matrix[:] = np.diag([bend, bend, twist])[..., None]
    # Half a segment bends between the grip and the middle of the first one.
    rod.bend_matrix[..., 0] *= 2.0
    rod.rest_kappa[1] = v["rest_curvature"]
    # The attachment is a part of the last element, about its axis, too.
    rod.mass[-1] += v["endpoint_mass"]
    heavier = 1.0 + v["endpoint_mass"] / v["segment_mass"]
    rod.mass_second_moment_of_inertia[2, 2, -1] *= heavier
    rod.inv_mass_second_moment_of_inertia[2, 2, -1] /= heavier
    return rod


def add_forces(system: Any, rod: Any, *, table: bool = True) -> None:
    """Add gravity, air and a table at z = 0 to a system that holds the rod.

    Args:
        system: Collection with Forcing, Contact and Damping.
        rod: The cable.
        table: False for a cable in the air.
    """
    import elastica as ea

    v = VALUES
    system.add_forcing_to(rod).using(
        ea.GravityForces, acc_gravity=np.array([0.0, 0.0, -v["gravity"]])
    )
    system.dampen(rod).using(
        ea.AnalyticalLinearDamper,
        translational_damping_constant=v["linear_damping"] * v["segment_mass"],
        rotational_damping_constant=v["angular_damping"] * v["roll_inertia"],
        time_step=v["dt"],
    )
    if not table:
        return
    plane = ea.Plane(plane_origin=np.zeros(3), plane_normal=np.array([0.0, 0.0, 1.0]))
    system.append(plane)
    across, along = v["friction"], v["friction"] * v["friction_ratio"]
    # Forwards, backwards, and across.
    friction = np.array([along, along, across])
    system.detect_contact_between(rod, plane).using(
        ea.RodPlaneContactWithAnisotropicFriction,
        k=v["contact_stiffness"],
        # Critical for a segment.
        nu=2.0 * np.sqrt(v["contact_stiffness"] * v["segment_mass"]),
        slip_velocity_tol=1e-3,
        static_mu_array=friction,
        kinetic_mu_array=friction,
    )
