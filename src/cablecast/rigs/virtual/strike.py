"""RigStrike: a laboratory in which an arm swings a cable in the air, in MuJoCo.

The cable is a chain of capsules with two hinges each, whose bending has an elastic part, some
damping and dry friction, so that it does not return to where it was. It is uneven along its length,
curled and perhaps kinked, and hangs in a knot from a stick that sways. An attachment swings in its
loop. The air drags by MuJoCo's model of ellipsoids, with added mass and lift, and moves a little.
The joints follow their set points as those of the table's laboratory do (arm.py). A camera beside
the plane of the swing sees the tip in perspective, blurred by its exposure, with stamps of a
millisecond, and where its calibration believes it. A contact of the cable with stick, arm or floor
ends the path.

None of it is EngineWarp's: that has a rod of nodes with quadratic drag, a stiff stick, and joints
with a servo of second order.
"""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Attachment
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.conventions import Array
from cablecast.engines.mujoco_ import quiet
from cablecast.errors import MissingExtraError, RigError
from cablecast.motion.joint_move import JointMoves, SwingPlane, swing_shape
from cablecast.motion.trajectory import JointPath, Trajectory
from cablecast.rigs.virtual._hidden import effect_strengths, hidden_arm, hidden_cable
from cablecast.rigs.virtual._hidden_strike import (
    HiddenPlaneCamera,
    SwingNoise,
    hidden_plane_camera,
    hidden_swing,
)
from cablecast.rigs.virtual.arm import move_arm
from cablecast.rigs.virtual.config import TrialNoise
from cablecast.rigs.virtual.trials import RigOfTrials, Trial
from cablecast.setup import Setup

