import numpy as np
import pytest

from cablecast.arm.limits import JOINT_NAMES, JointLimits
from cablecast.errors import InputError


def test_the_default_limits_are_those_of_a_ur5_and_a_ur5e():
    limits = JointLimits()
    assert limits.position == (2 * np.pi,) * len(JOINT_NAMES)
    assert limits.velocity == (np.pi,) * len(JOINT_NAMES)
    assert limits.to_array().shape == (3, 6)


@pytest.mark.parametrize("values", [(1.0,) * 5, (1.0, 1.0, 1.0, 1.0, 1.0, -1.0), (np.nan,) * 6])
def test_limits_that_are_not_six_positive_numbers_are_refused(values):
    with pytest.raises(InputError, match="velocity limit"):
        JointLimits(velocity=values)
