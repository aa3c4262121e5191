"""Forces on the cable that MuJoCo's rod does not have: air, the table's face, and memory.

MuJoCo knows one friction coefficient for the whole cable. The table here differs from it from place
to place, and along and across the cable; the difference is added where the cable's surface slides.
A rod of MuJoCo's is straight at rest. A real one keeps a curl, and some of every sharp bend.
"""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from cablecast.cable import Cable
from cablecast.conventions import GRAVITY
from cablecast.engines.warp_.device import start_warp
from cablecast.rigs.virtual._hidden import HiddenCable
from cablecast.rigs.virtual.force_kernel import Properties, sum_forces
from cablecast.rigs.virtual.state import CableMotion
from cablecast.rigs.virtual.table import CELL, FrictionMap

AIR_DENSITY = 1.2


class CableForces:
    """Forces on the free vertices of a batch of cables.

    Args:
        cable: Geometry of the cable.
        truth: True properties of the cable.
        friction_map: Friction of each place of the table.
        arc_lengths: Distance of each vertex from the grip [m], shape [vertex].
        masses: Mass lumped at each vertex [kg], shape [vertex].
        friction: Coulomb coefficient that MuJoCo applies [-], shape [world].
        curl: Curvature of each cable at the start, sideways and upwards [1/m], shape
            [world, 2, inner vertex].
    """

    def __init__(
        self,
        cable: Cable,
        truth: HiddenCable,
        friction_map: FrictionMap,
        arc_lengths: NDArray[np.float64],
        masses: NDArray[np.float64],
        friction: NDArray[np.float64],
        curl: NDArray[np.float64],
    ):
        start_warp()
        edge = np.diff(arc_lengths)
        world_count, free_count = len(friction), len(arc_lengths) - 2
        self.curl = curl
        # Arrays of Warp's that numpy sees: nothing is allocated or copied from window to window.
        self._worlds: Any = wp.zeros(world_count, dtype=wp.int32, device="cpu")
        self._force: Any = wp.zeros((world_count, free_count), dtype=wp.vec3d, device="cpu")
        vectors = (world_count, free_count + 2)
        self._motion = [wp.zeros(vectors, dtype=wp.vec3d, device="cpu") for _ in range(2)]
        scalars = (world_count, free_count)
        self._motion += [wp.zeros(scalars, dtype=wp.float64, device="cpu") for _ in range(3)]
        self._views = [array.numpy() for array in self._motion]
        self._world_view, self._force_view = self._worlds.numpy(), self._force.numpy()
        properties = Properties()
        properties.radius = cable.radius
        properties.friction = truth.friction
        properties.grain = truth.grain
        properties.bend_stiffness = truth.bend_stiffness
        properties.yield_curvature = truth.yield_curvature
        properties.yield_time = truth.yield_time
        properties.map_origin = wp.vec2d(*friction_map.origin)
        properties.map_cell = CELL
        drag = 0.5 * AIR_DENSITY * truth.drag * cable.diameter * edge
        constant = [
            edge,
            GRAVITY * masses[2:],
            drag,
            truth.linear_damping * masses[2:],
            friction,
            friction_map.factors,
        ]
        self._launch: Any = wp.launch(
            sum_forces,
            dim=world_count,
            inputs=[
                self._worlds,
                *self._motion,
                0.0,
                *(_as_warp(values) for values in constant),
                properties,
                _as_warp(curl),
                self._force,
            ],
            device="cpu",
            record_cmd=True,
        )

    def evaluate(
        self, motion: CableMotion, active: NDArray[np.intp], elapsed: float
    ) -> NDArray[np.float64]:
        """Return the forces on the vertices after the gripped two.

        Args:
            motion: Positions and velocities of the active worlds.
            active: Indices of these worlds in the batch.
            elapsed: Time since the last evaluation [s], in which the cable yields.

        Returns:
            Forces [N], shape [world, vertex - 2, 3]; the next evaluation overwrites them.
        """
        count = len(active)
        self._world_view[:count] = active
        values = (
            motion.vertices,
            motion.velocity,
            np.cos(motion.roll),
            np.sin(motion.roll),
            motion.roll_rate,
        )
        for view, value in zip(self._views, values, strict=True):
            view[:count] = value
        self._launch.set_dim(count)
        self._launch.set_param_by_name("elapsed", elapsed)
        self._launch.launch()
        return self._force_view[:count]


def _as_warp(values: NDArray[np.float64]) -> wp.array:
    """Return a Warp array that shares its memory with numpy's."""
    return wp.array(values, dtype=wp.float64, device="cpu", copy=False)
