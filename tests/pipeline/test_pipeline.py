"""The verbs as functions: objects in, results out, nothing printed, stopped work goes on."""

import dataclasses

import numpy as np
import pytest

import cablecast as cc
from cablecast.errors import CheckpointError, InputError
from cablecast.rigs.engine import RigEngine

SETUP = cc.Setup()
# A coarse cable and few casts: enough to run, not to be good.
COARSE = {"segment_count": 10, "dt": 0.002}
SEARCH = cc.TuneConfig(population_size=4, generations=2)
TARGETS = cc.load_targets()[::8]


def make_rig(setup=SETUP, **changes):
    """Return a rig that plays the engine with a cable that differs from what is believed."""
    params = cc.CableParams(**(setup.cable.params.to_dict() | changes))
    engine = cc.EngineWarp(segment_count=10, dt=0.002)
    return cc.make_rig(RigEngine(engine, setup, params), setup)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pipeline")


@pytest.fixture(scope="module")
def casts(folder):
    with make_rig(lateral_friction=0.7) as rig:
        return cc.collect(rig, count=8, out=folder / "casts")


@pytest.fixture(scope="module")
def tuned(casts, folder):
    return cc.tune(casts, config=SEARCH, **COARSE, out=folder / "tune")


@pytest.fixture(scope="module")
def simulated(tuned, folder):
    return cc.simulate(SETUP, tuned, count=200, **COARSE, out=folder / "dataset")


@pytest.fixture(scope="module")
def policy(simulated, folder):
    return cc.train(simulated, epochs=3, candidate_count=300, out=folder / "model")


def test_nothing_is_printed_and_progress_goes_to_the_callback(folder, tmp_path, capfd):
    reports = []
    with make_rig() as rig:
        casts = cc.collect(rig, count=6, progress=reports.append)
    tuned = cc.tune(casts, config=SEARCH, **COARSE, progress=reports.append)
    simulated = cc.simulate(SETUP, tuned, count=120, **COARSE, progress=reports.append)
    cc.train(simulated, epochs=2, candidate_count=200, progress=reports.append)
    captured = capfd.readouterr()
    # Warp announces itself once in a process, before the first kernel is compiled.
    printed = [line for line in captured.out.splitlines() if "Warp" not in line and line[:1] != " "]
    assert [line for line in printed if not line.startswith("Module")] == []
    tasks = [report.task for report in reports]
    for task in ("Casting cable_1", "Tuning cable_1", "Simulating cable_1", "Training"):
        assert task in tasks
        last = [report for report in reports if report.task == task][-1]
        assert last.done == last.total > 0


def test_a_network_is_as_wide_as_it_is_asked_for(simulated):
    narrow = cc.train(simulated, epochs=1, hidden_width=8, candidate_count=50).model
    wide = cc.train(simulated, epochs=1, candidate_count=50).model
    assert [model.weights[1][0].shape for model in (narrow, wide)] == [(8, 8), (256, 256)]


def test_casts_are_kept_with_the_set_up_and_taken_up_by_the_same_call(casts, folder):
    assert casts.setup == SETUP
    assert len(casts) == 8
    reports = []
    with make_rig(lateral_friction=0.7) as rig:
        again = cc.collect(rig, count=8, out=folder / "casts", progress=reports.append)
    assert again.fingerprint == casts.fingerprint
    assert [report.note for report in reports] == ["already done, nothing changed"]


def test_tuning_and_training_again_read_their_results_back(tuned, casts, simulated, policy, folder):
    assert tuned.setup == SETUP
    assert tuned.metrics["validation"]["tuned"]["track_count"] == 2
    reports = []
    again = cc.tune(casts, config=SEARCH, **COARSE, out=folder / "tune", progress=reports.append)
    assert again.params == tuned.params
    assert again.metrics == tuned.metrics
    assert [report.note for report in reports] == ["already done, nothing changed"]
    read = cc.load_tuned(folder / "tune", SETUP)
    assert read.params == tuned.params
    # Who aims with it knows which casts it was fitted to.
    assert read.fitted_to == casts.fingerprint
    options = {"epochs": 3, "candidate_count": 300, "out": folder / "model"}
    trained = cc.train(simulated, **options, progress=reports.append)
    assert trained.model.fingerprint == policy.model.fingerprint
    assert reports[-1].note == "already done, nothing changed"


def test_casts_that_were_made_again_are_tuned_to_again(folder, tmp_path):
    """The same settings with another camera or cable must not show the old result."""
    results = []
    for friction in (0.6, 0.9):
        with make_rig(lateral_friction=friction) as rig:
            # The rig's description does not tell what has changed in the world.
            rig.description["params"] = {}
            casts = cc.collect(rig, count=8, out=tmp_path / f"casts-{friction}")
        results.append(casts)
    first = cc.tune(results[0], config=SEARCH, **COARSE, out=tmp_path / "tune")
    assert first.metrics["dataset_fingerprint"] == results[0].fingerprint
    assert results[0].info["settings"] == results[1].info["settings"]
    with pytest.raises(InputError, match="dataset_fingerprint is"):
        cc.tune(results[1], config=SEARCH, **COARSE, out=tmp_path / "tune")


