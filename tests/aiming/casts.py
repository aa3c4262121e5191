"""Casts that were made up, for tests of what a session does with them."""

import numpy as np

from cablecast.cast import Cast, EndpointTrack, Proposal, TrialStatus
from cablecast.motion.casting import Action
from cablecast.setup import Setup
from cablecast.task import LANDING, Expectation, Goal

SETUP = Setup()
ACTION = Action(theta1=-0.5, theta2=0.6, r2=0.55, psi=1.0)


def made_up_cast(landing, target=None, *, number=0, try_number=1, deviation=1.0, expected=(0, 0)):
    """Return a cast that landed somewhere; at a target if one is given."""
    landing = np.array(landing, dtype=float)
    landed = bool(np.all(np.isfinite(landing)))
    proposal = None
    if target is not None:
        proposal = Proposal(
            goal=Goal(task=LANDING, setup=SETUP, value=np.array(target, dtype=float)),
            number=number,
            try_number=try_number,
            action=ACTION,
            expected=Expectation(
                mean=np.array(expected, dtype=float),
                covariance=deviation**2 * np.eye(2),
                scatter=0.01,
            ),
            inside_coverage=True,
        )
    status = TrialStatus.OK if landed else TrialStatus.OCCLUDED
    return Cast(
        action=ACTION,
        duration=1.0,
        joint_path=None,
        track=EndpointTrack(times=np.zeros(1), endpoint_xy=landing[None], status=status),
        purpose="aim" if proposal else "tune",
        proposal=proposal,
    )
