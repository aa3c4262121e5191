"""The scene as a MuJoCo model: a table, a gripping hand on five joints, and a discrete elastic rod.

The rod is a native 1-D flex. Its vertices are bodies of the world with three slides each, so that
the mass matrix is diagonal and nothing is computed in the frame of the turning hand; only the first
two belong to the hand, which clamps the edge between them. The hand is a heavy body that is driven
through its joints: a mocap body has no velocity, and the rod's length constraint would drag behind.

The attachment is a rigid body that clamps an edge of the rod beyond the cable's end, so that it
bends and twists the cable as it turns. A hook has its mass and its bend beside the cable's axis; a
magnet is a disc that can turn about the axis, and rolls on the table.
"""

import dataclasses
import math
from typing import Any

import numpy as np

from cablecast.cable import Attachment, Cable
from cablecast.conventions import GRAVITY, Array, tangent
from cablecast.errors import MissingExtraError
from cablecast.rigs.virtual._hidden import HiddenCable
from cablecast.workspace import Workspace

HAND_DOF_COUNT = 5
_TABLE_THICKNESS = 0.04
_FLOOR_Z = -0.75

# The hand weighs hundreds of times what the cable can pull, so it goes where it is driven. Its
# servo, 60 Hz and critically damped, only removes the drift of the integration.
_HAND_MASS = 20.0
_HAND_INERTIA = 1.0
_SERVO_OMEGA = 2.0 * math.pi * 60.0
_HAND_M = np.array([_HAND_MASS] * 3 + [_HAND_INERTIA] * 2)
_SERVO_KP = _SERVO_OMEGA**2 * _HAND_M
_SERVO_KV = 2.0 * _SERVO_OMEGA * _HAND_M

# A length constraint is soft by default and stretches by several per cent. At this time constant
# the rod stays within 0.3 % in the fastest casts.
_EDGE_SOLREF = "0.001 1"
_EDGE_SOLIMP = "0.9999 0.9999 0.001"
_CONTACT_SOLREF = "0.004 1"
_CONTACT_SOLIMP = "0.99 0.99 0.001"
# A smaller attachment is a part of the cable's last vertex: it would only make the model stiff.
_ATTACHMENT_LENGTH_MIN = 0.003
_ATTACHMENT_MASS_MIN = 1e-4
# A body that turns faster than the step can follow is no use: its radius of gyration is at least
# this [m].
_GYRATION_MIN = 0.005
# That of a magnet, whose clamp is light and turned by the whole cable's twist [m].
_MAGNET_GYRATION_MIN = 0.007
# The part of a magnet that is clamped to the cable and does not turn.
_MAGNET_CLAMP_SHARE = 0.1
_MAGNET_LENGTH_MIN = 0.006
# Twist acts on the clamp explicitly, and a step must not turn it too far [kg·m²].
_CLAMP_INERTIA = 6e-7
# A disc turns in its clamp with this torque for each newton of its weight [m], and rolls on foam
# with this lever arm [m].
_DISC_BEARING = 0.002
_DISC_ROLLING = 0.0025
# Of a hook in a loop: its eye, the lever arm of the rubbing eye for each newton of its weight [m],
# and a little damping for each kilogram [m²/s].
_LOOP_MASS_SHARE = 0.15
_LOOP_FRICTION = 0.0005
_LOOP_DAMPING = 2e-4
# Contacts: the cable meets the table, so does the attachment, but they do not meet each other.
_TABLE_BITS, _TIP_BITS = 'contype="3" conaffinity="3"', 'contype="2" conaffinity="2"'
# Resists the spinning of each segment about its own axis, as rolling on foam does [N·m·s].
_ROLL_DAMPING_PER_MASS = 1e-4


