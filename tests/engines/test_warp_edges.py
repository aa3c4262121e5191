"""Cables over the edges of a table: closed forms, and what is the same without an edge."""

import functools

import numpy as np
import pytest
from benchmarks.validation.scenes import LENGTH, MASS, make_cable

from cablecast.conventions import GRAVITY
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.grip_path import GripPath, PlanePath
from cablecast.workspace import Workspace

TABLE = Workspace()
COUNT = 28
CELL = LENGTH / COUNT
RADIUS = 0.5 * make_cable().diameter
ON_TOP = 0.35 * LENGTH
WEIGHT_PER_LENGTH = MASS * GRAVITY / LENGTH

MEAN_TENSION = 0.06
"""Error of the mean tension at an edge while some segments pass it [-]. The tension rises and falls
by a tenth as each node passes: a chain over an edge does."""
SINKING = 1e-3
"""Depth to which a falling node may sink into the table [m]."""


def make(friction):
    # Of the two factors of friction one is 1.
    return make_cable(
        twist_stiffness=1e-4,
        bend_stiffness=1e-4,
        lateral_friction=friction,
        worksurface_friction=1.0,
        spinning_friction=0.0,
        rolling_friction=0.0,
        endpoint_mass=0.0,
        linear_damping=4.0,
    )


@functools.cache
def slid(friction, way):
    """Return a cable over the far edge that hangs still, and is then pulled slowly outwards."""
    radius = TABLE.y_max - ON_TOP
    path = PlanePath(np.array([0.0, radius, RADIUS, 0.0, 0.0])).hold(4.0)
    path.move(6.0, radius=radius + way)
    engine = EngineWarp(segment_count=COUNT, dt=2e-4, precision="double")
    return engine.rollout(
        make(friction),
        path.grip_path(),
        duration=10.0,
        sample_dt=0.02,
        edges=TABLE,
        record_nodes=True,
        record_forces=True,
    )


def edge_tension(friction, way):
    """Return the tension on top of the edge over the weight of what hangs, in the mean."""
    rollout = slid(friction, way)
    slides = (rollout.times > 5.5) & (rollout.times < 9.0)
    nodes, pull = rollout.nodes[0, slides], rollout.forces.grip[0, slides, 1]
    hanging = WEIGHT_PER_LENGTH * -nodes[:, :, 2].min(axis=1)
    # The gripped node and its half of a segment rub on nothing.
    on_top = TABLE.y_max - nodes[:, 0, 1] - CELL
    rubbing = -np.sign(way) * friction * WEIGHT_PER_LENGTH * on_top
    return float(np.mean((pull - rubbing) / hanging))


@pytest.mark.parametrize("way", [-0.1, 0.1])
@pytest.mark.parametrize("friction", [0.001, 0.1, 0.3])
def test_a_cable_that_slides_over_an_edge_obeys_the_capstan_equation(friction, way):
    law = np.exp(-np.sign(way) * friction * 0.5 * np.pi)
    assert edge_tension(friction, way) == pytest.approx(law, rel=MEAN_TENSION)


def test_what_hangs_stays_outside_the_table():
    nodes = slid(0.3, -0.1).nodes[0]
    below = nodes[..., 2] < -CELL
    assert below.any()
    assert (nodes[below][:, 1] > TABLE.y_max + RADIUS - SINKING).all()
    inside = nodes[..., 1] < TABLE.y_max - CELL
    assert (nodes[inside][:, 2] > RADIUS - SINKING).all()


def test_a_cable_that_is_pulled_back_over_an_edge_lies_on_the_table_again():
    radius = TABLE.y_max - LENGTH + 0.2
    path = PlanePath(np.array([0.0, radius, RADIUS, 0.0, 0.0])).hold(2.0)
    path.move(4.0, radius=radius - 0.3)
    options = {"duration": 8.0, "record_nodes": True}
    engine = EngineWarp(segment_count=COUNT, dt=5e-4)
    with_edge, endless = (
        engine.rollout(make(0.3), path.grip_path(), edges=edges, **options)
        for edges in (TABLE, None)
    )
    assert with_edge.nodes[0, :, -1, 2].min() < -0.1
    np.testing.assert_allclose(with_edge.nodes[0, -1], endless.nodes[0, -1], atol=2e-3)


def test_an_edge_that_nothing_passes_changes_no_bit():
    path = PlanePath(np.array([0.0, 0.6, 0.05, 0.0, 0.0]))
    path.move(0.5, azimuth=0.4).move(0.5, azimuth=-0.2, height=RADIUS)
    engine = EngineWarp(segment_count=COUNT)
    first, second = (
        engine.rollout(make(0.5), path.grip_path(), edges=edges, record_nodes=True)
        for edges in (TABLE, None)
    )
    np.testing.assert_array_equal(first.nodes, second.nodes)


def test_a_cable_hangs_alike_over_all_edges():
    heights = []
    for x, y, yaw in (
        (TABLE.half_width - ON_TOP, 0.8, 0.5 * np.pi),
        (ON_TOP - TABLE.half_width, 0.8, -0.5 * np.pi),
        (0.0, TABLE.y_max - ON_TOP, 0.0),
        (0.0, TABLE.y_min + ON_TOP, np.pi),
    ):
        path = GripPath.hold(np.array([x, y, RADIUS, yaw, 0.0]), 3.0)
        engine = EngineWarp(segment_count=COUNT, dt=5e-4, precision="double")
        rollout = engine.rollout(make(0.3), path, duration=3.0, edges=TABLE)
        heights.append(rollout.endpoint_xyz[0, :, 2])
    assert heights[0][-1] < -0.3
    for other in heights[1:]:
        np.testing.assert_allclose(other, heights[0], atol=1e-6)
