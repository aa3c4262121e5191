"""Contact of cables with capsules."""

import numpy as np

from cablecast.engines.contact import first_contact

RADIUS, CABLE_RADIUS = 0.05, 0.01


def passing(speed, distance, step_count=101, dt=0.01):
    """Return a straight vertical cable that passes a point at a distance, [1, step, node, 3]."""
    s = np.linspace(0.0, 1.0, 26)
    nodes = np.zeros((1, step_count, 26, 3))
    nodes[..., 0] = (-0.505 + speed * dt * np.arange(step_count))[None, :, None]
    nodes[..., 1] = distance
    nodes[..., 2] = 1.0 - s
    return nodes


def lying(step_count=101):
    """Return a capsule along y that begins at the origin, [1, step, 1, 2, 3]."""
    ends = np.zeros((1, step_count, 1, 2, 3))
    ends[..., 1, 1] = -1.0
    ends[..., 2] = 0.6
    return ends


def test_a_cable_touches_a_capsule_when_its_surface_comes_near_enough():
    # The cable moves at 1 cm a sample from x = -0.505, and a node passes the axis at its height.
    nodes = passing(1.0, -0.3)
    reached = np.abs(nodes[0, :, 0, 0]) < RADIUS + CABLE_RADIUS
    assert first_contact(nodes, lying(), RADIUS, CABLE_RADIUS) == np.argmax(reached)
    # The cap is a sphere about the end of the axis.
    assert first_contact(passing(1.0, 0.059), lying(), RADIUS, CABLE_RADIUS) == 50
    assert first_contact(passing(1.0, 0.061), lying(), RADIUS, CABLE_RADIUS) == 101


def test_nodes_beside_the_grip_may_touch_what_holds_them():
    nodes = passing(1.0, -0.3)
    assert first_contact(nodes, lying(), RADIUS, CABLE_RADIUS, first_node=10) < 101
    # Nodes from 13 on hang more than 0.06 m below the axis at a height of 0.6 m.
    assert first_contact(nodes, lying(), RADIUS, CABLE_RADIUS, first_node=13) == 101


def test_worlds_and_capsules_have_radii_of_their_own():
    nodes = np.concatenate([passing(1.0, -0.3), passing(1.0, 0.061), passing(1.0, 0.061)])
    ends = np.concatenate([lying(), lying() + [0.0, 9.0, 0.0]], axis=2)
    steps = first_contact(nodes, ends, [RADIUS, 1.0], [CABLE_RADIUS, CABLE_RADIUS, 0.02])
    # The third is as thick as to touch the cap from x = -sqrt(0.07² - 0.061²) on.
    np.testing.assert_array_equal(steps, [45, 101, 48])
