"""The physics of the virtual laboratory, and what its seeds decide."""

import dataclasses

import numpy as np
import pytest

from cablecast.cable import CABLE_NAMES, Attachment, load_cable
from cablecast.cast import TrialStatus
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath
from cablecast.motion.trajectory import Trajectory
from cablecast.setup import Setup
from cablecast.workspace import Workspace

pytest.importorskip("mujoco")

from cablecast.rigs.virtual import RigVirtual, TrialNoise, VirtualConfig, laboratory
from cablecast.rigs.virtual._hidden import EFFECTS, HiddenTable, hidden_cable
from cablecast.rigs.virtual.scene import build_scene
from cablecast.rigs.virtual.trials import ASIDE_MAX, Trial, reset_shape

# A table far behind the robot: the cable hangs free above the floor, and touches nothing.
IN_THE_AIR = Workspace(grip_height=0.5, table_near_y=-5.0, table_depth=0.3)
# The rod, the table and the arm alone; test_effects.py has the effects.
QUICK = VirtualConfig(without=EFFECTS, segment_count=16, dt=1e-3, sensing="exact")
SILENT = dataclasses.replace(QUICK, noise=TrialNoise.none())
# Where two trials are compared, how a cable comes to rest proves nothing.
BRIEF = dataclasses.replace(QUICK, segment_count=10, dt=2e-3, reset_time=0.1, rest_time_max=0.2)
BRIEF_SILENT = dataclasses.replace(BRIEF, noise=TrialNoise.none())
# Contacts give way by micrometres; half a millimetre would be a cable that sinks in.
CONTACT_DEPTH = 5e-4
# The solver treats left and right in another order, and a whip magnifies rounding a little.
MIRROR_TOLERANCE = 1e-4

# Between two reported joints, 8 ms apart, the gripper goes up to a few millimetres round a curve.
INTERPOLATION = 1e-3
GRAVITY = 9.81
# Part of the energy that a falling cable sets free; a step's rounding, and nothing else, adds any.
ENERGY_GAIN = 1e-4
# The hand yields by micrometres to the weight that is suddenly there, and the attachment turns by
# an explicit rule: at the very first steps this is seen.
ENERGY_GAIN_TIP = 3e-3


def play(rig, trajectory):
    rig.reset()
    return rig.execute(trajectory)


def test_a_trial_is_the_same_bit_for_bit_whatever_is_played_beside_it_and_with_any_threads(
    setup, cast, small_cast
):
    threads = [dataclasses.replace(BRIEF, thread_count=count) for count in (2, 1)]
    together = RigVirtual(setup, 3, threads[0]).execute_many([small_cast, cast, small_cast])
    alone = RigVirtual(setup, 3, threads[1])
    tracks = [play(alone, small_cast), play(alone, cast)]
    for track, other in zip(tracks, together, strict=False):
        np.testing.assert_array_equal(track.nodes, other.nodes)
        # Reports of the shorter motion last as long as the longest one beside it.
        q = track.joint_path.q
        np.testing.assert_array_equal(q, other.joint_path.q[: len(q)])
    # Another trial, or another seed, has another luck.
    assert not np.array_equal(together[2].final_xy, together[0].final_xy)
    other = play(RigVirtual(setup, 4, BRIEF), small_cast)
    assert not np.array_equal(other.final_xy, together[0].final_xy)


def test_equal_motions_scatter_by_some_per_cent_and_not_at_all_without_noise(setup, cable, cast):
    landings = [
        [track.final_xy for track in RigVirtual(setup, 0, config).execute_many([cast] * count)]
        for config, count in ((BRIEF, 3), (BRIEF_SILENT, 2))
    ]
    scatter, none = (np.ptp(xy, axis=0).max() / cable.length for xy in landings)
    assert 0.001 < scatter < 0.2
    assert none == 0.0


