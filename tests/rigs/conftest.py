"""Rigs that the contract suite runs over, and motions for them to play."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from cablecast.cable import Cable, load_cable
from cablecast.motion.action import Action, MotionConfig
from cablecast.motion.grip_path import GripPath
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.rigs.base import Rig, make_rig
from cablecast.rigs.engine import RigEngine
from cablecast.workspace import Workspace

# A user's own rig, as small as one can be: its cable is a stick that points where the gripper does.
USER_RIG = """
import numpy as np

from cablecast.conventions import tangent
from cablecast.rigs.base import RigLifecycle
from cablecast.track import EndpointTrack, TrialStatus


class RigStick(RigLifecycle):
    def __init__(self, cable, workspace, seed):
        super().__init__()
        self.cable = cable
        self.workspace = workspace
        self.description = {"rig": "stick", "seed": seed}

    def execute(self, trajectory):
        self._use_reset()
        steps = int(np.ceil(trajectory.duration / 0.1)) + 1
        times = 0.1 * np.arange(steps)
        poses = trajectory.grip_path.evaluate(times)[0]
        grip = poses[:, :3]
        tip = grip + self.cable.length * tangent(poses[:, 3], poses[:, 4])
        on_table = self.workspace.on_table(tip[:, :2]).all()
        return EndpointTrack(
            times=times,
            endpoint_xy=tip[:, :2],
            status=TrialStatus.OK if on_table else TrialStatus.OFF_TABLE,
            nodes=np.stack([grip, tip], axis=1),
        )


def make(cable, workspace, seed):
    return RigStick(cable, workspace, seed)
"""


@pytest.fixture(scope="session")
def cable() -> Cable:
    return load_cable("cable_1")


@pytest.fixture(scope="session")
def workspace() -> Workspace:
    return Workspace()


@pytest.fixture(scope="session")
def cast(workspace) -> Trajectory:
    """A cast that lands well on the table."""
    action = Action(np.radians(-40), np.radians(35), 0.65, np.radians(60))
    return plan_trajectory(action, MotionConfig(), workspace)


@pytest.fixture(scope="session")
def wide_cast(workspace) -> Trajectory:
    """A cast that whips the tip around."""
    action = Action(np.radians(-60), np.radians(50), 0.7, np.radians(80))
    return plan_trajectory(action, MotionConfig(), workspace)


@pytest.fixture(scope="session")
def small_cast(workspace) -> Trajectory:
    """A short and narrow cast."""
    action = Action(np.radians(-15), np.radians(10), 0.6)
    return plan_trajectory(action, MotionConfig(), workspace)


@pytest.fixture(scope="session")
def wild() -> Trajectory:
    """A sweep that no arm could make, at full stretch: the tip flies off the table."""
    times = np.linspace(0.0, 0.9, 60)
    u = times / times[-1]
    theta = 1.2 * u**3 * (10 - 15 * u + 6 * u**2)
    still = np.zeros_like(times)
    poses = np.stack([0.9 * np.sin(theta), 0.9 * np.cos(theta), still + 0.02, theta, still], axis=1)
    return Trajectory(action=None, grip_path=GripPath.fit(times, poses), joint_path=None)


@dataclasses.dataclass(frozen=True)
class RigKind:
    name: str
    make: Callable[[], Rig]


@pytest.fixture(scope="module", params=["virtual", "engine", "user"])
def rig_kind(request, cable, workspace, tmp_path_factory) -> RigKind:
    """Each rig in a quick setting, made afresh by each call of `make`."""
    if request.param == "virtual":
        pytest.importorskip("mujoco")
        from cablecast.rigs.virtual import RigVirtual, VirtualConfig

        config = VirtualConfig(segment_count=16, dt=1e-3)
        return RigKind("virtual", lambda: RigVirtual(cable, workspace, 0, config))
    if request.param == "engine":
        from cablecast.engines.warp_ import EngineWarp

        engine = EngineWarp(segment_count=16, dt=1e-3)
        return RigKind("engine", lambda: RigEngine(engine, cable, workspace))
    folder = tmp_path_factory.mktemp("user")
    (folder / "stick_rig_of_a_user.py").write_text(USER_RIG)

    def make() -> Rig:
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(folder)
            return make_rig("stick_rig_of_a_user:make", cable, workspace, 0)

    return RigKind("user", make)
