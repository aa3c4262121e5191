"""A session whose simulator is fitted anew to all casts that it has."""

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
from tests.aiming.casts import made_up_cast

import cablecast as cc
from cablecast.aiming.session import RefitDue, RefitReason, refit_due
from cablecast.cli import main
from cablecast.errors import DatasetError, InputError
from cablecast.pipeline.aim import SimulatorConfig
from cablecast.report.words import refit_text
from cablecast.rigs.engine import RigEngine
from cablecast.runs.progress import DONE_NOTE, ignore

pytest.importorskip("torch")
pytest.importorskip("matplotlib")

COARSE = {"segment_count": 6, "dt": 4e-3}
SEARCH = cc.FitConfig(
    start_count=2,
    rough_iterations=1,
    kept_start_count=1,
    coarse_iterations=1,
    fine_iterations=1,
    coarse_segment_count=COARSE["segment_count"],
    coarse_dt=COARSE["dt"],
    ensemble_iterations=1,
    # The cable of the rig has none.
    materials=(),
)
SMALL = {
    **{"calibration_count": 3, "simulated_count": 120, "candidate_count": 200, "epochs": 2},
    # Simulators are fitted to sweeps.
    "polar": False,
}
QUICK = SimulatorConfig(fit=SEARCH, spread_count=3, **COARSE)
SETUP = cc.Setup()
TARGETS = np.array([[0.3, 1.1], [-0.2, 1.1]])


# A session as small as SMALL, from the command line.
COMMAND = (
    *("--rig", "engine", "--simulated-count", "120", "--candidate-count", "300", "--epochs", "2"),
    *("--within-pct", "0.01", "--no-polar"),
)


def quicken(patch):
    """Let the command line fit and simulate as quickly, too."""
    patch.setattr("cablecast.pipeline.aim.SimulatorConfig", lambda: QUICK)
    patch.setattr("cablecast.aiming.propose._SIMULATED_COUNT", 8)
    patch.setattr("cablecast.aiming.propose._SHORTLIST_COUNT", 4)
    patch.setattr("cablecast.aiming.predictor.SPREAD_COUNT", 12)
    patch.setattr("cablecast.tuning.spread._POOL_COUNT", 200)
    patch.setattr("cablecast.tuning.tuned.FitConfig", lambda: SEARCH)


@pytest.fixture(autouse=True)
def quick(blank_figures, coarse_engine, monkeypatch):
    quicken(monkeypatch)


def prepare(rig, *, out=None, progress=ignore, fit_all=False, casts=None, tuned=None, **changes):
    """Return a session that is small."""
    config = cc.AimConfig(**(SMALL | {"force": True} | changes))
    options = {"casts": casts, "tuned": tuned, "fit_all": fit_all, "out": out}
    return cc.prepare_aim(rig, config, simulators=QUICK, progress=progress, **options)


def opened_rig():
    # A cable that is not as it is believed to be.
    params = dataclasses.replace(SETUP.cable.params, bend_stiffness=2e-3, lateral_friction=0.4)
    return cc.make_rig(RigEngine(cc.EngineWarp(**COARSE), SETUP, params), SETUP)


@pytest.fixture
def rig():
    with opened_rig() as opened:
        yield opened


@pytest.fixture(scope="module")
def first_casts(tmp_path_factory, leave_figures_blank, make_engines_coarse):
    """Return the folder of a session that has made its first casts, and was fitted to them."""
    folder = tmp_path_factory.mktemp("first_casts")
    with pytest.MonkeyPatch.context() as patch, opened_rig() as opened:
        make_engines_coarse(patch)
        quicken(patch)
        leave_figures_blank(patch)
        prepare(opened, out=folder, tries=1)
    return folder


@pytest.fixture
def begun(first_casts, tmp_path):
    """Return a copy of that folder."""
    return shutil.copytree(first_casts, tmp_path / "begun")


def test_all_casts_go_into_a_new_fit_and_the_session_goes_on_with_it(rig, begun):
    first = prepare(rig, out=begun, tries=1)
    assert first.fitted_count == 3
    cc.aim(first, rig, TARGETS)
    again = prepare(rig, out=begun, tries=1, fit_all=True)
    folder = begun / "fits" / "00005-00000"
    tuned = json.loads((folder / "tune" / "config.json").read_text())["settings"]
    assert (tuned["training_count"], tuned["validation_count"]) == (5, 0)
    assert again.model.policy.model.fingerprint != first.model.policy.model.fingerprint
    assert again.fitted_count == len(again.casts) == 5
    for one, other in zip(first.casts, again.casts, strict=True):
        assert np.array_equal(one.final_xy, other.final_xy, equal_nan=True)
    # Aimed casts, too, say less than new ones: the simulator was fitted to them.
    assert all(again.predictor.fitted)

    cc.aim(again, rig, [[0.4, 1.0]])
    notes = []
    later = prepare(rig, out=begun, tries=1, progress=lambda state: notes.append(state.note))
    assert notes.count(DONE_NOTE) == 3
    assert later.model.policy.model.fingerprint == again.model.policy.model.fingerprint
    assert (later.fitted_count, len(later.casts)) == (5, 6)
    assert list(later.predictor.fitted) == [True] * 5 + [False]


