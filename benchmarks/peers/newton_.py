"""Newton's rods: capsules on rod joints, solved by vertex block descent (SolverVBD)."""

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.peers.base import CONTACT_STIFFNESS, STRETCH_STIFFNESS, Peer
from cablecast.cable import Cable, CableParams
from cablecast.conventions import GRAVITY

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
