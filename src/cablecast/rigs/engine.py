"""RigEngine: any Engine as a Rig, which tells the error of a model from that of its simulator."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.engines.base import SETTLE_TIME, Engine, engine_settings
from cablecast.engines.dynamics import Dynamics
from cablecast.engines.spread import spread
from cablecast.engines.swing import SAMPLE_DT, swing_model
from cablecast.errors import InputError, RigError, check_number
from cablecast.motion.grip_path import GripPath
from cablecast.motion.joint_move import JointMove
from cablecast.motion.trajectory import Trajectory
from cablecast.rigs.base import RigLifecycle
from cablecast.runs.workers import LOCAL
from cablecast.setup import Setup
from cablecast.task import LANDING
from cablecast.workspace import Workspace


class RigEngine(RigLifecycle):
    """Plays motions in an engine: without noise, so that equal motions give equal tracks.

    Args:
        engine: Simulator of the cable.
        setup: Cable, workspace, arm and motion settings.
        dynamics: Cable and servo of the arm, or parameters of the cable alone; the cable's own and
            an arm that follows its set points exactly if None.
        sample_dt: Time between samples of a track [s].

    Raises:
        InputError: The parameters are those of many worlds, or the sample time is out of bounds.
    """

    def __init__(
        self,
        engine: Engine,
        setup: Setup,
        dynamics: Dynamics | CableParams | None = None,
        *,
        sample_dt: float = 0.1,
    ):
        super().__init__()
        self.dynamics = Dynamics.of(dynamics, setup)
        if (count := self.dynamics.params.world_count) is not None:
            raise InputError(
                f"a rig has one cable, but its parameters are given for {count} worlds"
            )
        self.engine = spread(engine, LOCAL)
        self.setup = setup
        self.sample_dt = check_number("sample_dt", sample_dt, 1e-3, 10.0, "s")
        settings = setup.to_settings()
        self.description: dict[str, Any] = {
            "rig": "engine",
            "engine": engine_settings(engine),
            "cable": setup.cable.name,
            **self.dynamics.to_dict(),
            "workspace": settings["workspace"],
            "arm": settings["arm"],
        }

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        """Simulate one motion from the reset state."""
        self._use_reset()
        return self._simulate([trajectory])[0]

    def execute_many(
        self,
        trajectories: Sequence[Trajectory],
        progress: Callable[[int], None] | None = None,
    ) -> list[EndpointTrack]:
        """Simulate many motions in one batch, each from the reset state; see `run_trials`."""
        self._check_open()
        self._is_reset = False
        tracks = self._simulate(trajectories) if trajectories else []
        if progress is not None:
            progress(len(tracks))
        return tracks

    def _simulate(self, trajectories: Sequence[Trajectory]) -> list[EndpointTrack]:
        dynamics = self.dynamics
        paths = [dynamics.follow(trajectory.grip_path, self.setup) for trajectory in trajectories]
        # Whole sample intervals, so that the last sample is the end of the trial.
        step_counts = [
            math.ceil((float(path.duration[0]) + SETTLE_TIME) / self.sample_dt - 1e-9)
            for path in paths
        ]
        rollout = self.engine.rollout(
            self.setup.cable.with_params(dynamics.params),
            GripPath.stack(paths),
            duration=max(step_counts) * self.sample_dt,
            sample_dt=self.sample_dt,
            edges=self.setup.workspace,
            record_nodes=True,
        )
        return [
            EndpointTrack(
                times=rollout.times[: count + 1],
                endpoint_xy=rollout.endpoint_xy[world, : count + 1],
                status=status_of(rollout.endpoint_xy[world, : count + 1], self.setup.workspace),
                nodes=None if rollout.nodes is None else rollout.nodes[world, : count + 1],
            )
            for world, count in enumerate(step_counts)
        ]


def status_of(endpoint_xy: NDArray[np.float64], workspace: Workspace) -> TrialStatus:
    """Return how a simulated trial ended.

    An endpoint that ends beyond the edge of the table has left it.
    """
    if not np.all(np.isfinite(endpoint_xy)):
        return TrialStatus.NON_FINITE
    if not workspace.on_table(LANDING.outcome(endpoint_xy)):
        return TrialStatus.OFF_TABLE
    return TrialStatus.OK


class RigSwing(RigLifecycle):
    """Swings a cable in the air in EngineWarp: without noise, by an arm that follows exactly.

    Args:
        setup: Set-up with a strike section.
        cable: Cable that it has; that of the set-up if None.
        segment_count: Segments of the cable.

    Raises:
        InputError: The set-up has no strike section.
    """

    def __init__(self, setup: Setup, cable: Cable | None = None, segment_count: int = 24):
        super().__init__()
        self.setup, self.cable = setup, cable or setup.cable
        self.model = swing_model(setup, segment_count)
        settings = setup.to_settings()
        self.description: dict[str, Any] = {
            "rig": "engine",
            "cable": self.cable.to_dict(),
            "segment_count": segment_count,
            "strike": settings["strike"],
            "arm": settings["arm"],
        }

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        """Simulate one swing until its first contact."""
        self._use_reset()
        if not isinstance(trajectory.action, JointMove) or trajectory.joint_path is None:
            raise RigError("this rig plays the swings of its lab file, and this motion is none")
        motion = self.model.motion(self.model.moves.unit_of(trajectory.action))
        swings = self.model.play(motion, self.cable, nodes=True)
        (end,) = swings.contacts(np.array([0]))
        nodes = np.asarray(swings.nodes, dtype=float)[0, : max(end, 1)]
        good = bool(np.isfinite(nodes).all())
        return EndpointTrack(
            times=SAMPLE_DT * np.arange(len(nodes), dtype=float),
            endpoint_xy=nodes[:, -1, :2],
            endpoint_z=nodes[:, -1, 2],
            status=TrialStatus.OK if good else TrialStatus.NON_FINITE,
            nodes=nodes,
            joint_path=trajectory.joint_path,
        )
