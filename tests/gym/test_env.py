"""The environments keep Gymnasium's contract, and their rewards are those of the engine."""

import copy
import dataclasses
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector

import cablecast.gym  # noqa: F401
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.gym.env import CastEnv, CastVectorEnv
from cablecast.gym.picture import LANDING, MARGIN, ROBOT, SCALE, TABLE, TARGET, picture
from cablecast.motion.casting import cast_grip_paths
from cablecast.rigs.engine import RigEngine
from cablecast.setup import Setup
from cablecast.workspace import Workspace, load_targets

pytestmark = pytest.mark.usefixtures("coarse_engine")

ID = "cablecast.gym:cablecast/Cast-v0"

# A world of a batch is simulated for as long as the longest motion of the batch, and a cable that
# has settled still creeps a little [% of cable length].
BATCH_TOLERANCE_PCT = 0.5

# Observations are in single precision.
SINGLE = 1e-6

RAW_ACTION = np.array([-0.9, 0.7, 0.6, 1.2])


@pytest.mark.parametrize(
    "options",
    [{}, {"action_form": "raw", "observe_cable": False}, {"tries": 3, "spread": 0.5}],
    ids=["plain", "raw", "cables"],
)
def test_the_checker_of_gymnasium_finds_nothing(options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Raw actions are in radians and metres on purpose.
        warnings.filterwarnings("ignore", message=".*symmetric and normalized space")
        # A cast is over before a person could watch it: there is no "human" mode.
        check_env(gymnasium.make(ID, render_mode="rgb_array", **options).unwrapped)


@pytest.mark.parametrize("any_rig", [False, True])
def test_the_reward_is_minus_the_miss_of_the_cast_that_the_engine_makes(any_rig):
    setup, target = Setup(), load_targets()[20]
    rig = RigEngine(EngineWarp(), setup) if any_rig else "engine"
    env = CastEnv(setup, rig=rig, action_form="raw")
    env.reset(seed=0, options={"target_xy": target})
    _, reward, terminated, truncated, info = env.step(RAW_ACTION)
    rollout = EngineWarp().rollout(setup.cable, cast_grip_paths(RAW_ACTION[None], setup))
    miss = np.linalg.norm(rollout.endpoint_xy[0, -1] - target) / setup.cable.length
    assert reward == pytest.approx(-100 * miss, abs=BATCH_TOLERANCE_PCT)
    assert (terminated, truncated, info["status"]) == (True, False, "ok")
    env.close()


def test_a_vector_step_makes_the_casts_of_single_environments():
    count = 3
    many = gymnasium.make_vec(ID, num_envs=count)
    observations, start = many.reset(seed=5)
    actions = np.random.default_rng(1).uniform(-1, 1, size=(count, 4))
    targets = start["target_xy"]
    _, rewards, terminated, _, info = many.step(actions)
    assert terminated.all()
    for row in range(count):
        one = CastEnv()
        observation, _ = one.reset(options={"target_xy": targets[row]})
        assert observation == pytest.approx(observations[row])
        _, reward, *_ = one.step(actions[row])
        assert reward == pytest.approx(rewards[row], abs=BATCH_TOLERANCE_PCT)
    assert np.array_equal(info["target_xy"], targets)


def test_the_vector_form_works_inside_the_wrappers_of_gymnasium():
    env = gymnasium.make_vec(ID, num_envs=16)
    env = vector.NormalizeObservation(vector.RecordEpisodeStatistics(env))
    env = vector.DictInfoToList(vector.NormalizeReward(env))
    observations, infos = env.reset(seed=2)
    for _ in range(4):
        observations, rewards, ended, _, infos = env.step(np.zeros((16, 4)))
        assert observations.shape == env.observation_space.shape
        assert np.isfinite(rewards).all()
        if ended.all():
            assert all(info["episode"]["l"] == 1 for info in infos)
            assert {info["status"] for info in infos} <= {"ok", "off_table", "infeasible"}
    env.close()


def test_an_episode_ends_with_its_cast_and_the_next_one_starts_as_the_mode_says():
    actions = np.zeros((4, 4))
    nxt = CastVectorEnv(4)
    same = CastVectorEnv(4, autoreset_mode=AutoresetMode.SAME_STEP)
    first, _ = nxt.reset(seed=1)
    assert np.array_equal(same.reset(seed=1)[0], first)
    final, rewards, ended, _, info = nxt.step(actions)
    second, same_rewards, same_ended, _, same_info = same.step(actions)
    assert np.array_equal(final, np.stack(list(same_info["final_obs"])))
    assert np.array_equal(rewards, same_rewards)
    assert ended.all()
    assert same_ended.all()
    for name in ("landing_xy", "status", "target_xy"):
        assert np.array_equal(info[name], same_info["final_info"][name])
    # Here the actions count for nothing.
    observations, rewards, ended, _, info = nxt.step(actions)
    assert np.array_equal(observations, second)
    assert np.array_equal(info["target_xy"], same_info["target_xy"])
    assert not ended.any()
    assert not rewards.any()
    with pytest.raises(InputError, match="autoreset_mode"):
        CastVectorEnv(4, autoreset_mode=AutoresetMode.DISABLED)
    with pytest.raises(InputError, match="autoreset_mode 'same' must be one of NextStep, "):
        CastVectorEnv(4, autoreset_mode="same")


def test_a_picture_shows_target_and_landings_where_they_are():
    env = CastEnv(render_mode="rgb_array", action_form="raw", tries=2)
    env.reset(seed=0, options={"target_xy": (-0.4, 0.9)})
    assert not np.any(where(env.render(), LANDING))
    landing = env.step(RAW_ACTION)[4]["landing_xy"]
    image = env.render()
    half = env.task.setup.workspace.half_width + MARGIN
    far = env.task.setup.workspace.y_max + MARGIN
    for color, point in ((TARGET, (-0.4, 0.9)), (LANDING, landing)):
        row, column = np.mean(np.nonzero(where(image, color)), axis=1)
        assert column / SCALE - half == pytest.approx(point[0], abs=0.01)
        assert far - row / SCALE == pytest.approx(point[1], abs=0.01)
    assert CastEnv().render() is None
    many = CastVectorEnv(2, render_mode="rgb_array")
    many.reset(seed=0)
    assert [image.shape for image in many.render()] == [image.shape] * 2


@pytest.mark.parametrize("near", [-0.5, 0.3])
def test_a_picture_shows_the_table_from_its_near_edge_and_the_robot(near):
    workspace = Workspace(table_near_y=near)
    image = picture(workspace, np.array([0.0, 0.9]), np.empty((0, 2)))
    rows = np.nonzero(where(image, TABLE).any(axis=1))[0]
    top = workspace.y_max + MARGIN
    assert top - rows.max() / SCALE == pytest.approx(near, abs=0.01)
    assert top - rows.min() / SCALE == pytest.approx(workspace.y_max, abs=0.01)
    robot = np.mean(np.nonzero(where(image, ROBOT))[0])
    assert top - robot / SCALE == pytest.approx(0.0, abs=0.01)


def where(image, color):
    return np.all(image == np.array(color), axis=2)


def test_the_same_seed_gives_the_same_targets_and_cables():
    first, second = (CastVectorEnv(8, spread=1.0) for _ in range(2))
    assert np.array_equal(first.reset(seed=3)[0], second.reset(seed=3)[0])
    assert not np.array_equal(first.reset(seed=4)[0], second.reset(seed=3)[0])


def test_a_target_stays_for_its_tries_and_the_observation_tells_the_earlier_casts():
    env = CastEnv(tries=2, observe_cable=False)
    first, _ = env.reset(seed=0)
    assert np.all(first[2:] == 0)
    action = np.array([0.1, -0.2, 0.3, 0.4], dtype=np.float32)
    _, _, _, _, info = env.step(action)
    second, _ = env.reset()
    assert second[:2] == pytest.approx(first[:2])
    assert second[2:6] == pytest.approx(action)
    side = np.sign(info["target_xy"][0])
    reach = env.task.setup.workspace.reach(env.task.setup.cable.length)
    assert second[6:9] == pytest.approx([*(info["landing_xy"] * [side, 1] / reach), 1.0])
    env.step(action)
    third, _ = env.reset()
    assert third[:2] != pytest.approx(first[:2])
    assert np.all(third[2:] == 0)


def test_a_normalised_action_lands_mirrored_for_a_mirrored_target():
    env = CastEnv(spread=0.0)
    action, landings = np.array([0.2, 0.1, -0.3, 0.0]), []
    for side in (1.0, -1.0):
        observation, _ = env.reset(options={"target_xy": (side * 0.4, 0.8)})
        assert observation[0] > 0
        landings.append(env.step(action)[4]["landing_xy"])
    assert landings[1] == pytest.approx(landings[0] * [-1, 1], abs=1e-3)


def test_cables_are_drawn_from_the_ranges_of_tuning_as_widely_as_asked():
    widths = []
    for spread in (1.0, 0.2, 0.0):
        observations, _ = CastVectorEnv(500, spread=spread).reset(seed=0)
        # Behind the target, and the length and diameter of the cable.
        widths.append(np.ptp(observations[:, 4:], axis=0))
    assert np.all(widths[0] > 0.97)
    assert widths[1] == pytest.approx(0.2 * widths[0], abs=SINGLE)
    assert np.all(widths[2] == 0)


def test_a_motion_that_the_arm_cannot_make_earns_the_reward_of_a_failure():
    env = CastEnv(action_form="raw", fail_reward=-123.0)
    env.reset(seed=0)
    # Both arcs end on the same side.
    _, reward, _, _, info = env.step(np.array([0.5, 0.5, 0.6, 0.6]))
    assert (reward, info["status"]) == (-123.0, "infeasible")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"spread": 1.5}, "spread = 1.5"),
        ({"tries": 0}, "tries = 0"),
        ({"action_form": "polar"}, "action_form 'polar'"),
        ({"fail_reward": 3.0}, "fail_reward = 3"),
        ({"render_mode": "human"}, "render_mode 'human'"),
        ({"rig": "virtual", "spread": 0.5}, "spread needs the engine"),
        ({"targets": [(0.0, 9.0)]}, "out of reach"),
        ({"setup": "lab.yaml"}, "setup must be Setup"),
    ],
)
def test_a_bad_option_is_refused_in_one_line(options, words):
    with pytest.raises(InputError, match=words):
        CastEnv(**options)


def test_a_long_cable_stays_in_the_space_and_a_table_without_usual_targets_is_refused():
    cable = dataclasses.replace(Setup().cable, length=2.5)
    env = CastEnv(Setup(cable=cable, workspace=Workspace(table_depth=4.0)))
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    assert np.abs(observation).max() <= 1.0
    table = Workspace(table_width=0.3, table_depth=0.41, reset_y=0.2)
    env = CastEnv(Setup(cable=dataclasses.replace(Setup().cable, length=0.2), workspace=table))
    with pytest.raises(InputError, match="targets="):
        env.reset(seed=0)


def test_a_diverged_action_is_refused_and_a_copy_says_what_to_pickle_instead():
    env = CastEnv()
    env.reset(seed=0)
    with pytest.raises(InputError, match="not finite"):
        env.step(np.array([np.nan, 0, 0, 0]))
    for duplicate in (pickle.dumps, copy.deepcopy):
        with pytest.raises(InputError, match="pickle a function that makes it"):
            duplicate(env)
