import numpy as np
import pytest

from cablecast.errors import InputError, TargetError
from cablecast.workspace import Workspace, load_targets

WORKSPACE = Workspace()
CABLE_LENGTH = 0.62


def test_the_table_is_that_of_the_paper():
    corners = [[1.375, 1.5], [-1.375, 0.0], [1.376, 0.5], [0.0, 1.501], [0.0, -0.001]]
    np.testing.assert_array_equal(WORKSPACE.on_table(corners), [True, True, False, False, False])


def test_a_point_that_is_not_known_is_not_on_the_table():
    assert not WORKSPACE.on_table([np.nan, 0.5])
    assert np.isnan(WORKSPACE.edge_distance([np.nan, 0.5]))


@pytest.mark.parametrize("turn", [90.0, -90.0, 270.0])
def test_a_table_turned_by_a_quarter_swaps_width_and_depth_and_keeps_its_near_edge(turn):
    turned = Workspace(table_width=2.0, table_depth=1.2, table_yaw_deg=turn, table_near_y=-0.1)
    assert (turned.half_width, turned.y_min, turned.y_max) == (0.6, -0.1, 1.9)
    corners = [[0.6, 1.9], [-0.6, -0.1], [0.601, 0.5], [0.0, 1.901], [0.0, -0.101]]
    np.testing.assert_array_equal(turned.on_table(corners), [True, True, False, False, False])


def test_a_table_turned_by_a_half_is_the_same_table():
    turned = Workspace(table_yaw_deg=180.0)
    assert (turned.half_width, turned.y_min, turned.y_max) == (1.375, 0.0, 1.5)


def test_the_edge_distance_is_that_of_the_nearest_edge_and_negative_beyond_it():
    turned = Workspace(table_width=2.0, table_depth=1.2, table_yaw_deg=90.0)
    points = [[0.5, 1.0], [-0.5, 1.0], [0.0, 1.95], [0.0, 0.2], [0.7, 1.0], [0.0, 2.3]]
    np.testing.assert_allclose(turned.edge_distance(points), [0.1, 0.1, 0.05, 0.2, -0.1, -0.3])


def test_targets_beyond_the_side_of_a_turned_table_are_refused_with_its_edges():
    turned = Workspace(table_width=2.0, table_depth=1.2, table_yaw_deg=90.0)
    np.testing.assert_array_equal(
        turned.check_targets([0.5, 1.2], cable_length=CABLE_LENGTH), [[0.5, 1.2]]
    )
    with pytest.raises(TargetError, match=r"\|x\| <= 0\.6 m and 0 <= y <= 2 m.*x = 0\.700"):
        turned.check_targets([0.7, 1.0], cable_length=CABLE_LENGTH)


def test_a_workspace_survives_the_way_through_plain_values():
    turned = Workspace(table_yaw_deg=90.0, table_near_y=-0.2, r_max=0.8)
    assert Workspace.from_dict(turned.to_dict()) == turned


def test_the_reach_is_that_of_the_arm_and_the_cable():
    assert WORKSPACE.reach(CABLE_LENGTH) == pytest.approx(1.56)


def test_the_paper_has_32_targets_and_all_can_be_asked_for():
    targets = load_targets()
    assert targets.shape == (32, 2)
    assert len(np.unique(targets, axis=0)) == 32
    np.testing.assert_array_equal(
        WORKSPACE.check_targets(targets, cable_length=CABLE_LENGTH), targets
    )


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({}, "either target_xy or r and theta_deg"),
        ({"target_xy": [0.0, 1.0], "r": 1.0, "theta_deg": 0.0}, "either target_xy or r"),
        ({"target_xy": [0.0, 1.0], "r": 1.0}, "either target_xy or r"),
        ({"r": 1.0}, "both r and theta_deg"),
        ({"theta_deg": 1.0}, "both r and theta_deg"),
        ({"r": "far", "theta_deg": 1.0}, "r = 'far' must be numbers"),
        ({"r": [1.0, 1.1], "theta_deg": [0.0, 1.0, 2.0]}, "which do not match"),
        ({"r": [[1.0]], "theta_deg": 0.0}, r"it must be \[target\]"),
        ({"target_xy": [0.0, 1.0, 2.0]}, r"shape \(3,\): it must be \[2\] or \[target, 2\]"),
        ({"target_xy": np.zeros((1, 1, 2))}, r"it must be \[2\] or \[target, 2\]"),
        ({"target_xy": "there"}, "target_xy = 'there' must be numbers"),
        ({"target_xy": 1.0}, r"it must be \[2\]"),
    ],
    ids=str,
)
def test_targets_in_another_form_are_refused(asked, words):
    with pytest.raises(InputError, match=words) as caught:
        WORKSPACE.check_targets(**asked, cable_length=CABLE_LENGTH)
    assert not isinstance(caught.value, TargetError)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"r": -1.0, "theta_deg": 180.0}, "r = -1 m must not be negative"),
        ({"r": np.nan, "theta_deg": 0.0}, "r = nan m, theta = 0 deg must be finite"),
        ({"r": 1.0, "theta_deg": np.inf}, "theta = inf deg must be finite"),
        ({"r": [1.0, np.inf], "theta_deg": 0.0}, "r = inf m"),
        ({"target_xy": [np.nan, 1.0]}, "is not finite"),
        ({"target_xy": [0.0, np.inf]}, "is not finite"),
        (
            {"target_xy": [1.2, 1.2]},
            r"r = 1\.697 m, theta = 45\.0 deg is out of reach: r must be at most 1\.560 m",
        ),
        ({"r": 1.7, "theta_deg": 0.0}, "out of reach"),
        ({"target_xy": [0.0, 1.55]}, r"off the table.*y = 1\.550"),
        ({"target_xy": [1.4, 0.1]}, r"off the table.*x = 1\.400"),
        ({"target_xy": [0.5, -0.1]}, "off the table"),
        ({"target_xy": [[0.2, 1.0], [0.0, 9.0]]}, "out of reach"),
    ],
    ids=str,
)
def test_targets_that_no_motion_can_reach_are_refused(asked, words):
    with pytest.raises(TargetError, match=words):
        WORKSPACE.check_targets(**asked, cable_length=CABLE_LENGTH)
