"""The benchmark beside other simulators, most of it without any of them."""

import importlib.util

import numpy as np
import pytest
from benchmarks import peers
from benchmarks.peer_adapters import Peer, frames
from benchmarks.peers import casts, swings

from cablecast.cable import load_cable
from cablecast.conventions import tangent

CABLE = load_cable("cable_1")
OTHERS = [c for c in peers.contenders() if c.library not in ("mujoco", "pybullet")]
GENTLE = -np.radians([60.0, 55.0])


@pytest.fixture(scope="module")
def scene():
    return swings(CABLE, GENTLE, 0.2).solved(40, 5e-4)


class Stick(Peer):
    """A cable that does not bend, which needs no solver."""

    name = "stick"

    def start(self, cable, params, nodes, rotations):
        self.cable, self.nodes, self.rotations = cable, nodes, rotations

    def advance(self, times, grips, rotations):
        self.end = grips[-1] + self.cable.length * rotations[-1, :, :, 2]

    def endpoints(self):
        return self.end


def test_frames_are_level_and_right_handed():
    rng = np.random.default_rng(0)
    yaw, pitch = rng.uniform(-1.0, 1.0, (2, 5))
    turns = frames(tangent(yaw, pitch), yaw)
    identity = np.einsum("wij,wik->wjk", turns, turns)
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(3), (5, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turns), 1.0)
    np.testing.assert_allclose(turns[:, 2, 0], 0.0)


def test_a_peer_gets_a_segment_behind_the_grip_and_the_pose_at_the_end_of_each_step():
    scene = casts(CABLE, 3, 0)
    stick = Stick(20, 1e-3, table=True)
    rollout = scene.play(stick)[0]
    lengths = np.linalg.norm(np.diff(stick.nodes, axis=1), axis=-1)
    assert lengths.shape == (3, 21)
    np.testing.assert_allclose(lengths, CABLE.length / 20, rtol=1e-6)
    poses = scene.paths.evaluate(rollout.times)
    ends = poses[..., :3] + CABLE.length * tangent(poses[..., 3], poses[..., 4])
    np.testing.assert_allclose(rollout.endpoint_xyz[:, 1:], ends[:, 1:], atol=1e-9)
    assert scene.whole(rollout).all()
    rollout.endpoint_xyz[1, 5] += CABLE.length
    assert scene.whole(rollout).tolist() == [True, False, True]


def test_the_step_is_found_from_which_on_shorter_ones_gain_little(scene):
    own = peers.Contender("EngineWarp", "warp", "warp-lang", lambda dt, _: peers.warp(20, dt))
    result = peers.best(own, scene, peers.LADDER, False, np.inf)
    assert result.stable == peers.LADDER[0]
    errors = [
        np.median(scene.errors(scene.play(peers.warp(20, dt))[0], True)[:, 1:])
        for dt in (result.dt, result.dt / 2, result.dt / 4)
    ]
    assert errors[0] == peers.error(result)
    assert min(errors[1:]) >= peers.ENOUGH * errors[0]
    # One world beside another does not make a rate worth asserting.
    assert result.rate > 0.0


def test_a_cable_that_is_torn_is_no_result(scene):
    class Torn(Stick):
        def endpoints(self):
            return self.end + [0.0, 2.0 * CABLE.length, 0.0]

    torn = peers.Contender("torn", "numpy", "numpy", lambda dt, table: Torn(20, dt, table=table))
    text = peers.best(torn, scene, peers.LADDER[:2], False, np.inf)
    assert text == "2 of 2 worlds break at 5 ms"


def test_a_simulator_that_is_not_installed_or_fails_is_a_line_of_the_table(scene):
    missing = peers.Contender("A", "no_such_library", "a-package", lambda dt, table: None)
    assert (
        peers.played(missing, (scene, scene), 1.0) == ("not installed: pip install a-package",) * 2
    )
    failing = peers.Contender("B", "numpy", "numpy", lambda dt, table: 1 / 0)
    assert peers.played(failing, (scene, scene), 1.0)[0] == "ZeroDivisionError: division by zero"


@pytest.mark.slow
@pytest.mark.parametrize("contender", OTHERS, ids=lambda c: c.name)
def test_a_peer_that_is_installed_plays_a_gentle_swing(contender, scene):
    if importlib.util.find_spec(contender.library) is None:
        pytest.skip(f"{contender.package} is not installed")
    dt = 1.953125e-5 if contender.name == "PyElastica" else 1e-3
    rollout = scene.play(contender.make(dt, False))[0]
    errors = scene.errors(rollout, contender.rolls)
    assert scene.whole(rollout).all()
    # Newton's ten iterations leave the most, 1 % at the end.
    assert np.median(errors[:, 1:]) < 2.0