def test_simulated_casts_follow_the_tuned_parameters(simulated, tuned):
    assert simulated.settings.dynamics.params == tuned.params
    assert simulated.kind == "sim"
    other = dataclasses.replace(tuned, setup=cc.Setup(cable="cable_2"))
    with pytest.raises(InputError, match="parameters are those of cable_2, not of cable_1"):
        cc.simulate(SETUP, other, count=10, **COARSE)


def test_a_policy_plans_by_radius_and_angle_and_is_read_back(policy, folder):
    plan = policy.plan(r=1.0, theta_deg=20.0)
    assert plan.trajectories[0].joint_path is not None
    np.testing.assert_allclose(plan.target_xy, [[np.sin(np.pi / 9), np.cos(np.pi / 9)]])
    loaded = cc.ForwardSearchPolicy.load(folder / "model").plan(r=1.0, theta_deg=20.0)
    np.testing.assert_array_equal(loaded.actions, plan.actions)
    motion = cc.plan_motion(policy, r=1.0, theta_deg=20.0)
    assert motion.trajectories[0].duration == plan.trajectories[0].duration
    assert motion.miss_pct[0] == pytest.approx(
        100 * np.linalg.norm(plan.predicted_xy[0] - plan.target_xy[0]) / 0.62
    )


def test_an_evaluation_has_a_summary_and_files_where_it_is_asked_to(policy, tmp_path):
    pytest.importorskip("matplotlib")
    with make_rig(lateral_friction=0.7) as rig:
        evaluation = cc.evaluate(policy, rig, TARGETS, repeats=2, out=tmp_path / "out")
        assert len(evaluation.casts) == 2 * len(TARGETS)
        assert evaluation.summary.count <= len(evaluation.casts)
        assert evaluation.metrics["error_split"]["repeats"] == 2
        assert {"metrics.json", "trials.csv", "landings.png", "report.html"} <= {
            file.name for file in (tmp_path / "out").iterdir()
        }
        again = cc.evaluate(policy, rig, TARGETS, repeats=2, out=tmp_path / "out")
        in_memory = cc.evaluate(policy, rig, TARGETS)
    assert again.metrics == evaluation.metrics
    # The engine rig leaves nothing to chance.
    np.testing.assert_array_equal(in_memory.landed_xy, evaluation.landed_xy[::2])


def test_a_rig_of_another_table_is_refused(policy):
    other = dataclasses.replace(SETUP, workspace=cc.Workspace(table_width=2.0))
    with (
        make_rig(other) as rig,
        pytest.raises(InputError, match=r"workspace\.table_width is 2\.0 there and 2\.75 here"),
    ):
        cc.evaluate(policy, rig, TARGETS)


def test_casts_of_the_wrong_kind_or_method_are_refused_before_training(simulated, casts, policy):
    with pytest.raises(InputError, match="which are not simulated"):
        cc.train(casts)
    with pytest.raises(InputError, match="which are not casts of a rig"):
        cc.train(simulated, simulated)
    with pytest.raises(InputError, match="needs casts of a rig"):
        cc.tune(simulated)
    with pytest.raises(InputError, match="needs casts: simulated ones"):
        cc.train()
    with pytest.raises(InputError, match="gaussian-process takes simulated casts alone"):
        cc.train(simulated, casts, method="gaussian-process")
    with pytest.raises(InputError, match="method 'guess' must be one of"):
        cc.train(simulated, method="guess")
    other = dataclasses.replace(simulated, info=simulated.info | {"fingerprint": "another"})
    with pytest.raises(CheckpointError, match="was trained on another dataset"):
        cc.train(other, casts, start=policy.model)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"epochs": 0}, "epochs = 0"),
        ({"candidate_count": 10**9}, "candidate_count = 1000000000"),
        ({"candidate_count": 0}, "candidate_count = 0"),
        ({"seed": -1}, "seed = -1"),
        ({"device": "tpu"}, "device 'tpu'"),
    ],
)
def test_training_out_of_bounds_is_refused_and_writes_nothing(simulated, tmp_path, options, words):
    with pytest.raises(InputError, match=words):
        cc.train(simulated, out=tmp_path / "model", **options)
    assert not (tmp_path / "model").exists()


def test_repeats_measure_the_scatter_of_a_rig_that_has_none(tmp_path):
    with make_rig() as rig:
        repeated = cc.repeat(rig, combinations=("1.2",), action_count=2, repeats=2)
        with pytest.raises(InputError, match=r"combinations \[\] must be some of"):
            cc.repeat(rig, combinations=())
        with pytest.raises(InputError, match="repeats = 1"):
            cc.repeat(rig, repeats=1)
    assert repeated.results["1.2"].scatter_pct == pytest.approx(0.0, abs=1e-9)
    assert repeated.metrics["combinations"][0]["cast_count"] == 4


@pytest.mark.usefixtures("coarse_engine")
def test_a_selection_returns_the_chosen_set_up():
    pytest.importorskip("shapely")
    selection = cc.select(SETUP, grid=3, grid_psi=3)
    choice = selection.metrics["choice"]
    assert selection.setup.motion.r0 == choice["r0"]
    assert selection.setup.motion.v_max == choice["v_max"]
    assert selection.setup.workspace == SETUP.workspace
    for bound in (float("nan"), 0.0, -1.0):
        with pytest.raises(InputError, match="scatter_max_pct"):
            cc.select(SETUP, scatter_max_pct=bound)
