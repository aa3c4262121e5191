"""The same motions on the maker's simulator, where one runs: docs/ursim.md says how."""

import dataclasses
import os

import numpy as np
import pytest
from tests.robot import ROBOT

from cablecast.rigs.driver import CastAbortedError
from cablecast.rigs.path import JointCurve, straight_move
from cablecast.rigs.ur.link import UrLink, check_ready
from cablecast.rigs.ur.player import ProgramPlayer
from cablecast.rigs.ur.program import PROGRAM_SIZE_MAX, motion_program

pytestmark = [
    pytest.mark.ursim,
    pytest.mark.skipif("CABLECAST_URSIM" not in os.environ, reason="needs URSim"),
]

# URSim has no inertia: it ends where it was told to.
ANGLE_TOLERANCE = 1e-3
# servoj looks 0.03 s ahead, and the wrist turns at 0.16 rad/s.
LAG_TOLERANCE = 0.01


@pytest.fixture
def player():
    robot = dataclasses.replace(
        ROBOT,
        address=os.environ["CABLECAST_URSIM"],
        box_low=(-2.0, -2.0, -2.0),
        box_high=(2.0, 2.0, 2.0),
    )
    link = UrLink(robot)
    yield ProgramPlayer(link)
    link.close()


def turn(player, angle):
    q = player.link.wait_for_report().q
    return straight_move(q, q + [0, 0, 0, 0, 0, angle], 0.5)


def test_the_controller_carries_a_program_out_to_its_end(player):
    check_ready(player.link)
    for angle in (0.5, -0.5):
        points = turn(player, angle)
        player.play("cablecast_test", points)
        np.testing.assert_allclose(
            player.link.wait_for_report().q, points.q[-1], atol=ANGLE_TOLERANCE
        )


def test_the_controller_takes_a_program_of_twenty_kilobytes(player):
    check_ready(player.link)
    q = player.link.wait_for_report().q
    count = 151
    times = np.arange(count) * 0.04
    q = np.repeat(q[None], count, axis=0)
    q[:, 5] += 0.3 * np.sin(np.pi * times / times[-1]) ** 2
    qd = np.gradient(q, times, axis=0)
    qd[[0, -1]] = 0.0
    curve = JointCurve(times, q, qd)
    assert len(motion_program("cablecast_test", curve, player.robot, 1)) > 0.9 * PROGRAM_SIZE_MAX
    record = player.play("cablecast_test", curve)
    targets = np.array([r.target_q for r in record.reports])
    meant = curve.evaluate(np.array([r.time for r in record.reports]) - record.start_time)
    np.testing.assert_allclose(targets, meant, atol=LAG_TOLERANCE)


def test_the_controller_stops_when_the_heart_does_not_beat(player, monkeypatch):
    check_ready(player.link)
    monkeypatch.setattr(player.link, "keep_alive", lambda: None)
    with pytest.raises(CastAbortedError, match="heard nothing of this computer"):
        player.play("cablecast_test", turn(player, 0.5))
