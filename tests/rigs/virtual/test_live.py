"""The laboratory step by step is that of `RigVirtual`: equal trials end equally."""

import numpy as np
import pytest

pytest.importorskip("mujoco")

from cablecast.motion.polar import reset_pose
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.rigs.virtual.arm import LiveArm
from cablecast.rigs.virtual.laboratory import LiveCable

CONFIG = VirtualConfig(without=("arm",), segment_count=12, sensing="exact", thread_count=1)
DT, REST_TIME = 0.008, 2.5
# A controller hands on one set point after another, where RigVirtual knows the whole motion: what
# its servos do in between moved this landing by 1 mm.
LANDING_TOLERANCE = 0.01


@pytest.fixture
def home(setup):
    return setup.arm.inverse(np.asarray(reset_pose(setup.workspace), dtype=float))


def advance(arm, cable, count, is_reset=False):
    """Let time pass while the set point holds; return whether a cable was laid down."""
    laid = None
    for _ in range(count):
        at_rest = bool(np.abs(arm.qd).max() < 0.01)
        poses = arm.advance(round(DT / arm.dt))
        laid = cable.update(poses, at_rest, is_reset) or laid
    return laid


@pytest.fixture
def begun(setup, home):
    """Return an arm and a cable that was just laid down."""
    arm, cable = LiveArm(setup, home), LiveCable(setup, CONFIG, seed=0)
    arm.prepare(advance(arm, cable, 1))
    advance(arm, cable, round(CONFIG.reset_time / DT))
    return arm, cable


def test_a_cast_lands_where_the_virtual_rig_lands_in_the_same_trial(setup, cast, begun):
    arm, cable = begun
    for q in cast.joint_path.q:
        arm.command(q)
        advance(arm, cable, 1)
    advance(arm, cable, round(REST_TIME / DT))
    rig = RigVirtual(setup, 0, CONFIG)
    rig.reset()
    expected = rig.execute(cast).final_xy
    np.testing.assert_allclose(cable.nodes[-1, :2], expected, atol=LANDING_TOLERANCE)


def test_a_cable_is_laid_down_once_however_slowly_the_arm_comes_home(setup, home, begun):
    arm, cable = begun
    for turn in (0.3, 0.0):
        start = arm.q[0]
        for share in np.linspace(0.0, 1.0, 100):
            arm.command(home + [start - home[0] + share * (home[0] + turn - start), 0, 0, 0, 0, 0])
            advance(arm, cable, 1, is_reset=True)
    advance(arm, cable, 60, is_reset=True)
    assert cable.trial_count == 2


def test_a_cable_that_slipped_stays_short_until_it_is_gripped_anew(setup, begun):
    arm, cable = begun
    length = setup.cable.length

    def reach():
        return float(np.linalg.norm(cable.nodes[-1] - cable.nodes[0]))

    assert reach() == pytest.approx(length, rel=0.02)
    cable.slip()
    assert reach() == pytest.approx(0.8 * length, rel=0.02)
    advance(arm, cable, 5)
    cable.slip()
    assert reach() == pytest.approx(0.8 * length, rel=0.02)
    cable.grip_anew()
    advance(arm, cable, 1)
    assert reach() == pytest.approx(length, rel=0.02)
