"""Tasks give the same in this process and on a cluster, one of whose nodes is killed meanwhile."""

import contextlib
import threading
import time

import numpy as np
import pytest

from cablecast.cli import main
from cablecast.data.simulate import simulate_dataset
from cablecast.engines.spread import EngineSpread
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.pipeline.collect import collect
from cablecast.pipeline.tune import tune
from cablecast.rigs.engine import RigEngine
from cablecast.rigs.make import make_rig
from cablecast.runs.workers import check_workers, connected, run_tasks
from cablecast.setup import Setup
from cablecast.tuning.tune import TuneConfig

SETUP = Setup()
COUNT, SHARD_ROWS = 80, 10


def coarse_engine():
    return EngineWarp(segment_count=10, dt=2e-3)


def square(value, offset):
    return value**2 + offset


def test_tasks_run_here_in_their_order():
    tasks = [(number, (number,)) for number in range(4)]
    assert list(run_tasks(square, tasks, shared=(1,))) == [(0, 1), (1, 2), (2, 5), (3, 10)]


@pytest.mark.parametrize("workers", ["threads", "ray:", "local:2", ""])
def test_other_workers_are_refused(workers):
    with pytest.raises(InputError, match="must be local, ray or ray:ADDRESS"):
        check_workers(workers)


def test_verbs_that_simulate_hand_their_worlds_to_the_workers(tmp_path, monkeypatch):
    asked = []

    def here(function, tasks, workers, shared):
        asked.append(workers)
        return ((number, function(*arguments, *shared)) for number, arguments in tasks)

    # Stands for a cluster: the tasks of `tune` and `select` are played here.
    monkeypatch.setattr("cablecast.engines.spread.run_tasks", here)
    monkeypatch.setattr("cablecast.engines.spread.WORLD_COUNT", 4)
    monkeypatch.setattr("cablecast.pipeline.tune.connected", lambda _: contextlib.nullcontext())
    pytest.importorskip("ray")
    with make_rig(RigEngine(coarse_engine(), SETUP), SETUP) as rig:
        casts = collect(rig, count=4)
    search = TuneConfig(population_size=6, generations=2)
    options = {"config": search, "validation_count": 1, "segment_count": 10, "dt": 2e-3}
    spread, alone = (tune(casts, workers=who, **options) for who in ("ray", "local"))
    assert set(asked) == {"ray"}
    assert spread.dynamics.params == alone.dynamics.params


@pytest.mark.parametrize("verb", [["tune", "--dataset", "none"], ["select"], ["reproduce"]])
def test_a_command_with_workers_that_do_not_exist_is_refused_in_one_line(verb, tmp_path, capsys):
    if verb[0] == "tune":
        with make_rig(RigEngine(coarse_engine(), SETUP), SETUP) as rig:
            collect(rig, count=4, out=tmp_path / "casts")
        verb = ["tune", "--dataset", str(tmp_path / "casts")]
    assert main([*verb, "--out", str(tmp_path / "out"), "--workers", "threads"]) != 0
    assert "must be local, ray or ray:ADDRESS" in capsys.readouterr().err


def test_an_engine_that_cannot_be_made_anew_stays_here(tmp_path):
    pytest.importorskip("ray")
    engine = RigEngine(coarse_engine(), SETUP)
    with pytest.raises(InputError, match="this process only"):
        simulate_dataset(tmp_path, SETUP, None, engine, count=4, workers="ray")


@pytest.mark.slow
def test_a_cluster_that_loses_a_node_writes_the_same_files(tmp_path, monkeypatch):
    ray = pytest.importorskip("ray")
    cluster_utils = pytest.importorskip("ray.cluster_utils")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    cluster = cluster_utils.Cluster(
        initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False}
    )
    try:
        nodes = [cluster.add_node(num_cpus=1) for _ in range(2)]
        ray.init(address=cluster.address, log_to_driver=False)
        killed, counts = threading.Event(), []

        def count(progress):
            counts.append((progress.done, progress.total))
            # After the first shard, with tasks under way on every node.
            if progress.done and not killed.is_set():
                killed.set()
                cluster.remove_node(nodes[0], allow_graceful=False)

        options = {"count": COUNT, "shard_rows": SHARD_ROWS}
        spread = tmp_path / "spread"
        simulate_dataset(
            spread, SETUP, None, coarse_engine(), workers="ray", progress=count, **options
        )
        assert killed.is_set()
        # The cluster takes some time to notice.
        deadline = time.monotonic() + 120.0
        while sum(node["Alive"] for node in ray.nodes()) != 2:
            assert time.monotonic() < deadline
            time.sleep(0.2)
        assert counts[-1] == (COUNT, COUNT)
        # What is lost afterwards is made again by whoever goes on.
        lost = spread / "data/chunk-000/file-003.parquet"
        content = lost.read_bytes()
        lost.unlink()
        simulate_dataset(spread, SETUP, None, coarse_engine(), **options)
        assert lost.read_bytes() == content
        # A fit asks for many batches, in parts of some worlds.
        paths = cast_grip_paths(feasible_uniform(12, SETUP, seed=3), SETUP)
        together = EngineSpread(coarse_engine(), "ray", world_count=3)
        with connected("ray"):
            handed_out = together.rollout(SETUP.cable, paths)
    finally:
        ray.shutdown()
        cluster.shutdown()
    here = coarse_engine().rollout(SETUP.cable, paths)
    assert np.array_equal(here.endpoint_xyz, handed_out.endpoint_xyz)
    alone = tmp_path / "alone"
    simulate_dataset(alone, SETUP, None, coarse_engine(), **options)
    for file in sorted(alone.rglob("*.parquet")):
        assert (spread / file.relative_to(alone)).read_bytes() == file.read_bytes()
