import numpy as np
import pytest

from cablecast.conventions import tangent
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath

# A handful of operations on doubles of order one.
EXACT = 1e-12


def smooth(times):
    """Return a pose for each time and its first two derivatives, each [step, 5]."""
    w = np.array([1.0, 1.5, 0.5, 2.0, 0.7])
    phase = times[..., None] * w
    return np.sin(phase), w * np.cos(phase), -(w**2) * np.sin(phase)


def hermite(knots):
    knots = np.atleast_2d(knots)
    return GripPath.from_hermite(knots, *smooth(knots))


def test_quintic_pieces_match_pose_velocity_and_acceleration_at_every_knot():
    knots = np.array([[0.0, 0.3, 0.5, 1.1], [0.2, 0.4, 0.9, 1.0]])
    path = hermite(knots)
    for order, reference in enumerate(smooth(knots)):
        # The last knot belongs to the motion: derivatives are not yet zero there.
        np.testing.assert_allclose(path.evaluate(knots, order), reference, atol=1e-10)


def test_the_error_between_knots_falls_with_the_sixth_power_of_their_distance():
    times = np.linspace(0.0, 2.0, 777)
    errors = [
        np.max(np.abs(hermite(np.linspace(0.0, 2.0, n + 1)).evaluate(times)[0] - smooth(times)[0]))
        for n in (4, 8)
    ]
    # 2^6 = 64; the next order is not yet negligible.
    assert 45 < errors[0] / errors[1] < 80


def test_derivatives_are_those_of_the_pose():
    path, h = hermite(np.linspace(0.0, 2.0, 6)), 1e-6
    times = np.linspace(0.01, 1.99, 60)
    for order in range(3):
        slope = (path.evaluate(times + h, order) - path.evaluate(times - h, order)) / (2 * h)
        np.testing.assert_allclose(path.evaluate(times, order + 1), slope, atol=1e-4)


def test_the_gripper_holds_still_before_and_after():
    path = hermite([0.5, 1.0, 1.5])
    np.testing.assert_array_equal(path.evaluate([-1.0, 0.2])[0], path.evaluate([0.5, 0.5])[0])
    np.testing.assert_array_equal(path.evaluate([1.6, 9.0])[0], path.evaluate([1.5, 1.5])[0])
    np.testing.assert_array_equal(path.evaluate([0.2, 1.6], 1), 0.0)


def test_a_jump_of_acceleration_is_kept_at_its_knot():
    # x = t² / 2 until 1 s, and straight on from there.
    knots = np.array([[0.0, 1.0, 2.0]])
    poses, velocities, accelerations = (
        np.zeros((1, 3, 5)),
        np.zeros((1, 3, 5)),
        np.zeros((1, 2, 2, 5)),
    )
    poses[0, :, 0], velocities[0, :, 0] = [0.0, 0.5, 1.5], [0.0, 1.0, 1.0]
    accelerations[0, 0, :, 0] = 1.0
    path = GripPath.from_hermite(knots, poses, velocities, accelerations)
    times = np.linspace(0.0, 2.0, 41)
    expected = np.where(times < 1.0, times**2 / 2, times - 0.5)
    np.testing.assert_allclose(path.evaluate(times)[0, :, 0], expected, atol=EXACT)


def test_pieces_of_no_duration_change_nothing():
    plain, padded = hermite([0.0, 0.4, 1.0]), hermite([0.0, 0.4, 0.4, 1.0, 1.0, 1.0])
    times = np.concatenate([np.linspace(-0.1, 1.2, 50), [0.4, 1.0]])
    for order in range(3):
        np.testing.assert_array_equal(plain.evaluate(times, order), padded.evaluate(times, order))


def test_a_stack_evaluates_as_its_members_did():
    members = [hermite([0.0, 1.0]), hermite([0.0, 0.2, 0.5, 2.0])]
    times = np.linspace(0.0, 2.5, 40)
    stacked = GripPath.stack(members)
    np.testing.assert_array_equal(stacked.duration, [1.0, 2.0])
    for world, member in enumerate(members):
        np.testing.assert_allclose(
            stacked.evaluate(times)[world], member.evaluate(times)[0], atol=EXACT
        )


def test_a_motion_of_a_stack_without_its_padding_is_that_before_it():
    members = [hermite([0.0, 1.0]), hermite([0.0, 0.4, 0.4, 1.0]), hermite([0.0, 0.2, 0.5, 1, 2.0])]
    stacked = GripPath.stack(members)
    for world, member in enumerate(members):
        alone = stacked[world].without_padding()
        np.testing.assert_array_equal(alone.knots, member.knots)
        np.testing.assert_array_equal(alone.coefficients, member.coefficients)
    assert stacked.without_padding().knots.shape == stacked.knots.shape
    held = GripPath.hold(np.zeros(5), 0.0)
    assert held.without_padding().knots.shape == held.knots.shape