LABORATORY_VERSION = 1
"""Version of the strike laboratory; results of two versions are not compared."""
DT, RECORD_STEPS = 5e-4, 4
"""Step [s], and steps between two records of the cable."""
BODY_COUNT = 28
"""Capsules of a cable."""
_ARMATURE = 1e4
"""Inertia of a joint's rotor [kg·m²]: the pull of the cable does not move the arm."""
_SETTLE_TIME, _SETTLE_DAMPING = 1.5, 30.0
"""Time in which a cable comes to rest before a swing [s], and damping of its joints then, as a
multiple of its own [-]."""
_HANG_DAMPING = 2e-3
"""Damping of a joint of a cable that is brought to rest, over its mass [m²/s]."""
_ARM, _FLOOR = 1, 2
"""Groups of what a cable may touch."""
_TAIL = 0.4
"""Time after a move for which the joints are reported [s]."""
_AIR_DENSITY, _AIR_VISCOSITY = 1.2, 1.8e-5
_STICK_DENSITY = 200.0
"""Mass of a stick over its length and the square of its radius [kg/m³], about that of wood."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class StrikeLabConfig:
    """Settings of the strike laboratory.

    Attributes:
        lab_seed: Seed of the laboratory: another one has another copy of each cable, another stick
            and another camera.
        noise: What changes from swing to swing.
        arm: What changes in the arm from swing to swing.
        exact: Whether the tip is seen where it is, every `DT * RECORD_STEPS`, in place of the
            camera.
    """

    lab_seed: int = 0
    noise: SwingNoise = dataclasses.field(default_factory=SwingNoise)
    arm: TrialNoise = dataclasses.field(default_factory=TrialNoise)
    exact: bool = False


class RigStrike(RigOfTrials):
    """An arm with a stick, a hanging cable and a camera, which exist in MuJoCo only.

    Args:
        setup: Set-up with a strike section. The cable's parameters are what is believed of it.
        seed: Seed of what differs from swing to swing.
        config: Settings of the laboratory.

    Raises:
        InputError: The set-up has no strike section, or the seed is out of bounds.
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(self, setup: Setup, seed: int = 0, config: StrikeLabConfig | None = None):
        super().__init__(seed)
        self.setup = setup
        self.config = StrikeLabConfig() if config is None else config
        self.moves = JointMoves.of(setup)
        self.plane = SwingPlane.of(self.moves)
        lab_seed = self.config.lab_seed
        strengths = effect_strengths(lab_seed)
        self._servos = hidden_arm(lab_seed, strengths)
        self._camera = hidden_plane_camera(lab_seed)
        self._world = _World(setup, self.moves, lab_seed)
        # The calibration is that of the laboratory, the clocks that of a day.
        rng = np.random.default_rng([lab_seed, 23])
        self._scale = 1.0 + self._camera.scale * float(rng.normal())
        self._offset = self._camera.offset * rng.normal(size=2)
        self._clock = self._camera.clock * float(np.random.default_rng([seed, 24]).normal())
        settings = setup.to_settings()
        self.description: dict[str, Any] = {
            "rig": "virtual",
            "strike_laboratory_version": LABORATORY_VERSION,
            "cable": setup.cable.name,
            "seed": self.seed,
            "config": dataclasses.asdict(self.config),
            "strike": settings["strike"],
            "arm": settings["arm"],
        }

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        """Swing once from rest, and report where the tip was seen until a contact."""
        self._use_reset()
        strike = self.setup.strike_section
        seed, index = self._next
        trial = Trial.draw(self.config.arm, seed, index)
        rng = np.random.default_rng([seed, index, 7])
        self._trial_count += 1
        # The joints of a slow move are reported to its end, however long the tip is watched.
        steps = round(max(strike.watch_time, trajectory.duration + _TAIL) / DT)
        (arm,) = move_arm([trajectory], [trial], self.setup.arm, self._servos, DT, steps)
        if arm.q is None or arm.joint_path is None:
            raise RigError("a swing needs the joints of a motion, and this one has none")
        with quiet():
            watched = arm.q[: round(strike.watch_time / DT) + 1]
            nodes, is_broken = self._world.swing(watched, self.config.noise, rng)
        report = _reported(arm.joint_path, trajectory.duration + _TAIL)
        if is_broken:
            nothing = EndpointTrack.unseen(TrialStatus.NON_FINITE)
            return dataclasses.replace(nothing, endpoint_z=np.full(1, np.nan), joint_path=report)
        times: Array = DT * RECORD_STEPS * np.arange(len(nodes), dtype=np.float64)
        shown = np.arange(len(nodes))
        tip = nodes[:, -1]
        if not self.config.exact:
            times, tip, shown = self._seen(times, tip, rng)
        return EndpointTrack(
            times=times,
            endpoint_xy=tip[:, :2],
            endpoint_z=tip[:, 2],
            status=TrialStatus.OK,
            nodes=nodes[shown],
            joint_path=report,
        )

    def _seen(
        self, times: Array, tip: Array, rng: np.random.Generator
    ) -> tuple[Array, Array, NDArray[np.int_]]:
        """Return times of frames [s], what the camera sees of the tip, and the records of it."""
        camera: HiddenPlaneCamera = self._camera
        first = float(rng.uniform(0.0, 1.0 / camera.rate))
        # One before the motion, so that a path starts where the cable hangs.
        frames = np.append(0.0, np.arange(first, times[-1], 1.0 / camera.rate))
        open_for = camera.exposure * (np.linspace(0.0, 1.0, 5) - 0.5)
        moments = np.clip(frames[:, None] + open_for, 0.0, times[-1])
        places = np.stack([np.interp(moments, times, values) for values in tip.T], axis=-1)
        u, v, away = np.moveaxis(self.plane.coordinates(places.mean(axis=1)), -1, 0)
        seen = np.stack([u, v], axis=-1) - self._middle
        # The camera looks from the side to which `away` counts.
        seen *= camera.distance / (camera.distance - away)[:, None]
        seen += camera.noise * camera.distance / camera.focal * rng.normal(size=seen.shape)
        seen = self._scale * seen + self._middle + self._offset
        seen[1:][rng.uniform(size=len(frames) - 1) < camera.lost] = np.nan
        stamps = np.round((frames + self._clock) / camera.stamp) * camera.stamp
        stamps[0] = 0.0
        # Two frames never have one stamp, and none is before the motion.
        kept = np.append(True, np.diff(stamps) > 0.0) & (stamps >= 0.0)
        # A track ends where the tip was seen last.
        kept &= np.arange(len(kept)) <= np.flatnonzero(np.isfinite(seen[:, 0]))[-1]
        shown = np.minimum(np.rint(frames / times[1]).astype(int), len(times) - 1)
        return stamps[kept], self.plane.points(seen[kept]), shown[kept]

    @property
    def _middle(self) -> Array:
        """Where the camera's axis meets the plane: about the root at the start [m], shape [2]."""
        root = self.moves.stick.root(self.moves.arm.frames(np.array(self.moves.start))[-1])
        return self.plane.coordinates(root)[:2] + np.array([0.0, 0.4])