def test_without_calibration_it_aims_at_once_and_the_first_casts_are_fitted(rig, tmp_path):
    options = {"out": tmp_path, "tries": 2, "within_pct": 0.01, "calibration_count": 0}
    session = prepare(rig, **options)
    assert (len(session.casts), session.fitted_count, session.refit_due) == (0, 0, None)
    believed = session.propose(TARGETS[0])
    # The simulators land far apart, and the region says so.
    sure = cc.AimSession(session.model.policy).propose(TARGETS[0])
    assert (
        believed.expected.ellipse(0.9).semi_axes[0] > 1.5 * sure.expected.ellipse(0.9).semi_axes[0]
    )

    cc.aim(session, rig, [*TARGETS, [0.4, 1.0]])
    assert session.fitted_count == 0
    due = RefitDue(RefitReason.FIRST_FIT, 6, 0)
    assert session.refit_due == due
    fork = session.fork()
    fork.undo()
    assert fork.refit_due == RefitDue(RefitReason.FIRST_FIT, 5, 0)
    fork.undo()
    assert fork.refit_due is None
    # A session that is opened again waits for them, too.
    again = prepare(rig, **options)
    assert again.refit_due == due
    cc.aim(again, rig, [0.0, 1.1])
    assert again.fitted_count == 6
    assert prepare(rig, **options).fitted_count == 6
    with pytest.raises(InputError, match="calibration_count is 1: a fit takes at least 2"):
        prepare(rig, calibration_count=1)


def paces_of(session):
    """Return the paces of the casts, of the candidates and of proposals."""
    casts = [cast.sweep[4] for cast in session.casts]
    proposals = [session.propose(target).action.pace for target in TARGETS]
    return np.array(casts), session.model.policy.actions[:, 4], np.array(proposals)


def test_only_a_fast_session_keeps_to_the_pace_of_the_paper(rig, tmp_path):
    for paces in paces_of(prepare(rig, fast=True, out=tmp_path)):
        np.testing.assert_array_equal(paces, 1.0)
    for paces in paces_of(prepare(rig)):
        assert np.all(paces != 1.0)
    with pytest.raises(DatasetError, match=r"ranges\.pace is \[1\.0, 1\.0\] there"):
        prepare(rig, out=tmp_path)


def test_the_command_states_the_pace_of_a_calm_cast_and_what_the_simulator_is_fitted_to(
    tmp_path, capsys
):
    options = [*COMMAND, "--calibration-count", "0", "--tries", "1", "--force"]
    first, second = (["--target", "1.1", "10"], ["--target", "1.0", "-5"])
    calm, fast = (["--out", str(tmp_path / name)] for name in ("calm", "fast"))
    assert main(["aim", *first, *options, *calm]) == 3
    printed = capsys.readouterr().out
    assert "no cast of cable_1 is known yet" in printed
    assert re.search(r"motion  \d+\.\d\d s, a pace of \d\.\d\d\n", printed)
    assert main(["aim", *second, *options, *calm]) == 3
    assert "1 cast of cable_1 is known; the simulator is fitted to 0" in capsys.readouterr().out
    assert main(["aim", *first, *options, *fast, "--fast"]) == 3
    assert re.search(r"motion  \d+\.\d\d s\n", capsys.readouterr().out)


def test_a_new_fit_needs_casts_and_a_folder(rig, tmp_path):
    for out in (tmp_path, None):
        with pytest.raises(InputError, match="needs the folder of a session"):
            prepare(rig, out=out, fit_all=True)


def test_casts_of_another_rig_are_not_taken_for_those_of_this_one(rig, begun):
    prepare(rig, out=begun)
    other = RigEngine(cc.EngineWarp(**COARSE), SETUP, SETUP.cable.params)
    with cc.make_rig(other, SETUP) as opened, pytest.raises(InputError) as refused:
        prepare(opened, out=begun)
    assert "holds casts of another rig: rig.params.bend_stiffness is 0.002 there" in str(
        refused.value
    )
    prepare(rig, out=begun)


