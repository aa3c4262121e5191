import numpy as np
import pytest

from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.evaluation.coverage import (
    concave_hull,
    covered_share,
    measure_coverage,
    outlines,
    polar_casting_region,
)
from cablecast.motion.polar import PolarReach
from cablecast.setup import Setup

SETUP = Setup()
RADIUS = 1.56
# 4,000 random points leave a seam of about a point's distance, 3 cm, along the rim.
SAMPLING_TOLERANCE = 0.05


def points_in_sector(rng, count, low, high):
    """Points spread evenly over the part of the half disc between two angles from the y axis."""
    r = RADIUS * np.sqrt(rng.uniform(size=count))
    theta = rng.uniform(low, high, size=count)
    return np.stack([r * np.sin(theta), r * np.cos(theta)], axis=-1)


@pytest.mark.parametrize("covered", [1.0, 1 / 3])
def test_a_sector_and_its_mirror_image_cover_their_share_of_the_half_disc(covered):
    points = points_in_sector(np.random.default_rng(0), 4000, 0.0, covered * np.pi / 2)
    share = covered_share(concave_hull(points, RADIUS), RADIUS)
    assert share == pytest.approx(covered, abs=SAMPLING_TOLERANCE)


def test_a_hollow_that_the_convex_hull_would_fill_is_not_covered():
    # A ring without its inside, open towards the robot.
    points = points_in_sector(np.random.default_rng(0), 8000, 0.0, np.pi / 2)
    points = points[np.linalg.norm(points, axis=1) > 0.7 * RADIUS]
    concave = covered_share(concave_hull(points, RADIUS), RADIUS)
    convex = covered_share(concave_hull(points, RADIUS, ratio=1.0), RADIUS)
    assert convex == pytest.approx(1.0, abs=SAMPLING_TOLERANCE)
    assert concave == pytest.approx(1 - 0.7**2, abs=SAMPLING_TOLERANCE)


def test_what_lies_behind_the_robot_is_cut_off():
    rng = np.random.default_rng(0)
    points = np.concatenate([points_in_sector(rng, 4000, 0.0, np.pi / 2), [[0.3, -1.0]]])
    hull = concave_hull(points, RADIUS)
    assert min(outline[:, 1].min() for outline in outlines(hull)) >= 0.0
    assert covered_share(hull, RADIUS) <= 1.0


def test_the_region_of_polar_casting_is_that_of_its_motions():
    points = points_in_sector(np.random.default_rng(0), 4000, -np.pi / 2, np.pi / 2)
    region = polar_casting_region(SETUP)
    inside = np.mean(PolarReach.of(SETUP).contains(points))
    share = covered_share(region, SETUP.workspace.reach(SETUP.cable.length))
    # Of 4,000 points 13 % lie inside, give or take 0.5 %.
    assert share == pytest.approx(inside, abs=0.02)
    assert 0.05 < share < 0.3


def test_faster_casts_cover_more_and_a_turn_of_the_wrist_more_still():
    engine = EngineWarp(segment_count=15, dt=0.002)

    def coverage(v_max, counts):
        return measure_coverage(SETUP.with_motion(v_max=v_max), SETUP.cable.params, engine, counts)

    slow, fast = (coverage(v_max, (6, 6, 6)) for v_max in (1.2, 1.5))
    turning = coverage(1.5, (6, 6, 6, 3))
    assert 0.0 < slow["share"] < fast["share"] < turning["share"] < 1.0
    assert (fast["with_psi"], turning["with_psi"], slow["v_max"]) == (False, True, 1.2)
    assert turning["feasible_count"] <= 6 * 6 * 6 * 3
    low, high = sorted(turning["share_by_ratio"].values())
    assert low <= turning["share"] <= high


def test_hull_ratios_and_grids_that_make_no_sense_are_refused():
    for ratio in (1.5, np.nan):
        with pytest.raises(InputError, match=r"is outside \[0, 1\]"):
            concave_hull(np.zeros((3, 2)), RADIUS, ratio=ratio)
    for counts in ((0, 5, 5), (5, 5), (1000, 1000, 1000)):
        with pytest.raises(InputError, match="grid"):
            measure_coverage(SETUP, SETUP.cable.params, EngineWarp(), counts)
