"""A cable for PyBullet: a URDF of capsules on spherical joints, and the calls that set its springs.

Bullet's Python API has no spring between links: the script computes the moments before each step.
They are explicit, so that a segment must not be too short for the step: the step is shortened until
the fastest bending wave, and the damping of its moment, are stable.
"""

import math
from typing import Any

from cablecast.conventions import GRAVITY
from cablecast.exports.facts import CableModel, comment
from cablecast.exports.script import script

LONGEST_DT = 1.0 / 480.0
"""Step of the paper's simulator [s]."""
STABLE = 0.7
"""Largest (w dt)^2 of the fastest bending wave w, and largest damping of it within a step."""
_GRIP_MASS, _GRIP_INERTIA = 1.0, 1e-2


def step(model: CableModel) -> float:
    """Return the longest step [s], 1/480 s halved as often as needed, that bears the moments."""
    wave = 16.0 * model.value("bend_stiffness") / (model.segment_mass * model.segment_length**3)
    dt = LONGEST_DT
    while wave * dt**2 > STABLE or wave * model.value("damping_time") * dt > STABLE:
        dt /= 2.0
    return dt


def urdf(model: CableModel) -> str:
    """Return a cable as URDF, straight along y from the grip, which five joints move."""
    radius, parent = model.cable.radius, "base"
    links, joints = [_link(parent, 0.0, 0.0, 0.0, radius)], []
    for name, kind, axis in (
        ("x", "prismatic", "1 0 0"),
        ("y", "prismatic", "0 1 0"),
        ("z", "prismatic", "0 0 1"),
        ("yaw", "continuous", "0 0 -1"),
        ("pitch", "continuous", "1 0 0"),
    ):
        grip = f"grip_{name}"
        links.append(_link(grip, _GRIP_MASS, _GRIP_INERTIA, 0.0, radius))
        joints.append(_joint(grip, kind, parent, grip, 0.0, axis))
        parent = grip
    parts = [(model.segment_length, model.segment_mass)] * model.segment_count
    if model.attachment_length:
        parts.append((model.attachment_length, model.value("endpoint_mass")))
    at = 0.0
    for index, (own, own_mass) in enumerate(parts):
        across = own_mass * (own**2 / 12 + radius**2 / 4)
        # A light spin is unstable at this step; and whether a cable rolls barely moves its casts.
        links.append(_link(f"segment_{index}", own_mass, across, own, radius))
        joints.append(_joint(f"joint_{index}", "spherical", parent, f"segment_{index}", at))
        parent, at = f"segment_{index}", own
    if model.value("endpoint_mass") and not model.attachment_length:
        links.append(_link("attachment", model.value("endpoint_mass"), 1e-9, 0.0, radius))
        joints.append(_joint("end", "fixed", parent, "attachment", at))
    facts = [
        *model.lines("PyBullet", dropped(model)),
        "",
        "The springs are not part of URDF: the script next to this file sets them.",
    ]
    body = "\n".join(links + joints)
    return (
        f'<?xml version="1.0"?>\n{comment(facts)}\n'
        f'<robot name="{model.cable.name}">\n{body}\n</robot>\n'
    )


def _link(name: str, mass: float, inertia: float, length: float, radius: float) -> str:
    """Return a link; one of no length has no shape."""
    shape = ""
    if length:
        # Capsules lie along z in URDF.
        shape = (
            f'<origin xyz="0 {length / 2:.9g} 0" rpy="{-math.pi / 2:.9g} 0 0"/><geometry><capsule '
            f'radius="{radius:.6g}" length="{length:.9g}"/></geometry>'
        )
        shape = f"<collision>{shape}</collision><visual>{shape}</visual>"
    return (
        f'<link name="{name}"><inertial><origin xyz="0 {length / 2:.9g} 0"/><mass '
        f'value="{mass:.9g}"/><inertia ixx="{inertia:.6g}" iyy="{inertia:.6g}" '
        f'izz="{inertia:.6g}" ixy="0" '
        f'ixz="0" iyz="0"/></inertial>{shape}</link>'
    )


def _joint(name: str, kind: str, parent: str, child: str, at: float, axis: str = "0 1 0") -> str:
    limit = '<limit lower="-9" upper="9" effort="1e6" velocity="1e3"/>'
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="0 {at:.9g} 0"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{axis}"/>{limit if kind == "prismatic" else ""}</joint>'
    )


def springs(model: CableModel) -> str:
    """Return the script that loads the URDF file, sets its contacts, and applies its springs."""
    value, cells = model.value, model.cells
    friction = [value("friction")] * model.segment_count
    if model.attachment_length:
        friction.append(value("friction") * value("attachment_friction_ratio"))
    bend, limit = model.springs, value("bend_stiffness") * value("yield_curvature")
    values: dict[str, Any] = {
        "urdf": f"{model.cable.name}.urdf",
        "dt": step(model),
        "gravity": GRAVITY,
        "segment_count": model.segment_count,
        "segment_length": model.segment_length,
        "bend": bend,
        "twist": [value("twist_stiffness") / cell for cell in cells],
        "rest": [value("rest_curvature") * cell for cell in cells],
        "yield_angle": [limit / spring for spring in bend] if limit else [],
        "friction": friction,
    }
    names = ("damping_time", "linear_damping", "angular_damping", "friction_ratio", "yield_time")
    names += ("spinning_friction", "rolling_friction")
    values |= {name: value(name) for name in names}
    units = (
        "bend, twist: moment over angle of each joint [N m/rad]; rest, yield_angle: angles [rad]; "
        "dt, times [s]; dampings [1/s]; spinning and rolling friction: lever arms [m]."
    )
    lines = [*model.lines("PyBullet", dropped(model)), "", units]
    return script("pybullet_cable", lines, values)


def dropped(model: CableModel) -> list[str]:
    """Return what the model leaves out or changes."""
    lines = [
        "friction is a pyramid, regularised by Bullet's solver, at two points of each capsule.",
        "linear_damping and angular_damping grow with speed: right at 1 m/s and at 10 rad/s.",
        "twist is not damped, and segments are as inert about their axis as across it, so that the "
        "cable rolls less.",
    ]
    lines += [
        f"{name}: left out." for name in ("drag_coefficient", "drag_ratio") if model.value(name)
    ]
    return lines