def _reported(path: JointPath, until: float) -> JointPath:
    """Return the reports of the joints up to a time [s]."""
    kept = path.times <= until
    return JointPath(times=path.times[kept], q=path.q[kept], qd=path.qd[kept])


class _World:
    """Arm, stick and cable in MuJoCo.

    Args:
        setup: Set-up with a strike section.
        moves: Its moves.
        lab_seed: Seed of the laboratory.
    """

    def __init__(self, setup: Setup, moves: JointMoves, lab_seed: int):
        try:
            import mujoco
        except ModuleNotFoundError:
            raise MissingExtraError("mujoco", "mujoco", "the virtual rig") from None
        self._mujoco: Any = mujoco
        self.setup, self.moves = setup, moves
        self._truth = hidden_cable(setup.cable, lab_seed, effect_strengths(lab_seed))
        self._swing = hidden_swing(lab_seed)
        self.model: Any = self._built()
        self.data: Any = mujoco.MjData(self.model)  # pyright: ignore[reportAttributeAccessIssue]
        count = moves.arm.joint_count
        self._joints = slice(0, count)
        self._hanging: Array | None = None
        self._hinges = slice(count + 2, count + 2 + 2 * BODY_COUNT)
        self._knot = [self._hinges.start, self._hinges.start + 1]
        self._chain = [self.model.body(f"cable_{number}").id for number in range(BODY_COUNT)]

    def swing(self, q: Array, noise: SwingNoise, rng: np.random.Generator) -> tuple[Array, bool]:
        """Swing along joint angles [rad], one each step, until a contact.

        Returns:
            Cable from its root to the tip at each record [m], shape [record, node, 3], and whether
            MuJoCo gave up.
        """
        model, data, step = self.model, self.data, self._mujoco.mj_step
        self._hang(noise, rng)
        joints, q = self._joints, q - np.array(self.moves.start)
        bias, asked = data.qfrc_bias[joints], data.qfrc_applied[joints]
        at, rate = data.qpos[joints], data.qvel[joints]
        nodes = []
        for number in range(len(q)):
            if number % RECORD_STEPS == 0:
                nodes.append(self._nodes())
            if number == len(q) - 1 or data.ncon or not np.isfinite(nodes[-1]).all():
                break
            # The acceleration that brings the joints to where they are next.
            wanted = (q[number + 1] - at - DT * rate) / DT**2
            asked[:] = _ARMATURE * wanted + bias
            step(model, data)
        path = np.array(nodes)
        return path, not bool(np.isfinite(path).all()) or len(path) < 3

    def _hang(self, noise: SwingNoise, rng: np.random.Generator) -> None:
        """Let the cable hang from the arm at the start, all but at rest."""
        model, data, mujoco = self.model, self.data, self._mujoco
        mujoco.mj_resetData(model, data)
        if self._hanging is None:
            self._hanging = self._settled()
        data.qpos[:] = self._hanging
        draws = np.clip(rng.normal(size=7), -3.0, 3.0)
        model.qpos_spring[self._hinges] = self._rest
        model.qpos_spring[self._hinges][1::2] += noise.curl * draws[0] * self._piece
        model.jnt_pos[self._knot, 2] = noise.slip * draws[1]
        # It sways as a pendulum about the knot.
        length = self.setup.cable.length
        phases = rng.uniform(0.0, 2.0 * math.pi, size=2)
        for axis, (size, phase) in enumerate(zip(draws[2:4], phases, strict=True)):
            hinge, angle = self._hinges.start + axis, noise.sway * size / length
            data.qpos[hinge] += angle * math.sin(phase)
            data.qvel[hinge] = angle * math.cos(phase) * math.sqrt(9.81 / length)
        model.opt.wind[:] = noise.air * draws[4:7]
        mujoco.mj_forward(model, data)

    def _settled(self) -> Array:
        """Return the positions of all joints as the cable hangs at rest."""
        model, data, joints = self.model, self.data, self._joints
        damping = model.dof_damping.copy()
        model.dof_damping[joints.stop :] = np.maximum(
            _SETTLE_DAMPING * damping[joints.stop :], _HANG_DAMPING * self._truth.mass
        )
        model.opt.wind[:] = 0.0
        model.qpos_spring[self._hinges] = self._rest
        for _ in range(round(_SETTLE_TIME / DT)):
            wanted = -(data.qpos[joints] + DT * data.qvel[joints]) / DT**2
            data.qfrc_applied[joints] = _ARMATURE * wanted + data.qfrc_bias[joints]
            self._mujoco.mj_step(model, data)
        model.dof_damping[:] = damping
        hanging = data.qpos.copy()
        self._mujoco.mj_resetData(model, data)
        return hanging

    def _nodes(self) -> Array:
        """Return the ends of the pieces from the root to the tip [m], shape [node, 3]."""
        data = self.data
        middle = data.xpos[self._chain]
        along = data.xmat[self._chain][:, [2, 5, 8]]
        return np.concatenate([middle[:1], middle + self._piece * along])

    def _built(self) -> Any:
        """Return the model at the start of all swings."""
        mujoco, setup, moves = self._mujoco, self.setup, self.moves
        truth, swing, cable = self._truth, self._swing, setup.cable
        floor = setup.strike_section.floor
        start = np.array(moves.start)
        frames = moves.arm.frames(start)
        shape = swing_shape(start, moves.arm, moves.stick)
        spec = mujoco.MjSpec()
        spec.option.timestep = DT
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
        spec.option.density, spec.option.viscosity = _AIR_DENSITY, _AIR_VISCOSITY
        spec.compiler.degree = False
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[10.0, 10.0, 0.1],
            pos=[0.0, 0.0, floor],
            contype=_FLOOR,
            conaffinity=0,
        )
        capsule_kind = mujoco.mjtGeom.mjGEOM_CAPSULE
        drag = [truth.drag * swing.drag_blunt, truth.drag * swing.drag_slender, 1.5, 0.5, 0.5]

        # The capsules of the arm in their order, each on the joint that moves it first.
        body, place = spec.worldbody, np.zeros(3)
        rods = iter(zip(shape.ends[:-1], shape.radii[:-1], strict=True))
        carried = _carried(moves, start)
        for joint in range(moves.arm.joint_count + 1):
            if joint:
                frame = frames[joint - 1]
                body = body.add_body(
                    pos=frame[:3, 3] - place,
                    mass=1e-3,
                    ipos=[0.0, 0.0, 0.0],
                    inertia=[1e-6, 1e-6, 1e-6],
                    explicitinertial=1,
                )
                place = frame[:3, 3]
                body.add_joint(
                    type=mujoco.mjtJoint.mjJNT_HINGE, axis=frame[:3, 2], armature=_ARMATURE
                )
            for _ in range(carried.count(joint)):
                ends, radius = next(rods)
                body.add_geom(
                    type=capsule_kind,
                    fromto=(ends - place).ravel(),
                    size=[radius, 0.0, 0.0],
                    mass=1e-3,
                    contype=_ARM,
                    conaffinity=0,
                )
        out = frames[-1][:3, 2]
        # Two directions across the stick: within the plane of the swing, and out of it.
        normal = frames[moves.joints[0]][:3, 2]
        inside = np.cross(normal, out)
        foot, root = frames[-1][:3, 3], moves.stick.root(frames[-1])
        mass = max(_STICK_DENSITY * moves.stick.length * math.pi * moves.stick.radius**2 * 4, 0.02)
        inertia = mass * moves.stick.length**2 / 3.0 + 1e-6
        omega = 2.0 * math.pi * swing.stick_frequency
        body = body.add_body(pos=foot - place)
        place = foot
        for axis in (normal, inside):
            body.add_joint(
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=axis,
                stiffness=inertia * omega**2,
                damping=2.0 * swing.stick_damping * inertia * omega,
            )
        body.add_geom(
            type=capsule_kind,
            # Its end leaves room for the knot.
            fromto=np.concatenate([np.zeros(3), 0.9 * (root - foot)]),
            size=[moves.stick.radius, 0.0, 0.0],
            mass=mass,
            contype=_ARM,
            conaffinity=0,
        )
        piece = cable.length / BODY_COUNT
        places = (np.arange(BODY_COUNT) + 0.5) / BODY_COUNT
        stiffness, masses = _uneven(truth, places)
        self._piece = piece
        rest = np.zeros(2 * BODY_COUNT)
        # It is curled out of the plane of the swing and within it.
        lean = np.random.default_rng([truth.field_seed, 25]).uniform(0.0, 2.0 * math.pi)
        rest[0::2], rest[1::2] = (
            truth.curl * piece * wave for wave in (math.cos(lean), math.sin(lean))
        )
        if truth.kink:
            rest[2 * int(truth.kink_place * BODY_COUNT)] += truth.kink
        self._rest = rest
        # Hanging, the pieces point down: along z of their bodies, which are turned once.
        down = np.array([0.0, 0.0, -1.0])
        body = body.add_body(pos=root - place, quat=_towards(down, normal))
        for number in range(BODY_COUNT):
            if number:
                body = body.add_body(pos=[0.0, 0.0, piece])
            body.name = f"cable_{number}"
            elastic = truth.bend_stiffness * stiffness[number] / piece
            knot = swing.knot_stiffness if number == 0 else 1.0
            slips = truth.strand_share * truth.bend_stiffness * truth.slip_curvature
            for axis in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):
                body.add_joint(
                    type=mujoco.mjtJoint.mjJNT_HINGE,
                    axis=axis,
                    stiffness=knot * (1.0 - truth.strand_share) * elastic,
                    damping=truth.bend_damping * knot * elastic,
                    frictionloss=slips if truth.strand_share else 0.0,
                )
            body.add_geom(
                type=capsule_kind,
                fromto=[0.0, 0.0, 0.0, 0.0, 0.0, piece],
                size=[cable.radius, 0.0, 0.0],
                mass=truth.mass / BODY_COUNT * masses[number],
                contype=0,
                # What lies along the stick that holds it is no contact.
                conaffinity=_FLOOR | (_ARM if number > 2 else 0),
                fluid_ellipsoid=1,
                fluid_coefs=drag,
            )
        self._add_attachment(body, piece, drag)
        return spec.compile()

    def _add_attachment(self, body: Any, piece: float, drag: list[float]) -> None:
        """Hang the attachment into the end of the cable."""
        mujoco, truth, cable = self._mujoco, self._truth, self.setup.cable
        if cable.attachment is Attachment.NONE or truth.endpoint_mass < 1e-5:
            return
        length = max(cable.attachment_length, 0.005)
        tip = body.add_body(pos=[0.0, 0.0, piece])
        if cable.attachment is Attachment.HOOK:
            rub = self._swing.hook_friction * truth.endpoint_mass * 9.81 * length
            for axis in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):
                tip.add_joint(
                    type=mujoco.mjtJoint.mjJNT_HINGE,
                    axis=axis,
                    frictionloss=rub,
                    damping=0.1 * rub,
                    armature=1e-8,
                )
        offset = truth.endpoint_offset
        tip.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[offset, 0.0, 0.2 * length, offset, 0.0, 2.0 * truth.endpoint_share * length],
            size=[truth.endpoint_radius, 0.0, 0.0],
            mass=truth.endpoint_mass,
            contype=0,
            conaffinity=_ARM | _FLOOR,
            fluid_ellipsoid=1,
            fluid_coefs=drag,
        )


