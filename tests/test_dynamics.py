"""Dynamics: what a simulated cast takes beside the set-up travels as one."""

import dataclasses

import numpy as np
import pytest

from cablecast.data.dataset import StoredSettings
from cablecast.engines.dynamics import Dynamics
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import DatasetError
from cablecast.motion.casting import Action
from cablecast.motion.servo import ServoModel
from cablecast.motion.trajectory import plan_trajectory
from cablecast.rigs.engine import RigEngine
from cablecast.setup import Setup

SETUP = Setup()
ENGINE = EngineWarp(segment_count=20, dt=1e-3)
SERVO = ServoModel(
    delay=np.full(6, 0.02), frequency=np.full(6, 60.0), damping=np.ones(6), residual=np.zeros(6)
)
BARE = Dynamics.of(None, SETUP)
DAMPED = BARE.with_params(dataclasses.replace(BARE.params, damping_time=0.03))
WHOLE = dataclasses.replace(DAMPED, servo=SERVO)
MOTION = plan_trajectory(Action.from_array(np.array([-0.65, 1.40, 0.41, 2.97])), SETUP)


def landing(dynamics):
    return dynamics.rollout(ENGINE, SETUP, MOTION.grip_path).endpoint_xy[0, -1]


def test_material_and_servo_each_move_a_landing():
    landings = [
        landing(BARE),
        landing(DAMPED),
        landing(dataclasses.replace(BARE, servo=SERVO)),
        landing(WHOLE),
    ]
    for index, one in enumerate(landings):
        for other in landings[:index]:
            assert np.linalg.norm(one - other) > 1e-4


def test_it_comes_back_from_plain_values_and_leaves_out_what_it_lacks():
    assert set(BARE.to_dict()) == {"params"}
    again = Dynamics.from_dict(WHOLE.to_dict() | {"seed": 0})
    assert again.params == WHOLE.params
    np.testing.assert_array_equal(landing(again), landing(WHOLE))


def test_a_rig_and_the_settings_of_a_dataset_play_all_of_it():
    stored = StoredSettings({"settings": WHOLE.to_dict()}, "the dataset").dynamics
    rig = RigEngine(ENGINE, SETUP, stored)
    rig.reset()
    np.testing.assert_allclose(rig.execute(MOTION).final_xy, landing(WHOLE), atol=1e-6)
    assert rig.description["params"]["damping_time"] == 0.03


def test_settings_without_parameters_or_of_another_version_are_refused():
    with pytest.raises(DatasetError, match="the model lack params"):
        _ = StoredSettings({"settings": {}}, "the model").dynamics
    values = WHOLE.to_dict() | {"params": {"mass": 0.05}}
    with pytest.raises(DatasetError, match="does not fit this version"):
        _ = StoredSettings({"settings": values}, "the model").dynamics


def test_other_parameters_and_rows_keep_the_rest():
    many = WHOLE.with_params(dataclasses.replace(WHOLE.params, mass=np.full(3, 0.05)))
    assert many.rows(slice(0, 2)).params.world_count == 2
    assert many.rows(slice(0, 2)).params.damping_time == 0.03
    assert many.rows(slice(0, 2)).servo is SERVO
    assert WHOLE.with_params(None) is WHOLE


def test_several_dynamics_play_as_one_batch():
    other = BARE.with_params(dataclasses.replace(DAMPED.params, lateral_friction=0.5))
    both = Dynamics.stack([BARE, other])
    paths = MOTION.grip_path[np.zeros(2, dtype=int)]
    landings = both.rollout(ENGINE, SETUP, paths).endpoint_xy[:, -1]
    np.testing.assert_allclose(landings, [landing(BARE), landing(other)], rtol=0, atol=1e-4)
    assert np.linalg.norm(landings[1] - landings[0]) > 1e-2


def test_a_straight_cable_is_its_own_mirror_image_and_a_curled_one_is_not():
    assert WHOLE.mirrored() is WHOLE.without_curl() is WHOLE
    assert BARE.mirrored() is BARE.without_curl() is BARE
    curled = WHOLE.with_params(dataclasses.replace(WHOLE.params, rest_curvature=0.4))
    assert curled.mirrored().params.rest_curvature == -0.4
    assert curled.without_curl().params == WHOLE.params
    assert curled.without_curl().servo is SERVO
