import numpy as np
import pytest

from cablecast.errors import TargetError
from cablecast.workspace import Workspace, load_targets

WORKSPACE = Workspace()
CABLE_LENGTH = 0.62


def test_the_table_is_that_of_the_paper():
    corners = [[1.375, 1.5], [-1.375, 0.0], [1.376, 0.5], [0.0, 1.501], [0.0, -0.001]]
    np.testing.assert_array_equal(WORKSPACE.on_table(corners), [True, True, False, False, False])


def test_a_point_that_is_not_known_is_not_on_the_table():
    assert not WORKSPACE.on_table([np.nan, 0.5])


def test_the_reach_is_that_of_the_arm_and_the_cable():
    assert WORKSPACE.reach(CABLE_LENGTH) == pytest.approx(1.56)


def test_the_paper_has_32_targets_and_all_can_be_asked_for():
    targets = load_targets()
    assert targets.shape == (32, 2)
    assert len(np.unique(targets, axis=0)) == 32
    np.testing.assert_array_equal(WORKSPACE.check_target(targets, CABLE_LENGTH), targets)


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ([np.nan, 1.0], "is not finite"),
        ([0.0, np.inf], "is not finite"),
        (
            [1.2, 1.2],
            r"r = 1\.697 m, theta = 45\.0 deg is out of reach: r must be at most 1\.560 m",
        ),
        ([0.0, 1.55], r"off the table.*y = 1\.550"),
        ([1.4, 0.1], r"off the table.*x = 1\.400"),
        ([0.5, -0.1], "off the table"),
    ],
)
def test_a_target_that_cannot_be_is_refused_with_its_bound(target, message):
    with pytest.raises(TargetError, match=message):
        WORKSPACE.check_target(target, CABLE_LENGTH)


def test_one_bad_target_among_good_ones_is_found():
    with pytest.raises(TargetError, match="out of reach"):
        WORKSPACE.check_target([[0.2, 1.0], [0.0, 9.0]], CABLE_LENGTH)