def _carried(moves: JointMoves, q: Array) -> list[int]:
    """Return which joint each capsule of the arm is first moved by, 0 for none.

    Each joint is turned a little: what moves is behind it.
    """
    shape = swing_shape(q, moves.arm, moves.stick).ends[:-1]
    carried = np.zeros(len(shape), dtype=int)
    for joint in range(moves.arm.joint_count):
        turned = q.copy()
        turned[joint] += 0.3
        moved = swing_shape(turned, moves.arm, moves.stick).ends[:-1]
        carried[np.abs(moved - shape).max(axis=(1, 2)) > 1e-6] = joint + 1
    return sorted(carried.tolist())


def _uneven(truth: Any, places: Array) -> tuple[Array, Array]:
    """Return factors of stiffness and mass along the cable, of mean 1, shape [piece]."""
    rng = np.random.default_rng(truth.field_seed)
    fields = []
    for deviation in (truth.stiffness_field, truth.mass_field):
        waves = np.cos(np.pi * np.arange(1, 5) * places[:, None])
        field = np.exp(deviation * (waves @ rng.normal(size=4)) / math.sqrt(2.0))
        fields.append(field / field.mean())
    return fields[0], fields[1]


def _towards(z: Array, x: Array) -> Array:
    """Return the quaternion (w, x, y, z) of axes whose z and x are given unit vectors."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=-1))
    return np.roll(turned.as_quat(), 1)
