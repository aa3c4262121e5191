"""Whether the jaws still hold the cable, by pictures of it in them, beside and out of sight."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.conventions import tangent
from cablecast.motion.polar import reset_pose
from cablecast.motion.trajectory import JointPath
from cablecast.rigs.virtual.camera import TrialFilm
from cablecast.rigs.virtual.drawing import FilmedTrial
from cablecast.setup import Setup
from cablecast.vision.grip import is_held, turned_into_sight

SETUP = Setup()
ARM, CABLE = SETUP.arm, SETUP.cable
START = ARM.inverse(np.asarray(reset_pose(SETUP.workspace), dtype=float))
# To the side, as a cast leaves them; ahead of the second the camera sees the hand.
OPEN = ARM.inverse(np.array([-0.45, 0.5, SETUP.workspace.grip_height, -0.6, 0.0]))
HIDDEN = ARM.inverse(np.array([0.5, 0.35, SETUP.workspace.grip_height, 2.0, 0.0]))


def picture(camera, q, start, yaw, seed, bow=0.0):
    """Return a picture of the arm and of a cable from a place on, in a direction."""
    arc = np.linspace(0.0, CABLE.length, 20)
    nodes = np.array([*start, CABLE.radius]) + arc[:, None] * tangent(yaw, 0.0)
    nodes[:, :2] += (bow * arc**2)[:, None] * tangent(yaw + np.pi / 2, 0.0)[:2]
    joints = JointPath(times=np.zeros(1), q=q[None], qd=0 * q[None])
    trial = FilmedTrial.of(SETUP, np.zeros(1), nodes[None], joints)
    return TrialFilm(camera, trial, seed).frame(0)


@pytest.fixture(scope="module")
def before(virtual_camera):
    return picture(virtual_camera, START, reset_pose(SETUP.workspace)[:2], 0.0, 1)


def held(camera, before, q, start, yaw, **changes):
    """Return what a picture with the arm at some joints tells."""
    after = picture(camera, q, start, yaw, 2, **changes)
    return is_held((before, after), np.array([START, q]), ARM, camera.view)


@pytest.mark.parametrize("bow", [0.0, 1.5])
def test_a_cable_that_leaves_the_jaws_is_held_straight_or_bent(virtual_camera, before, bow):
    x, y, _, yaw, _ = ARM.grip_pose(OPEN)
    assert held(virtual_camera, before, OPEN, (x, y), yaw, bow=bow) is True


@pytest.mark.parametrize(("aside", "turn"), [(0.12, 1.2), (-0.15, 0.3)])
def test_a_cable_that_lies_beside_the_jaws_is_not_held(virtual_camera, before, aside, turn):
    x, y, _, yaw, _ = ARM.grip_pose(OPEN)
    beside = np.array([x, y]) + aside * tangent(yaw + np.pi / 2, 0.0)[:2]
    assert held(virtual_camera, before, OPEN, beside, yaw + turn) is False


def test_jaws_that_the_hand_hides_are_turned_until_they_are_seen(virtual_camera, before):
    view = virtual_camera.view
    x, y, _, yaw, _ = ARM.grip_pose(HIDDEN)
    assert held(virtual_camera, before, HIDDEN, (x, y), yaw) is None
    turned = turned_into_sight(HIDDEN, ARM, view)
    assert turned is not None
    pose = ARM.grip_pose(turned)
    np.testing.assert_allclose(pose[:3], ARM.grip_pose(HIDDEN)[:3], atol=1e-9)
    assert held(virtual_camera, before, turned, (x, y), pose[3]) is True
    assert held(virtual_camera, before, turned, (x, y), yaw) is False
    # What is in sight needs no turn.
    assert turned_into_sight(OPEN, ARM, view) is OPEN


@pytest.mark.parametrize("yaw_deg", [180.02, -180.02])
def test_jaws_turned_by_half_a_turn_and_a_little_are_not_spun_to_be_seen(virtual_camera, yaw_deg):
    x, yaw = np.copysign(0.5, yaw_deg), np.radians(yaw_deg)
    q = ARM.inverse(np.array([x, 0.35, SETUP.workspace.grip_height, yaw, 0.0]))
    turned = turned_into_sight(q, ARM, virtual_camera.view)
    assert turned is not None
    assert np.abs(turned - q).max() < np.pi


def test_nothing_is_said_of_a_cable_that_looks_like_the_table(virtual_camera):
    bare = picture(virtual_camera, START, (0.9, 0.1), 0.0, 1)
    x, y, _, yaw, _ = ARM.grip_pose(OPEN)
    assert held(virtual_camera, bare, OPEN, (x, y), yaw) is None
    nowhere = dataclasses.replace(virtual_camera.view, position=(0.0, 1.0, 0.05))
    assert turned_into_sight(HIDDEN, ARM, nowhere) is None


def test_nothing_is_said_where_the_jaws_stood_beside_the_picture(virtual_camera, before):
    view = virtual_camera.view
    x, y, z = view.position
    aside = dataclasses.replace(view, position=(x, y + 1.2, z))
    assert is_held((before, before), np.array([START, OPEN]), ARM, aside) is None
