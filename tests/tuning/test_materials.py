"""A fit finds each value of a material that the casts tell, and keeps what the file says."""

import dataclasses

import numpy as np
import pytest

from cablecast.cable import FITTED_MATERIAL, PARAMS, Attachment
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath
from cablecast.setup import Setup
from cablecast.tuning.fit import FitConfig
from cablecast.tuning.space import YIELD_TIME, ParamPrior, SearchSpace
from cablecast.tuning.tracks import TrackObjective
from cablecast.tuning.tune import fit_params
from cablecast.tuning.tuned import load_tuned, write_params

PLAIN = FitConfig(
    start_count=8,
    rough_iterations=8,
    kept_start_count=1,
    coarse_iterations=1,
    fine_iterations=2,
    materials=(),
    ensemble_iterations=0,
)
COARSE = {"segment_count": 10, "dt": 2e-3}
LENGTH = Setup().cable.length


def finding(*names):
    """Return the settings of a fit that finds some material parameters."""
    return dataclasses.replace(PLAIN, materials=names)


def tracks_of(cable, truth, tracks, **material):
    """Return tracks of the same casts, of a cable of another material."""
    params = dataclasses.replace(truth, **material)
    xy, _ = TrackObjective(EngineWarp(**COARSE), cable, tracks).tracks_of(params)
    return dataclasses.replace(tracks, endpoint_xy=xy[0, :, :-1], final_xy=xy[0, :, -1])


def fit(cable, tracks, config):
    engine = EngineWarp(**COARSE)
    return fit_params(Setup(cable=cable), tracks, None, (engine,) * 3, config)


def miss(tuned):
    """Return how closely a fit follows its casts [% of cable length]."""
    return tuned.metrics["training"]["tuned"]["mean_pct"]


@pytest.fixture(scope="module")
def damped(cable, truth, tracks):
    return tracks_of(cable, truth, tracks[np.arange(6)], damping_time=0.03)


@pytest.fixture(scope="module")
def fitted(cable, damped):
    return fit(cable, damped, finding("damping_time"))


def test_the_damping_time_of_a_damped_cable_is_found(fitted, cable, damped):
    assert 0.02 < fitted.params.damping_time < 0.045
    without = fit(cable, damped, PLAIN)
    assert not without.params.has_material
    assert miss(fitted) < 0.8 * miss(without)


def test_the_curl_of_a_cable_is_found_with_a_handful_of_casts_to_both_sides(cable, truth, tracks):
    few = tracks[np.arange(5)]
    paths = few.grip_path
    both = GripPath.stack([paths[np.arange(3)], paths[np.arange(3, 5)].mirrored()])
    few = dataclasses.replace(few, grip_path=both)
    curled = tracks_of(cable, truth, few, rest_curvature=0.4 / LENGTH)
    result = fit(cable, curled, finding("rest_curvature"))
    # With five casts what is believed, none, still counts.
    assert 0.2 < result.params.rest_curvature * LENGTH < 0.5


def test_bends_that_stay_in_a_cable_are_found(cable, truth, tracks):
    bent = tracks_of(
        cable, truth, tracks[np.arange(6)], yield_curvature=10.0, yield_time=YIELD_TIME
    )
    # From 8 starts one build of the engine ends in a valley at 22 1/m with twice the loss.
    many = dataclasses.replace(finding("yield_curvature"), start_count=24)
    result = fit(cable, bent, many)
    # Folds magnify rounding: three builds of one engine found 12, 14 and 15 1/m.
    assert 6.0 < result.params.yield_curvature < 17.0
    assert result.params.yield_time == YIELD_TIME


def test_the_arm_of_an_attachment_is_found(cable, truth, good):
    arm = 2.0 / 3.0 * cable.attachment_length
    body = tracks_of(cable, truth, good[np.arange(5)], attachment_arm=arm)
    result = fit(cable, body, finding("attachment_arm"))
    assert result.params.attachment_arm == pytest.approx(arm, rel=0.3)


def test_pads_of_a_gripper_that_give_are_found(cable, truth, good):
    # As stiff as a rod: a soft rope bends at its first segments far more than pads turn.
    stiff, compliance = cable.with_params(bend_stiffness=0.01), 10.0
    true = dataclasses.replace(truth, bend_stiffness=0.01)
    soft = tracks_of(stiff, true, good[np.arange(5)], grip_compliance=compliance)
    result = fit(stiff, soft, finding("grip_compliance"))
    assert 0.5 * compliance < result.params.grip_compliance < 2.0 * compliance


def test_a_rod_without_a_material_is_followed_without_one(cable, tracks):
    few = tracks[np.arange(5)]
    result, plain = (fit(cable, few, finding(*names)) for names in (FITTED_MATERIAL, ()))
    assert not result.params.has_material
    np.testing.assert_array_equal(result.params.to_array(), plain.params.to_array())
    assert result.metrics["simulation_count"] > plain.metrics["simulation_count"]


def test_values_of_the_cables_file_are_kept(cable):
    own = cable.with_params(damping_time=0.002, drag_coefficient=0.6)
    space = SearchSpace.for_cable(own, FITTED_MATERIAL)
    assert set(space.names[10:]) == set(FITTED_MATERIAL) - {"damping_time", "drag_coefficient"}
    found = space.to_params(np.full(space.dimension, 0.5))
    assert (found.damping_time, found.drag_coefficient) == (0.002, 0.6)


def test_a_cable_without_attachment_has_no_arm(cable):
    bare = dataclasses.replace(cable, attachment=Attachment.NONE, attachment_length=0.0)
    assert "attachment_arm" not in SearchSpace.for_cable(bare, FITTED_MATERIAL).names


def test_the_most_likely_material_is_the_usual_one(cable):
    space = SearchSpace.for_cable(cable, FITTED_MATERIAL)
    ten = ParamPrior.for_cable(cable, SearchSpace.for_cable(cable))
    prior = ParamPrior.for_cable(cable, space)
    np.testing.assert_array_equal(prior.mean[:10], ten.mean)
    usual = space.to_params(prior.mean)
    assert usual.drag_coefficient == pytest.approx(1.1)
    assert usual.rest_curvature == pytest.approx(0.0, abs=1e-12)
    assert usual.friction_ratio == pytest.approx(1.0)
    farther = space.to_params(prior.mean + prior.deviation)
    assert farther.drag_coefficient == pytest.approx(1.1 * 1.3)
    assert farther.rest_curvature * LENGTH == pytest.approx(0.3)


def test_a_material_keeps_within_its_bounds_anywhere_in_the_box(cable):
    space = SearchSpace.for_cable(cable, FITTED_MATERIAL)
    corners = space.to_params(np.full((2, space.dimension), [[-1.0], [2.0]]))
    assert corners.world_count == 2
    for name in FITTED_MATERIAL:
        low, high = PARAMS[name].bounds
        assert np.all(getattr(corners, name) >= low)
        assert np.all(getattr(corners, name) <= high)


def test_unknown_values_are_refused():
    with pytest.raises(InputError, match="materials = 'softness' is none of damping_time"):
        FitConfig(materials=("softness",))


def test_the_material_is_kept_with_the_parameters(fitted, cable, tmp_path):
    write_params(tmp_path, fitted.to_dict())
    assert load_tuned(tmp_path, Setup(cable=cable)).params == fitted.params
