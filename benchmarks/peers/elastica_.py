"""PyElastica's Cosserat rods: explicit steps (position Verlet), the table a spring and a damper."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.base import CONTACT_STIFFNESS, STRETCH_STIFFNESS, Peer
from cablecast.cable import Cable, CableParams
from cablecast.conventions import GRAVITY

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