def test_selecting_worlds_always_leaves_a_batch():
    path = GripPath.stack([hermite([0.0, 1.0]), hermite([0.0, 2.0]), hermite([0.0, 3.0])])
    assert [len(path[1]), len(path[:2]), len(path[np.array([True, False, True])])] == [1, 2, 2]
    np.testing.assert_array_equal(path[2].duration, [3.0])


def test_mirroring_changes_the_sign_of_x_and_yaw_only():
    path, times = hermite([0.0, 0.7, 1.5]), np.linspace(0.0, 1.5, 20)
    flip = np.array([-1.0, 1.0, 1.0, -1.0, 1.0])
    np.testing.assert_array_equal(path.mirrored().evaluate(times), path.evaluate(times) * flip)


def test_a_fitted_path_passes_through_its_measurements():
    times = np.linspace(0.0, 2.0, 21)
    path = GripPath.fit(times, smooth(times)[0])
    np.testing.assert_allclose(path.evaluate(times)[0], smooth(times)[0], atol=EXACT)
    between = times[:-1] + 0.05
    # A cubic spline errs by about 5/384 w⁴ h⁴ = 2e-5 at the fastest channel, more near the ends.
    np.testing.assert_allclose(path.evaluate(between)[0], smooth(between)[0], atol=2e-4)


def test_too_few_measurements_are_refused():
    with pytest.raises(InputError, match="at least 4"):
        GripPath.fit([0.0, 1.0, 2.0], np.zeros((3, 5)))


@pytest.mark.parametrize(
    ("knots", "shape", "message"),
    [
        ([[0.0, 1.0]], (1, 2, 5, 6), "require"),
        ([[0.0]], (1, 0, 5, 6), "require"),
        ([[1.0, 0.0]], (1, 1, 5, 6), "must not decrease"),
        ([[0.0, np.nan]], (1, 1, 5, 6), "must be finite"),
    ],
)
def test_a_path_that_makes_no_sense_is_refused(knots, shape, message):
    with pytest.raises(InputError, match=message):
        GripPath(knots=np.array(knots), coefficients=np.zeros(shape))


def turning(pitch):
    """Return a gripper that stays in place and turns its yaw by 1 rad at a constant pitch."""
    times = np.linspace(0.0, 1.0, 20)
    poses = np.zeros((20, 5))
    poses[:, 2], poses[:, 4] = 1.0, pitch
    poses[:, 3] = times**2 * (3 - 2 * times)
    return GripPath.fit(times, poses)


def end_of_roll(path):
    """Return the roll at the end of a path of one row [rad]."""
    h = np.diff(path.knots, axis=1)[0, -1]
    return np.sum(path.roll[0, -1] * h ** np.arange(6))


@pytest.mark.parametrize("pitch", [-np.pi / 2, -0.5, 0.3])
def test_a_level_gripper_rolls_by_the_sine_of_its_pitch(pitch):
    level = turning(pitch).levelled()
    np.testing.assert_allclose(end_of_roll(level), -np.sin(pitch), atol=1e-9)
    np.testing.assert_allclose(end_of_roll(level.mirrored()), np.sin(pitch), atol=1e-9)
    assert level.is_level
    assert not turning(pitch).is_level


def test_a_level_cable_makes_no_gripper_roll():
    assert turning(0.0).levelled().roll is None
    assert turning(0.0).is_level


def test_rolls_are_stacked_and_selected_with_their_paths():
    rolling, still = turning(-np.pi / 2).levelled(), turning(0.0)
    both = GripPath.stack([still, rolling])
    np.testing.assert_array_equal(both.roll[0], 0.0)
    np.testing.assert_array_equal(both[1].roll, rolling.roll)


def test_a_roll_of_another_shape_is_refused():
    path = turning(0.0)
    with pytest.raises(InputError, match="roll has shape"):
        GripPath(knots=path.knots, coefficients=path.coefficients, roll=np.zeros((1, 3, 6)))


@pytest.mark.parametrize("past", [0.0, 1e-3, 1e-2, 0.1])
def test_a_path_through_directions_that_pass_straight_down_follows_them(past):
    # At 100 Hz and 3 rad/s, the yaw turns by half a turn within a frame or two.
    def wanted(times):
        angle = 3.0 * (times - 1.003)
        across = np.full_like(times, np.sin(past))
        return np.stack(
            [np.sin(angle) * np.cos(past), across, -np.cos(angle) * np.cos(past)], axis=-1
        )

    times = np.linspace(0.0, 2.0, 201)
    x, y, z = wanted(times).T
    poses = np.zeros((len(times), 5))
    poses[:, 3], poses[:, 4] = np.unwrap(np.arctan2(x, y)), np.arcsin(np.clip(z, -1.0, 1.0))
    fine = np.linspace(0.5, 1.5, 4001)
    found = GripPath.fit(times, poses).evaluate(fine)[0]
    off = np.linalg.norm(tangent(found[:, 3], found[:, 4]) - wanted(fine), axis=1)
    # Half a frame of the turn, and no swing that goes on beside it.
    assert np.degrees(off.max()) < 0.75
    assert np.degrees(off[np.abs(fine - 1.003) > 0.08].max()) < 0.02