def test_a_fit_to_casts_that_are_gone_is_refused(rig, begun):
    prepare(rig, out=begun, tries=1)
    prepare(rig, out=begun, tries=1, fit_all=True)
    sorted((begun / "session" / "casts").iterdir())[-1].unlink()
    with pytest.raises(InputError, match="a fit to 3 casts, but the session has 2"):
        prepare(rig, out=begun)


def test_a_command_without_a_target_is_refused(capsys):
    assert main(["aim", "--rig", "engine"]) == 2
    needed = "either --target R THETA or --target-xy X Y, once or more, or --paper-targets"
    assert needed in capsys.readouterr().err


def test_the_command_fits_anew_by_itself_before_a_new_target(tmp_path, capsys):
    options = [*COMMAND, "--out", str(tmp_path), "--calibration-count", "2"]
    options += ["--tries", "2", "--force"]
    assert main(["aim", "--target", "1.1", "10", "--target", "1.0", "-5", *options]) == 3
    once = [*options, "--tries", "1"]
    assert main(["aim", "--target", "1.2", "0", *once, "--no-refit"]) == 3
    printed = capsys.readouterr().out
    assert "new fit" not in printed
    settings = json.loads((tmp_path / "model" / "config.json").read_text())["settings"]
    assert settings["candidate_count"] == 300
    # Each target that was named was aimed at.
    assert [printed.count(f"\ntarget    r = {r} m") for r in ("1.100", "1.000", "1.200")] == [1] * 3
    assert main(["aim", "--target", "1.1", "-20", *once]) == 3
    printed = capsys.readouterr()
    due = "new fit   7 casts are known, and the simulator is fitted to 2 (--no-refit"
    assert due in printed.out
    assert "the simulator is fitted to 7 casts now" in printed.out
    assert "2/4 fit to 7 casts" in printed.err


def test_a_new_fit_that_was_stopped_goes_on_and_targets_keep_their_tries(rig, tmp_path):
    options = {"out": tmp_path, "tries": 2, "within_pct": 0.01, "calibration_count": 2}

    def stop_at_the_training(state):
        if state.task == "4/4 train":
            raise KeyboardInterrupt

    session = prepare(rig, **options)
    places = np.array([*TARGETS, [0.4, 1.0]])
    with pytest.raises(KeyboardInterrupt):
        cc.aim(session, rig, places, progress=stop_at_the_training)
    # Two tries at each of two targets: with those of the first fit, three times as many.
    assert len(session.casts) == 6
    stopped = tmp_path / "fits" / "00006-00000"
    assert not (stopped / "model" / "metrics.json").exists()
    ended = (stopped / "tune" / "metrics.json").stat().st_mtime_ns
    again = prepare(rig, **options)
    assert again.fitted_count == 2
    result = cc.aim(again, rig, places)
    assert (stopped / "tune" / "metrics.json").stat().st_mtime_ns == ended
    assert [len(casts) for casts in result.casts] == [2] * 3
    assert result.session is again
    assert again.fitted_count == 6


def test_after_an_undo_the_casts_that_are_left_are_fitted_anew(rig, begun):
    session = prepare(rig, out=begun, tries=1)
    cc.aim(session, rig, TARGETS)
    session.refit()
    before = session.model.policy.model.fingerprint
    session.undo(4)
    session.refit()
    assert session.model.policy.model.fingerprint != before
    assert session.fitted_count == len(session.predictor.casts) == 4
    kept = sorted(folder.name for folder in (begun / "fits").iterdir())
    assert kept == ["00005-00000", "00005-00001"]
    again = prepare(rig, out=begun, tries=1)
    assert again.model.policy.model.fingerprint == session.model.policy.model.fingerprint


@pytest.mark.parametrize("begins", ["casts", "nothing"])
def test_a_session_that_began_without_calibration_goes_on_without(rig, tmp_path, begins):
    casts = cc.collect(rig, count=4, out=tmp_path / "casts", progress=ignore)
    options, count = {"calibration_count": 0}, 0
    if begins == "casts":
        options, count = {"casts": casts}, 4
    first = prepare(rig, out=tmp_path / "aim", **options)
    again = prepare(rig, out=tmp_path / "aim")
    for session in (first, again):
        assert (len(session.casts), session.fitted_count) == (count, count)
    assert again.model.policy.model.fingerprint == first.model.policy.model.fingerprint
    for session in (first, again):
        assert (session.model.fitted_to is None) == (begins == "nothing")


def test_a_session_that_began_with_calibration_says_so_where_none_is_asked_for(rig, tmp_path):
    (tmp_path / "calibration").mkdir()
    with pytest.raises(InputError, match="began with calibration casts"):
        prepare(rig, out=tmp_path, calibration_count=0)


