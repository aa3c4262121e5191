"""The physics of the virtual laboratory, and what its seeds decide."""

import dataclasses

import numpy as np
import pytest

from cablecast.cable import load_cable
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath
from cablecast.motion.trajectory import Trajectory
from cablecast.track import TrialStatus
from cablecast.workspace import Workspace

pytest.importorskip("mujoco")

from cablecast.rigs.virtual import RigVirtual, TrialNoise, VirtualConfig
from cablecast.rigs.virtual._hidden import hidden_cable
from cablecast.rigs.virtual.scene import build_scene

QUICK = VirtualConfig(segment_count=16, dt=1e-3)
SILENT = dataclasses.replace(QUICK, noise=TrialNoise.none())
# Contacts give way by micrometres; half a millimetre would be a cable that sinks in.
CONTACT_DEPTH = 5e-4
# The solver treats left and right in another order, and a whip magnifies rounding a little.
MIRROR_TOLERANCE = 1e-4

GRAVITY = 9.81
# Part of the energy that a falling cable sets free; a step's rounding, and nothing else, adds any.
ENERGY_GAIN = 1e-4


def play(rig, trajectory):
    rig.reset()
    return rig.execute(trajectory)


def test_the_same_seed_repeats_the_sequence_of_trials_and_another_does_not(
    cable, workspace, small_cast
):
    first, again, other = (RigVirtual(cable, workspace, seed, QUICK) for seed in (3, 3, 4))
    tracks = [play(first, small_cast), play(first, small_cast)]
    np.testing.assert_array_equal(play(again, small_cast).nodes, tracks[0].nodes)
    np.testing.assert_array_equal(play(again, small_cast).nodes, tracks[1].nodes)
    assert not np.array_equal(tracks[0].final_xy, tracks[1].final_xy)
    assert not np.array_equal(play(other, small_cast).final_xy, tracks[0].final_xy)


def test_the_number_of_threads_changes_nothing(cable, workspace, small_cast):
    tracks = [
        RigVirtual(
            cable, workspace, 0, dataclasses.replace(QUICK, thread_count=count)
        ).execute_many([small_cast] * 3)
        for count in (1, 2)
    ]
    for one, two in zip(*tracks, strict=True):
        np.testing.assert_array_equal(one.nodes, two.nodes)


def test_equal_motions_scatter_by_some_per_cent_and_not_at_all_without_noise(
    cable, workspace, cast
):
    landings = [
        [track.final_xy for track in rig.execute_many([cast] * 4)]
        for rig in (RigVirtual(cable, workspace, 0, c) for c in (QUICK, SILENT))
    ]
    scatter, none = (np.ptp(xy, axis=0).max() / cable.length for xy in landings)
    assert 0.001 < scatter < 0.2
    assert none == 0.0


def test_a_mirrored_motion_ends_mirrored_without_noise(cable, workspace, cast):
    mirrored = Trajectory(action=None, grip_path=cast.grip_path.mirrored(), joint_path=None)
    rig = RigVirtual(cable, workspace, 0, SILENT)
    right, left = play(rig, cast), play(rig, mirrored)
    np.testing.assert_allclose(left.final_xy * [-1, 1], right.final_xy, atol=MIRROR_TOLERANCE)


def test_a_cable_that_is_only_held_lies_still_on_the_table(cable, workspace):
    pose = [0.0, workspace.reset_y, workspace.grip_height, 0.0, 0.0]
    hold = Trajectory(action=None, grip_path=GripPath.hold(pose, 1.0), joint_path=None)
    track = play(RigVirtual(cable, workspace, 0, QUICK), hold)
    assert track.status is TrialStatus.OK
    # It rests as soon as it may: the trial ends with the first sample after the motion.
    assert track.times[-1] <= 1.2 + 1e-9
    assert np.ptp(track.nodes, axis=0).max() < 1e-3
    assert track.nodes[..., 2].min() > cable.radius - CONTACT_DEPTH
    # The free half lies on the table and does not hover.
    half = track.nodes.shape[1] // 2
    assert track.nodes[-1, half:, 2].max() < cable.radius + CONTACT_DEPTH


@pytest.mark.parametrize("name", ["cable_2", "cable_3"])
def test_thin_and_stiff_cables_swing_out_and_come_to_rest_on_the_table(name, workspace, wide_cast):
    cable = load_cable(name)
    track = play(RigVirtual(cable, workspace, 0, QUICK), wide_cast)
    assert track.status is TrialStatus.OK
    length = np.linalg.norm(np.diff(track.nodes, axis=1), axis=-1).sum(axis=1)
    np.testing.assert_allclose(length, cable.length, rtol=0.01)
    # The tip swings from straight ahead over to the left, then far to the right, and stops before
    # the time is up.
    assert track.endpoint_xy[:, 0].min() < -0.05
    assert track.endpoint_xy[:, 0].max() > 0.4
    assert track.times[-1] < wide_cast.duration + QUICK.rest_time_max - 0.5


def test_a_cable_that_falls_off_the_edge_hangs_below_the_table(cable, workspace):
    pose = np.array([0.0, workspace.reset_y, workspace.grip_height, 0.0, 0.0])
    times = np.linspace(0.0, 2.0, 30)
    poses = np.repeat(pose[None], len(times), axis=0)
    u = times / times[-1]
    poses[:, 1] += 0.6 * u**3 * (10 - 15 * u + 6 * u**2)
    push = Trajectory(action=None, grip_path=GripPath.fit(times, poses), joint_path=None)
    track = play(RigVirtual(cable, workspace, 0, QUICK), push)
    assert track.status is TrialStatus.OFF_TABLE
    assert track.nodes[-1, -1, 2] < -0.1


def test_settings_out_of_bounds_are_refused_by_name(cable, workspace):
    with pytest.raises(InputError, match=r"dt = 0\.01 is outside"):
        VirtualConfig(dt=0.01)
    with pytest.raises(InputError, match="segment_count = 1 "):
        VirtualConfig(segment_count=1)
    with pytest.raises(InputError, match="friction = -1"):
        TrialNoise(friction=-1)
    with pytest.raises(InputError, match="seed = -1"):
        RigVirtual(cable, workspace, -1)


def test_a_cable_that_swings_down_from_a_height_never_gains_energy(cable):
    import mujoco

    # The grip high above the floor: no contact takes or hides energy. The softest cable folds most.
    truth = dataclasses.replace(hidden_cable(cable, 0), bend_stiffness=1e-5)
    scene = build_scene(cable, truth, Workspace(grip_height=2.0), 16, 1e-3)
    data = mujoco.MjData(scene.model)
    mass = scene.masses[2:]
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
