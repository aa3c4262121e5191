"""A session whose simulator is fitted anew to all casts that it has."""

import dataclasses
import functools
import json

import numpy as np
import pytest

import cablecast as cc
from cablecast.cli import main
from cablecast.errors import InputError
from cablecast.pipeline import aim as aim_module
from cablecast.rigs.engine import RigEngine
from cablecast.runs.progress import DONE_NOTE

pytest.importorskip("torch")
pytest.importorskip("matplotlib")

COARSE = {"segment_count": 10, "dt": 2e-3}
SEARCH = cc.FitConfig(start_count=3, coarse_iterations=2, fine_start_count=1, fine_iterations=1)
SMALL = {"calibration_count": 3, "count": 120}
SETUP = cc.Setup()
TARGETS = np.array([[0.3, 1.1], [-0.2, 1.1]])


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    tune, simulate, train = aim_module.tune, aim_module.simulate, aim_module.train
    quick_tune = functools.partial(tune, config=SEARCH, **COARSE)
    monkeypatch.setattr(aim_module, "tune", quick_tune)
    monkeypatch.setattr(aim_module, "simulate", functools.partial(simulate, **COARSE))
    few = {"epochs": 2, "candidate_count": 200}
    monkeypatch.setattr(aim_module, "train", lambda casts, **given: train(casts, **(given | few)))
    monkeypatch.setattr("cablecast.pipeline.aim_beliefs._SPREAD_ACTIONS", 10)


@pytest.fixture
def rig():
    # A cable that is not as it is believed to be.
    params = dataclasses.replace(SETUP.cable.params, bend_stiffness=2e-3, lateral_friction=0.4)
    own = RigEngine(cc.EngineWarp(**COARSE), SETUP, params)
    with cc.make_rig(own, SETUP) as opened:
        yield opened


def test_all_casts_go_into_a_new_fit_and_the_session_goes_on_with_it(rig, tmp_path):
    first = cc.prepare_aim(rig, out=tmp_path, tries=1, **SMALL)
    assert first.fitted_count == 3
    cc.aim(first, rig, TARGETS)
    again = cc.prepare_aim(rig, out=tmp_path, tries=1, fit_all=True, **SMALL)
    folder = tmp_path / "fits" / "00005"
    tuned = json.loads((folder / "tune" / "config.json").read_text())["settings"]
    assert (tuned["training_count"], tuned["validation_count"]) == (5, 0)
    assert again.aimer.policy.model.fingerprint != first.aimer.policy.model.fingerprint
    assert again.fitted_count == len(again.history) == 5
    for one, other in zip(first.history, again.history, strict=True):
        assert np.array_equal(one.final_xy, other.final_xy, equal_nan=True)
    # Aimed casts, too, say less than new ones: the simulator was fitted to them.
    assert all(cast.fitted for cast in again.aimer.casts)

    cc.aim(again, rig, [[0.4, 1.0]])
    notes = []
    later = cc.prepare_aim(
        rig, out=tmp_path, tries=1, progress=lambda state: notes.append(state.note), **SMALL
    )
    assert notes.count(DONE_NOTE) == 3
    assert later.aimer.policy.model.fingerprint == again.aimer.policy.model.fingerprint
    assert (later.fitted_count, len(later.history)) == (5, 6)
    assert [cast.fitted for cast in later.aimer.casts] == [True] * 5 + [False]


def test_a_new_fit_needs_casts_and_a_folder(rig, tmp_path):
    with pytest.raises(InputError, match="needs the folder of a session"):
        cc.prepare_aim(rig, out=tmp_path, fit_all=True, **SMALL)
    with pytest.raises(InputError, match="needs the folder of a session"):
        cc.prepare_aim(rig, fit_all=True, **SMALL)


def test_a_fit_to_casts_that_are_gone_is_refused(rig, tmp_path):
    cc.prepare_aim(rig, out=tmp_path, tries=1, **SMALL)
    cc.prepare_aim(rig, out=tmp_path, tries=1, fit_all=True, **SMALL)
    sorted((tmp_path / "session" / "casts").iterdir())[-1].unlink()
    with pytest.raises(InputError, match="a fit to 3 casts, but the session has 2"):
        cc.prepare_aim(rig, out=tmp_path, **SMALL)


def test_a_command_without_a_target_is_refused(capsys):
    assert main(["aim", "--rig", "engine"]) == 2
    assert "at least one --target" in capsys.readouterr().err


def test_the_command_says_when_a_new_fit_is_worth_it(tmp_path, capsys):
    options = ["--rig", "engine", "--out", str(tmp_path), "--calibration-count", "2"]
    options += ["--count", "120", "--tries", "2", "--within", "0.01"]
    assert main(["aim", "--target", "1.1", "10", "--target", "1.0", "-5", *options]) == 3
    printed = capsys.readouterr().out
    assert "--fit-all" not in printed
    # Each target that was named was aimed at.
    assert [printed.count(f"\ntarget    r = {r} m") for r in ("1.100", "1.000")] == [1, 1]
    assert main(["aim", "--target", "1.1", "10", *options]) == 3
    assert "note: --fit-all fits the simulator to all of them" in capsys.readouterr().out
    assert main(["aim", "--target", "1.1", "10", *options, "--fit-all"]) == 3
    assert "6 casts of cable_1 are known; the simulator fits 6" in capsys.readouterr().out