def test_a_mirrored_motion_ends_mirrored_on_an_even_table_with_an_even_cable(
    setup, cast, monkeypatch
):
    def even(cable, lab_seed, strengths):
        return dataclasses.replace(
            hidden_cable(cable, lab_seed, strengths), curl=0.0, endpoint_offset=0.0
        )

    monkeypatch.setattr(laboratory, "hidden_cable", even)
    bare = dataclasses.replace(
        setup, cable=dataclasses.replace(setup.cable, attachment=Attachment.NONE)
    )
    right = Trajectory(action=None, grip_path=cast.grip_path, joint_path=None)
    left = Trajectory(action=None, grip_path=cast.grip_path.mirrored(), joint_path=None)
    uneven = RigVirtual(bare, 0, BRIEF_SILENT).execute_many([right, left])
    monkeypatch.setattr(
        laboratory,
        "hidden_table",
        lambda seed, strengths: HiddenTable(seed=seed, wear=0, board=0, seam=0),
    )
    tracks = RigVirtual(bare, 0, BRIEF_SILENT).execute_many([right, left])
    landings = [track.final_xy for track in tracks]
    np.testing.assert_allclose(landings[1] * [-1, 1], landings[0], atol=MIRROR_TOLERANCE)
    # The true table is not even: both sides differ by more than that, and by less than a cast.
    apart = np.linalg.norm(uneven[1].final_xy * [-1, 1] - uneven[0].final_xy)
    assert 5 * MIRROR_TOLERANCE < apart < 0.1


def test_the_arm_reports_joints_that_carry_the_cable_where_it_is_gripped(setup, small_cast):
    track = play(RigVirtual(setup, 0, BRIEF_SILENT), small_cast)
    times, q = track.joint_path.times, track.joint_path.q
    grip = setup.arm.grip_pose(q)[:, :2]
    seen = track.times[track.times <= times[-1]]
    there = np.stack([np.interp(seen, times, grip[:, axis]) for axis in (0, 1)], axis=1)
    np.testing.assert_allclose(track.nodes[: len(seen), 0, :2], there, atol=INTERPOLATION)
    # The command itself was elsewhere on the way.
    commanded = small_cast.grip_path.evaluate(seen)[0, :, :2]
    assert np.abs(commanded - there).max() > 10 * INTERPOLATION


def test_a_cable_that_only_sweeps_past_the_edge_has_landed(setup, workspace):
    pose = np.array([0.0, workspace.reset_y, workspace.grip_height, 0.0, 0.0])
    times = np.linspace(0.0, 2.0, 40)
    poses = np.repeat(pose[None], len(times), axis=0)
    # Towards the far edge until the tip hangs over it, and back.
    poses[:, 1] += 0.36 * np.sin(np.pi * times / times[-1]) ** 2
    there = Trajectory(action=None, grip_path=GripPath.fit(times, poses), joint_path=None)
    # Only a straight cable can be pushed.
    track = play(RigVirtual(setup, 0, SILENT), there)
    assert track.endpoint_xy[:, 1].max() > workspace.y_max
    assert track.status is TrialStatus.OK


