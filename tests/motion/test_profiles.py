import numpy as np
import pytest
import ruckig
from hypothesis import given, settings
from hypothesis import strategies as st

from cablecast.errors import InputError
from cablecast.motion.grip_path import plan_profiles

# Sums and products of a few doubles of order one, with jerks of order a hundred.
EXACT = 1e-9


def batch(distances, velocity=2.5, jerk=100.0):
    distances = np.atleast_1d(np.asarray(distances, dtype=float))
    return plan_profiles(
        distances, np.full_like(distances, velocity), np.full_like(distances, jerk)
    )


def test_profiles_equal_those_that_ruckig_samples():
    distances = np.random.default_rng(0).uniform(-3.0, 3.0, 30)
    profiles = batch(distances)
    times = np.linspace(0.0, 1.0, 50) * profiles.duration[:, None]
    ours = profiles.evaluate(times)
    planner, request, plan = ruckig.Ruckig(1), ruckig.InputParameter(1), ruckig.Trajectory(1)
    request.max_velocity, request.max_jerk = [2.5], [100.0]
    request.max_acceleration = [float("inf")]
    for row, distance in enumerate(distances):
        request.target_position = [distance]
        planner.calculate(request, plan)
        assert plan.duration == pytest.approx(profiles.duration[row], abs=EXACT)
        reference = np.array([plan.at_time(t) for t in times[row]])[:, :, 0]
        np.testing.assert_allclose(np.stack([v[row] for v in ours], axis=1), reference, atol=1e-6)


@settings(max_examples=100, deadline=None)
@given(distance=st.floats(1e-3, 4.0), velocity=st.floats(0.1, 5.0), jerk=st.floats(5.0, 500.0))
def test_the_closed_form_of_a_jerk_limited_rest_to_rest_move(distance, velocity, jerk):
    profile = batch(distance, velocity, jerk)
    # Up to full speed and down again covers 2 v sqrt(v / j); a shorter move has four equal phases.
    full = 2.0 * velocity * np.sqrt(velocity / jerk)
    if distance >= full:
        expected = 4.0 * np.sqrt(velocity / jerk) + (distance - full) / velocity
        peak = velocity
    else:
        expected = 4.0 * np.cbrt(distance / (2.0 * jerk))
        peak = jerk * (expected / 4.0) ** 2
    assert profile.duration[0] == pytest.approx(expected, rel=1e-6)
    assert profile.peak_velocity[0] == pytest.approx(peak, rel=1e-6)


@settings(max_examples=50, deadline=None)
@given(distance=st.floats(-4.0, 4.0), velocity=st.floats(0.1, 5.0), jerk=st.floats(5.0, 500.0))
def test_a_move_starts_and_ends_at_rest_where_it_should(distance, velocity, jerk):
    profile = batch(distance, velocity, jerk)
    ends = np.array([[-1.0, 0.0, profile.duration[0], profile.duration[0] + 1.0]])
    position, rate, acceleration = profile.evaluate(ends)
    np.testing.assert_allclose(position[0], [0, 0, distance, distance], atol=EXACT)
    np.testing.assert_allclose(rate, 0.0, atol=1e-8)
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-6)


def test_a_mirrored_move_is_equal_to_the_last_bit():
    distances = np.random.default_rng(1).uniform(0.01, 3.0, 20)
    times = np.broadcast_to(np.linspace(0.0, 2.0, 40), (20, 40))
    for right, left in zip(
        batch(distances).evaluate(times), batch(-distances).evaluate(times), strict=True
    ):
        np.testing.assert_array_equal(right, -left)


def test_a_move_of_no_distance_takes_no_time():
    profile = batch([0.0, 1.0])
    assert profile.duration[0] == 0.0
    np.testing.assert_array_equal(profile.evaluate(np.zeros((2, 3)))[0][0], 0.0)


def test_a_dilated_move_passes_the_same_places_later():
    profile = batch([1.0, -0.2])
    slow = profile.dilated(np.array([1.0, 2.0]))
    times = np.linspace(0.0, 1.0, 20) * profile.duration[:, None]
    stretched = times * np.array([[1.0], [2.0]])
    np.testing.assert_allclose(slow.evaluate(stretched)[0], profile.evaluate(times)[0], atol=EXACT)
    np.testing.assert_allclose(slow.peak_velocity, profile.peak_velocity / [1.0, 2.0])


def test_a_profile_without_a_velocity_is_refused():
    with pytest.raises(InputError, match="no profile over"):
        batch(1.0, velocity=-1.0)
