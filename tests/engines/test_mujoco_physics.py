"""The physics of EngineMujoco against closed forms."""

import numpy as np
import pytest
from benchmarks.validation import CASES
from benchmarks.validation.case import make_mujoco, outcomes
from benchmarks.validation.scenes import RADIUS, make_cable, straight

from cablecast.motion.grip_path import GripPath

mujoco = pytest.importorskip("mujoco")

from cablecast.engines.mujoco_ import EngineMujoco  # noqa: E402

GRAVITY = 9.81


def sideways(distance_at, duration) -> GripPath:
    """Return a grip that lies on the table and moves along x by a law."""
    times = np.linspace(0.0, duration, 200)
    poses = np.zeros((200, 5))
    poses[:, 0] = distance_at(times)
    poses[:, 2] = RADIUS
    return GripPath.fit(times, poses)


# Half a cell at the clamp, a few segments, and a step of first order.
@pytest.mark.parametrize(
    ("name", "segment_count", "dt", "tolerance"),
    [
        ("elastica", 12, 1e-3, 0.01),
        ("torsional_swing", 16, 1e-3, 0.01),
        # The last node has half a segment's mass and turns a whole one.
        ("slip_to_roll", 10, 5e-4, 0.02),
    ],
)
def test_mujocos_rod_meets_the_closed_form(name, segment_count, dt, tolerance):
    (case,) = (case for case in CASES if case.name == name)
    for outcome in outcomes(case.measure(make_mujoco, segment_count, dt)):
        assert outcome.error < tolerance, outcome.quantity


def test_a_cable_sliding_sideways_stops_after_v_squared_over_2_mu_g():
    speed, friction = 1.0, 0.4
    stop = speed / (friction * GRAVITY)
    # Some bending keeps neighbours together, which hop by a millimetre at their own instants each.
    c = make_cable(lateral_friction=friction, bend_stiffness=1e-3)
    path = sideways(lambda t: speed * t - 0.5 * friction * GRAVITY * t**2, stop)
    state = straight(12, (0, 0, RADIUS), (0, 1, 0), (speed, 0, 0))
    engine = EngineMujoco(12, 2.5e-4, rolling=False)
    rollout = engine.rollout(c, path, state, duration=0.4)
    expected = speed**2 / (2 * friction * GRAVITY)
    moved = rollout.final_state.positions[0, :, 0]
    np.testing.assert_allclose(moved, expected, rtol=5e-3)


def test_a_stopped_cable_can_be_taken_up_again():
    # MuJoCo counts the roll from frames of its own, which begin anew with the second rollout.
    c = make_cable(bend_stiffness=3e-4, twist_stiffness=3e-4, lateral_friction=0.4)
    times = np.linspace(0.0, 1.0, 80)
    poses = np.zeros((80, 5))
    poses[:, 0] = 0.3 * np.sin(np.pi * times) ** 2
    poses[:, 3] = 1.2 * np.sin(np.pi * times) ** 2
    poses[:, 2] = 0.03
    engine = EngineMujoco(12)
    path = GripPath.fit(times, poses)
    whole = engine.rollout(c, path, duration=0.6)
    half = engine.rollout(c, path, duration=0.5)
    assert np.abs(half.final_state.roll).max() > 0.05
    later = np.linspace(0.5, 1.0, 80)
    rest = GripPath.fit(later - 0.5, path.evaluate(later)[0])
    again = engine.rollout(c, rest, half.final_state, duration=0.1)
    np.testing.assert_allclose(again.endpoint_xyz[0, -1], whole.endpoint_xyz[0, -1], atol=1e-4)


def test_a_world_that_blows_up_leaves_no_log_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    c = make_cable(bend_stiffness=3e-4)
    state = straight(6, (0, 0, 0.1), (0, 1, 0), (1e9, 0.0, 1e9))
    path = GripPath.hold([0, 0, 0.1, 0, 0], 1.0)
    rollout = EngineMujoco(6).rollout(c, path, state, duration=0.2)
    assert not rollout.finite[0]
    assert np.isnan(rollout.endpoint_xyz[0, -1]).all()
    assert list(tmp_path.iterdir()) == []
    assert mujoco.get_mju_user_warning() is None
