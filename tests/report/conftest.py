import numpy as np
import pytest

from cablecast.cast import Cast, EndpointTrack, TrialStatus
from cablecast.evaluation.evaluate import Evaluation
from cablecast.motion.casting import Action
from cablecast.motion.trajectory import plan_trajectory
from cablecast.setup import Setup
from cablecast.workspace import load_targets

TIMES = np.arange(0.0, 3.05, 0.1)
NODE_COUNT = 7


def straight_cable(grip_xy, length):
    """Return the nodes of a cable that points away from the base: crude, but possible."""
    direction = grip_xy / np.linalg.norm(grip_xy, axis=-1, keepdims=True)
    s = np.linspace(0.0, length, NODE_COUNT)
    xy = grip_xy[:, None] + s[:, None] * direction[:, None]
    return np.concatenate([xy, np.full((*xy.shape[:2], 1), 0.005)], axis=-1)


@pytest.fixture(scope="session")
def make_evaluation():
    """Return a function that builds an evaluation in which some of 32 casts left the table."""
    setup = Setup()
    action = Action(theta1=-0.6, theta2=0.5, r2=0.55, psi=0.8)
    trajectory = plan_trajectory(action, setup)
    nodes = straight_cable(trajectory.grip_path.evaluate(TIMES)[0, :, :2], setup.cable.length)
    targets = load_targets()

    def make(lost=(8, 9), with_nodes=True, rig=None, setup=setup):
        rng = np.random.default_rng(1)
        casts = []
        for index, target in enumerate(targets):
            path = nodes[:, -1, :2].copy()
            path[-1] = target + rng.normal(scale=0.05, size=2)
            status = TrialStatus.OFF_TABLE if index in lost else TrialStatus.OK
            shown = nodes if with_nodes else None
            track = EndpointTrack(times=TIMES, endpoint_xy=path, status=status, nodes=shown)
            casts.append(Cast.of_motion(trajectory, track, "evaluate"))
        return Evaluation(
            setup=setup,
            rig=rig or {"rig": "virtual", "seed": 0},
            target_xy=targets,
            inside_coverage=np.arange(len(targets)) < 28,
            casts=tuple(casts),
            motions=(trajectory,) * len(casts),
            target_index=np.arange(len(targets)),
            predicted_xy=targets + 0.002,
        )

    return make
