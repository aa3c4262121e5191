"""The Engine contract: many simulated cables at once, each gripped at its near end."""

import dataclasses
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath


@dataclasses.dataclass(frozen=True, kw_only=True)
class CableState:
    """State of the cables of a batch; node 0 is gripped, the last node is the free end.

    Attributes:
        positions: Nodes in the base frame, z of the cable's axis above the table's surface [m],
            shape [world, node, 3].
        velocities: Their velocities [m/s], same shape.
        roll: Roll angle of each segment about its tangent [rad], shape [world, segment].
        roll_rate: Its rate [rad/s], same shape.
    """

    positions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    roll: NDArray[np.float64]
    roll_rate: NDArray[np.float64]

    @property
    def world_count(self) -> int:
        """Number of worlds."""
        return len(self.positions)

    @property
    def segment_count(self) -> int:
        """Number of segments."""
        return self.positions.shape[1] - 1

    @classmethod
    def at_rest(cls, positions: NDArray[np.float64]) -> "CableState":
        """Cables at rest and untwisted in a given shape [m], shape [world, node, 3]."""
        world_count, node_count, _ = positions.shape
        segments = np.zeros((world_count, node_count - 1))
        return cls(
            positions=np.array(positions, dtype=float),
            velocities=np.zeros_like(positions, dtype=float),
            roll=segments,
            roll_rate=segments.copy(),
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rollout:
    """What a batch of simulated motions did.

    Attributes:
        times: Sample times [s], shape [step]; the first is 0.
        endpoint_xyz: Path of the free end in the base frame [m], shape [world, step, 3].
        final_state: State at the end of the rollout.
        finite: False for a world that became non-finite; its samples are NaN from then on,
            shape [world].
        nodes: Cable shapes at the sample times [m], shape [world, step, node, 3], where asked for.
    """

    times: NDArray[np.float64]
    endpoint_xyz: NDArray[np.float64]
    final_state: CableState
    finite: NDArray[np.bool_]
    nodes: NDArray[np.float64] | None = None

    @property
    def endpoint_xy(self) -> NDArray[np.float64]:
        """Path of the free end on the table [m], shape [world, step, 2]."""
        return self.endpoint_xyz[..., :2]


class Engine(Protocol):
    """A cable simulator; implementations are `EngineWarp`, and others behind the same call."""

    segment_count: int

    def rollout(
        self,
        cable: Cable,
        params: CableParams,
        grip_path: GripPath,
        initial_state: CableState | None = None,
        duration: float | None = None,
        sample_dt: float = 0.1,
        *,
        far_path: GripPath | None = None,
        record_nodes: bool = False,
    ) -> Rollout:
        """Simulate a batch; every argument is shared (one row) or per world.

        Args:
            cable: Geometry, shared by all worlds.
            params: Shared, or one value per world.
            grip_path: One row, or one per world.
            initial_state: One row, or one per world; by default the reset state, see
                `reset_state`.
            duration: How long to simulate [s]; by default the longest motion plus two seconds.
            sample_dt: Time between samples [s].
            far_path: Holds the far end on this path; free where None.
            record_nodes: Also return the cable's shapes.

        Raises:
            InputError: Batches of different sizes, or a duration or step that is not positive.
        """
        ...


SETTLE_TIME = 2.0
"""How long a rollout goes on after the motion by default [s]: casts settle within 1.5 s."""


def batch_size(*counts: int | None) -> int:
    """The number of worlds that several arguments agree on; None and 1 go with any.

    Raises:
        InputError: Two arguments disagree.
    """
    sizes = sorted({count for count in counts if count not in (None, 1)})
    if len(sizes) > 1:
        raise InputError(f"arguments have different numbers of worlds: {sizes}")
    return sizes[0] if sizes else 1


def reset_state(cable: Cable, grip_path: GripPath, segment_count: int) -> CableState:
    """The cable as the paper's reset leaves it: straight, at rest, pulled towards the robot.

    The gripper holds the near end a little above the table; from there a smooth ramp leads down to
    the lying cable. Every segment has the same length.

    Args:
        cable: Geometry.
        grip_path: Its start gives the grip pose, so the cable points along the initial yaw.
        segment_count: Number of segments.

    Returns:
        One state per row of the grip path.
    """
    segment_length = cable.length / segment_count
    start = grip_path.evaluate(grip_path.knots[:, :1])[:, 0]
    height = start[:, 2] - cable.radius
    # A raised-cosine ramp no steeper than about 15 degrees, walked with steps of equal length.
    ramp = np.maximum(6.0 * np.abs(height), 1e-9)
    s = np.zeros((len(start), segment_count + 1))
    z = np.zeros_like(s)
    z[:, 0] = height

    def ramp_height(at):
        u = np.clip(at / ramp, 0.0, 1.0)
        return height * 0.5 * (1.0 + np.cos(np.pi * u))

    for node in range(segment_count):
        # Solve |step| = segment_length for the horizontal step by fixed-point iteration; the slope
        # is small, so it contracts fast.
        step = np.full(len(start), segment_length)
        for _ in range(60):
            drop = ramp_height(s[:, node] + step) - z[:, node]
            step = np.sqrt(np.maximum(segment_length**2 - drop**2, 0.0))
        s[:, node + 1] = s[:, node] + step
        z[:, node + 1] = ramp_height(s[:, node + 1])
    positions = np.empty((*s.shape, 3))
    positions[..., 0] = start[:, None, 0] + s * np.sin(start[:, None, 3])
    positions[..., 1] = start[:, None, 1] + s * np.cos(start[:, None, 3])
    positions[..., 2] = cable.radius + z
    return CableState.at_rest(positions)