@dataclasses.dataclass(frozen=True, kw_only=True)
class CableMotion:
    """Positions and velocities of a batch of cables.

    Attributes:
        vertices: Positions up to the endpoint [m], shape [world, vertex, 3].
        velocity: Velocities of the vertices [m/s], same shape.
        roll: Roll angle of each edge but the gripped one [rad], shape [world, edge - 1].
        roll_rate: Rate of that angle [rad/s], same shape.
    """

    vertices: Array
    velocity: Array
    roll: Array
    roll_rate: Array


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scene:
    """A compiled model, and the places of things in it.

    Attributes:
        model: Compiled MjModel.
        arc_lengths: Distance of each vertex from the grip to the endpoint [m], shape [vertex].
        masses: Mass of the cable without its attachment, lumped at each vertex [kg], shape
            [vertex].
        has_tip: Whether the attachment is a body of its own, whose orientation follows the slides
            as a quaternion in qpos and three rates in qvel.
        end_height: Height of the endpoint when attachment and cable lie on the table [m].
        extra_count: Degrees of freedom between the attachment's turn and the rolls of the edges.
        hand_origin: Pose of the hand at joint values 0: x, y, z [m], yaw, pitch [rad], shape [5].
        vertex_origin: Positions of the free vertices at slides 0 [m], shape [vertex - 2, 3].
        stiffness: Bending stiffness at each vertex after the first, as a multiple of the mean [-],
            shape [vertex - 2].
    """

    model: Any
    arc_lengths: Array
    masses: Array
    has_tip: bool
    end_height: float
    extra_count: int
    hand_origin: Array
    vertex_origin: Array
    stiffness: Array

    @property
    def vertex_slice(self) -> slice:
        """Degrees of freedom of the free vertices, in qpos and qvel alike."""
        return slice(HAND_DOF_COUNT, HAND_DOF_COUNT + self.vertex_origin.size)

    @property
    def tip_slice(self) -> slice:
        """Quaternion of the attachment in qpos; empty where it is no body of its own."""
        start = self.vertex_slice.stop
        return slice(start, start + (4 if self.has_tip else 0))

    @property
    def roll_slices(self) -> tuple[slice, slice]:
        """Roll of each edge but the gripped one, in qpos and in qvel."""
        count = len(self.arc_lengths) - 2
        start = self.tip_slice.stop + self.extra_count
        rate = start - (1 if self.has_tip else 0)
        return slice(start, start + count), slice(rate, rate + count)

    def lay_down(self, qpos: Array, pose: Array, shape: Array, tip_roll: float) -> None:
        """Fill the positions of all joints of a world with what a reset left of hand and cable.

        The pose is x, y, z [m], yaw, pitch [rad] of the grip, the shape the cable's vertices [m],
        shape [vertex, 3]; the lying attachment is turned about the cable [rad].
        """
        qpos[:HAND_DOF_COUNT] = pose - self.hand_origin
        qpos[self.vertex_slice] = (shape[2:] - self.vertex_origin).ravel()
        if not self.has_tip:
            return
        ahead = shape[-1] - shape[-2]
        # A hook's bend comes down from above: its other side would start within the table.
        yaw, roll = -np.arctan2(ahead[0], ahead[1]) / 2, -abs(tip_roll) / 2
        # Turned about its own y, the cable's axis, and then about z.
        qpos[self.tip_slice] = [
            np.cos(yaw) * np.cos(roll),
            -np.sin(yaw) * np.sin(roll),
            np.cos(yaw) * np.sin(roll),
            np.sin(yaw) * np.cos(roll),
        ]

    def vertices(self, qpos: Array) -> Array:
        """Return the positions of all vertices up to the endpoint [m], shape [world, vertex, 3]."""
        count = len(qpos)
        vertices = np.empty((count, len(self.arc_lengths), 3))
        pose = qpos[:, :HAND_DOF_COUNT] + self.hand_origin
        vertices[:, 0] = pose[:, :3]
        vertices[:, 1] = pose[:, :3] + self.arc_lengths[1] * tangent(pose[:, 3], pose[:, 4])
        free = qpos[:, self.vertex_slice].reshape(count, -1, 3)
        np.add(free, self.vertex_origin, out=vertices[:, 2:])
        return vertices

    def motion(self, qpos: Array, qvel: Array) -> CableMotion:
        """Return positions and velocities of the cables, from those of all joints."""
        rolls, roll_rates = self.roll_slices
        vertices = self.vertices(qpos)
        velocity = np.empty_like(vertices)
        # The gripped edge is as short as the jaws: what its turn adds is left out.
        velocity[:, :2] = qvel[:, None, :3]
        velocity[:, 2:] = qvel[:, self.vertex_slice].reshape(len(qpos), -1, 3)
        return CableMotion(
            vertices=vertices, velocity=velocity, roll=qpos[:, rolls], roll_rate=qvel[:, roll_rates]
        )

    def controls(self, poses: Array, dt: float) -> Array:
        """Return servo targets that carry the hand exactly along sampled poses.

        A semi-implicit step ends at q + dt v, so the velocity that belongs to a step is the
        backward difference; the velocity and the acceleration reach the servo through its position
        target. Poses have the shape [step + 1, 5], and there is one target per step of dt [s].
        """
        velocity = np.diff(poses, axis=0) / dt
        acceleration = np.diff(velocity, axis=0, prepend=0.0) / dt
        feedforward = (_SERVO_KV * velocity + _HAND_M * acceleration) / _SERVO_KP
        return poses[1:] - self.hand_origin + feedforward


