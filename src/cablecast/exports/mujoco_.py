"""A cable as MJCF: a chain of capsules, and MuJoCo's own rod, a 1-D flex.

The flex is the model of `EngineMujoco`, with the values of one cable.

The chain. Each capsule hangs on the one before by three hinges (left and right, up and down,
twist), whose springs are those of the length of cable between the middles of the two: EI / l and
GJ / l, with half such a length at the grip and at the attachment. Where bends stay in the cable, a
second hinge with dry friction stands in series with each spring of a bend: it gives way at the
moment EI x yield curvature, and creeps with the yield time.

The integrator "discrete" takes springs, damping and contacts implicitly, so that the light, stiff
twist of thin cables needs no armature.
"""

import math

from cablecast.cable import AIR_DENSITY, PARAMS
from cablecast.conventions import GRAVITY
from cablecast.engines.mujoco_ import SERVO_OMEGA, rod_model
from cablecast.exports.facts import CableModel, comment

CHAIN_DT, FLEX_DT = 2e-3, 1e-3
"""Steps of the exported models [s]."""
CONTACT_TIME = 4e-3
"""Time in which a contact pushes a segment out of the table [s]."""
NO_ROLLING = 0.1
"""Lever arm of rolling friction with which no segment rolls [m].

MuJoCo's convex contact lifts what slides. That takes momentum from the sliding, three times as much
from a cylinder that is free to roll, which moves three times as easily at the contact: at a
coefficient of 0.4 a rolling chain is farther from the cable than one that does not roll."""
HAND_MASS, HAND_INERTIA = 1.0, 1e-2
"""Mass [kg] and moment of inertia [kg m²] of the hand, which the weld leads."""
WELD_TIME = 2e-3
"""Time constant of the weld between the moved body and the hand [s]."""
_SOLIMP = "0.9999 0.9999 0.001"
_LEAST_FRICTION = 1e-5


def chain_xml(model: CableModel, *, rolls: bool = False) -> str:
    """Return a cable as MJCF of a chain of capsules on a table.

    It rolls as easily as the cable where `rolls` is set; see `NO_ROLLING`.
    """
    value, count, length = model.value, model.segment_count, model.segment_length
    radius, mass, tail = model.cable.radius, model.segment_mass, model.attachment_length
    bodies = [
        f'<body name="segment_{index}" pos="0 {length if index else 0:.9g} 0">'
        + _hinges(model, index)
        + _rod(f"segment_{index}", length, radius, mass, _drag(model))
        for index in range(count)
    ]
    end_mass, tip = value("endpoint_mass"), f'<site name="tip" pos="0 {length:.9g} 0"/>'
    if tail:
        tip += (
            f'<body name="attachment" pos="0 {length:.9g} 0">'
            + _hinges(model, count)
            + _rod("attachment", tail, radius, end_mass, 0.0)
            + "</body>"
        )
    elif end_mass:
        tip += (
            f'<body name="attachment" pos="0 {length:.9g} 0"><inertial pos="0 0 0" '
            f'mass="{end_mass:.9g}" diaginertia="1e-9 1e-9 1e-9"/></body>'
        )
    arm = value("rolling_friction") if rolls else NO_ROLLING
    pairs = [_pair(model, f"segment_{index}", arm) for index in range(count)]
    if tail:
        pairs.append(_pair(model, "attachment", arm, value("attachment_friction_ratio")))
    chain = "\n".join([*bodies, tip + "</body>" * count])
    contacts = "\n".join(pairs)
    facts = model.lines("MuJoCo (a chain of capsules)", _dropped_by_chain(model))
    return f"""{comment(facts)}
<mujoco model="{model.cable.name}">
<compiler angle="radian" autolimits="true"/>
<option integrator="discrete" timestep="{CHAIN_DT}" cone="elliptic" gravity="0 0 -{GRAVITY}"
        density="{AIR_DENSITY if value("drag_coefficient") else 0}"
        viscosity="{_viscosity(model):.6g}" iterations="100" tolerance="1e-10"/>
<worldbody>
  <geom name="table" type="plane" size="3 3 0.1" pos="0 0 0"/>
  <!-- Move `hand`: write data.mocap_pos and data.mocap_quat. `grip` follows through the weld, which
       lags by two time constants, {2 * WELD_TIME:g} s. To hold the cable with a robot, put
       `segment_0` into its gripper's body in place of hand, grip and weld; the cable leaves the
       gripper along y. -->
  <body name="hand" mocap="true" pos="0 0 {radius:.9g}"/>
  <body name="grip" pos="0 0 {radius:.9g}" gravcomp="1"><freejoint/>
  <inertial pos="0 0 0" mass="{HAND_MASS}"
            diaginertia="{HAND_INERTIA} {HAND_INERTIA} {HAND_INERTIA}"/>
{chain}
  </body>
</worldbody>
<contact>
{contacts}
</contact>
<equality>
  <weld body1="hand" body2="grip" relpose="0 0 0 1 0 0 0" solref="{WELD_TIME} 1"
        solimp="{_SOLIMP}"/>
</equality>
</mujoco>
"""


