import dataclasses

import numpy as np
import pytest

from cablecast.track import EndpointTrack, TrialStatus


@dataclasses.dataclass(frozen=True)
class PlanStub:
    actions: np.ndarray
    predicted_xy: np.ndarray
    inside_coverage: np.ndarray


class PolicyStub:
    """The same feasible action for every target, predicted to land 1 cm to its right."""

    def plan(self, target_xy):
        targets = np.atleast_2d(target_xy)
        actions = np.tile([-0.6, 0.5, 0.55, 0.8], (len(targets), 1))
        return PlanStub(actions, targets + (0.01, 0.0), targets[:, 0] > 0)


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
            times=np.array([0.0, 0.1]),
            endpoint_xy=np.stack([[0.0, 1.2], end]),
            status=self.statuses[index],
        )

    def close(self):
        self.calls.append("close")


@pytest.fixture
def policy():
    return PolicyStub()


@pytest.fixture
def make_rig_stub():
    return RigStub
