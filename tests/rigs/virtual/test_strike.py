"""The strike laboratory: physics of its cable, what it repeats, and what its camera sees."""

import dataclasses

import numpy as np
import pytest

from cablecast.cast import TrialStatus
from cablecast.errors import InputError, RigError
from cablecast.motion.joint_move import JointMoves, SwingPlane
from cablecast.motion.trajectory import joints_at, plan_trajectory
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.make import make_rig
from cablecast.rigs.virtual._hidden_strike import SwingNoise
from cablecast.rigs.virtual.config import TrialNoise
from cablecast.rigs.virtual.strike import DT, RECORD_STEPS, RigStrike, StrikeLabConfig, _World
from cablecast.setup import Setup, StrikeConfig

pytest.importorskip("mujoco")

SETUP = Setup(strike=StrikeConfig(watch_time=1.6))
MOVES = JointMoves.of(SETUP)
PLANE = SwingPlane.of(MOVES)
UNIT = np.array([0.7, 0.6, 0.6])
SILENT = StrikeLabConfig(
    noise=SwingNoise(sway=0.0, air=0.0, curl=0.0, slip=0.0), arm=TrialNoise.none(), exact=True
)
# A chain of 28 pieces is a continuous pendulum to a per cent.
PERIOD_TOLERANCE = 0.03
# The laboratory's camera errs by some millimetres where a tip is slow, and by its blur elsewhere.
SEEN_TOLERANCE = 0.012
# Equal swings differ by more than this [m].
SCATTER_LOW = 1e-4
# Joints are held to what the rotors' inertia allows against the pull of a cable.
HELD_TOLERANCE = 1e-4


def swing(rig, unit=UNIT, index=0):
    rig.seek(index, "aim")
    rig.reset()
    return rig.execute(plan_trajectory(MOVES.move(unit), SETUP))


@pytest.fixture(scope="module")
def rig():
    return RigStrike(SETUP)


@pytest.fixture(scope="module")
def track(rig):
    """Return the first swing of a laboratory as it is."""
    return swing(rig)


@pytest.fixture(scope="module")
def silent():
    return RigStrike(SETUP, config=SILENT)


@pytest.fixture(scope="module")
def exact(silent):
    """Return the same swing without noise."""
    return swing(silent)


def test_the_cable_hangs_straight_down_from_the_stick(exact):
    nodes = exact.nodes[0]
    root = MOVES.stick.root(MOVES.arm.frames(np.array(MOVES.start))[-1])
    np.testing.assert_allclose(nodes[0], root, atol=5e-3)
    np.testing.assert_allclose(nodes[-1, :2], root[:2], atol=0.03)
    assert root[2] - nodes[-1, 2] == pytest.approx(SETUP.cable.length, rel=0.01)


def test_a_cable_that_was_pushed_swings_with_the_period_of_a_hanging_chain_with_a_weight():
    """J0 of a chain alone: 2 pi / (1.2024 sqrt(g / l)); a weight at its end makes it longer."""
    cable = dataclasses.replace(
        SETUP.cable,
        name="chain",
        attachment=type(SETUP.cable.attachment).NONE,
        attachment_length=0.0,
        params=dataclasses.replace(
            SETUP.cable.params, bend_stiffness=1e-6, twist_stiffness=1e-6, endpoint_mass=0.0
        ),
    )
    setup = dataclasses.replace(SETUP, cable=cable)
    world = _World(setup, JointMoves.of(setup), 0)
    world.model.opt.density = world.model.opt.viscosity = 0.0
    world.model.qpos_spring[:] = 0.0
    world._rest = np.zeros_like(world._rest)
    world.model.dof_frictionloss[:] = 0.0
    still = np.repeat(np.array(MOVES.start)[None], round(4.0 / DT), axis=0)
    noise = SwingNoise(sway=0.01, air=0.0, curl=0.0, slip=0.0)
    nodes, broken = world.swing(still, noise, np.random.default_rng(1))
    assert not broken
    offset = nodes[:, -1, 1] - nodes[:, -1, 1].mean()
    crossings = np.flatnonzero(np.diff(np.sign(offset)) != 0)
    period = 2.0 * DT * RECORD_STEPS * np.mean(np.diff(crossings))
    expected = 2.0 * np.pi / (1.2024 * np.sqrt(9.81 / cable.length))
    assert period == pytest.approx(expected, rel=PERIOD_TOLERANCE)


