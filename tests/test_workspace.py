import numpy as np
import pytest

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


def test_a_workspace_survives_the_way_through_plain_values():
    turned = Workspace(table_yaw_deg=90.0, table_near_y=-0.2, r_max=0.8)
    assert Workspace.from_dict(turned.to_dict()) == turned


def test_the_reach_is_that_of_the_arm_and_the_cable():
    assert WORKSPACE.reach(CABLE_LENGTH) == pytest.approx(1.56)


def test_the_paper_has_32_targets():
    targets = load_targets()
    assert targets.shape == (32, 2)
    assert len(np.unique(targets, axis=0)) == 32
