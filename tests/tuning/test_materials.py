"""Damping, curl, yield and an arm are taken up where the casts ask for them, and only there."""

import dataclasses

import numpy as np
import pytest

from cablecast.engines.warp_ import EngineWarp
from cablecast.material import Material
from cablecast.setup import Setup
from cablecast.tuning.fit import fit_params
from cablecast.tuning.least_squares import FitConfig
from cablecast.tuning.materials import GAIN_MIN, first_material
from cablecast.tuning.objective import TrackObjective
from cablecast.tuning.result import params_file, read_dynamics, write_params

WITH_ARMS = FitConfig(
    start_count=2,
    coarse_iterations=6,
    fine_start_count=1,
    fine_iterations=2,
    drag_coefficient=0.0,
    yield_curvatures=(),
)
# The hook of most of these casts is a point mass.
CONFIG = dataclasses.replace(WITH_ARMS, arms=())
# Whether materials are tried does not depend on how good the fit is.
POOR = dataclasses.replace(CONFIG, start_count=1, coarse_iterations=1, fine_iterations=1)
DAMPED = Material(damping_time=0.03)
COARSE = {"segment_count": 10, "dt": 2e-3}
LENGTH = Setup().cable.length


def sides(tracks):
    """Return the sides of the table on which casts end."""
    return {"right" if x > 0 else "left" for x in tracks.final_xy[:, 0]}


def tracks_of(cable, truth, tracks, material):
    """Return tracks of the same casts, of a cable of another material."""
    other = dataclasses.replace(cable, material=material)
    xy, _ = TrackObjective(EngineWarp(**COARSE), other, tracks).tracks_of(truth)
    return dataclasses.replace(tracks, endpoint_xy=xy[0, :, :-1], final_xy=xy[0, :, -1])


@pytest.fixture(scope="module")
def damped(cable, truth, tracks):
    return tracks_of(cable, truth, tracks, DAMPED)


@pytest.fixture(scope="module")
def fitted(cable, damped):
    engine = EngineWarp(**COARSE)
    return fit_params(cable, damped, None, engine, engine, CONFIG)


def test_the_damping_time_of_a_damped_cable_is_found(fitted):
    assert fitted.material == DAMPED
    assert fitted.material_gain > GAIN_MIN


def test_a_cable_that_rates_of_damping_explain_gets_no_damping_time(cable, tracks):
    engine = EngineWarp(**COARSE)
    no_curls = dataclasses.replace(CONFIG, curls=())
    result = fit_params(cable, tracks, None, engine, engine, no_curls)
    assert result.material is None
    # The fit begins with the usual damping time.
    assert result.material_gain > GAIN_MIN


def test_the_curl_of_a_cable_is_found_with_a_handful_of_casts_to_both_sides(cable, truth, tracks):
    assert {"left", "right"} == sides(tracks[np.arange(5)])
    curled = tracks_of(cable, truth, tracks[np.arange(5)], Material(rest_curvature=0.4 / LENGTH))
    engine = EngineWarp(**COARSE)
    result = fit_params(cable, curled, None, engine, engine, CONFIG)
    assert result.material is not None
    assert 0.25 < result.material.rest_curvature * LENGTH < 0.55
    assert result.material_gain > GAIN_MIN
    straight = dataclasses.replace(CONFIG, curls=(), damping_times=())
    without = fit_params(cable, curled, None, engine, engine, straight)
    assert without.material is None
    assert result.training.loss[1] < 0.8 * without.training.loss[1]


def test_bends_that_stay_in_a_cable_are_found(cable, truth, tracks):
    yielding = Material(yield_curvature=10.0, yield_time=0.4)
    bent = tracks_of(cable, truth, tracks, yielding)
    engine = EngineWarp(**COARSE)
    alone = dataclasses.replace(
        CONFIG, curls=(), damping_times=(), yield_curvatures=(0.0, 10.0, 20.0, 40.0)
    )
    result = fit_params(cable, bent, None, engine, engine, alone)
    assert result.material == yielding
    assert result.material_gain > GAIN_MIN


def test_air_drags_on_a_cable_and_damping_is_usual_unless_its_file_says_otherwise(cable):
    usual = first_material(cable, FitConfig())
    assert usual.drag_coefficient == FitConfig().drag_coefficient
    assert usual.damping_time == FitConfig().damping_times[0]
    own = Material(damping_time=0.002, drag_coefficient=0.6)
    first = first_material(dataclasses.replace(cable, material=own), FitConfig())
    assert (first.damping_time, first.drag_coefficient) == (0.002, 0.6)


def test_what_the_cables_file_says_is_kept(cable, damped):
    engine = EngineWarp(**COARSE)
    both = Material(damping_time=0.03, rest_curvature=0.1)
    told = dataclasses.replace(cable, material=both)
    known = fit_params(told, damped, None, engine, engine, POOR)
    assert known.material is None
    assert known.material_gain == 0.0


def test_an_attachment_is_a_body_unless_the_casts_tell_a_point_mass(cable, truth, tracks):
    engine = EngineWarp(**COARSE)
    only_arms = dataclasses.replace(WITH_ARMS, damping_times=(), curls=())
    point = fit_params(cable, tracks, None, engine, engine, only_arms)
    assert point.material is None
    assert point.material_gain > GAIN_MIN
    arm = 2.0 / 3.0 * cable.attachment_length
    body = tracks_of(cable, truth, tracks, Material(attachment_arm=arm))
    found = fit_params(cable, body, None, engine, engine, only_arms)
    assert found.material == Material(attachment_arm=arm)
    no_arms = dataclasses.replace(only_arms, arms=())
    without = fit_params(cable, body, None, engine, engine, no_arms)
    assert found.training.loss[1] < 0.8 * without.training.loss[1]


def test_the_material_is_kept_with_the_parameters(fitted, cable, tmp_path):
    write_params(tmp_path, {"cable": cable.name, **params_file(fitted, cable.length, None)})
    assert read_dynamics(tmp_path).material == DAMPED
