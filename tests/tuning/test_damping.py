"""A damping time is taken up where the casts ask for it, and only there."""

import dataclasses

import numpy as np
import pytest

from cablecast.engines.warp_ import EngineWarp
from cablecast.material import Material
from cablecast.tuning.damping import EVIDENCE_MIN, TRACKS_MIN
from cablecast.tuning.fit import fit_params
from cablecast.tuning.least_squares import FitConfig
from cablecast.tuning.objective import TrackObjective
from cablecast.tuning.result import params_file, read_dynamics, write_params

CONFIG = FitConfig(start_count=2, coarse_iterations=6, fine_start_count=1, fine_iterations=2)
# Whether damping times are tried does not depend on how good the fit is.
POOR = dataclasses.replace(CONFIG, start_count=1, coarse_iterations=1, fine_iterations=1)
DAMPED = Material(damping_time=0.03)
COARSE = {"segment_count": 10, "dt": 2e-3}


@pytest.fixture(scope="module")
def damped(cable, truth, tracks):
    """Return tracks of the same casts, of a cable whose material damps."""
    material = dataclasses.replace(cable, material=DAMPED)
    engine = EngineWarp(**COARSE)
    xy, _ = TrackObjective(engine, material, tracks).tracks_of(truth)
    return dataclasses.replace(tracks, endpoint_xy=xy[0, :, :-1], final_xy=xy[0, :, -1])


@pytest.fixture(scope="module")
def fitted(cable, damped):
    engine = EngineWarp(**COARSE)
    return fit_params(cable, damped, None, engine, engine, CONFIG)


def test_the_damping_time_of_a_damped_cable_is_found(fitted):
    assert fitted.material == DAMPED
    assert tuple(fitted.damping_evidence) == CONFIG.damping_times
    assert fitted.damping_evidence[0.03] == max(fitted.damping_evidence.values())
    assert fitted.damping_evidence[0.03] > EVIDENCE_MIN


def test_a_cable_that_rates_of_damping_explain_gets_none(cable, tracks):
    engine = EngineWarp(**COARSE)
    result = fit_params(cable, tracks, None, engine, engine, CONFIG)
    assert len(tracks) >= TRACKS_MIN
    assert max(result.damping_evidence.values()) < EVIDENCE_MIN
    assert result.material is None


def test_nothing_is_tried_with_a_handful_of_casts_or_where_the_cable_says_it(cable, damped):
    engine = EngineWarp(**COARSE)
    few = fit_params(cable, damped[np.arange(3)], None, engine, engine, POOR)
    told = dataclasses.replace(cable, material=DAMPED)
    known = fit_params(told, damped, None, engine, engine, POOR)
    unwanted = dataclasses.replace(POOR, damping_times=())
    told_not_to = fit_params(cable, damped, None, engine, engine, unwanted)
    for result in (few, known, told_not_to):
        assert not result.damping_evidence
        assert result.material is None


def test_the_material_is_kept_with_the_parameters(fitted, cable, tmp_path):
    write_params(tmp_path, {"cable": cable.name, **params_file(fitted, cable.length, None)})
    assert read_dynamics(tmp_path).material == DAMPED
