"""A policy and a rig with closed forms: the rig lands elsewhere than the policy believes."""

import dataclasses

import numpy as np
from tests.learning.synthetic_casts import CABLE, SETUP, linear_model

from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.motion.action import ActionRanges, grid_actions, mirror_actions
from cablecast.rigs.base import RigLifecycle, purpose_seed

LENGTH = CABLE.length


def make_policy() -> ForwardSearchPolicy:
    """Return a policy of the linear model, with features that vary by about 1."""
    scale = np.array([0.4, 0.4, 0.13, 0.45, 1.0], dtype=np.float32)
    model = linear_model()
    ((matrix, offset),) = model.weights
    model = dataclasses.replace(
        model, weights=((matrix * scale[:, None], offset),), feature_scale=scale
    )
    return ForwardSearchPolicy.from_candidates(grid_actions(ActionRanges(), (3, 40, 20, 3)), model)


class FormulaRig(RigLifecycle):
    """Lands where the policy believes, plus a bias that follows the action, plus scatter.

    Attributes:
        bias: Size of the bias [cable lengths].
        scatter: Standard deviation of equal casts along each axis [cable lengths].
        drift: Growth of a shift along x with each cast after the first 20 [cable lengths].
        hidden: Whether every cast ends hidden.
    """

    def __init__(self, policy, seed=0, bias=0.08, scatter=0.005, drift=0.0, hidden=False):
        super().__init__()
        self.policy, self.seed = policy, seed
        self.bias, self.scatter, self.drift, self.hidden = bias, scatter, drift, hidden
        self.description = {"rig": "formula", "seed": seed}
        self.actions, self._draw = [], (seed, 0)

    def seek(self, index, purpose=""):
        self._draw = (purpose_seed(self.seed, purpose), index)

    def landing(self, action):
        """Return the landing of an action without scatter."""
        action = np.asarray(action, dtype=float)
        side = np.sign(action[1])
        mirrored = mirror_actions(action, side)
        theta1, theta2, r2, psi, _ = mirrored
        bias = self.bias * np.array([np.sin(3 * theta2 + side), np.cos(2 * psi + 5 * r2 - theta1)])
        xy = self.policy.model.predict(mirrored[None])[0] + LENGTH * bias
        return xy * np.array([side, 1.0])

    def execute(self, trajectory):
        self._use_reset()
        action = trajectory.action.to_array()
        self.actions.append(action)
        noise = np.random.default_rng(self._draw).normal(size=2)
        drift = np.array([self.drift * max(len(self.actions) - 20, 0), 0.0])
        xy = self.landing(action) + LENGTH * (self.scatter * noise + drift)
        times = np.array([0.0, trajectory.duration + 1.0])
        status = TrialStatus.OCCLUDED if self.hidden else TrialStatus.OK
        last = np.full(2, np.nan) if self.hidden else xy
        start = [0.0, SETUP.workspace.reset_y + LENGTH]
        return EndpointTrack(times=times, endpoint_xy=np.array([start, last]), status=status)
