import numpy as np
import pytest

from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.learning.policy import Plan
from cablecast.setup import Setup
from cablecast.task import LANDING


class PolicyStub:
    """The same feasible action for every target, predicted to land 1 cm to its right."""

    def __init__(self, setup):
        self.setup = setup
        self.info = {"name": "stub"}

    def plan(self, target_xy=None, *, r=None, theta_deg=None):
        targets = LANDING.values(self.setup, target_xy, r=r, theta_deg=theta_deg)
        return Plan(
            setup=self.setup,
            target_xy=targets,
            actions=np.tile([-0.6, 0.5, 0.55, 0.8, 1.0], (len(targets), 1)),
            predicted_xy=targets + (0.01, 0.0),
            inside_coverage=targets[:, 0] > 0,
        )


class RigStub:
    """Lands wherever it is told; keeps count of its calls."""

    def __init__(self, landings, statuses=None):
        self.description = {"rig": "stub"}
        self.landings = [np.asarray(xy, dtype=float) for xy in landings]
        self.statuses = statuses or [TrialStatus.OK] * len(self.landings)
        self.calls = []

    def reset(self):
        self.calls.append("reset")

    def execute(self, trajectory):
        self.calls.append("execute")
        index = self.calls.count("execute") - 1
        end = self.landings[index]
        return EndpointTrack(
            times=np.array([0.0, trajectory.duration + 1.0]),
            endpoint_xy=np.stack([[0.0, 1.2], end]),
            status=self.statuses[index],
        )

    def close(self):
        self.calls.append("close")


@pytest.fixture
def policy():
    return PolicyStub(Setup())


@pytest.fixture
def make_rig_stub():
    return RigStub
