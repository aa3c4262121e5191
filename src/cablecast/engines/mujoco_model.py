"""Model of a gripped cable in MuJoCo's XML: a hand on five joints, a flex rod, a table.

engines/mujoco_.py explains why it is built this way.
"""

import math

from cablecast.cable import Cable

HAND_DOF_COUNT = 5
_STUB = 1e-3
"""Length of the clamped stub behind the grip, in segments."""

# The hand outweighs what the cable pulls by far; the servo only removes the drift of integration.
HAND_MASS = 100.0
"""Mass of the hand [kg]."""
SERVO_OMEGA = 400.0
"""Natural frequency of the servo that drives the hand [rad/s]."""
_SERVO = f'kp="{HAND_MASS * SERVO_OMEGA**2}" kv="{2.0 * HAND_MASS * SERVO_OMEGA}"'

# The solver measures its progress against the mean inertia, which the hand dominates.
_TOLERANCE = 1e-13
# A contact much stiffer than the step throws a sliding node up by centimetres: within one step it
# gives the node a normal velocity of friction x sliding speed x 2 dt / time constant.
_CONTACT_TIME = 4e-3
_SOLIMP = "0.9999 0.9999 0.001"


def rod_model(cable: Cable, segment_count: int, dt: float, gravity: float, *, held: bool) -> str:
    """Return the model as XML, with the cable straight along y from the origin.

    Stiffness, masses, friction and damping are placeholders of 1 that the engine replaces for each
    world.

    Args:
        cable: Geometry.
        segment_count: Number of segments.
        dt: Step [s].
        gravity: Acceleration of free fall [m/s²].
        held: True where the far end is driven along a path, too.
    """
    count = segment_count
    length = cable.length / count
    second_moment = math.pi * cable.radius**4 / 4
    hand_joints = ("slide 1 0 0", "slide 0 1 0", "slide 0 0 1", "hinge 0 0 -1", "hinge 1 0 0")
    joints, servos, bodies, rolls, tendons = [], [], [], [], []
    for index, joint in enumerate(hand_joints):
        kind, axis = joint.split(" ", 1)
        joints.append(f'<joint name="hand_{index}" type="{kind}" axis="{axis}"/>')
        servos.append(f'<position joint="hand_{index}" {_SERVO}/>')
    for node in range(1, count + 1):
        driven = held and node == count
        slides = "".join(
            f'<joint name="node_{node}_{c}" type="slide" axis="{axis}"/>'
            for c, axis in enumerate(("1 0 0", "0 1 0", "0 0 1"))
        )
        bodies.append(
            f'<body name="node_{node}" pos="0 {node * length:.17g} 0" gravcomp="{int(driven)}">'
            f'<inertial pos="0 0 0" mass="1" diaginertia="1e-9 1e-9 1e-9"/>{slides}</body>'
        )
        # MuJoCo finds the roll joint of each edge by these names.
        name = "cable_twist" if node == count else f"cable_twist_{node}"
        rolls.append(
            f'<body name="{name}"><inertial pos="0 0 0" mass="1e-9" diaginertia="1 1 1"/>'
            f'<joint name="{name}" type="hinge" axis="0 1 0"/></body>'
        )
        for c in range(3):
            before = f"hand_{c}" if node == 1 else f"node_{node - 1}_{c}"
            tendons.append(
                f'<fixed damping="1"><joint joint="{before}" coef="-1"/>'
                f'<joint joint="node_{node}_{c}" coef="1"/></fixed>'
            )
            if driven:
                servos.append(f'<position joint="node_{node}_{c}" {_SERVO}/>')
    names = " ".join(["hand", "hand", *(f"node_{node}" for node in range(1, count + 1))])
    vertices = f"0 {-_STUB * length:.17g} 0 " + "0 0 0 " * (count + 1)
    elements = " ".join(f"{edge} {edge + 1}" for edge in range(count + 1))
    contact_time = max(_CONTACT_TIME, dt)
    return f"""<mujoco model="cablecast cable">
<option integrator="discrete" timestep="{dt:.17g}" cone="elliptic" iterations="100"
        tolerance="{_TOLERANCE}" ls_tolerance="1e-6" gravity="0 0 {-gravity:.17g}">
  <flag autoreset="disable"/>
</option>
<worldbody>
  <geom name="table" type="plane" size="0 0 1"/>
  <body name="hand" gravcomp="1">
    <inertial pos="0 0 0" mass="{HAND_MASS}"
              diaginertia="{HAND_MASS} {HAND_MASS} {HAND_MASS}"/>{"".join(joints)}
  </body>
  {"".join(bodies)}
  {"".join(rolls)}
</worldbody>
<deformable>
  <flex name="cable" dim="1" radius="{cable.radius:.17g}" body="{names}" vertex="{vertices}"
        element="{elements}">
    <contact condim="6" friction="1 0.001 0.001" priority="1" solref="{contact_time:.17g} 1"
             solimp="{_SOLIMP}" selfcollide="none"/>
    <elasticity young="{1.0 / second_moment:.17g}" shear="{0.5 / second_moment:.17g}" damping="0"/>
  </flex>
</deformable>
<equality><flex flex="cable" solref="{dt:.17g} 1" solimp="{_SOLIMP}"/></equality>
<tendon>{"".join(tendons)}</tendon>
<actuator>{"".join(servos)}</actuator>
</mujoco>"""
