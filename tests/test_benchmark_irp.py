"""The world of IRP's benchmark: its start, its motion and its metric."""

import numpy as np
import pytest
from benchmarks.irp import Args, interval, model, problems
from benchmarks.irp_world import (
    DT,
    MOVING,
    PIXELS_PER_M,
    RECORD_STEPS,
    START_DEG,
    Rope,
    World,
    joint_targets,
    middle_of,
    pixel_error,
    pixels_of,
)

pytest.importorskip("mujoco")

ACTION = np.array([0.4, 0.6, 0.3])
# Set points of the library lie on lines between samples every 10 ms, at up to 31 rad/s²; those of
# the benchmark take up to a step of 1 ms longer, at 3 rad/s.
ANGLE_TOLERANCE = 1e-3


@pytest.fixture(scope="module")
def swing():
    return World(Rope(1.0, 0.0644)).swing(ACTION)


def test_the_rope_hangs_below_the_stick_and_stays_there_until_it_is_moved(swing):
    # 0.0892 - 0.425 sin(-70 deg) and so on down to the stick's end, then 1 m of rope.
    assert swing.path[0] == pytest.approx([0.3081, 0.0199 - 0.49 - 1.0 - 0.0094], abs=1e-3)
    np.testing.assert_allclose(swing.path[1], swing.path[0], atol=1e-3)


def test_the_model_of_the_arm_moves_as_the_world_does(swing):
    times = DT * RECORD_STEPS * np.arange(len(swing.motion))
    moves = model()
    assert moves.respond is not None
    q = moves.respond(moves.moves.angles(ACTION[None], times)[0], DT * RECORD_STEPS)
    np.testing.assert_allclose(q[0][:, MOVING], swing.motion, atol=ANGLE_TOLERANCE)


def test_targets_are_a_trapezoid_of_the_joint_that_moves_most():
    targets = joint_targets(ACTION)
    rate = np.abs(np.gradient(targets, DT, axis=0)).max()
    assert rate == pytest.approx(1.0 + 0.4 * 2.14, rel=0.01)
    np.testing.assert_allclose(targets[0], np.radians(START_DEG)[list(MOVING)])
    turns = targets[-1] - targets[0]
    np.testing.assert_allclose(np.degrees(turns), [-60 - 0.6 * 120, 60 - 0.3 * 180], atol=0.1)


def test_an_impulse_at_the_start_moves_the_tip(swing):
    pushed = World(Rope(1.0, 0.0644)).swing(ACTION, impulse=1e-3)
    steps = min(len(pushed.path), len(swing.path), 60)
    apart = np.linalg.norm(pushed.path[:steps] - swing.path[:steps], axis=1)
    assert 1e-4 < apart.max() < 0.4


def test_the_metric_is_zero_on_a_covered_pixel_and_counts_whole_pixels_beside_it():
    path = np.array([[0.0, 0.0], [0.5, 0.25]])
    covered = pixels_of(path)
    assert pixel_error(path, covered[7]) == 0.0
    # A column of pixels to the left of the first one.
    assert pixel_error(path, covered[0] - [3, 0]) == pytest.approx(3 / PIXELS_PER_M)
    gaps = np.abs(np.diff(covered, axis=0)).max(axis=1)
    assert gaps.max() == 1
    assert np.abs(middle_of(covered[0]) - path[0]).max() <= 0.5 / PIXELS_PER_M


def test_committed_goals_are_five_ropes_of_each_kind_with_25_goals_each():
    found = problems(Args())
    assert [kind for kind, _, _ in found] == ["interpolation"] * 5 + ["extrapolation"] * 5
    assert len({(rope.length, rope.density) for _, rope, _ in found}) == 10
    assert all(goals.shape == (25, 2) for _, _, goals in found)


def test_an_interval_holds_the_mean_of_its_sample():
    values = np.random.default_rng(0).exponential(size=(200, 2))
    low, high = interval(values)
    assert np.all(low < values.mean(axis=0))
    assert np.all(values.mean(axis=0) < high)
