import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cablecast.conventions import (
    STREAMS,
    Ellipse,
    mirror_xy,
    polar_to_xy,
    side_of,
    stream,
    tangent,
    xy_to_polar,
)

# A few operations on doubles of order one.
EXACT = 1e-12


def test_theta_is_measured_from_the_y_axis_positive_to_the_right():
    np.testing.assert_allclose(polar_to_xy([2.0, 0.0]), [0.0, 2.0], atol=EXACT)
    np.testing.assert_allclose(polar_to_xy([2.0, np.pi / 2]), [2.0, 0.0], atol=EXACT)
    np.testing.assert_allclose(xy_to_polar([-1.0, 0.0]), [1.0, -np.pi / 2], atol=EXACT)


@given(r=st.floats(0.01, 5.0), theta=st.floats(-3.1, 3.1))
def test_polar_coordinates_survive_the_way_through_cartesian_ones(r, theta):
    np.testing.assert_allclose(xy_to_polar(polar_to_xy([r, theta])), [r, theta], atol=EXACT)


def test_whole_batches_are_converted_at_once():
    polar = np.random.default_rng(0).uniform(0.1, 1.0, (4, 3, 2))
    assert polar_to_xy(polar).shape == (4, 3, 2)
    np.testing.assert_array_equal(polar_to_xy(polar)[2, 1], polar_to_xy(polar[2, 1]))


def test_mirroring_negates_theta_and_leaves_its_argument_alone():
    xy = polar_to_xy([1.2, 0.4])
    before = xy.copy()
    np.testing.assert_allclose(xy_to_polar(mirror_xy(xy)), [1.2, -0.4], atol=EXACT)
    np.testing.assert_array_equal(xy, before)
    np.testing.assert_array_equal(mirror_xy([[1.0, 2.0, 3.0]]), [[-1.0, 2.0, 3.0]])


def test_only_points_on_the_left_are_mirrored_to_the_right():
    xy = np.array([[0.3, 1.0], [-0.2, 0.9], [0.0, 1.1]])
    np.testing.assert_array_equal(side_of(xy), [1.0, -1.0, 1.0])
    np.testing.assert_array_equal(mirror_xy(xy, side_of(xy)), [[0.3, 1.0], [0.2, 0.9], [0.0, 1.1]])
    np.testing.assert_array_equal(mirror_xy(xy[0], [1.0, -1.0]), [[0.3, 1.0], [-0.3, 1.0]])


def test_the_cable_leaves_along_its_yaw_and_rises_with_its_pitch():
    np.testing.assert_allclose(tangent(0.0), [0.0, 1.0, 0.0], atol=EXACT)
    np.testing.assert_allclose(tangent(np.pi / 2), [1.0, 0.0, 0.0], atol=EXACT)
    np.testing.assert_allclose(tangent(0.3, np.pi / 2), [0.0, 0.0, 1.0], atol=EXACT)
    np.testing.assert_allclose(np.linalg.norm(tangent(np.linspace(-3, 3, 9), 0.4), axis=-1), 1.0)


def test_the_outline_of_an_ellipse_lies_at_its_distance_and_its_longer_axis_comes_first():
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    covariance = turn @ np.diag([0.04**2, 0.01**2]) @ turn.T
    ellipse = Ellipse.of_covariance([0.2, 0.9], covariance, 4.0)
    np.testing.assert_allclose(ellipse.semi_axes, [0.08, 0.02])
    assert np.tan(ellipse.angle) == pytest.approx(0.8 / 0.6)
    offset = ellipse.outline() - [0.2, 0.9]
    np.testing.assert_allclose(np.sum(offset @ np.linalg.inv(covariance) * offset, axis=1), 4.0)
    np.testing.assert_allclose(offset[0], offset[-1], atol=EXACT)


@pytest.mark.parametrize("seed", [0, 1, 2**32 - 1])
def test_a_stream_is_that_of_its_number_and_its_seed(seed):
    for name, number in STREAMS.items():
        drawn = stream(seed, name).integers(2**32, size=4)
        wanted = np.random.default_rng([seed, number] if number else seed)
        np.testing.assert_array_equal(drawn, wanted.integers(2**32, size=4))


def test_streams_that_share_a_number_are_known():
    numbers = list(STREAMS.values())
    shared = {name for name, number in STREAMS.items() if numbers.count(number) > 1}
    assert {number for name, number in STREAMS.items() if name in shared} == {0, 1, 3}
