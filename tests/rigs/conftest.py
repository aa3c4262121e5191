"""Rigs that the contract suite runs over, and motions for them to play."""

import dataclasses
import itertools
import os
import pathlib
import sys
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from cablecast.cable import Cable
from cablecast.files import parse_yaml
from cablecast.motion.casting import Action
from cablecast.motion.grip_path import GripPath
from cablecast.motion.polar import reset_pose
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.rigs.arm import RigArm
from cablecast.rigs.base import Rig
from cablecast.rigs.driver import RigPhase
from cablecast.rigs.engine import RigEngine
from cablecast.rigs.make import make_rig
from cablecast.rigs.path import check_path, straight_move
from cablecast.rigs.ur.twin.laboratory import TwinConfig
from cablecast.rigs.ur.twin.process import TwinProcess
from cablecast.setup import Setup
from cablecast.workspace import Workspace

# A user's own rig is made as the command line makes it, from a module in the working directory.
EXAMPLES = pathlib.Path(__file__).parents[2] / "examples"
USER_RIG = "05_your_own_rig:make_rig"
TWIN_FILE = EXAMPLES / "twin.yaml"
# Largest speed of a joint on the way back [rad/s], several times that of a lab.
RETURN_SPEED = 1.2

TwinMaker = Callable[..., tuple[TwinProcess, Setup]]


@pytest.fixture(scope="session")
def setup() -> Setup:
    return Setup()


@pytest.fixture(scope="session")
def cable(setup) -> Cable:
    return setup.cable


@pytest.fixture(scope="session")
def workspace(setup) -> Workspace:
    return setup.workspace


@pytest.fixture(scope="session")
def cast(setup) -> Trajectory:
    """Return a cast that lands well on the table."""
    action = Action(np.radians(-40), np.radians(35), 0.65, np.radians(60))
    return plan_trajectory(action, setup)


@pytest.fixture(scope="session")
def wide_cast(setup) -> Trajectory:
    """Return a cast that whips the tip around."""
    action = Action(np.radians(-60), np.radians(50), 0.7, np.radians(80))
    return plan_trajectory(action, setup)


@pytest.fixture(scope="session")
def small_cast(setup) -> Trajectory:
    """Return a short and narrow cast."""
    action = Action(np.radians(-15), np.radians(10), 0.6)
    return plan_trajectory(action, setup)


@pytest.fixture(scope="session")
def wild() -> Trajectory:
    """Return a sweep that no arm could make: at full stretch to the side, off the table."""
    times = np.linspace(0.0, 0.9, 60)
    u = times / times[-1]
    theta = 1.5 * u**3 * (10 - 15 * u + 6 * u**2)
    still = np.zeros_like(times)
    poses = np.stack([0.9 * np.sin(theta), 0.9 * np.cos(theta), still + 0.02, theta, still], axis=1)
    return Trajectory(action=None, grip_path=GripPath.fit(times, poses), joint_path=None)


@pytest.fixture(scope="session")
def twin_address() -> Callable[[], str]:
    """Return a function that gives each twin an address of its own, as ports are fixed."""
    if not sys.platform.startswith("linux"):
        pytest.skip("several loopback addresses need Linux")
    process, numbers = os.getpid(), itertools.count(1)
    return lambda: f"127.{process // 250 % 250 + 1}.{process % 250 + 1}.{next(numbers)}"


@pytest.fixture(scope="module")
def make_twin(twin_address) -> Iterator[TwinMaker]:
    """Make twins that stop at the end of a file's tests; each comes with the set-up to reach it."""
    pytest.importorskip("mujoco")
    twins = []

    def make(
        robot: dict | None = None,
        model: str = "ur5",
        camera: dict | None = None,
        lab: dict | None = None,
        **config,
    ):
        address = twin_address()
        values = parse_yaml(TWIN_FILE.read_text(), "lab file")
        for section, changes in {**(lab or {}), "arm": {"model": model}}.items():
            values[section] = {**values.get(section, {}), **(lab or {}).get(section, {}), **changes}
        setup = Setup.from_dict(values)
        setup = dataclasses.replace(
            setup,
            robot=dataclasses.replace(
                setup.robot, address=address, **({"silence_max": 10.0} | (robot or {}))
            ),
            camera=dataclasses.replace(setup.camera, **(camera or {})),
        )
        # A computer that is busy with other tests must not make the watchdog bark.
        config = {"camera_port": 0, "patience": 5.0, **config}
        seen = setup if camera is not None else dataclasses.replace(setup, camera=None)
        twin = TwinProcess(seen, TwinConfig(address=address, **config))
        twins.append(twin)
        if twin.camera_url is not None:
            seen = dataclasses.replace(setup.camera, source=twin.camera_url)
            setup = dataclasses.replace(setup, camera=seen)
        return twin, setup

    yield make
    for twin in twins:
        twin.close()


class RigQuick(RigArm):
    """The arm with a reset that only brings it back: the paper's takes 17 s."""

    def _reset_once(self):
        self.driver.ready()
        home = self.setup.arm.inverse(np.asarray(reset_pose(self.setup.workspace), dtype=float))
        way = straight_move(self._at_rest(), home, RETURN_SPEED)
        check_path(way, self.setup, "the way back")
        self._play("cablecast_approach", way, RigPhase.RESET)
        self._wait(0.2)


@dataclasses.dataclass(frozen=True)
class RigKind:
    name: str
    make: Callable[[], Rig]


@pytest.fixture(scope="module", params=["virtual", "engine", "user", "ur"])
def rig_kind(request, setup) -> RigKind:
    """Each rig in a quick setting, made afresh by each call of `make`."""
    if request.param == "virtual":
        pytest.importorskip("mujoco")
        from cablecast.rigs.virtual import RigVirtual, VirtualConfig
        from cablecast.rigs.virtual._hidden import EFFECTS

        config = VirtualConfig(
            without=EFFECTS,
            segment_count=12,
            dt=2e-3,
            reset_time=0.1,
            rest_time_max=1.5,
            sensing="exact",
        )
        return RigKind("virtual", lambda: RigVirtual(setup, 0, config))
    if request.param == "ur":
        from benchmarks.truth import TruthCamera

        make_twin = request.getfixturevalue("make_twin")
        _, lab = make_twin(segment_count=12, rate=3.0)
        return RigKind("ur", lambda: RigQuick(lab, TruthCamera(lab)))
    if request.param == "engine":
        from cablecast.engines.warp_ import EngineWarp

        engine = EngineWarp(segment_count=10, dt=2e-3)
        return RigKind("engine", lambda: RigEngine(engine, setup))

    def make_user() -> Rig:
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(EXAMPLES)
            return make_rig(USER_RIG, setup)

    return RigKind("user", make_user)