def test_a_motion_that_no_simulation_survives_is_marked_and_leaves_no_log_file(
    setup, workspace, small_cast, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    times = np.linspace(0.0, 0.4, 30)
    poses = np.zeros((len(times), 5))
    poses[:, 1:3] = workspace.reset_y, workspace.grip_height
    poses[15:, 0] = 400.0
    jump = Trajectory(action=None, grip_path=GripPath.fit(times, poses), joint_path=None)
    tracks = RigVirtual(setup, 0, BRIEF).execute_many([jump, small_cast])
    assert tracks[0].status in (TrialStatus.NON_FINITE, TrialStatus.OFF_TABLE)
    assert tracks[1].status is TrialStatus.OK
    assert not list(tmp_path.iterdir())


def test_a_cable_that_is_only_held_lies_still_on_the_table(setup, cable, workspace):
    pose = [0.0, workspace.reset_y, workspace.grip_height, 0.0, 0.0]
    hold = Trajectory(action=None, grip_path=GripPath.hold(pose, 1.0), joint_path=None)
    track = play(RigVirtual(setup, 0, VirtualConfig()), hold)
    assert track.status is TrialStatus.OK
    # It rests as soon as it may: the trial ends with the first sample after the motion.
    assert track.times[-1] <= 1.2 + 1e-9
    assert np.ptp(track.nodes, axis=0).max() < 1e-3
    assert track.nodes[..., 2].min() > cable.radius - CONTACT_DEPTH
    # The free half lies on the table and does not hover.
    half = track.nodes.shape[1] // 2
    assert track.nodes[-1, half:, 2].max() < cable.radius + CONTACT_DEPTH


@pytest.mark.parametrize("name", ["cable_2", "cable_3"])
def test_thin_and_stiff_cables_swing_out_and_come_to_rest_on_the_table(name, wide_cast):
    setup = Setup(cable=name)
    cable = setup.cable
    # In the first laboratories this cast carries cable 2 off the table.
    track = play(RigVirtual(setup, 0, dataclasses.replace(QUICK, lab_seed=2)), wide_cast)
    assert track.status is TrialStatus.OK
    length = np.linalg.norm(np.diff(track.nodes, axis=1), axis=-1).sum(axis=1)
    np.testing.assert_allclose(length, cable.length, rtol=0.01)
    # The tip swings from straight ahead over to the left, then far to the right, and stops before
    # the time is up.
    assert track.endpoint_xy[:, 0].min() < -0.05
    assert track.endpoint_xy[:, 0].max() > 0.4
    assert track.times[-1] < wide_cast.duration + QUICK.rest_time_max - 0.5


def test_a_cable_that_falls_off_the_edge_hangs_below_the_table(setup, workspace):
    pose = np.array([0.0, workspace.reset_y, workspace.grip_height, 0.0, 0.0])
    times = np.linspace(0.0, 2.0, 30)
    poses = np.repeat(pose[None], len(times), axis=0)
    u = times / times[-1]
    poses[:, 1] += 0.6 * u**3 * (10 - 15 * u + 6 * u**2)
    push = Trajectory(action=None, grip_path=GripPath.fit(times, poses), joint_path=None)
    # Only a straight cable can be pushed.
    track = play(RigVirtual(setup, 0, SILENT), push)
    assert track.status is TrialStatus.OFF_TABLE
    assert track.nodes[-1, -1, 2] < -0.1


def test_settings_out_of_bounds_are_refused_by_name(setup):
    with pytest.raises(InputError, match=r"dt = 0\.01 s is outside"):
        VirtualConfig(dt=0.01)
    with pytest.raises(InputError, match="segment_count = 1 "):
        VirtualConfig(segment_count=1)
    with pytest.raises(InputError, match="friction = -1"):
        TrialNoise(friction=-1)
    with pytest.raises(InputError, match="seed = -1"):
        RigVirtual(setup, -1)


def test_a_cable_that_swings_down_from_a_height_never_gains_energy(cable):
    import mujoco

    # No contact takes or hides energy. The softest cable folds most.
    truth = dataclasses.replace(hidden_cable(cable, 0, {}), bend_stiffness=1e-5)
    bare = dataclasses.replace(cable, attachment=Attachment.NONE)
    scene = build_scene(bare, truth, IN_THE_AIR, 16, 1e-3)
    data = mujoco.MjData(scene.model)
    mass = scene.masses[2:].copy()
    mass[-1] += truth.endpoint_mass
    energy, stretch = [], []
    for _ in range(1000):
        mujoco.mj_step(scene.model, data)
        height = data.qpos[scene.vertex_slice].reshape(-1, 3)[:, 2]
        speed_squared = (data.qvel[scene.vertex_slice].reshape(-1, 3) ** 2).sum(axis=1)
        energy.append((mass * (GRAVITY * height + speed_squared / 2)).sum())
        stretch.append(data.flexedge_length.sum() / scene.arc_lengths[-1] - 1.0)
    fall = GRAVITY * (mass * scene.arc_lengths[2:]).sum()
    assert max(energy) < ENERGY_GAIN * fall
    # It swings through the bottom and up again: by then it has moved, and kept most of its energy.
    assert min(energy) > -0.4 * fall
    assert np.abs(stretch).max() < 0.01


@pytest.mark.parametrize("name", ["cable_1", "cable_3"])
def test_a_hook_or_a_magnet_that_falls_with_its_cable_never_gains_energy(name):
    import mujoco

    cable = load_cable(name)
    truth = hidden_cable(cable, 0, {})
    scene = build_scene(cable, truth, IN_THE_AIR, 16, 1e-3)
    scene.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(scene.model)
    energy = []
    for _ in range(800):
        mujoco.mj_step(scene.model, data)
        # Both are those of the state before the step.
        height = (scene.model.body_mass[2:] * data.xipos[2:, 2]).sum()
        energy.append(GRAVITY * height + data.energy[1])
    fall = GRAVITY * (truth.mass / 2 + truth.endpoint_mass) * cable.length
    assert max(energy) < energy[0] + ENERGY_GAIN_TIP * fall
    assert min(energy) > energy[0] - 0.4 * fall
    # The attachment has swung down, and turned with the end of its cable.
    quaternion = data.qpos[scene.tip_slice]
    assert abs(np.linalg.norm(quaternion) - 1.0) < 1e-9
    assert abs(quaternion[0]) < 0.95


def test_a_hook_set_on_its_edge_falls_to_its_side_and_its_cable_stays(cable, workspace):
    scene = build_scene(cable, hidden_cable(cable, 0, {}), workspace, 30, 1e-3)
    data = rest_on_table(scene, cable)
    data.qpos[scene.tip_slice] = [np.cos(0.6), 0.0, -np.sin(0.6), 0.0]
    tip = tip_height(scene, data)
    settle(scene, data, 0.5)
    assert tip > 0.012
    assert tip_height(scene, data) < 0.007


def test_a_magnet_that_still_turns_rolls_the_end_of_a_cable_at_rest_aside(workspace):
    cable = load_cable("cable_3")
    truth = hidden_cable(cable, 0, {})
    scene = build_scene(cable, truth, workspace, 30, 1e-3)
    data = rest_on_table(scene, cable)
    settle(scene, data, 0.5)
    before = end_of_cable(scene, data)
    disc = scene.vertex_slice.stop + 3
    # Its rim is as fast as the end of a cable in the middle of a cast.
    data.qvel[disc] = 0.54 / truth.endpoint_radius
    settle(scene, data, 0.5)
    moved = end_of_cable(scene, data) - before
    assert abs(moved[0]) > 0.002
    assert abs(moved[1]) < 0.002


@pytest.mark.parametrize("name", CABLE_NAMES)
def test_a_trial_begins_with_the_cable_on_the_table_and_nearly_straight_ahead(name):
    cable = load_cable(name)
    spread = hidden_cable(cable, 0, {}).reset_spread
    pose = np.array([0.0, 0.6, 0.02, 0.0, 0.0])
    arc_lengths = np.linspace(0.0, cable.length, 32)
    for index in range(20):
        trial = Trial.draw(TrialNoise(), 0, index)
        shape = reset_shape(cable, pose, trial, arc_lengths, cable.radius, spread)
        assert shape[:, 2].min() >= cable.radius
        assert abs(shape[-1, 0]) <= ASIDE_MAX
        assert shape[-1, 1] > 0.6 + 0.97 * cable.length


def rest_on_table(scene, cable):
    """Return a straight cable that lies on the table, its grip above."""
    import mujoco

    data = mujoco.MjData(scene.model)
    pose = np.array([0.0, 0.6, 0.02, 0.0, 0.0])
    trial = Trial.draw(TrialNoise.none(), 0, 0)
    shape = reset_shape(cable, pose, trial, scene.arc_lengths, scene.end_height, 0.0)
    data.qpos[scene.vertex_slice] = (shape[2:] - scene.vertex_origin).ravel()
    return data


def settle(scene, data, duration):
    import mujoco

    for _ in range(round(duration / scene.model.opt.timestep)):
        mujoco.mj_step(scene.model, data)


def end_of_cable(scene, data):
    return data.qpos[scene.vertex_slice][-3:] + scene.vertex_origin[-1]


def tip_height(scene, data):
    import mujoco

    mujoco.mj_kinematics(scene.model, data)
    return data.geom("tip").xpos[2]
