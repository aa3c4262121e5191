"""A cable that slipped out of the jaws is noticed within the cast, where it lies out of reach."""

import dataclasses

import numpy as np
import pytest

from cablecast.camera.settings import CameraSight
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.motion.trajectory import JointPath
from cablecast.rigs.ur.rig import SLIP_DISTANCE, find_slip
from cablecast.setup import Setup

SETUP = Setup()
LENGTH = SETUP.cable.length + SETUP.cable.attachment_length
GRIP = np.array([0.1, 0.5, SETUP.workspace.grip_height])
CAMERA = np.array([0.0, 1.0, 1.8])


def track(apart, height=0.0):
    """Return endpoints at some distances ahead of a standing grip, as seen on the table."""
    count = len(apart)
    q = np.repeat(SETUP.arm.inverse(np.array([*GRIP, 0.0, 0.0]))[None], count, axis=0)
    times = 0.1 * np.arange(count)
    places = np.column_stack([np.full(count, GRIP[0]), GRIP[1] + apart, np.full(count, height)])
    share = places[:, 2:] / (CAMERA[2] - places[:, 2:])
    seen = places[:, :2] + share * (places[:, :2] - CAMERA[:2])
    return EndpointTrack(
        times=times,
        endpoint_xy=seen,
        status=TrialStatus.OK,
        joint_path=JointPath(times=times, q=q, qd=0 * q),
    )


SIGHT = CameraSight(position=(0.0, 1.0, 1.8))


@pytest.mark.parametrize("height", [0.0, 0.3])
def test_an_end_within_reach_of_the_grip_has_not_slipped(height):
    apart = np.linspace(0.2, np.sqrt(LENGTH**2 - (height - GRIP[2]) ** 2), 10)
    seen = track(apart, height)
    assert find_slip(seen, SETUP, SIGHT) is None
    if height == 0.0:
        assert find_slip(seen, SETUP, None) is None


def test_an_end_out_of_reach_has_slipped_and_one_mistaken_marker_is_no_slip():
    far = LENGTH + 1.5 * SLIP_DISTANCE
    words = find_slip(track(np.array([0.3, far, far])), SETUP, None)
    assert f"{np.hypot(far, GRIP[2] - SETUP.cable.radius):.2f} m from the grip" in words
    assert "slipped out of the jaws" in words
    assert find_slip(track(np.array([0.3, far, 0.3])), SETUP, None) is None


def test_what_was_not_seen_and_what_was_aborted_is_not_judged():
    far = np.full(4, 2 * LENGTH)
    seen = track(far)
    hidden = dataclasses.replace(seen, endpoint_xy=np.full((4, 2), np.nan))
    assert find_slip(hidden, SETUP, SIGHT) is None
    assert find_slip(dataclasses.replace(seen, joint_path=None), SETUP, SIGHT) is None
    aborted = dataclasses.replace(seen, status=TrialStatus.ABORTED)
    assert find_slip(aborted, SETUP, SIGHT) is None
