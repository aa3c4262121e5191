"""params.json: what tuning wrote is read back, what a person wrote is checked."""

import dataclasses
import json

import numpy as np
import pytest

from cablecast.cable import load_cable
from cablecast.engines.dynamics import Dynamics
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.servo import ServoModel
from cablecast.setup import Setup
from cablecast.tuning.tracks import TrackDistances
from cablecast.tuning.tune import TuneConfig, distance_summary, split_tracks, tune_params
from cablecast.tuning.tuned import Tuned, load_tuned, write_params

CABLE = load_cable("cable_1")
SETUP = Setup(cable=CABLE)
PARAMS = CABLE.params.to_dict()
SERVO = ServoModel(delay=np.full(6, 0.01), frequency=np.full(6, 50.0), damping=np.full(6, 0.8))
LITTLE = TuneConfig(population_size=4, generations=2)


@pytest.fixture
def result(cable, good, engine):
    return tune_params(Setup(cable=cable), *split_tracks(good), engine, LITTLE)


@pytest.fixture
def file(tmp_path):
    """Return a file as tuning writes it."""
    values = {"cable": CABLE.name, "params": PARAMS, "servo": SERVO.to_dict()}
    write_params(tmp_path / "params.json", values)
    return tmp_path / "params.json"


def refusal(file, text=None):
    if text is not None:
        file.write_text(text)
    with pytest.raises(InputError) as caught:
        load_tuned(file, SETUP)
    message = str(caught.value)
    assert "\n" not in message
    assert str(file) in message
    assert len(message) < 500 + len(str(file))
    return message


def test_the_file_of_the_result_gives_back_the_parameters(result, cable, tmp_path):
    write_params(tmp_path, result.to_dict())
    file = tmp_path / "params.json"
    assert load_tuned(file, SETUP).params == load_tuned(tmp_path, SETUP).params == result.params
    assert load_tuned(file, SETUP).dynamics.servo is None
    low, middle, high = result.metrics["spread"]["friction"]
    assert low <= middle <= high
    other = dataclasses.replace(cable, name="another")
    with pytest.raises(InputError, match="of cable_1, not of another"):
        load_tuned(file, Setup(cable=other))


def test_distances_are_summed_up_in_pct_of_the_cable_and_none_where_nobody_measured(cable):
    final = np.array([[0.02, np.nan, 0.04, 0.06]])
    apart = TrackDistances(
        mean=final / 2, final=final, finite=np.array([[True, True, False, True]])
    )
    summary = distance_summary(apart, 0, cable.length)
    assert summary["final_median_pct"] == pytest.approx(4.0 / cable.length)
    assert summary["mean_pct"] == pytest.approx(2.0 / cable.length)
    assert (summary["final_count"], summary["non_finite_count"]) == (3, 1)
    blind = distance_summary(dataclasses.replace(apart, final=np.nan * final), 0, cable.length)
    assert blind["final_median_pct"] is blind["final_max_pct"] is None
    assert blind["final_count"] == 0


def test_the_servo_is_read_back(file):
    np.testing.assert_array_equal(load_tuned(file, SETUP).dynamics.servo.frequency, SERVO.frequency)


def test_a_value_that_was_changed_is_not_believed_until_the_checksum_is_deleted(file):
    lines = file.read_text().splitlines()
    changed = [line.replace(str(PARAMS["mass"]), "0.051") for line in lines]
    assert changed != lines
    text = "\n".join(changed)
    assert "was changed since it was written: delete its sha256 line" in refusal(file, text)
    with pytest.raises(InputError, match="was changed"):
        load_tuned(file, SETUP)
    file.write_text("\n".join(line for line in changed if '"sha256"' not in line))
    assert load_tuned(file, SETUP).params.mass == 0.051


def test_a_fit_plays_itself_with_its_material_and_servo():
    params = dataclasses.replace(CABLE.params, damping_time=0.02, rest_curvature=0.5)
    tuned = Tuned(setup=SETUP, dynamics=Dynamics(params=params, servo=SERVO))
    action, engine = np.array([-0.9, 0.7, 0.6, 1.2]), EngineWarp(20, 1e-3)
    played = tuned.rollout(action, engine, duration=0.8)
    path = SERVO.apply(cast_grip_paths(action[None], SETUP), SETUP.arm)
    expected = engine.rollout(CABLE.with_params(params), path, duration=0.8)
    assert np.array_equal(played.endpoint_xyz, expected.endpoint_xyz)
    commanded = tuned.rollout(cast_grip_paths([action, action], SETUP), engine, duration=0.8)
    assert np.array_equal(commanded.endpoint_xyz[1], expected.endpoint_xyz[0])
    bare = Tuned.of(None, SETUP).rollout(action, engine, duration=0.8)
    assert not np.allclose(bare.endpoint_xyz, played.endpoint_xyz, atol=1e-4)


def test_a_file_that_a_person_wrote_needs_the_parameters_alone(tmp_path):
    file = tmp_path / "mine.json"
    file.write_text("\ufeff" + json.dumps({"params": PARAMS}), encoding="utf-8")
    assert load_tuned(file, SETUP).params == CABLE.params
    assert load_tuned(file, SETUP).dynamics.servo is None


def test_a_missing_file_says_how_to_make_one(tmp_path):
    with pytest.raises(InputError, match="cablecast tune"):
        load_tuned(tmp_path / "params.json", SETUP)
    with pytest.raises(InputError, match="cablecast tune"):
        load_tuned(tmp_path, SETUP)


NO_FILES = ["", "3", "[]", "[1, 2", "[" * 100_000, "{}", "\x00", '{"params": ' * 100_000]
NO_PARAMS = [None, [1, 2, 3], 7, {"mass": 1}, PARAMS | {"temper\nature": 1.0}]
NO_MASSES = [None, True, "0.05", [0.05], {}, -1.0, 1e9, float("nan"), 10**400]
NO_NAMES = [3, ["cable_1"], "a\nb", "x" * 1000]
NO_HASHES = [
    '{"sha256": "x", "params": ' + "[" * 900 + "]" * 900 + "}",
    '{"sha256": 3, "params": {}}',
]


@pytest.mark.parametrize(
    "text",
    [
        *NO_FILES,
        *NO_HASHES,
        *(json.dumps({"params": params}) for params in NO_PARAMS),
        *(json.dumps({"params": PARAMS | {"mass": mass}}) for mass in NO_MASSES),
        *(json.dumps({"cable": name, "params": PARAMS}) for name in NO_NAMES),
    ],
    ids=lambda text: text[-20:],
)
def test_files_that_hold_no_parameters_are_refused(file, text):
    refusal(file, text)


@pytest.mark.parametrize(
    "servo",
    [
        3,
        [],
        {"delay": 1},
        {"warp\nfactor": [1.0] * 6},
        SERVO.to_dict() | {"delay": [10**400] * 6},
        SERVO.to_dict() | {"delay": [9.0] * 6},
        SERVO.to_dict() | {"delay": [[0.01]] * 6},
    ],
    ids=lambda v: str(v)[:20],
)
def test_a_servo_of_the_wrong_kind_is_refused(file, servo):
    refusal(file, json.dumps({"params": PARAMS, "servo": servo}))
