"""Swings in the air: an arm swings cables that hang from a stick, until they touch it."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.shape import ArmShape, segment_distance
from cablecast.cable import Cable
from cablecast.conventions import Array
from cablecast.engines.base import CableRows, CableState
from cablecast.engines.contact import first_contact
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath
from cablecast.motion.joint_move import (
    KNOT_DT,
    JointMoves,
    grip_path_of_joints,
    knot_times,
    swing_shape,
)
from cablecast.setup import Setup

SAMPLE_DT = KNOT_DT
"""Time between samples of a path [s]."""

_FREE_NODES = 2
"""First node that may touch the arm: those before it lie along the stick that holds them."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SwingMotion:
    """Moves of an arm, ready to swing cables.

    Attributes:
        duration: Duration [s].
        grip_path: Paths of the cable's root, one for each move.
        shape: Arm and stick at every `SAMPLE_DT`, ends of shape [move, step, rod, 2, 3].
        end: Step at which the stick meets the arm, or one after the last, shape [move].
    """

    duration: float
    grip_path: GripPath
    shape: ArmShape
    end: NDArray[np.int_]

    def rows(self, index: NDArray[np.int_]) -> "SwingMotion":
        """Return some of the moves."""
        shape = ArmShape(ends=self.shape.ends[index], radii=self.shape.radii)
        path = self.grip_path[index]
        return dataclasses.replace(self, grip_path=path, shape=shape, end=self.end[index])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Swings:
    """Simulated swings.

    Attributes:
        tip: Path of the tip at every `SAMPLE_DT` through whatever is in its way [m], shape [world,
            step, 3]; NaN once a world broke.
        nodes: Shapes of the cables [m], shape [world, step, node, 3]; None where they were not
            asked for.
        radius: Radius of the cables [m], one or shape [world].
        motion: Moves, one for each world or one for all.
    """

    tip: Array
    nodes: Array | None
    radius: ArrayLike
    motion: SwingMotion

    def contacts(self, worlds: NDArray[np.int_], margin: ArrayLike = 0.0) -> NDArray[np.int_]:
        """Return the step of the first contact of some worlds, or one after the last, [world].

        Cables are thicker by a margin [m], one or shape [world].
        """
        if self.nodes is None:
            raise InputError("contacts need the shapes of the cables: play swings with nodes=True")
        moves = np.minimum(worlds, len(self.motion.end) - 1)
        shape = self.motion.shape
        radius = np.broadcast_to(self.radius, len(self.tip))[worlds] + np.asarray(margin)
        first = first_contact(
            self.nodes[worlds], shape.ends[moves], shape.radii, radius, first_node=_FREE_NODES
        )
        return np.minimum(first, self.motion.end[moves])


@dataclasses.dataclass(frozen=True, kw_only=True)
class SwingModel:
    """A simulated arm that swings cables by joint moves.

    Attributes:
        moves: Family of moves.
        engine: Engine without a table.
        duration: Duration of a path [s].
        respond: Function from set points [rad], shape [..., tick, joint], and the time between them
            [s] to the angles that follow them, such as `ServoModel.respond`; the joints are where
            they are set if None.
    """

    moves: JointMoves
    engine: EngineWarp
    duration: float = 4.0
    respond: Callable[[Array, float], Array] | None = None

    def motion(self, unit: ArrayLike, duration: float | None = None) -> SwingMotion:
        """Return moves, shape [move, parameter] of unit coordinates, for a time [s]."""
        duration = self.duration if duration is None else duration
        times = knot_times(duration)
        q, _ = self.moves.angles(np.atleast_2d(np.asarray(unit, dtype=float)), times)
        if self.respond is not None:
            q = self.respond(q, float(times[1]))
        arm, stick = self.moves.arm, self.moves.stick
        shape = swing_shape(q, arm, stick)
        return SwingMotion(
            duration=duration,
            grip_path=grip_path_of_joints(times, q, arm, stick),
            shape=shape,
            end=_meetings(shape, arm.links(arm.frames(q[0, 0])).names),
        )

    def play(
        self, motion: SwingMotion, cable: Cable | Sequence[Cable], *, nodes: bool = False
    ) -> Swings:
        """Return the swings of moves with cables: one move, one cable, or as many of both."""
        path = motion.grip_path
        start = path.evaluate(path.knots[:, :1])
        # Moves of a family start alike, and cables that are alike hang alike.
        held = path[0] if np.ptp(start, axis=0).max() == 0.0 else path
        state = CableState.hanging(cable, held, self.engine.segment_count, self.engine.gravity)
        rollout = self.engine.rollout(
            cable, path, state, motion.duration, SAMPLE_DT, record_nodes=nodes
        )
        return Swings(
            tip=rollout.endpoint_xyz,
            nodes=rollout.nodes,
            radius=CableRows.of(cable).radius,
            motion=motion,
        )


def swing_model(setup: Setup, segment_count: int = 24) -> SwingModel:
    """Return the simulated arm of a set-up with a strike section.

    Raises:
        InputError: There is no such section.
    """
    moves = JointMoves.of(setup)
    engine = EngineWarp(segment_count=segment_count, dt=1e-3, table=False)
    return SwingModel(moves=moves, engine=engine, duration=setup.strike_section.watch_time)


def _meetings(shape: ArmShape, names: tuple[str, ...]) -> NDArray[np.int_]:
    """Return the step at which the last capsule meets one before the wrist, shape [move]."""
    wrist = next((k for k, name in enumerate(names[1:]) if "wrist" in name), len(names) - 1)
    a, b = (shape.ends[:, :, -1:, side] for side in (0, 1))
    c, d = (shape.ends[:, :, :wrist, side] for side in (0, 1))
    gap = segment_distance(a, b, c, d) - shape.radii[:wrist] - shape.radii[-1]
    meets = np.any(gap < 0.0, axis=2)
    return np.where(meets.any(axis=1), meets.argmax(axis=1), meets.shape[1])
