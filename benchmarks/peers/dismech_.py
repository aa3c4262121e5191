"""Discrete elastic rods for Newton (dismech-newton): implicit steps, contact by ADMM."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.base import STRETCH_STIFFNESS, Peer
from cablecast.cable import Cable, CableParams
from cablecast.conventions import GRAVITY


class PeerDismech(Peer):
    """DiSMechSolver, all worlds in one model; implicit midpoint in the air, Euler on a table.

    Its documentation advises the midpoint rule only where nothing touches.

    Args:
        segment_count: Number of segments in front of the grip.
        dt: Step [s].
        table: True for a table at height 0.
        iterations: Iterations of a step.
        exact: Factorise anew in each iteration (Gauss-Newton).
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
