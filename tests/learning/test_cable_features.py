import dataclasses

import numpy as np

from cablecast.cable import CableParams, load_cable
from cablecast.engines.warp_ import EngineWarp
from cablecast.learning.network import CABLE_FEATURES, cable_features
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.setup import Setup
from cablecast.tuning.space import draw_cables

CABLE = load_cable("cable_1")

# The engine computes in single precision; casts that come to rest on an edge between two ways of
# falling enlarge its rounding, and one in thirty does.
ROUNDING_PCT = 0.1


def rescaled(params, factor, friction_factor):
    """Return cables of another mass and stiffness and other shares of friction, alike otherwise."""
    return dataclasses.replace(
        params,
        twist_stiffness=params.twist_stiffness * factor,
        bend_stiffness=params.bend_stiffness * factor,
        mass=params.mass * factor,
        endpoint_mass=params.endpoint_mass * factor,
        lateral_friction=params.lateral_friction * friction_factor,
        worksurface_friction=params.worksurface_friction / friction_factor,
    )


def test_cables_with_equal_features_land_in_the_same_place():
    setup = Setup(cable=CABLE)
    paths = cast_grip_paths(feasible_uniform(32, setup, seed=3), setup)
    params = draw_cables(CABLE, 32, seed=3)
    other = rescaled(params, 1.7, 0.9)
    np.testing.assert_allclose(cable_features(other, CABLE), cable_features(params, CABLE))
    engine = EngineWarp(segment_count=12, dt=1e-3)
    landed = [engine.rollout(CABLE, p, paths).endpoint_xy[:, -1] for p in (params, other)]
    apart_pct = 100 * np.linalg.norm(landed[0] - landed[1], axis=1) / CABLE.length
    assert np.quantile(apart_pct, 0.75) < ROUNDING_PCT
    # The same casts with half the friction land elsewhere, and the features say so.
    smooth = dataclasses.replace(params, lateral_friction=params.lateral_friction / 2)
    elsewhere = engine.rollout(CABLE, smooth, paths).endpoint_xy[:, -1]
    assert np.median(np.linalg.norm(landed[0] - elsewhere, axis=1)) > 0.01
    assert not np.allclose(cable_features(smooth, CABLE), cable_features(params, CABLE))


def test_every_feature_follows_its_parameter_and_a_zero_is_finite():
    params = draw_cables(CABLE, 4, seed=0)
    before = cable_features(params, CABLE)
    for name, column in zip(
        (
            "twist_stiffness",
            "bend_stiffness",
            "endpoint_mass",
            "worksurface_friction",
            "spinning_friction",
            "rolling_friction",
            "linear_damping",
            "angular_damping",
        ),
        range(len(CABLE_FEATURES)),
        strict=True,
    ):
        more = dataclasses.replace(params, **{name: getattr(params, name) * 1.1})
        change = cable_features(more, CABLE) - before
        assert np.all(change[:, column] > 0), name
        np.testing.assert_array_equal(np.delete(change, column, axis=1), 0.0)
    bare = CABLE.params.to_dict() | {"endpoint_mass": 0.0, "rolling_friction": 0.0}
    assert np.all(np.isfinite(cable_features(CableParams(**bare), CABLE)))
