"""The world of the whip's benchmark, and the search in it."""

import numpy as np
import pytest
from benchmarks.whip import BUDGET, Search
from benchmarks.whip_world import HIGH, LINKS, LOW, TARGETS, Whip, World, hand, postures

pytest.importorskip("mujoco")

# The arm's reach and the whip's length, to the digits of the published targets.
REACH, DIGITS = 0.294 + 0.291 + 1.8, 1e-3
# A weight of 0.3 kg that nothing carries lowers the whip by centimetres in this time; the arm
# itself has hardly begun to move.
EARLY, AT_REST = 0.05, 2e-3
UNIT = np.array([0.5, 0.5, 0.5, 0.3, 0.5, 0.5, 0.5, 0.3, 1.0])


@pytest.fixture(scope="module")
def tip():
    return World(Whip(node_count=12), dt=5e-4).swing(UNIT)


def test_the_far_targets_lie_at_the_rim_of_what_arm_and_whip_reach():
    far = np.linalg.norm(TARGETS[3:], axis=1)
    np.testing.assert_allclose(far, REACH, atol=DIGITS)


def test_the_whip_hangs_below_the_hand_and_its_weight_is_carried(tip):
    start = LOW[:4] + UNIT[:4] * (HIGH - LOW)[:4]
    below = hand(start[None])[0] - [0.0, 0.0, 1.8]
    np.testing.assert_allclose(tip[0], below, atol=1e-9)
    early = tip[: round(EARLY / 5e-4)]
    np.testing.assert_allclose(early, np.broadcast_to(below, early.shape), atol=AT_REST)


def test_a_hand_hangs_by_the_length_of_both_links_and_goes_forward_with_the_first_joint():
    length = sum(link[0] for link in LINKS)
    forward = hand(np.array([[0.0, 0.0, 0.0, 0.0], [np.pi / 2, 0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(forward, [[0.0, 0.0, -length], [length, 0.0, 0.0]], atol=1e-12)


def test_a_posture_moves_once_from_rest_to_rest():
    duration = 1.5
    q, qd = postures(UNIT[None], np.array([0.0, 0.5 * duration, duration, 2.0 * duration]))
    np.testing.assert_allclose(q[0, 1], 0.5 * (q[0, 0] + q[0, 2]))
    np.testing.assert_allclose(q[0, 3], q[0, 2])
    np.testing.assert_allclose(qd[0, [0, 2, 3]], 0.0, atol=1e-12)


def test_a_search_ends_with_a_strike_and_counts_its_simulations():
    played = []

    def play(unit):
        """Move a point along a line whose place the move decides."""
        played.append(unit)
        values = unit - 0.5
        line = np.linspace(-1.0, 1.0, 40)[:, None] * [1.0, 0.2, 0.1]
        return line + [values[0] ** 3, values[:4].sum(), 2.0 * values[4:].sum()]

    search = Search(play, (0.5, 1.2, 0.7), seed=0)
    found = search.run()
    assert found.miss <= search.within
    assert search.count == len(played) <= BUDGET
