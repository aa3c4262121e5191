"""Simulators of other physics that follow the same casts."""

import dataclasses

import numpy as np
import pytest

from cablecast.cable import FITTED_MATERIAL, PAPER_PARAMS, PARAMS
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.setup import Setup
from cablecast.tuning.ensemble import MEMBER_COUNT, other_materials
from cablecast.tuning.fit import FitConfig
from cablecast.tuning.space import ParamPosterior
from cablecast.tuning.tracks import TrackObjective
from cablecast.tuning.tune import fit_params
from cablecast.tuning.tuned import Tuned, load_tuned, write_params

CONFIG = FitConfig(
    start_count=2, rough_iterations=6, kept_start_count=1, coarse_iterations=1, fine_iterations=2
)
COARSE = {"segment_count": 10, "dt": 2e-3}


@pytest.fixture(scope="module")
def few(tracks):
    return tracks[np.arange(4)]


@pytest.fixture(scope="module")
def fitted(cable, few):
    engine = EngineWarp(**COARSE)
    return fit_params(Setup(cable=cable), few, None, (engine,) * 3, CONFIG)


def test_the_first_material_is_that_of_the_cable_and_each_other_one_is_changed(cable):
    found = cable.with_params(damping_time=0.01, rest_curvature=0.1).params
    materials = other_materials(found, 0.62)
    assert len(materials) == MEMBER_COUNT
    assert materials[0] == found
    assert len(set(materials)) == MEMBER_COUNT
    curls = sorted(float(m.rest_curvature) - 0.1 for m in materials)
    assert curls[0] == pytest.approx(-curls[-1])


def test_materials_at_their_bounds_stay_within_them(cable):
    ends = {name: PARAMS[name].bounds[1] for name in FITTED_MATERIAL}
    assert len(other_materials(cable.with_params(**ends).params, 0.62)) == MEMBER_COUNT


def test_each_member_follows_the_casts_better_with_its_own_parameters(fitted, cable, few):
    engine = EngineWarp(**COARSE)
    assert len(fitted.members) == MEMBER_COUNT
    for member in fitted.members:
        objective = TrackObjective(engine, cable, few)
        own = objective.distances(member.params).loss[0]
        material = {name: getattr(member.params, name) for name in FITTED_MATERIAL}
        other = dataclasses.replace(fitted.params, **material)
        assert own <= objective.distances(other).loss[0]
        # None of these materials is far from the true one.
        assert own < 0.05 * cable.length


def test_members_part_where_the_casts_say_nothing(fitted, cable, tracks, few):
    def spread(some):
        ends = []
        for member in fitted.members:
            xy, _ = TrackObjective(EngineWarp(**COARSE), cable, some).tracks_of(member.params)
            ends.append(xy[0, :, -1])
        return np.median(np.linalg.norm(np.std(ends, axis=0), axis=1)) / cable.length

    others = tracks[np.arange(4, len(tracks))]
    assert 1e-3 < spread(few) < spread(others)


def test_it_is_kept_with_the_parameters(fitted, cable, tmp_path):
    write_params(tmp_path, fitted.to_dict())
    again = load_tuned(tmp_path, Setup(cable=cable))
    assert (again.members, again.resolution) == (fitted.members, fitted.resolution)
    assert again.member_resolution == fitted.member_resolution


@pytest.mark.parametrize("damage", [{"segment_count": 1}, {"fine_dt": None}, {"members": []}])
def test_a_damaged_one_is_refused(fitted, cable, tmp_path, damage):
    values = fitted.to_dict()
    write_params(tmp_path, values | {"ensemble": values["ensemble"] | damage})
    with pytest.raises(InputError, match="does not hold tuned parameters"):
        load_tuned(tmp_path, Setup(cable=cable))


def test_its_simulations_count_as_coarse_ones_and_none_is_made_without_steps(fitted, cable, few):
    engine = EngineWarp(**COARSE)
    without = dataclasses.replace(CONFIG, ensemble_iterations=0)
    alone = fit_params(Setup(cable=cable), few, None, (engine,) * 3, without)
    assert alone.members == ()
    more = fitted.metrics["coarse_simulation_count"] - alone.metrics["coarse_simulation_count"]
    assert more == fitted.metrics["simulation_count"] - alone.metrics["simulation_count"] > 0


def test_before_any_cast_the_members_are_drawn_from_what_is_believed(cable):
    setup, belief = Setup(cable=cable), ParamPosterior.before_casts(cable)
    one, same, other = (Tuned.believed(setup, seed) for seed in (0, 0, 1))
    assert one.members == same.members != other.members
    assert one.dynamics == one.members[0]
    assert one.fitted_to is None
    likeliest = one.members[0]
    np.testing.assert_allclose(likeliest.params.to_array()[:10], cable.params.to_array()[:10])
    # What is usual of a real cable, though its file says nothing of it.
    assert likeliest.params.damping_time == pytest.approx(8e-3)
    assert likeliest.params.rest_curvature == pytest.approx(0.0)
    many = [m for seed in range(20) for m in Tuned.believed(setup, seed).members[1:]]
    turns = [cable.length * m.params.rest_curvature for m in many]
    assert 0.2 < np.std(turns) < 0.4
    # Draws lie about a deviation from the believed values, and all deviate.
    points = np.array([belief.space.to_unit(m.params) for m in many])
    deviation = np.sqrt(np.mean((points - belief.mean) ** 2, axis=0))
    assert np.all(deviation > 0.5 * np.minimum(belief.deviation, 0.3))
    assert np.all(deviation < 1.3 * belief.deviation)
    assert set(belief.undetermined) == set(PAPER_PARAMS)