def test_the_joints_of_the_world_are_where_the_servos_bring_them(exact):
    trajectory = plan_trajectory(MOVES.move(UNIT), SETUP)
    reported = exact.joint_path
    root = MOVES.stick.root(MOVES.arm.frames(joints_at(reported, exact.times))[-1])
    # The stick sways: its end is within a centimetre or two of where the joints put it.
    assert np.linalg.norm(exact.nodes[:, 0] - root, axis=1).max() < 0.03
    assert np.abs(reported.q[0] - trajectory.joint_path.q[0]).max() < HELD_TOLERANCE


def test_equal_draws_give_equal_swings_and_others_and_other_laboratories_others(rig, track):
    again, other = swing(rig), swing(rig, index=1)
    np.testing.assert_array_equal(track.nodes, again.nodes)
    count = min(len(track.nodes), len(other.nodes))
    gap = np.linalg.norm(track.nodes[: count // 2, -1] - other.nodes[: count // 2, -1], axis=1)
    # Frames of two swings are at other times.
    assert gap.max() > SCATTER_LOW
    elsewhere = swing(RigStrike(SETUP, config=StrikeLabConfig(lab_seed=1)))
    assert not np.array_equal(track.nodes[:20], elsewhere.nodes[:20])


def test_equal_swings_without_noise_are_equal_and_seen_exactly(silent, exact):
    np.testing.assert_array_equal(exact.nodes, swing(silent, index=5).nodes)
    np.testing.assert_array_equal(exact.path, exact.nodes[:, -1])


def test_the_camera_sees_the_tip_in_the_plane_to_a_centimetre(track):
    seen = np.isfinite(track.path).all(axis=1)
    off = PLANE.coordinates(track.path[seen]) - PLANE.coordinates(track.nodes[seen, -1])
    assert np.median(np.linalg.norm(off[:, :2], axis=1)) < SEEN_TOLERANCE
    np.testing.assert_allclose(PLANE.coordinates(track.path[seen])[:, 2], 0.0, atol=1e-9)
    assert np.all(np.diff(track.times) > 0.0)
    assert np.isfinite(track.path[-1]).all()


def test_a_path_ends_when_the_cable_touches_the_arm(silent):
    # The elbow turns up and back: the cable comes down on the forearm.
    track = swing(silent, np.array([0.7, 1.0, 0.5]))
    assert track.status is TrialStatus.OK
    assert track.times[-1] < SETUP.strike.watch_time - 0.05


@pytest.mark.parametrize("cable", ["cable_2", "cable_3"])
def test_light_strings_and_wires_with_a_magnet_swing_as_well(cable):
    setup = Setup(cable=cable, strike=SETUP.strike)
    rig = make_rig("virtual", setup)
    rig.reset()
    track = rig.execute(plan_trajectory(MOVES.move(UNIT), setup))
    assert isinstance(rig, CheckedRig)
    assert track.status is TrialStatus.OK
    assert len(track.times) > 60


def test_a_motion_without_joints_and_a_swing_without_reset_are_refused(rig):
    trajectory = plan_trajectory(MOVES.move(UNIT), SETUP)
    with pytest.raises(RigError, match="must be reset"):
        rig.execute(trajectory)
    rig.reset()
    with pytest.raises(RigError, match="needs the joints"):
        rig.execute(dataclasses.replace(trajectory, joint_path=None))


def test_a_set_up_without_a_strike_section_is_refused():
    with pytest.raises(InputError, match="no strike section"):
        RigStrike(Setup())


def test_a_rig_whose_track_has_no_heights_is_refused(track):
    class Flat:
        description: dict = {}  # noqa: RUF012

        def reset(self):
            pass

        close = reset

        def execute(self, trajectory):
            return dataclasses.replace(track, endpoint_z=None)

    flat = CheckedRig(Flat(), SETUP)
    flat.reset()
    with pytest.raises(RigError, match="no endpoint_z, the height of the tip"):
        flat.execute(plan_trajectory(MOVES.move(UNIT), SETUP))


def test_the_joints_of_a_move_that_lasts_longer_than_the_tip_is_watched_are_reported_to_its_end():
    rig = make_rig("virtual", SETUP)
    slow = plan_trajectory(MOVES.move(np.array([0.0, 1.0, 0.5])), SETUP)
    assert slow.duration > SETUP.strike.watch_time
    rig.reset()
    track = rig.execute(slow)
    assert track.joint_path.times[-1] >= slow.duration
    assert track.times[-1] <= SETUP.strike.watch_time + DT