def test_a_fork_is_fitted_anew_without_touching_the_folder(rig, begun):
    session = prepare(rig, out=begun, tries=1)
    other = session.fork()
    other.cast(rig, other.propose(TARGETS[0]))
    other.refit(ignore)
    assert other.fitted_count == 4
    with pytest.raises(InputError, match="only a session that prepare_aim returned"):
        cc.AimSession(session.model.policy).refit()
    assert not (begun / "fits").exists()
    assert len(prepare(rig, out=begun, tries=1).casts) == len(session.casts) == 3


def test_a_session_of_a_fit_held_in_memory_is_opened_again_without_it(rig, tmp_path):
    casts = cc.collect(rig, count=3)
    tuned = cc.tune(casts, config=SEARCH, **COARSE)
    assert tuned.path is None
    # A run that was killed before the fit was kept leaves a folder.
    (tmp_path / "tune").mkdir()
    first = prepare(rig, out=tmp_path, tuned=tuned)
    again = prepare(rig, out=tmp_path)
    assert (len(again.casts), again.fitted_count) == (0, 0)
    assert again.model.tuned.params == tuned.params
    assert again.model.policy.model.fingerprint == first.model.policy.model.fingerprint
    np.testing.assert_array_equal(again.model.tuned.posterior.mean, tuned.posterior.mean)
    with pytest.raises(InputError, match="is a file: aiming needs a folder"):
        prepare(rig, out=tmp_path / "rig.json")


def test_what_was_learned_is_not_learned_again(rig, begun, monkeypatch):
    session = prepare(rig, out=begun, tries=1)
    cc.aim(session, rig, TARGETS)
    expected = session.predictor.predict(session.casts[-1].sweep)

    def refuse(*_, **__):
        raise AssertionError("nothing is left to simulate")

    with monkeypatch.context() as patch:
        patch.setattr(cc.EngineWarp, "rollout", refuse)
        patch.setattr("cablecast.data.simulate.feasible_actions", refuse)
        again = prepare(rig, out=begun, tries=1)
    for one, other in zip(again.predictor.predict(session.casts[-1].sweep), expected, strict=True):
        np.testing.assert_array_equal(one, other)
    (begun / "session" / "landings.npz").write_bytes(b"damaged")
    with pytest.warns(UserWarning, match=r"landings\.npz cannot be read, and its landings are sim"):
        mended = prepare(rig, out=begun, tries=1)
    np.testing.assert_allclose(
        mended.predictor.predict(session.casts[-1].sweep)[0], expected[0], rtol=0, atol=1e-6
    )


def casts_of(*innovations, fitted=5, try_number=1):
    """Return first tries with given innovations, casts that the simulator was fitted to, and which.

    The latter come last: a dataset may be taken in after casts at targets.
    """
    deviation = 0.1
    known = [made_up_cast((0.0, 0.0)) for _ in range(fitted)]
    aimed = [
        made_up_cast(
            (deviation * np.sqrt(2.0 * innovation), 0.0),
            (0.0, 0.0),
            deviation=deviation,
            try_number=try_number,
        )
        for innovation in innovations
    ]
    return aimed + known, [False] * len(aimed) + [True] * fitted


def test_a_new_fit_is_due_at_three_times_the_casts_or_when_first_tries_land_far_off():
    assert refit_due(*casts_of(*[1.0] * 9)) is None
    due = refit_due(*casts_of(*[1.0] * 10))
    assert due.reason is RefitReason.MORE_CASTS
    assert refit_text(due) == "15 casts are known, and the simulator is fitted to 5"
    # Twice the casts and a mean innovation of 3: 1.7 times as far as stated.
    due = refit_due(*casts_of(*[3.0] * 5))
    assert due.reason is RefitReason.FAR_OFF
    assert "1.7 times as far off" in refit_text(due)
    assert refit_due(*casts_of(*[3.0] * 4)) is None
    # One cast that went wrong is no reason, and casts without a landing tell nothing.
    assert refit_due(*casts_of(100.0, 0.5, 0.5, 0.5, 0.5)) is None
    assert refit_due(*casts_of(3.0, 3.0, *[np.nan] * 3)) is None
    assert refit_due(*casts_of(*[3.0] * 5, try_number=2)) is None
    assert refit_due(*casts_of(*[3.0] * 100, fitted=40)) is None
    assert refit_due(*casts_of(*[3.0] * 100, fitted=0)) is None
    assert refit_due(*casts_of(*[1.0] * 4, fitted=0), needs_first_fit=True) is None
    due = refit_due(*casts_of(*[1.0] * 5, fitted=0), needs_first_fit=True)
    assert due.reason is RefitReason.FIRST_FIT
    assert refit_text(due).endswith("fitted to none")
