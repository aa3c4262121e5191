"""A rig with a closed form: a stick that points where the gripper does, seen with some noise."""

import os
import signal

import numpy as np
from tests.data.killed import kill_at_rename

from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.conventions import tangent
from cablecast.data import record
from cablecast.data.record import collect_dataset
from cablecast.motion.trajectory import JointPath
from cablecast.rigs.base import RigLifecycle
from cablecast.rigs.checked import RETRY_STRIDE
from cablecast.setup import Setup

SETUP = Setup()
CABLE = SETUP.cable
COUNT = 6
NOISE = 0.002
"""Standard deviation of what the camera sees [m]."""
SERVO_DELAY = 0.03
"""How much later than commanded the joints move [s]."""


class StickRig(RigLifecycle):
    """The n-th trial draws its noise from the seed and n.

    Attributes:
        executed: Indices of the trials that were begun, in order.
        troubles: What happens instead of a trial, by its index, once each; an exception is raised,
            a status reported, "kill" kills the process.
    """

    def __init__(self, seed=0, troubles=(), sees_joints=True):
        super().__init__()
        self.description = {"rig": "stick", "seed": seed}
        self.executed = []
        self.troubles = list(troubles)
        self.sees_joints = sees_joints
        self._seed = seed
        self._next = 0

    def seek(self, index, purpose=""):
        # What a trial gives depends on its number alone, whatever the attempt.
        self._next = index % RETRY_STRIDE

    def execute(self, trajectory):
        self._use_reset()
        index = self._next
        self._next += 1
        self.executed.append(index)
        for trouble in self.troubles:
            if trouble[0] == index:
                self.troubles.remove(trouble)
                if trouble[1] == "kill":
                    os.kill(os.getpid(), signal.SIGKILL)
                if isinstance(trouble[1], BaseException):
                    raise trouble[1]
                if not isinstance(trouble[1], TrialStatus):
                    return trouble[1]
                return self._track(trajectory, index, trouble[1])
        return self._track(trajectory, index)

    def _track(self, trajectory, index, status=None):
        times = np.arange(0.0, trajectory.duration + 0.5, 0.1)
        poses = trajectory.grip_path.evaluate(times)[0]
        tip = poses[:, :2] + CABLE.length * tangent(poses[:, 3], poses[:, 4])[:, :2]
        noise = np.random.default_rng([self._seed, index]).normal(scale=NOISE, size=tip.shape)
        stayed = SETUP.workspace.on_table(tip).all()
        path = trajectory.joint_path
        later = JointPath(times=path.times + SERVO_DELAY, q=path.q, qd=path.qd)
        return EndpointTrack(
            times=times,
            endpoint_xy=tip + noise,
            status=status or (TrialStatus.OK if stayed else TrialStatus.OFF_TABLE),
            joint_path=later if self.sees_joints else None,
        )


class ManyStickRig(StickRig):
    """The same with many trials at once; a trouble of one spoils all of them.

    Attributes:
        batches: How many trials were asked for at once.
    """

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.batches = []

    def execute_many(self, trajectories, progress=None):
        self.batches.append(len(trajectories))
        tracks = []
        for trajectory in trajectories:
            self.reset()
            tracks.append(self.execute(trajectory))
        return tracks


def collect(path, rig=None, **options):
    options = {"purpose": "tune", "count": COUNT} | options
    return collect_dataset(
        path,
        rig or StickRig(),
        options.pop("setup", SETUP),
        **options,
    )


def collect_and_die(moment, folder, kind=StickRig):
    """Collect a dataset, and die in the middle of a trial or at the rename of a file."""
    record._CASTS_PER_CORE = 1
    if isinstance(moment, str):
        rig = kind(troubles=[(int(moment.removeprefix("trial")), "kill")])
    else:
        rig = kind()
        kill_at_rename(moment)
    collect(folder, rig)