def build_scene(
    cable: Cable,
    truth: HiddenCable,
    workspace: Workspace,
    segment_count: int,
    dt: float,
    tilt: tuple[float, float] = (0.0, 0.0),
) -> Scene:
    """Compile the model, with a step of dt [s], on a table that slopes along x and y [rad].

    Raises:
        MissingExtraError: MuJoCo is not installed.
    """
    try:
        from mujoco import MjModel  # pyright: ignore[reportAttributeAccessIssue]
    except ModuleNotFoundError:
        raise MissingExtraError("mujoco", "mujoco", "the virtual rig") from None
    # The clamped edge is as short as the jaws. With a clamped edge of a whole segment the hinge
    # would sit half a segment too far out, and the landing would depend on the segment count.
    arc = np.concatenate([[0.0], np.linspace(truth.sleeve, cable.length, segment_count + 1)])
    # Half the mass of each edge is lumped at each of its ends.
    field = _fields(truth, arc)
    halves = np.diff(arc) * (truth.mass / cable.length) / 2 * field[1]
    masses = np.append(halves, 0.0) + np.insert(halves, 0, 0.0)
    has_tip = (
        cable.attachment is not Attachment.NONE
        and cable.attachment_length >= _ATTACHMENT_LENGTH_MIN
        and truth.endpoint_mass >= _ATTACHMENT_MASS_MIN
    )
    magnet = has_tip and cable.attachment is Attachment.MAGNET
    hand_origin = np.array([0.0, workspace.reset_y, workspace.grip_height, 0.0, 0.0])
    positions = np.zeros((len(arc), 3)) + hand_origin[:3]
    positions[:, 1] += arc
    xml = _mjcf(cable, truth, workspace, arc, masses, has_tip, positions, dt)
    model = MjModel.from_xml_string(xml)
    # The table stays level in its own frame; what comes from the side is its slope.
    model.opt.gravity[:2] = [-GRAVITY * slope for slope in tilt]
    pads = _soften(model, truth, field[0])
    stiffness = field[0][: len(arc) - 2].copy()
    # What the cable remembers bends it at the grip through the same pads.
    stiffness[0] *= pads
    loop = has_tip and not magnet and truth.play > 0.0
    return Scene(
        model=model,
        arc_lengths=arc,
        masses=masses,
        has_tip=has_tip,
        end_height=max(cable.radius, truth.endpoint_radius) if magnet else cable.radius,
        extra_count=1 if magnet else 2 if loop else 0,
        hand_origin=hand_origin,
        vertex_origin=positions[2:],
        stiffness=stiffness,
    )


def _fields(truth: HiddenCable, arc: Array) -> tuple[Array, Array]:
    """Return factors of the stiffness and of the mass of each edge, of mean 1, shape [edge]."""
    middle = (arc[1:] + arc[:-1]) / (2 * arc[-1])
    fields = []
    rng = np.random.default_rng(truth.field_seed)
    for deviation in (truth.stiffness_field, truth.mass_field):
        # Four half waves, so that ends differ, and bends of some decimetres.
        sizes, waves = rng.normal(size=4), np.cos(np.pi * np.arange(1, 5) * middle[:, None])
        field = np.exp(deviation * (waves @ sizes) / math.sqrt(2.0))
        fields.append(field / np.average(field, weights=np.diff(arc)))
    return fields[0], fields[1]


def _soften(model: Any, truth: HiddenCable, stiffness: Array) -> float:
    """Let the cable be stiffer here than there, and held by pads that give.

    MuJoCo keeps ten numbers for each bent vertex: at 4 the bending stiffness over the length that
    belongs to it, at 8 that of twist. The stiffness is a factor for each edge, shape [edge].
    Returns the share of the stiffness at the grip that the pads leave.
    """
    rows = model.flex_bending[1:].reshape(-1, 10)
    if truth.stiffness_field:
        # The first vertex ends the gripped edge, the last may be the attachment's.
        rows[:, [4, 8]] *= stiffness[np.minimum(np.arange(len(rows)), len(stiffness) - 1), None]
    if not truth.pad_stiffness:
        return 1.0
    # Two springs in series.
    left = truth.pad_stiffness / (truth.pad_stiffness + float(rows[0, 4]))
    rows[0, 4] *= left
    return left


