"""Adapters of other authors' simulators: `Engine.rollout`, step by step."""

import abc
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cablecast.cable import Cable, CableParams
from cablecast.conventions import GRAVITY, tangent
from cablecast.engines.base import CableState, Rollout, plan_rollout
from cablecast.engines.mujoco_ import HAND_DOF_COUNT, SERVO_OMEGA, rod_model
from cablecast.motion.grip_path import GripPath

STRETCH_STIFFNESS = 2000.0
"""EA where a simulator has no inextensible cable [N]: its weight stretches cable_1 by 0.03 %."""

CONTACT_STIFFNESS = 1e4
"""Stiffness of the table against a segment, where it is a spring [N/m]: it gives by micrometres."""


def frames(tangents: NDArray[np.float64], yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return orthonormal frames whose third axis is a tangent and whose first is level.

    Along a cable in the vertical plane of `yaw` they do not twist.

    Args:
        tangents: Unit tangents, shape [..., 3].
        yaw: Heading of the vertical plane [rad], shape [...].

    Returns:
        Rotation matrices, the axes as columns, shape [..., 3, 3].
    """
    level = np.stack([np.cos(yaw), -np.sin(yaw), np.zeros_like(yaw)], axis=-1)
    level = np.broadcast_to(level, tangents.shape)
    return np.stack([level, np.cross(tangents, level), tangents], axis=-1)


class Peer(abc.ABC):
    """A simulator of other authors that plays what `Engine.rollout` is asked for, to the end.

    The cable gets one segment more, behind the grip, which is moved as the gripper moves. The joint
    at the grip is twice as stiff as the others: half a cell bends there, as in EngineWarp.

    Args:
        segment_count: Number of segments in front of the grip.
        dt: Step [s].
        table: True for a table at height 0; False for motions in the air.
    """

    name = ""
    rolls = True
    """True where segments may roll on the table; otherwise they only slide."""

    def __init__(self, segment_count: int, dt: float, *, table: bool):
        self.segment_count = segment_count
        self.dt = dt
        self.table = table

    @abc.abstractmethod
    def start(self, cable: Cable, params: CableParams, nodes: NDArray, rotations: NDArray) -> None:
        """Build the worlds.

        Args:
            cable: Geometry.
            params: Parameters, shared; damping and rolling and spinning friction are not played.
            nodes: Initial nodes [m], the first behind the grip, shape [world, node, 3].
            rotations: Frame of each segment, its tangent the third column, shape
                [world, segment, 3, 3].
        """

    @abc.abstractmethod
    def advance(self, times: NDArray, grips: NDArray, rotations: NDArray) -> None:
        """Take steps.

        Args:
            times: Ends of the steps [s], shape [step].
            grips: Position of the grip at the end of each step [m], shape [step, world, 3].
            rotations: Frame of the grip there, shape [step, world, 3, 3].
        """

    @abc.abstractmethod
    def endpoints(self) -> NDArray[np.float64]:
        """Return the free ends [m], shape [world, 3]."""

    def rollout(
        self,
        cable: Cable,
        grip_path: GripPath,
        initial_state: CableState | None = None,
        duration: float | None = None,
        sample_dt: float = 0.1,
        *,
        far_path: GripPath | None = None,
        record_nodes: bool = False,
    ) -> Rollout:
        """Simulate a batch; see `Engine.rollout`. Only free ends are recorded."""
        plan = plan_rollout(self, cable, grip_path, initial_state, duration, sample_dt, far_path)
        count, length = plan.world_count, cable.length / self.segment_count
        poses = np.broadcast_to(grip_path.evaluate(np.zeros(1)), (count, 1, 5))[:, 0]
        nodes = np.broadcast_to(
            plan.initial_state.positions, (count, self.segment_count + 1, 3)
        ).astype(float)
        behind = nodes[:, :1] - length * tangent(poses[:, 3], poses[:, 4])[:, None]
        nodes = np.concatenate([behind, nodes], axis=1)
        edges = np.diff(nodes, axis=1)
        edges /= np.linalg.norm(edges, axis=-1, keepdims=True)
        self.start(cable, cable.params, nodes, frames(edges, poses[:, None, 3]))
        track = np.full((count, plan.sample_count, 3), np.nan)
        track[:, 0] = nodes[:, -1]
        for sample in range(1, plan.sample_count):
            first = (sample - 1) * plan.steps_per_sample
            times = (first + 1 + np.arange(plan.steps_per_sample)) * self.dt
            poses = np.broadcast_to(grip_path.evaluate(times), (count, len(times), 5))
            poses = poses.transpose(1, 0, 2)
            rotations = frames(tangent(poses[..., 3], poses[..., 4]), poses[..., 3])
            self.advance(times, poses[..., :3], rotations)
            track[:, sample] = self.endpoints()
            if not np.isfinite(track[:, sample]).all(axis=-1).any():
                break
        track[~np.isfinite(track).all(axis=-1)] = np.nan
        return Rollout(
            times=np.arange(plan.sample_count) * (plan.steps_per_sample * self.dt),
            endpoint_xyz=track,
            final_state=CableState.at_rest(np.full((count, self.segment_count + 1, 3), np.nan)),
            finite=np.isfinite(track).all(axis=(1, 2)),
        )


SLIP_SPEED = 1e-3
"""Speed below which a segment counts as sticking [m/s]."""


class PeerElastica(Peer):
    """PyElastica, all rods in one system."""

    name = "PyElastica"

    def start(self, cable: Cable, params: CableParams, nodes: NDArray, rotations: NDArray) -> None:
        import elastica as ea

        class System(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Contact):
            pass

        system: Any = System()
        self.rods = [
            self._rod(ea, cable, params, nodes[world], rotations[world])
            for world in range(len(nodes))
        ]
        for rod in self.rods:
            system.append(rod)
            system.add_forcing_to(rod).using(
                ea.GravityForces, acc_gravity=np.array([0.0, 0.0, -GRAVITY])
            )
        if self.table:
            self._add_table(ea, system, cable, params)
        self.held = Held(self.rods, nodes[:, :2], rotations[:, 0])
        held = self.held

        class Grip(ea.ConstraintBase):
            """One constraint moves the held ends of all rods."""

            def constrain_values(self, system, time):
                held.place(time)

            def constrain_rates(self, system, time):
                held.drive()

        system.constrain(self.rods[0]).using(Grip)
        system.finalize()
        self.system, self.stepper, self.time = system, ea.PositionVerlet(), 0.0
        self.length = cable.length / self.segment_count

    def _rod(self, ea: Any, cable: Cable, params: CableParams, nodes: NDArray, rotations: NDArray):
        radius, count = cable.radius, self.segment_count + 1
        length = cable.length / self.segment_count
        bend, twist, mass, end_mass = (
            float(np.asarray(getattr(params, name)))
            for name in ("bend_stiffness", "twist_stiffness", "mass", "endpoint_mass")
        )
        rod = ea.CosseratRod.straight_rod(
            count,
            nodes[0],
            rotations[0, :, 2],
            rotations[0, :, 0],
            length * count,
            radius,
            mass / (cable.length * np.pi * radius**2),
            youngs_modulus=bend / (0.25 * np.pi * radius**4),
            position=nodes.T.copy(),
            # Rows are the axes of a segment.
            directors=rotations.transpose(2, 1, 0).copy(),
        )
        rod.shear_matrix[:] = np.eye(3)[..., None] * STRETCH_STIFFNESS
        rod.bend_matrix[:] = np.diag([bend, bend, twist])[..., None]
        # Half a cell bends at the grip.
        rod.bend_matrix[..., 0] *= 2.0
        rod.mass[-1] += end_mass
        # The end's mass is part of a cylinder about the axis, as in EngineWarp.
        heavier = 1.0 + end_mass * self.segment_count / mass
        rod.mass_second_moment_of_inertia[2, 2, -1] *= heavier
        rod.inv_mass_second_moment_of_inertia[2, 2, -1] /= heavier
        return rod

    def _add_table(self, ea: Any, system: Any, cable: Cable, params: CableParams) -> None:
        plane = ea.Plane(plane_origin=np.zeros(3), plane_normal=np.array([0.0, 0.0, 1.0]))
        system.append(plane)
        mass = float(np.asarray(params.mass)) / self.segment_count
        friction = np.full(3, float(np.asarray(params.friction)))
        for rod in self.rods:
            system.detect_contact_between(rod, plane).using(
                ea.RodPlaneContactWithAnisotropicFriction,
                k=CONTACT_STIFFNESS,
                # Critical for a segment.
                nu=2.0 * np.sqrt(CONTACT_STIFFNESS * mass),
                slip_velocity_tol=SLIP_SPEED,
                static_mu_array=friction,
                kinetic_mu_array=friction,
            )

    def advance(self, times: NDArray, grips: NDArray, rotations: NDArray) -> None:
        behind = grips - self.length * rotations[..., 2]
        held = np.stack([behind, grips], axis=2)
        with np.errstate(all="ignore"):
            for step in range(len(times)):
                self.held.aim(self.time, self.dt, held[step], rotations[step])
                self.time = float(self.stepper.step(self.system, self.time, self.dt))

    def endpoints(self) -> NDArray[np.float64]:
        return np.stack([rod.position_collection[:, -1] for rod in self.rods])


class Held:
    """The two held nodes and the held segment of every rod.

    Args:
        rods: Rods, whose arrays are those that the system advances.
        nodes: Held nodes at the start [m], shape [world, 2, 3].
        rotations: Frames of the held segments, shape [world, 3, 3].
    """

    def __init__(self, rods: list[Any], nodes: NDArray, rotations: NDArray):
        self.rods = rods
        self.aim(0.0, 1.0, nodes, rotations)
        self.before = nodes

    def aim(self, start: float, dt: float, nodes: NDArray, rotations: NDArray) -> None:
        """Set where the held ends are at the end of a step from `start` [s] on."""
        self.before = getattr(self, "nodes", nodes)
        self.start, self.dt, self.nodes, self.rotations = start, dt, nodes, rotations
        self.speed = (self.nodes - self.before) / dt

    def place(self, time: float) -> None:
        """Put held nodes and segments where they are at a time within the step [s]."""
        nodes = self.before + self.speed * (time - self.start)
        for world, rod in enumerate(self.rods):
            rod.position_collection[:, :2] = nodes[world].T
            rod.director_collection[:, :, 0] = self.rotations[world].T

    def drive(self) -> None:
        """Give held nodes their velocities."""
        for world, rod in enumerate(self.rods):
            rod.velocity_collection[:, :2] = self.speed[world].T
            rod.omega_collection[:, 0] = 0.0


FRICTION_SPEED = 1e-3
"""Speed below which friction is regularised [m/s]."""


class PeerNewton(Peer):
    """Newton's SolverVBD, all worlds in one model.

    Args:
        segment_count: Number of segments in front of the grip.
        dt: Step [s].
        table: True for a table at height 0.
        iterations: Iterations of vertex block descent in a step.
    """

    name = "Newton"

    def __init__(self, segment_count: int, dt: float, *, table: bool, iterations: int = 10):
        super().__init__(segment_count, dt, table=table)
        self.iterations = iterations

    def start(self, cable: Cable, params: CableParams, nodes: NDArray, rotations: NDArray) -> None:
        import newton

        builder = newton.ModelBuilder(gravity=(0.0, 0.0, -GRAVITY))
        self.bodies = []
        for world in range(len(nodes)):
            builder.begin_world()
            self.bodies.append(self._add_cable(builder, cable, params, world))
            builder.end_world()
        if self.table:
            builder.add_ground_plane(cfg=self._surface(newton, params))
        builder.color()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.model = builder.finalize(device="cpu")
            self.solver = newton.solvers.SolverVBD(
                self.model,
                iterations=self.iterations,
                friction_epsilon=FRICTION_SPEED,
                rigid_compliant_alm=True,
            )
        self.length = cable.length / self.segment_count
        self.state, self.next = self.model.state(), self.model.state()
        self.contacts = self.model.contacts() if self.table else None
        middles = 0.5 * (nodes[:, 1:] + nodes[:, :-1])
        for state in (self.state, self.next):
            poses = state.body_q.numpy()
            for world, bodies in enumerate(self.bodies):
                poses[bodies] = _poses(middles[world], rotations[world])

    def _surface(self, newton: Any, params: CableParams, density: float = 0.0):
        friction = float(np.asarray(params.friction))
        return newton.ModelBuilder.ShapeConfig(
            density=density,
            ke=CONTACT_STIFFNESS,
            kd=0.0,
            mu=friction,
            mu_torsional=0.0,
            mu_rolling=0.0,
            has_shape_collision=self.table,
        )

    def _add_cable(self, builder: Any, cable: Cable, params: CableParams, world: int) -> list[int]:
        """Add a straight cable, as it is at rest, and return its bodies; the first is moved."""
        import newton
        import warp as wp

        length, radius = cable.length / self.segment_count, cable.radius
        points = np.zeros((self.segment_count + 2, 3))
        points[:, 1] = np.arange(len(points)) * length
        twist = max(float(np.asarray(params.twist_stiffness)), 1e-9)
        rod = newton.Rod(
            points,
            radius=radius,
            stretch_rigidity=STRETCH_STIFFNESS,
            shear_rigidity=STRETCH_STIFFNESS,
            bend_rigidity=float(np.asarray(params.bend_stiffness)),
            twist_rigidity=twist,
        )
        # A capsule's caps lie within its neighbours: the mass is that of its own length.
        volume = np.pi * radius**2 * (length + 4.0 * radius / 3.0)
        mass = float(np.asarray(params.mass)) / self.segment_count
        surface = self._surface(newton, params, mass / volume)
        bodies, joints = builder.add_rod(rod=rod, cfg=surface, body_frame_origin="com")
        # Half a cell bends at the grip.
        first = builder.joint_qd_start[joints[0]]
        for axis in (2, 3):
            builder.joint_target_ke[first + axis] *= 2.0
        hook = self._surface(newton, params, 1.0)
        hook.has_shape_collision = False
        hook.density = float(np.asarray(params.endpoint_mass)) / (4.0 / 3.0 * np.pi * radius**3)
        end = wp.transform(wp.vec3(0.0, 0.0, 0.5 * length), wp.quat_identity())
        builder.add_shape_sphere(bodies[-1], xform=end, radius=radius, cfg=hook)
        builder.body_mass[bodies[0]] = builder.body_inv_mass[bodies[0]] = 0.0
        builder.body_inertia[bodies[0]] = builder.body_inv_inertia[bodies[0]] = wp.mat33(0.0)
        return list(bodies)

    def advance(self, times: NDArray, grips: NDArray, rotations: NDArray) -> None:
        held = [bodies[0] for bodies in self.bodies]
        behind = grips - 0.5 * self.length * rotations[..., 2]
        for step in range(len(times)):
            poses = _poses(behind[step], rotations[step])
            for state in (self.state, self.next):
                state.body_q.numpy()[held] = poses
            self.state.clear_forces()
            if self.contacts is not None:
                self.model.collide(self.state, self.contacts)
            self.solver.step(self.state, self.next, None, self.contacts, self.dt)
            self.state, self.next = self.next, self.state

    def endpoints(self) -> NDArray[np.float64]:
        poses = self.state.body_q.numpy()[[bodies[-1] for bodies in self.bodies]].astype(float)
        along = Rotation.from_quat(poses[:, 3:]).as_matrix()[..., 2]
        return poses[:, :3] + 0.5 * self.length * along


def _poses(positions: NDArray, rotations: NDArray) -> NDArray[np.float64]:
    """Return positions [m] and quaternions (x, y, z, w), shape [..., 7]."""
    return np.concatenate([positions, Rotation.from_matrix(rotations).as_quat()], axis=-1)


class PeerDismech(Peer):
    """DiSMechSolver, all worlds in one model; implicit midpoint in the air, Euler on a table.

    Its documentation advises the midpoint rule only where nothing touches.

    Args:
        segment_count: Number of segments in front of the grip.
        dt: Step [s].
        table: True for a table at height 0.
        iterations: Iterations of a step.
        exact: Factorise in each iteration (Gauss-Newton).
    """

    name = "dismech-newton"
    rolls = False

    def __init__(
        self,
        segment_count: int,
        dt: float,
        *,
        table: bool,
        iterations: int = 3,
        exact: bool = True,
    ):
        super().__init__(segment_count, dt, table=table)
        self.options = {"iterations": iterations, "exact": exact}

    def start(self, cable: Cable, params: CableParams, nodes: NDArray, rotations: NDArray) -> None:
        import newton

        allow_unions()
        from dismech_newton import DiSMechSolver, flatten_state

        builder = newton.ModelBuilder(gravity=(0.0, 0.0, -GRAVITY))
        friction = float(np.asarray(params.friction))
        surface = newton.ModelBuilder.ShapeConfig(mu=friction, has_shape_collision=self.table)
        for world in range(len(nodes)):
            self._add_cable(builder, cable, params, surface, world)
        if self.table:
            builder.add_ground_plane(cfg=surface)
        self.model = builder.finalize(device="cpu")
        self.solver = DiSMechSolver(
            self.model,
            self_contact=False,
            theta=1.0 if self.table else 0.5,
            **self.options,
        )
        self.length = cable.length / self.segment_count
        self.world_count = len(nodes)
        self.state, self.next = self.model.state(), self.model.state()
        straight = self.model.state()
        for state in (self.state, self.next, straight):
            flatten_state(state)
        self._nodes(self.state)[:] = nodes
        self.solver.restart(self.state, straight)

    def _add_cable(
        self, builder: Any, cable: Cable, params: CableParams, surface: Any, world: int
    ) -> None:
        """Add a straight cable, as it is at rest; its first segment is moved."""
        import newton
        from dismech_newton import DiSMechSolver

        length = cable.length / self.segment_count
        bend, twist, mass, end_mass = (
            float(np.asarray(getattr(params, name)))
            for name in ("bend_stiffness", "twist_stiffness", "mass", "endpoint_mass")
        )
        points = np.zeros((self.segment_count + 2, 3))
        points[:, 1] = np.arange(len(points)) * length
        first_node = builder.particle_count
        DiSMechSolver.add_rod(
            builder,
            newton.Rod(points, radius=cable.radius),
            cfg=surface,
            stretch_stiffness=STRETCH_STIFFNESS / length,
            bend_stiffness=bend / length,
            twist_stiffness=max(twist, 1e-9) / length,
            collide=self.table,
            proxies=self.table,
        )
        # Half a cell bends at the grip; entries 2 to 4 are two bends and the twist.
        attributes = builder.custom_attributes
        first = world * self.segment_count
        values = attributes["dismech:triplet_params"].values
        values[first] = type(values[first])(
            *(v * (2.0 if 2 <= i <= 4 else 1.0) for i, v in enumerate(values[first]))
        )
        masses = np.full(len(points), mass / self.segment_count)
        masses[-1] = 0.5 * masses[-1] + end_mass
        builder.particle_mass[first_node:] = masses.tolist()
        DiSMechSolver.fix_segment(builder, edge=world * (self.segment_count + 1))

    def _nodes(self, state: Any) -> NDArray:
        return state.particle_q.numpy().reshape(self.world_count, -1, 3)

    def advance(self, times: NDArray, grips: NDArray, rotations: NDArray) -> None:
        behind = grips - self.length * rotations[..., 2]
        held = np.stack([behind, grips], axis=2)
        for step in range(len(times)):
            self._nodes(self.state)[:, :2] = held[step]
            self.solver.step(self.state, self.next, None, None, self.dt)
            self.state, self.next = self.next, self.state

    def endpoints(self) -> NDArray[np.float64]:
        return self._nodes(self.state)[:, -1].astype(float)


def allow_unions() -> None:
    """Let a Warp struct be joined with None by |, in annotations that Python 3.14 leaves alone.

    Earlier Pythons evaluate them, so that the import of dismech-newton 0.1.0 fails.
    """
    import warp as wp

    @wp.struct
    class Empty:
        value: float

    kind = type(Empty)
    if "__or__" not in vars(kind):
        kind.__or__ = lambda self, other: self  # pyright: ignore


TOLERANCE = 1e-10
"""Tolerance of the solver: single precision does not reach EngineMujoco's."""

DEPTH = 5.0
"""Depth of the table where motions are in the air [m]."""


class PeerMujocoWarp(Peer):
    """MuJoCo Warp, all worlds at once; its segments roll where there is a table."""

    name = "MuJoCo Warp"

    def start(self, cable: Cable, params: CableParams, nodes: NDArray, rotations: NDArray) -> None:
        import mujoco
        import mujoco_warp

        library: object = mujoco
        model = self._model(library, cable, params)
        data = mujoco.MjData(model)  # pyright: ignore[reportAttributeAccessIssue]
        self.step = mujoco_warp.step
        self.model = mujoco_warp.put_model(model)
        self.data = mujoco_warp.put_data(model, data, nworld=len(nodes))
        count = self.segment_count
        self.rest = np.zeros((count, 3))
        self.rest[:, 1] = np.arange(1, count + 1) * cable.length / count
        self.slides = slice(HAND_DOF_COUNT, HAND_DOF_COUNT + 3 * count)
        self.driven = _hand(nodes[:, 1], rotations[:, 0])
        self.speed = np.zeros_like(self.driven)
        positions = self.data.qpos.numpy()
        positions[:, :HAND_DOF_COUNT] = self.driven
        positions[:, self.slides] = (nodes[:, 2:] - self.rest).reshape(len(nodes), -1)

    def _model(self, mujoco, cable: Cable, params: CableParams):
        """Compile EngineMujoco's model with these parameters and the options that Warp supports."""
        bend, twist, mass, end_mass, friction = (
            float(np.asarray(value))
            for value in (
                params.bend_stiffness,
                params.twist_stiffness,
                params.mass,
                params.endpoint_mass,
                params.friction,
            )
        )
        second_moment = np.pi * cable.radius**4 / 4
        xml = rod_model(cable, self.segment_count, self.dt, GRAVITY, held=False)
        for word, unit, value in (("young", 1.0, bend), ("shear", 0.5, twist)):
            placeholder = f'{word}="{unit / second_moment:.17g}"'
            xml = xml.replace(placeholder, f'{word}="{value * unit / second_moment:.17g}"')
        model = mujoco.MjModel.from_xml_string(xml)
        count = self.segment_count
        model.body_mass[2 : 2 + count] = mass / count
        model.body_mass[1 + count] = 0.5 * mass / count + end_mass
        model.body_inertia[2 + count :] = 0.5 * mass / count * cable.radius**2
        model.dof_damping[:] = 0.0
        model.tendon_damping[:] = 0.0
        model.flex_friction[:] = (friction, 0.0, 0.0)
        if not self.table:
            model.geom_pos[:, 2] = -DEPTH
        # Warp's version supports neither this flag nor Newton's method for a rod on a hand.
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        model.opt.solver = mujoco.mjtSolver.mjSOL_CG
        model.opt.tolerance = TOLERANCE
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def advance(self, times: NDArray, grips: NDArray, rotations: NDArray) -> None:
        for step in range(len(times)):
            pose = _hand(grips[step], rotations[step])
            speed = (pose - self.driven) / self.dt
            acceleration = (speed - self.speed) / self.dt
            self.driven, self.speed = pose, speed
            control = pose + 2.0 * speed / SERVO_OMEGA + acceleration / SERVO_OMEGA**2
            self.data.ctrl.numpy()[:] = control
            self.step(self.model, self.data)

    def endpoints(self) -> NDArray[np.float64]:
        last = slice(self.slides.stop - 3, self.slides.stop)
        return self.data.qpos.numpy()[:, last].astype(float) + self.rest[-1]


def _hand(grips: NDArray, rotations: NDArray) -> NDArray[np.float64]:
    """Return the hand's joints: x, y, z [m], yaw and pitch [rad], shape [world, 5]."""
    along = rotations[..., 2]
    yaw = np.arctan2(along[..., 0], along[..., 1])
    pitch = np.arcsin(np.clip(along[..., 2], -1.0, 1.0))
    return np.concatenate([grips, yaw[..., None], pitch[..., None]], axis=-1)
