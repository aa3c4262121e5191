import dataclasses

import numpy as np
import pytest

from cablecast.arm.ur import JOINT_NAMES, LINKS, ArmUR, ur_limits
from cablecast.errors import InputError


def test_the_default_limits_are_those_of_a_ur5_and_a_ur5e():
    limits = ur_limits()
    assert limits.position == (2 * np.pi,) * len(JOINT_NAMES)
    assert limits.velocity == (np.pi,) * len(JOINT_NAMES)
    assert limits.to_array().shape == (3, 6)


@pytest.mark.parametrize("values", [(1.0,) * 5, (1.0, 1.0, 1.0, 1.0, 1.0, -1.0), (np.nan,) * 6])
def test_limits_that_are_not_six_positive_numbers_are_refused(values):
    with pytest.raises(InputError, match="velocity limit"):
        dataclasses.replace(ur_limits(), velocity=values)


# Masses of upper arm, forearm and each wrist joint [kg], and places of the centres of upper arm
# (along it, aside) and forearm (along it) [m], from the maker's "DH parameters for calculations of
# kinematics and dynamics"; torque of the base joint [N m] from his "Max. joint torques".
DYNAMICS = {
    "ur3": ((3.42, 1.26, 0.8, 0.8, 0.35), (0.11365, 0.1157, 0.16325), 56.0),
    "ur5": ((8.393, 2.33, 1.219, 1.219, 0.1879), (0.2125, 0.11336, 0.24225), 150.0),
    "ur10": ((12.7, 4.27, 2.0, 2.0, 0.365), (0.232, 0.158, 0.3323), 330.0),
}
GRIPPER = 1.0


@pytest.mark.parametrize("model", DYNAMICS)
def test_the_base_joint_spends_at_most_sixty_per_cent_of_its_torque(model):
    (upper, forearm, *wrists), (along, aside, beyond), torque = DYNAMICS[model]
    links = LINKS[model]
    reach = links.upper_arm + links.forearm
    # Each link as a point at its centre and, for the long ones, as a thin rod about it.
    inertia = upper * (along**2 + aside**2 + links.upper_arm**2 / 12)
    inertia += forearm * ((links.upper_arm + beyond) ** 2 + links.forearm**2 / 12)
    inertia += (sum(wrists) + GRIPPER) * (reach**2 + links.d4**2)
    share = ur_limits(model).acceleration[0] * inertia / torque
    assert 0.2 < share < 0.6


@pytest.mark.parametrize(
    ("model", "velocity"), [("ur3e", (180, 360)), ("ur5e", (180, 180)), ("ur10e", (120, 180))]
)
def test_each_model_has_the_speeds_of_its_manual_unless_they_are_given(model, velocity):
    limits = ArmUR(model=model).limits
    assert np.degrees(limits.velocity)[[0, 5]] == pytest.approx(velocity)
    assert ArmUR.from_dict({"model": model}).limits == limits
    given = ArmUR.from_dict({"model": model, "limits": {"position": [3.0] * 6}}).limits
    assert given.position == (3.0,) * 6
    assert given.velocity == limits.velocity
    assert ArmUR.from_dict(ArmUR(model=model).to_dict()).limits == limits


def test_limits_in_degrees_are_beyond_their_bounds():
    with pytest.raises(InputError, match=r"arm position limit = 360 rad is outside \[0\.001, 30\]"):
        dataclasses.replace(ur_limits(), position=(360.0,) * 6)