def _mjcf(
    cable: Cable,
    truth: HiddenCable,
    workspace: Workspace,
    arc: Array,
    masses: Array,
    has_tip: bool,
    positions: Array,
    dt: float,
) -> str:
    """Return the whole model as XML, with a straight cable at some positions."""
    radius, count = cable.radius, len(arc)
    hand_joints, servos = [], []
    axes = ("slide 1 0 0", "slide 0 1 0", "slide 0 0 1", "hinge 0 0 -1", "hinge 1 0 0")
    for index, joint in enumerate(axes):
        kind, axis = joint.split(" ", 1)
        hand_joints.append(f'<joint name="hand_{index}" type="{kind}" axis="{axis}"/>')
        servos.append(
            f'<position joint="hand_{index}" kp="{_SERVO_KP[index]:.17g}" '
            f'kv="{_SERVO_KV[index]:.17g}"/>'
        )
    slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    bodies, rolls = [], []
    for index in range(2, count):
        mass = float(masses[index])
        # An attachment that is no body of its own is a part of the last vertex.
        if index == count - 1 and not has_tip:
            mass += truth.endpoint_mass
        body = f'<inertial pos="0 0 0" mass="{mass:.9g}" diaginertia="1e-9 1e-9 1e-9"/>'
        if index == count - 1 and has_tip:
            body = _tip(cable, truth, mass)
        place = f'pos="{_text(positions[index])}"'
        bodies.append(f'<body name="cable_{index}" {place}>{slides}{body}</body>')
    for edge in range(1, count - 1):
        # The compiler finds the roll joint of each edge by these names. The last edge's has a name
        # of its own; that of a clamped attachment has none.
        name = "cable_twist" if edge == count - 2 and not has_tip else f"cable_twist_{edge}"
        edge_mass = truth.mass / cable.length * (arc[edge + 1] - arc[edge])
        inertia = max(0.5 * edge_mass * radius**2, 1e-10)
        rolls.append(
            f'<body name="{name}"><inertial pos="0 0 0" mass="1e-9" '
            f'diaginertia="{inertia:.9g} {inertia:.9g} {inertia:.9g}"/>'
            f'<joint name="{name}" type="hinge" axis="0 1 0" '
            f'damping="{_ROLL_DAMPING_PER_MASS * edge_mass:.9g}"/></body>'
        )
    owners = ["hand", "hand", *(f"cable_{index}" for index in range(2, count))]
    vertices = "0 0 0 " + f"0 {arc[1]:.9g} 0 " + "0 0 0 " * (count - 2)
    if has_tip:
        owners.append(owners[-1])
        vertices += f"0 {cable.attachment_length:.9g} 0"
    elements = " ".join(f"{edge} {edge + 1}" for edge in range(len(owners) - 1))
    second_moment = math.pi * radius**4 / 4
    friction = truth.friction * (1.0 + truth.static_excess)
    depth = workspace.y_max - workspace.y_min
    table_size = (workspace.half_width, depth / 2, _TABLE_THICKNESS / 2)
    table_pos = (0.0, (workspace.y_min + workspace.y_max) / 2, -_TABLE_THICKNESS / 2)
    inertia = _text(np.full(3, _HAND_INERTIA))
    return f"""<mujoco model="cablecast virtual laboratory">
<option integrator="discrete" timestep="{dt:.9g}" cone="elliptic">
  <flag autoreset="disable"/>
</option>
<worldbody>
  <geom name="table" {_TABLE_BITS} type="box" size="{_text(table_size)}" pos="{_text(table_pos)}"/>
  <geom name="floor" {_TABLE_BITS} type="plane" size="5 5 0.1" pos="0 0 {_FLOOR_Z}"/>
  <body name="hand" pos="{_text(positions[0])}">
    <inertial pos="0 0 0" mass="{_HAND_MASS}" diaginertia="{inertia}"/>
    {"".join(hand_joints)}
  </body>
  {"".join(bodies)}
  {"".join(rolls)}
</worldbody>
<deformable>
  <flex name="cable" dim="1" radius="{radius:.9g}" body="{" ".join(owners)}" vertex="{vertices}"
        element="{elements}">
    <contact condim="3" friction="{friction:.9g} 0.005 0.0001" priority="1"
             solref="{_CONTACT_SOLREF}" solimp="{_CONTACT_SOLIMP}" selfcollide="none"/>
    <elasticity young="{truth.bend_stiffness / second_moment:.9g}"
                shear="{truth.twist_stiffness / (2 * second_moment):.9g}"
                damping="{truth.bend_damping:.9g}"/>
  </flex>
</deformable>
<equality><flex flex="cable" solref="{_EDGE_SOLREF}" solimp="{_EDGE_SOLIMP}"/></equality>
<actuator>{"".join(servos)}</actuator>
</mujoco>"""


