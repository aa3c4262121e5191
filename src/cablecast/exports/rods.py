"""A cable for Newton (VBD rods) and for PyElastica (Cosserat rods): scripts that build it.

Both know EA, EI and GJ of a rod by name. Neither is inextensible: the stretch rigidity is one that
the cable's motion does not feel.
"""

import math
from typing import Any

from cablecast.conventions import GRAVITY
from cablecast.exports.facts import CableModel
from cablecast.exports.script import script

STRETCH_RIGIDITY = 2000.0
"""EA [N]: a metre of rope stretches by 0.03 % under its own weight."""
CONTACT_STIFFNESS = 1e4
"""Stiffness of the table against a segment [N/m]: it gives by micrometres."""
SHEAR_STEP = 0.7
"""Step of PyElastica times the rate [rad/s] at which a thin segment rocks against its shear, the
fastest motion of the rod: beyond 2 it breaks."""
_UNITS = (
    "stretch_rigidity EA [N]; bend_stiffness EI, twist_stiffness GJ [N m2]; lengths [m]; masses "
    "[kg]; contact_stiffness [N/m]; dampings [1/s]; times [s]; spinning and rolling friction: [m]."
)


def newton(model: CableModel) -> str:
    """Return the script that adds a cable to a model of Newton."""
    dropped = _dropped(
        model, ("rest_curvature", "friction_ratio", "linear_damping", "angular_damping")
    )
    dropped.append("damping_time: damping of each joint, damping_time x stiffness.")
    lines = [*model.lines("Newton", dropped), "", _UNITS]
    return script("newton_cable", lines, _values(model))


def elastica(model: CableModel) -> str:
    """Return the script that makes a cable a rod of PyElastica."""
    length = model.segment_length
    inertia = 0.25 * model.segment_mass * model.cable.radius**2
    bending = 4.0 * max(model.value("bend_stiffness"), model.value("twist_stiffness")) / length
    rate = math.sqrt((STRETCH_RIGIDITY * length + bending) / inertia)
    values = _values(model) | {
        "gravity": GRAVITY,
        "rest_curvature": model.value("rest_curvature"),
        "friction_ratio": model.value("friction_ratio"),
        "linear_damping": model.value("linear_damping"),
        "angular_damping": model.value("angular_damping"),
        "roll_inertia": 2.0 * inertia,
        "dt": float(f"{SHEAR_STEP / rate:.1g}"),
    }
    dropped = _dropped(model, ("spinning_friction", "rolling_friction", "damping_time"))
    dropped.append("angular_damping slows the spin of a segment about its axis alone.")
    lines = [*model.lines("PyElastica", dropped), "", f"{_UNITS} dt: longest step."]
    return script("elastica_cable", lines, values)


def _values(model: CableModel) -> dict[str, Any]:
    names = ("bend_stiffness", "twist_stiffness", "endpoint_mass", "damping_time", "friction")
    names += ("spinning_friction", "rolling_friction")
    return {
        "segment_count": model.segment_count,
        "segment_length": model.segment_length,
        "radius": model.cable.radius,
        "segment_mass": model.segment_mass,
        "stretch_rigidity": STRETCH_RIGIDITY,
        "contact_stiffness": CONTACT_STIFFNESS,
        **{name: model.value(name) for name in names},
    }


def _dropped(model: CableModel, more: tuple[str, ...]) -> list[str]:
    """Return a sentence about the parameters that the model leaves out, if it has any."""
    names = ("drag_coefficient", "drag_ratio", "yield_curvature", "grip_compliance")
    names += ("attachment_arm", *more)
    nothing = {"friction_ratio": 1.0}
    left_out = [name for name in names if model.value(name) != nothing.get(name, 0.0)]
    if "attachment_arm" in left_out:
        left_out[left_out.index("attachment_arm")] = "attachment_arm (the mass is a point)"
    return [f"left out: {', '.join(left_out)}."] if left_out else []