def _hinges(model: CableModel, index: int) -> str:
    """Return the hinges of a joint at which the cable bends and twists."""
    value, cell, bend = model.value, model.cells[index], model.springs[index]
    twist = value("twist_stiffness") / cell
    # At least a step: an undamped chain breaks where it whips.
    time = max(value("damping_time"), CHAIN_DT)
    rest = value("rest_curvature") * cell
    limit = value("bend_stiffness") * value("yield_curvature")
    text = ""
    for name, axis, rest_angle in (("side", "0 0 1", rest), ("lift", "1 0 0", 0.0)):
        if limit:
            text += (
                f'<joint name="{name}_yield_{index}" type="hinge" axis="{axis}" '
                f'frictionloss="{limit:.6g}" damping="{value("yield_time") * bend:.6g}" '
                f'armature="{_armature(model):.3g}" solreffriction="{CHAIN_DT} 1" '
                f'solimpfriction="{_SOLIMP}"/>'
            )
        text += (
            f'<joint name="{name}_{index}" type="hinge" axis="{axis}" stiffness="{bend:.6g}" '
            f'damping="{time * bend:.6g}" springref="{rest_angle:.6g}"/>'
        )
    return text + (
        f'<joint name="twist_{index}" type="hinge" axis="0 1 0" stiffness="{twist:.6g}" '
        f'damping="{time * twist:.6g}"/>'
    )


def _armature(model: CableModel) -> float:
    """Return the inertia of a hinge that yields [kg m²], that of a segment.

    MuJoCo's dry friction creeps the faster the lighter what it holds; the flow is so damped that it
    does not feel this inertia.
    """
    return model.segment_mass * model.segment_length**2 / 3


def _rod(name: str, length: float, radius: float, mass: float, drag: float) -> str:
    """Return inertia and shape of a uniform rod along y from its joint."""
    across = mass * (length**2 / 12 + radius**2 / 4)
    fluid = f' fluidshape="ellipsoid" fluidcoef="{drag:.6g} 0 0 0 0"'
    return (
        f'<inertial pos="0 {length / 2:.9g} 0" mass="{mass:.9g}" diaginertia="{across:.6g} '
        f'{mass * radius**2 / 2:.6g} {across:.6g}"/>'
        f'<geom name="{name}" type="capsule" size="{radius:.6g}" fromto="0 0 0 0 {length:.9g} 0" '
        f'contype="1" conaffinity="2"{fluid}/>'
    )


def _drag(model: CableModel) -> float:
    """Return the blunt drag coefficient of a capsule's ellipsoid whose drag is that of the cable.

    MuJoCo's force is density x coefficient x pi a c x speed², a and c being the half axes of the
    ellipsoid; ours is 1/2 density x drag coefficient x diameter x length x speed².
    """
    radius, length = model.cable.radius, model.segment_length
    return model.value("drag_coefficient") * length / (math.pi * (0.5 * length + radius))


def _viscosity(model: CableModel) -> float:
    """Return the viscosity of the air that slows a capsule as `linear_damping` does [Pa s].

    MuJoCo's force is 3 pi x viscosity x diameter x velocity, with 2/3 of the sum of the half axes
    of the ellipsoid as the diameter.
    """
    radius = model.cable.radius
    diameter = 2 / 3 * (3 * radius + 0.5 * model.segment_length)
    return model.value("linear_damping") * model.segment_mass / (3 * math.pi * diameter)


def _pair(model: CableModel, name: str, arm: float, more: float = 1.0) -> str:
    """Return the contact of a capsule with the table, whose first direction is along the cable."""
    across = model.value("friction") * more
    sliding = (across * model.value("friction_ratio"), across)
    turning = (model.value("spinning_friction"), arm, 0.0)
    friction = " ".join(f"{max(v, _LEAST_FRICTION):.6g}" for v in (*sliding, *turning))
    return (
        f'<pair geom1="table" geom2="{name}" condim="6" friction="{friction}" '
        f'solref="{CONTACT_TIME} 1" solimp="{_SOLIMP}"/>'
    )


def _dropped_by_chain(model: CableModel) -> list[str]:
    value = model.value
    lines = [
        "friction: MuJoCo's contact lifts a sliding capsule a little, which slows it across the "
        "cable, most where it may roll. So this chain does not roll: the lever arm of rolling "
        f"friction is {NO_ROLLING:g} m. Sliding and spinning are limited together, not each alone.",
    ]
    if value("angular_damping"):
        lines.append(
            "angular_damping acts on rotation in space, which joints do not know: left out."
        )
    if value("damping_time") < CHAIN_DT:
        lines.append(f"damping_time is {CHAIN_DT:g} s: an undamped chain breaks where it whips.")
    else:
        lines.append("damping_time: Kelvin's and Voigt's solid, without the limit of fast motions.")
    if value("drag_ratio"):
        lines.append("drag_ratio: left out.")
    if value("yield_curvature"):
        lines.append("yield_curvature acts on bends to the side and up and down each for itself.")
    return lines


def flex_xml(model: CableModel) -> str:
    """Return a cable as MJCF of MuJoCo's rod on a table, with the ten parameters of the paper."""
    dropped = [
        "friction: MuJoCo's contact lifts a sliding node a little, which slows it across the "
        "cable, most where it rolls.",
        "bending: the moment grows with the angle phi at a node as 2 tan(phi/2) / cos(phi/2)^2.",
    ]
    left_out = [
        name
        for name, info in PARAMS.items()
        if info.default is not None and model.value(name) != info.default
    ]
    if left_out:
        dropped.append(f"left out: {', '.join(left_out)}.")
    if model.value("linear_damping"):
        dropped.append(
            "linear_damping: MJCF refuses it to nodes of a flex. Set it after loading: for each "
            "joint node_I_C, model.dof_damping[dof] = linear_damping x the node's mass."
        )
    facts = [
        *model.lines("MuJoCo (a 1-D flex)", dropped),
        "",
        "The hand is driven by five actuators, x, y, z, yaw (from y to the right) and pitch:",
        "write data.ctrl = pose + 2 x velocity / w + acceleration / w^2 before each step, "
        f"w = {SERVO_OMEGA:g} rad/s.",
    ]
    xml = rod_model(model.cable, model.segment_count, FLEX_DT, GRAVITY, held=False, values=True)
    return f"{comment(facts)}\n{xml}\n"