def _tip(cable: Cable, truth: HiddenCable, lumped: float) -> str:
    """Return the attachment as a body that turns freely, but for the cable that it clamps.

    The mass of the cable's own end [kg] is lumped into it.
    """
    length, radius, offset = cable.attachment_length, truth.endpoint_radius, truth.endpoint_offset
    contact = (
        f'{_TIP_BITS} condim="6" priority="2" solref="{_CONTACT_SOLREF}" '
        f'solimp="{_CONTACT_SOLIMP}" friction="{truth.endpoint_friction:.9g} 0.001 {_DISC_ROLLING}"'
    )
    if cable.attachment is Attachment.HOOK:
        mass = truth.endpoint_mass + lumped
        centre = (
            truth.endpoint_mass / mass * np.array([0.5 * offset, truth.endpoint_share * length])
        )
        inertia = mass * np.maximum(
            np.array([length**2 / 12, offset**2 / 2, length**2 / 12]), _GYRATION_MIN**2
        )
        if truth.play > 0.0:
            return _hung_hook(truth, contact, length, radius, offset, lumped)
        return (
            f'<joint name="tip" type="ball"/>'
            f'<inertial pos="{_text([*centre, 0.0])}" mass="{mass:.9g}" '
            f'diaginertia="{_text(inertia)}"/>'
            f'<geom name="tip" type="capsule" size="{radius:.9g}" {contact} '
            f'fromto="{_text([offset, 0.4 * length, 0.0, offset, length - radius, 0.0])}"/>'
        )
    thickness = max(length, _MAGNET_LENGTH_MIN)
    disc = (1.0 - _MAGNET_CLAMP_SHARE) * truth.endpoint_mass
    clamp = lumped + truth.endpoint_mass - disc
    gyration = np.array([radius**2 / 4 + thickness**2 / 12, radius**2 / 2] * 2)[:3]
    least = np.maximum(gyration, _MAGNET_GYRATION_MIN**2)
    held, turning = (_text(mass * least) for mass in (clamp, disc))
    # The cylinder's axis is its z, the cable's is y.
    return (
        f'<joint name="tip" type="ball" armature="{_CLAMP_INERTIA:.9g}"/>'
        f'<inertial pos="0 0 0" mass="{clamp:.9g}" diaginertia="{held}"/>'
        f'<body name="disc" pos="0 {thickness / 2:.9g} 0">'
        f'<joint name="disc" type="hinge" axis="0 1 0" '
        f'frictionloss="{_DISC_BEARING * disc * GRAVITY:.9g}"/>'
        f'<inertial pos="0 0 0" mass="{disc:.9g}" diaginertia="{turning}"/>'
        f'<geom name="tip" type="cylinder" size="{radius:.9g} {thickness / 2:.9g}" '
        f'euler="90 0 0" {contact}/></body>'
    )


def _hung_hook(
    truth: HiddenCable, contact: str, length: float, radius: float, offset: float, lumped: float
) -> str:
    """Return a hook that hangs in a loop of the cable: it swings freely by the play, then is held.

    The loop is clamped to the cable and has its end's mass.
    """
    mass, share = truth.endpoint_mass, truth.endpoint_share
    loop = lumped + _LOOP_MASS_SHARE * mass
    gyration = np.array([length**2 / 12, offset**2 / 2, length**2 / 12])
    inertia = mass * np.maximum(gyration, _GYRATION_MIN**2)
    swing = "".join(
        f'<joint type="hinge" axis="{axis}" limited="true" range="{-math.degrees(truth.play):.9g} '
        f'{math.degrees(truth.play):.9g}" frictionloss="{_LOOP_FRICTION * mass * GRAVITY:.9g}" '
        f'damping="{_LOOP_DAMPING * mass:.9g}" solreflimit="0.006 1"/>'
        for axis in ("1 0 0", "0 0 1")
    )
    return (
        f'<joint name="tip" type="ball" armature="{_CLAMP_INERTIA:.9g}"/>'
        f'<inertial pos="0 0 0" mass="{loop:.9g}" '
        f'diaginertia="{_text([loop * _GYRATION_MIN**2] * 3)}"/>'
        f'<body name="hook">{swing}'
        f'<inertial pos="{_text([0.5 * offset, share * length, 0.0])}" '
        f'mass="{(1.0 - _LOOP_MASS_SHARE) * mass:.9g}" diaginertia="{_text(inertia)}"/>'
        f'<geom name="tip" type="capsule" size="{radius:.9g} " {contact} '
        f'fromto="{_text([offset, 0.4 * length, 0.0, offset, length - radius, 0.0])}"/></body>'
    )


def _text(values) -> str:
    return " ".join(f"{value:.9g}" for value in values)
