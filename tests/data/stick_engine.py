"""An engine with a closed form: a rigid stick that runs ahead of the turning gripper."""

import dataclasses
import os
import signal

import numpy as np
from tests.data.killed import kill_at_rename

from cablecast.conventions import tangent
from cablecast.data.simulate import simulate_dataset
from cablecast.engines.base import SETTLE_TIME, CableState, Rollout
from cablecast.setup import Setup

LEAD = 0.1
"""How far ahead of the gripper the stick turns [s]: it overshoots and comes back."""

SETUP = Setup()
CABLE = SETUP.cable
COUNT = 220
SHARD_ROWS = 60


@dataclasses.dataclass(kw_only=True)
class StickEngine:
    """A rigid stick; worlds whose motion ends farther out than `breaks_beyond` [m] become NaN."""

    segment_count: int = 1
    dt: float = 1e-3
    device: str = "cpu"
    thread_count: int | None = None
    breaks_beyond: float = np.inf
    batches: list = dataclasses.field(default_factory=list, init=False)

    def rollout(
        self,
        cable,
        grip_path,
        initial_state=None,
        duration=None,
        sample_dt=0.1,
        *,
        far_path=None,
        edges=None,
        record_nodes=False,
    ):
        self.batches.append(len(grip_path))
        duration = grip_path.duration.max() + SETTLE_TIME if duration is None else duration
        times = np.arange(round(duration / sample_dt) + 1) * sample_dt
        poses = grip_path.evaluate(times)
        yaw = poses[..., 3] + LEAD * grip_path.evaluate(times, derivative=1)[..., 3]
        end = poses[..., :3] + cable.length * tangent(yaw, poses[..., 4])
        finite = np.hypot(poses[:, -1, 0], poses[:, -1, 1]) <= self.breaks_beyond
        end[~finite, 1:] = np.nan
        return Rollout(
            times=times,
            endpoint_xyz=end,
            final_state=CableState.at_rest(np.stack([poses[:, -1, :3], end[:, -1]], axis=1)),
            finite=finite,
        )


def simulate(path, *, engine=None, **options):
    return simulate_dataset(
        path,
        options.pop("setup", SETUP),
        options.pop("params", None),
        engine or StickEngine(),
        **({"count": COUNT, "shard_rows": SHARD_ROWS} | options),
    )


class DyingEngine(StickEngine):
    """Dies in the middle of a rollout."""

    def rollout(self, *args, **kwargs):
        if len(self.batches) == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().rollout(*args, **kwargs)


def simulate_and_die(moment, folder):
    """Simulate a dataset, and die in the middle of a rollout or at the rename of a file."""
    if moment == "rollout":
        engine = DyingEngine()
        DyingEngine.__name__ = "StickEngine"  # The settings name the class; it computes the same.
    else:
        engine = StickEngine()
        kill_at_rename(moment)
    simulate(folder, engine=engine)
