import dataclasses

import numpy as np
import pytest

from cablecast.aiming.session import AimSession
from cablecast.cast import TrialStatus
from cablecast.data.dataset import read_dataset
from cablecast.errors import DatasetError, InputError
from cablecast.evaluation.evaluate import evaluate_policy
from cablecast.pipeline.collect import collect
from cablecast.pipeline.evaluate import CASTS_FOLDER
from cablecast.runs.folder import Parts
from cablecast.setup import Setup
from cablecast.tuning.tuned import PARAMS_FILE, write_params
from cablecast.view.look import open_collection
from cablecast.view.page import slid_params

TARGETS = np.array([[0.3, 1.15], [-0.2, 1.2]])


def test_casts_of_a_rig_are_shown_as_measured_and_as_simulated(rig, engine, tmp_path):
    casts = collect(rig, count=2, out=tmp_path / "casts")
    found = open_collection(tmp_path / "casts")
    assert len(found) == 2
    for index in (-1, 2):
        with pytest.raises(InputError, match=f"cast = {index} is outside"):
            found.shot(index, engine)
    with pytest.raises(DatasetError, match="holds no casts"):
        open_collection(tmp_path / "casts" / "data")
    measured = found.measured(1)
    assert np.allclose(measured.path[-1], casts.rest_xy[1], atol=1e-6)
    simulated = found.simulated(1, engine, found.believed)
    assert simulated.nodes is not None
    shot = found.shot(1, engine)
    assert shot.other is not None
    assert shot.caption == "cast 1"


def test_an_evaluation_knows_its_targets_and_which_casts_have_no_landing(
    own, policy, engine, tmp_path
):
    evaluate_policy(tmp_path / "a" / CASTS_FOLDER, policy, own, TARGETS, repeats=2)
    found = open_collection(tmp_path / "a")
    assert found.target_xy.tolist() == TARGETS.repeat(2, axis=0).tolist()
    assert found.measured(0).nodes is not None
    assert found.shot(0, engine).result.endswith("% of the cable's length off")
    # One that was seen to the table's edge.
    own.status = TrialStatus.OFF_TABLE
    evaluate_policy(tmp_path / "b" / CASTS_FOLDER, policy, own, TARGETS)
    shot = open_collection(tmp_path / "b").shot(0, engine)
    assert np.isfinite(shot.cast.path[-1]).all()
    assert not shot.landed
    assert shot.result.endswith(": off table")


def test_a_session_of_aim_is_shown_with_its_tries(open_desk, policy, tmp_path):
    desk = open_desk(AimSession(policy, out=tmp_path / "session"))
    desk.cast(desk.aim(TARGETS[0]))
    desk.cast(desk.correct())
    found = open_collection(tmp_path)
    assert found.labels[1] == "cast 1 at 1.19 m, 15°, try 2"
    assert found.measured(1).nodes is not None
    assert found.setup == desk.setup


def test_an_evaluation_is_simulated_with_what_tune_found_beside_it(own, policy, tmp_path):
    evaluate_policy(tmp_path / "evaluate-own" / CASTS_FOLDER, policy, own, TARGETS)
    params = dataclasses.replace(Setup().cable.params, mass=0.077)
    write_tuning(tmp_path / "tune", params, "")
    assert open_collection(tmp_path / "evaluate-own").fitted.params.mass == 0.077


def write_tuning(folder, params, fingerprint):
    values = {"cable": Setup().cable.name, "params": params.to_dict()}
    write_params(folder / PARAMS_FILE, values)
    Parts(folder).put("metrics", {"dataset_fingerprint": fingerprint})


def test_a_tuning_result_is_shown_over_the_casts_that_it_was_fitted_to(rig, engine, tmp_path):
    for name, count in (("other", 2), ("casts", 3)):
        collect(rig, count=count, out=tmp_path / name)
    fitted = dataclasses.replace(Setup().cable.params, mass=0.05)
    write_tuning(tmp_path / "tune", fitted, read_dataset(tmp_path / "casts").fingerprint)
    found = open_collection(tmp_path / "tune")
    assert len(found) == 3
    assert found.tuned.params.mass == fitted.mass
    write_tuning(tmp_path / "tune", fitted, "of nothing here")
    with pytest.raises(DatasetError, match="do not lie next to it"):
        open_collection(tmp_path / "tune")


def test_the_newest_fit_of_a_session_is_shown_and_none_of_another_cable(
    open_desk, policy, tmp_path
):
    session = tmp_path / "aim"
    desk = open_desk(AimSession(policy, out=session / "session"))
    desk.cast(desk.aim(TARGETS[0]))
    masses = {"tune": 0.03, "fits/00005-00000/tune": 0.04, "fits/00015-00000/tune": 0.05}
    for name, mass in masses.items():
        params = dataclasses.replace(Setup().cable.params, mass=mass)
        write_tuning(session / name, params, "")
        assert open_collection(session).tuned.params.mass == mass
    write_params(tmp_path / "tune" / PARAMS_FILE, {"cable": "cable_2", "params": params.to_dict()})
    assert open_collection(session).tuned.params.mass == mass


def test_sliders_multiply_parameters_and_stay_within_their_bounds():
    base = Setup().cable.params
    slid = slid_params(base, {"mass": -1.0, "worksurface_friction": 1.0})
    assert slid.mass == pytest.approx(base.mass / 10)
    assert slid.worksurface_friction <= 2.0
    for exponents in ({"mass": 3.0}, {"mass": float("nan")}, {"length": 0.1}):
        with pytest.raises(InputError, match="is outside"):
            slid_params(base, exponents)
