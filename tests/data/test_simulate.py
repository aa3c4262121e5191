import dataclasses
import json
import shutil

import numpy as np
import pytest
from tests.data.killed import contents, run_and_kill
from tests.data.stick_engine import (
    CABLE,
    COUNT,
    SETUP,
    SHARD_ROWS,
    StickEngine,
    simulate,
    simulate_and_die,
)

from cablecast.cable import load_cable
from cablecast.cast import TrialStatus
from cablecast.data import simulate as simulation
from cablecast.data.dataset import read_dataset
from cablecast.data.simulate import SAMPLE_DT
from cablecast.engines.base import engine_settings
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import DatasetError, InputError
from cablecast.motion.action import ActionRanges
from cablecast.motion.casting import cast_grip_paths
from cablecast.setup import Setup

# The gripper's path reproduces the end of the motion to about 1e-6 m.
PATH_TOLERANCE = 1e-5

SHARD_COUNT = -(-COUNT // SHARD_ROWS)
# Files in the order in which they are renamed: info, the shards, stats, card, info.
FILE_COUNT = SHARD_COUNT + 4


def test_rows_hold_the_action_and_where_its_motion_lands(unbroken):
    dataset = read_dataset(unbroken)
    _, theta2, r2, psi, _ = dataset.actions.T
    landing = np.stack(
        [
            r2 * np.sin(theta2) + CABLE.length * np.sin(psi),
            r2 * np.cos(theta2) + CABLE.length * np.cos(psi),
        ],
        axis=-1,
    )
    assert len(dataset) == COUNT
    np.testing.assert_allclose(dataset.rest_xy, landing, atol=PATH_TOLERANCE)


def test_the_status_says_where_the_free_end_rests_and_the_margin_where_it_was(unbroken):
    dataset = read_dataset(unbroken)
    paths = cast_grip_paths(dataset.actions, SETUP)
    track = StickEngine().rollout(CABLE, paths, sample_dt=SAMPLE_DT).endpoint_xy
    stayed = np.all(SETUP.workspace.on_table(track), axis=1)
    landed = SETUP.workspace.on_table(track[:, -1])
    assert 0 < stayed.sum() < landed.sum() < COUNT
    np.testing.assert_array_equal(dataset.ok, landed)
    np.testing.assert_array_equal(dataset.table_margin() >= 0, stayed)


def test_a_world_that_becomes_non_finite_is_marked_and_keeps_no_landing(tmp_path):
    dataset = simulate(tmp_path / "d", engine=StickEngine(breaks_beyond=0.6))
    broken = dataset.status == TrialStatus.NON_FINITE.code
    assert 0 < broken.sum() < COUNT
    np.testing.assert_array_equal(broken, ~dataset.finite)
    assert np.all(np.isnan(dataset.extent[broken]))
    assert np.all(dataset.table_margin()[broken] == -np.inf)


def test_the_same_seed_gives_the_same_bytes_and_another_seed_other_actions(unbroken, tmp_path):
    calls = []
    simulate(tmp_path / "same", progress=lambda state: calls.append((state.done, state.total)))
    assert calls == [(min(k * SHARD_ROWS, COUNT), COUNT) for k in range(SHARD_COUNT + 1)]
    other = simulate(tmp_path / "other", seed=1)
    assert contents(tmp_path / "same") == contents(unbroken)
    assert not np.array_equal(other.actions, read_dataset(unbroken).actions)


def test_the_size_of_the_shards_does_not_change_the_rows(unbroken, tmp_path):
    whole = simulate(tmp_path / "d", shard_rows=COUNT)
    sharded = read_dataset(unbroken)
    np.testing.assert_array_equal(whole.actions, sharded.actions)
    np.testing.assert_array_equal(whole.rest_xy, sharded.rest_xy)


@pytest.mark.parametrize("moment", ["rollout", 0, 2, FILE_COUNT - 3, FILE_COUNT - 1])
def test_a_killed_and_resumed_dataset_equals_an_unbroken_one(unbroken, tmp_path, moment):
    run_and_kill(simulate_and_die, moment, tmp_path / "d")
    with pytest.raises(DatasetError, match=r"unfinished|missing"):
        read_dataset(tmp_path / "d")
    engine = StickEngine()
    simulate(tmp_path / "d", engine=engine)
    assert contents(tmp_path / "d") == contents(unbroken)
    # What the killed run had finished is not simulated again.
    done = {"rollout": 2, 0: 0, 2: 1}.get(moment, SHARD_COUNT)
    assert len(engine.batches) == SHARD_COUNT - done


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"engine": StickEngine(dt=5e-4)}, "engine.dt is 0.001 there and 0.0005 here"),
        ({"engine": StickEngine(device="cuda")}, "engine.device is 'cpu' there and 'cuda' here"),
        ({"setup": SETUP.with_motion(v_max=1.2)}, "motion.v_max is 1.5 there and 1.2 here"),
        ({"count": 100}, "count is 220 there and 100 here"),
        ({"setup": Setup(cable="cable_2")}, "cable.name is 'cable_1' there and 'cable_2' here"),
        ({"params": load_cable("cable_3").params}, "params.mass is 0.05 there and 0.09 here"),
        ({"ranges": ActionRanges(r2=(0.5, 0.6))}, r"ranges.r2 is \[0.3\d*, 0.8\d*\] there"),
        ({"shard_rows": 50}, "shard_rows is 60 there and 50 here"),
    ],
)
def test_other_settings_are_refused_by_name_with_both_values(unbroken, options, words):
    before = contents(unbroken)
    with pytest.raises(DatasetError, match=words) as caught:
        simulate(unbroken, **options)
    assert "\n" not in str(caught.value)
    assert contents(unbroken) == before


