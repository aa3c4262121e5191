"""A desk in a linear world: a policy with a closed form, and a rig that lands beside it."""

import time

import numpy as np
import pytest
from tests.learning.synthetic_casts import SETUP, linear_model

from cablecast.aiming.session import AimSession
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import RigError
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.motion.action import ActionRanges, grid_actions, mirror_actions
from cablecast.rigs.base import RigLifecycle
from cablecast.rigs.make import make_rig
from cablecast.view.desk import Desk


class OffsetRig(RigLifecycle):
    """Lands where the linear model says, plus an offset and whatever else a test asks for.

    Attributes:
        offset: Distance from the model's landing to the rig's [m], shape [2].
        failures: Number of casts to come that fail.
        during: Called in the middle of each cast, if any.
        status: End of the casts.
        sees_cable: Whether it reports the shape of the cable.
    """

    def __init__(self):
        super().__init__()
        self.description = {"rig": "offset"}
        self.model = linear_model()
        self.offset = np.array([0.06, -0.04])
        self.failures = 0
        self.during = None
        self.status = TrialStatus.OK
        self.sees_cable = True
        self.cast_count = 0

    def execute(self, trajectory):
        self._use_reset()
        if self.during is not None:
            self.during()
        if self.failures:
            self.failures -= 1
            raise RigError("the arm stopped: protective stop")
        self.cast_count += 1
        action = trajectory.action.to_array()
        side = 1.0 if action[1] > 0 else -1.0
        landed = self.model.predict(mirror_actions(action, side)[None])[0]
        landed = landed * [side, 1.0] + self.offset
        times = np.array([0.0, 2.0, 4.0])
        start = np.array([0.0, 1.2])
        endpoint_xy = np.stack([start, (start + landed) / 2, landed])
        nodes = np.zeros((3, 4, 3))
        nodes[:, :, :2] = endpoint_xy[:, None] * np.linspace(0.5, 1.0, 4)[:, None]
        return EndpointTrack(
            times=times,
            endpoint_xy=endpoint_xy,
            status=self.status,
            nodes=nodes if self.sees_cable else None,
        )


def drain(worker):
    """Do what was submitted, and return."""
    while worker.state.busy:
        worker._step()


@pytest.fixture(scope="session")
def policy():
    actions = grid_actions(ActionRanges(), (3, 40, 20, 3))
    return ForwardSearchPolicy.from_candidates(actions, linear_model())


@pytest.fixture(scope="session")
def engine():
    return EngineWarp(segment_count=8, dt=2e-3)


@pytest.fixture
def own():
    """Return the rig itself, which tests change."""
    return OffsetRig()


@pytest.fixture
def rig(own):
    return make_rig(own, SETUP)


@pytest.fixture
def open_desk(rig, engine):
    """Return a function that opens a desk with a session."""

    def opened(session):
        desk = Desk(rig, engine)
        desk.set_session(session)
        return desk

    return opened


@pytest.fixture
def desk(open_desk, policy):
    return open_desk(AimSession(policy))


@pytest.fixture
def drawn():
    """Return what viser draws and shows, by the names in the tree of the scene."""

    def nodes(server):
        # viser has no public way to ask.
        known = server.scene._handle_from_node_name
        return {name: node for name, node in known.items() if node.visible}

    return nodes


@pytest.fixture(scope="session")
def wait_until():
    """Return a function that waits until a condition holds, and fails if it never does."""

    def wait(condition, patience=60.0):
        until = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < until, "it never came"
            time.sleep(0.01)

    return wait
