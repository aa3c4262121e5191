"""Base class of the adapters of other authors' simulators: `Engine.rollout`, step by step."""

import abc

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams
from cablecast.conventions import tangent
from cablecast.engines.base import CableState, Rollout, plan_rollout
from cablecast.motion.grip_path import GripPath

STRETCH_STIFFNESS = 2000.0
"""EA of simulators that know no inextensible cable [N]: its weight stretches cable_1 by 0.03 %."""

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