def test_the_number_of_threads_does_not_count_as_a_setting():
    one, two = (engine_settings(StickEngine(thread_count=count)) for count in (1, 2))
    assert one == two


def test_what_is_no_dataset_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("dear")
    with pytest.raises(DatasetError, match=r"holds thesis.tex but no dataset"):
        simulate(tmp_path)
    with pytest.raises(DatasetError, match="is a file"):
        simulate(tmp_path / "thesis.tex")
    assert contents(tmp_path) == {"thesis.tex": b"dear"}


def test_a_second_writer_is_turned_away_while_the_first_is_at_work(tmp_path):
    refusals = []

    def intrude(progress):
        with pytest.raises(DatasetError, match="another process is writing") as caught:
            simulate(tmp_path / "d")
        refusals.append(caught.value)

    simulate(tmp_path / "d", progress=intrude)
    assert len(refusals) == SHARD_COUNT + 1


def test_a_card_gets_more_worlds_at_a_time_than_a_processor(tmp_path, monkeypatch):
    assert simulation.SHARD_ROWS < simulation.CUDA_SHARD_ROWS
    monkeypatch.setattr(simulation, "SHARD_ROWS", 30)
    monkeypatch.setattr(simulation, "CUDA_SHARD_ROWS", 360)
    for device, batches in (("cpu", [30, 2]), ("cuda", [32])):
        engine = StickEngine(device=device)
        simulate(tmp_path / device, engine=engine, count=32, shard_rows=None)
        assert engine.batches == batches


def test_an_unfinished_dataset_of_other_settings_or_with_a_damaged_shard_is_not_resumed(tmp_path):
    run_and_kill(simulate_and_die, "rollout", tmp_path / "d")
    before = contents(tmp_path / "d")
    with pytest.raises(DatasetError, match="seed is 0 there and 3 here"):
        simulate(tmp_path / "d", seed=3)
    assert contents(tmp_path / "d") == before
    shard = tmp_path / "d/data/chunk-000/file-001.parquet"
    shard.write_bytes(shard.read_bytes()[:-20])
    with pytest.raises(DatasetError, match=r"file-001.parquet is truncated"):
        simulate(tmp_path / "d")


@pytest.mark.parametrize("damage", ["deleted", "truncated"])
def test_a_finished_dataset_heals_a_shard(unbroken, tmp_path, damage):
    shutil.copytree(unbroken, tmp_path / "d")
    engine = StickEngine()
    # Nothing is simulated where nothing is missing.
    assert len(simulate(tmp_path / "d", engine=engine)) == COUNT
    assert engine.batches == []
    shard = tmp_path / "d/data/chunk-000/file-001.parquet"
    if damage == "truncated":
        shard.write_bytes(shard.read_bytes()[:-20])
        with pytest.raises(DatasetError, match="delete it and run the command"):
            simulate(tmp_path / "d")
    shard.unlink()
    simulate(tmp_path / "d", engine=engine)
    assert contents(tmp_path / "d") == contents(unbroken)
    assert len(engine.batches) == 1


def test_a_dataset_that_is_being_mended_is_not_taken_for_a_whole_one(unbroken, tmp_path):
    shutil.copytree(unbroken, tmp_path / "d")
    (tmp_path / "d/data/chunk-000/file-001.parquet").unlink()

    def stop(progress):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(tmp_path / "d", progress=stop)
    with pytest.raises(DatasetError, match="unfinished: 3 of 4 shards"):
        read_dataset(tmp_path / "d")


def test_the_settings_say_everything_that_made_the_rows(unbroken):
    info = json.loads((unbroken / "meta/info.json").read_text())
    settings = info["settings"]
    assert settings["engine"] == {
        "class": "StickEngine",
        "segment_count": 1,
        "dt": 1e-3,
        "device": "cpu",
        "breaks_beyond": "inf",
    }
    assert settings["params"] == CABLE.params.to_dict()
    assert (settings["count"], settings["seed"]) == (COUNT, 0)
    dataset = read_dataset(unbroken)
    assert dataset.cable == CABLE
    assert dataset.setup == SETUP


def test_a_dataset_of_the_fast_engine_is_resumed_with_the_same_rows(tmp_path):
    from cablecast.engines.warp_ import EngineWarp

    def engine():
        return EngineWarp(segment_count=8, dt=1e-3)

    def interrupt_after_the_second_shard(progress):
        if progress.done == 20:
            raise KeyboardInterrupt

    size = {"count": 30, "shard_rows": 10}
    unbroken = simulate(tmp_path / "unbroken", engine=engine(), **size)
    stop = interrupt_after_the_second_shard
    with pytest.raises(KeyboardInterrupt):
        simulate(tmp_path / "broken", engine=engine(), progress=stop, **size)
    simulate(tmp_path / "broken", engine=engine(), **size)
    assert contents(tmp_path / "broken") == contents(tmp_path / "unbroken")
    assert unbroken.info["settings"]["engine"]["segment_count"] == 8
    assert unbroken.finite.all()


def test_a_count_of_nothing_and_a_curled_cable_are_refused_for_planning_mirrors_casts(tmp_path):
    curled = CABLE.with_params(rest_curvature=1.0)
    with pytest.raises(InputError, match="rest_curvature = 1 1/m"):
        simulate(tmp_path / "curled", setup=dataclasses.replace(SETUP, cable=curled))
    found = Dynamics(params=CABLE.with_params(rest_curvature=-0.5).params)
    with pytest.raises(InputError, match=r"rest_curvature = 0\.5 1/m"):
        simulate(tmp_path / "curled", params=found)
    with pytest.raises(InputError, match="count = 0"):
        simulate(tmp_path / "curled", count=0)
    assert not (tmp_path / "curled").exists()
