"""EnginePybullet: the paper's simulator, a string of capsules with springs between them at 1/480 s.

The paper joins capsules by Bullet's 6-DOF spring constraints, which its Python API does not offer.
The nearest is one articulated body: capsules on spherical joints, so that lengths are exact, with
spring torques that we compute and apply before each step. The hand is five driven joints.

Mapping of the ten parameters, and differences from `EngineWarp`:

- bend_stiffness, twist_stiffness: torques EI phi / l and GJ tau / l at each joint, twice that at
  the grip, explicit in time. A joint stiffer than the step can take is softened to m l^2 / (24
  dt^2); a segment too light for its twist gets a larger moment of inertia about its axis.
- mass, endpoint_mass: uniform capsules, and a point at the end of the last one.
- lateral_friction, worksurface_friction: Bullet's own; it multiplies them, as we do. A capsule
  touches the table at two points, and friction is a pyramid, regularised by Bullet's solver.
- spinning_friction, rolling_friction: Bullet multiplies them by the other body's lateral friction,
  which we divide out. They act on a capsule as a whole.
- linear_damping, angular_damping: Bullet's own for articulated bodies, c (1 + |v|) v per mass and
  c (1 + |w|) w per moment of inertia, scaled to be right at 1 m/s and at 10 rad/s: too weak for a
  slower motion, too strong for a faster one.

At 1/480 s about one in fifteen random casts of `cable_1` gains energy where the cable whips, and
leaves the table or sinks into it by more than 5 mm. More damping in the joints makes that worse.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams
from cablecast.checks import check_count, check_number
from cablecast.engines.base import GRAVITY, CableState, Rollout, plan_rollout
from cablecast.engines.cables import one_cable
from cablecast.engines.pybullet_client import load_pybullet
from cablecast.engines.pybullet_world import BulletWorld
from cablecast.motion.grip_path import GripPath

DEFAULT_SEGMENT_COUNT = 18
DEFAULT_DT = 1.0 / 480.0


class EnginePybullet:
    """Bullet's articulated body: one world after the other, on one core.

    Args:
        segment_count: Number of capsules, at least 2.
        dt: Step [s]; the paper's is 1/480 s.
        gravity: Acceleration of free fall [m/s²].

    Raises:
        InputError: A count or step out of bounds.
        MissingExtraError: PyBullet is not installed.
    """

    def __init__(
        self,
        segment_count: int = DEFAULT_SEGMENT_COUNT,
        dt: float = DEFAULT_DT,
        gravity: float = GRAVITY,
    ):
        # Bullet packs the links of one body into messages of a fixed size.
        segment_count = check_count("segment_count", segment_count, 2, 100)
        dt = check_number("dt", dt, 1e-6, 1e-2, "s")
        load_pybullet()
        self.segment_count = segment_count
        self.dt = dt
        self.gravity = gravity

    def rollout(
        self,
        cable: Cable | Sequence[Cable],
        params: CableParams,
        grip_path: GripPath,
        initial_state: CableState | None = None,
        duration: float | None = None,
        sample_dt: float = 0.1,
        *,
        far_path: GripPath | None = None,
        record_nodes: bool = False,
    ) -> Rollout:
        """Simulate a batch; see `Engine.rollout`."""
        cable = one_cable(cable)
        plan = plan_rollout(
            self, cable, params, grip_path, initial_state, duration, sample_dt, far_path
        )
        values = np.broadcast_to(params.to_array(), (plan.world_count, len(params.names())))
        nodes = np.full((plan.world_count, plan.sample_count, self.segment_count + 1, 3), np.nan)
        final = CableState.at_rest(np.full((plan.world_count, self.segment_count + 1, 3), np.nan))
        finite = np.zeros(plan.world_count, dtype=bool)
        for index in range(plan.world_count):
            state = _row(plan.initial_state, index)
            nodes[index, 0] = state["positions"]
            for field in dataclasses.fields(CableState):
                getattr(final, field.name)[index] = np.nan
            if not all(np.isfinite(value).all() for value in state.values()):
                nodes[index, 0] = np.nan
                continue
            path = grip_path[min(index, len(grip_path) - 1)]
            far = None if far_path is None else far_path[min(index, len(far_path) - 1)]
            row = CableParams.from_array(values[index])
            world = BulletWorld(
                cable,
                row,
                path,
                far,
                segment_count=self.segment_count,
                dt=self.dt,
                gravity=self.gravity,
            )
            try:
                world.start(state)
                finite[index] = world.run(nodes[index], plan.steps_per_sample)
                if finite[index]:
                    for name, value in world.state().items():
                        getattr(final, name)[index] = value
            finally:
                world.close()
        return Rollout(
            times=np.arange(plan.sample_count, dtype=float) * (plan.steps_per_sample * self.dt),
            endpoint_xyz=nodes[:, :, -1].copy(),
            final_state=final,
            finite=finite,
            nodes=nodes if record_nodes else None,
        )


def _row(state: CableState, index: int) -> dict[str, NDArray[np.float64]]:
    index = min(index, state.world_count - 1)
    return {f.name: getattr(state, f.name)[index] for f in dataclasses.fields(CableState)}
