import numpy as np
import pytest

from cablecast.setup import Setup
from cablecast.view.film import camera_behind_robot
from cablecast.view.shapes import (
    CABLE_RADIUS_MIN,
    TRAIL_COUNT,
    TRAIL_WIDTH,
    Rods,
    arm_rods,
    hatched_circle,
    level,
    map_image,
    map_targets,
    miss_map,
    ribbon,
    target_marks,
    text_image,
    thinned,
    tube,
)

# Rounding of a rotation by a quaternion in double precision.
ROUNDING = 1e-12


def rotate(quat_wxyz, vector):
    w, xyz = quat_wxyz[0], quat_wxyz[1:]
    return vector + 2 * np.cross(xyz, np.cross(xyz, vector) + w * vector)


def test_a_unit_cylinder_is_turned_onto_each_rod():
    ends = np.array([[1.0, 0, 0], [0, 2, 0], [0, 0, 3], [0, 0, -1], [0.3, -0.4, 0.5]])
    ends_of_rods, no_housings = np.stack([np.zeros((5, 3)), ends], axis=1), np.zeros(5, dtype=bool)
    rods = Rods(ends=ends_of_rods, radii=np.full(5, 0.1), housings=no_housings)
    for quat, center, scale, end in zip(
        rods.quats_wxyz, rods.centers, rods.scales, ends, strict=True
    ):
        top = center + rotate(quat, np.array([0, 0, scale[2] / 2]))
        assert np.allclose(top, end, atol=ROUNDING)


def test_the_arm_ends_at_the_grip():
    setup = Setup()
    q = setup.arm.inverse(np.array([[0.2, 0.6, 0.02, 0.1, 0.0]]))[0]
    tip = arm_rods(q, setup.arm).ends[-1, 1]
    # The cable leaves the fingers in front of the flange's axis.
    assert np.linalg.norm(tip - [0.2, 0.6, 0.02]) == pytest.approx(setup.arm.grip_offset, abs=1e-9)


def test_short_links_are_housings_that_stand_out_and_long_ones_are_slimmer_tubes():
    arm = Setup().arm
    q = arm.inverse(np.array([[0.2, 0.6, 0.02, 0.1, 0.0]]))[0]
    links, drawn = arm.links(arm.frames(q[None])), arm_rods(q, arm)
    names = np.array([*links.names, "palm", "fingers"])
    assert {"upper arm", "forearm"} == set(names[~drawn.housings]) - {"palm", "fingers"}
    length, plain = (
        np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[: len(links.names)]
        for ends in (drawn.ends, links.ends[0])
    )
    moving = np.arange(len(links.names)) >= 2
    housings = drawn.housings[: len(links.names)]
    assert np.all(length[housings & moving] > plain[housings & moving])
    np.testing.assert_allclose(length[~moving], plain[~moving])
    assert np.all(drawn.radii[: len(links.names)][~housings] < links.drawn[~housings])
    # Balls round the others off.
    assert len(drawn.joints[1]) == 2 * np.sum(~drawn.housings)


def test_a_target_has_a_ring_of_its_tolerance():
    rings = target_marks(np.array([0.3, 1.1]), 0.004, 0.019)
    away = np.linalg.norm(rings[:48, 0, :2] - [0.3, 1.1], axis=-1)
    np.testing.assert_allclose(away, 0.019)


def test_a_thin_cable_is_drawn_as_a_tube_that_can_be_seen():
    s = np.linspace(0, 1, 20)
    nodes = np.stack([np.sin(s), np.cos(s), 0.1 * s], axis=1)
    vertices, faces = tube(nodes, 1e-4)
    ring = vertices.reshape(20, -1, 3)
    assert np.allclose(np.linalg.norm(ring - nodes[:, None], axis=2), CABLE_RADIUS_MIN)
    assert faces.max() == len(vertices) - 1
    # Faces look outwards: their normals point away from the axis.
    a, b, c = vertices[faces].transpose(1, 0, 2)
    near = nodes[faces[:, 0] // ring.shape[1]]
    assert np.all(np.sum(np.cross(b - a, c - a) * ((a + b + c) / 3 - near), axis=1) > 0)


def test_the_map_knows_the_reach_and_the_misses(policy):
    xy, miss = map_targets(policy.setup.workspace), miss_map(policy)
    radius = np.hypot(xy[..., 0], xy[..., 1])
    reach = policy.setup.workspace.reach(policy.setup.cable.length)
    assert np.array_equal(np.isfinite(miss), radius <= reach)
    inside = policy.inside_coverage(xy) & np.isfinite(miss)
    assert np.median(miss[inside]) < np.median(miss[np.isfinite(miss) & ~inside])
    image = map_image(miss, policy.setup)
    rows, columns = 4 * miss.shape[0], 4 * miss.shape[1]
    assert image.shape == (rows, columns, 4)
    # The first row of the picture is the far edge, where the middle alone is in reach.
    shown = image[0, :, 3] > 0
    assert shown[columns // 2]
    assert not shown[0]
    assert (2 * policy.setup.workspace.half_width) * shown.mean() == pytest.approx(
        2 * np.sqrt(reach**2 - policy.setup.workspace.y_max**2), abs=0.05
    )
    # Colours pass from one target of the map to the next.
    seen = image[:, 1::4, 0][image[:, 1::4, 3] > 0].astype(int)
    assert len(np.unique(seen)) > 2 * len(np.unique(image[1::4, 1::4, 0]))


@pytest.mark.parametrize(
    ("size", "panel"),
    [((1440, 900), False), ((800, 360), True), ((390, 844), False), ((390, 844), True)],
)
def test_the_table_fills_the_picture_and_stays_in_it(size, panel):
    setup = Setup()
    table = setup.workspace
    camera = camera_behind_robot(setup, *size, panel=panel)
    corners = [
        (x, y, 0.0)
        for x in (-table.half_width, table.half_width)
        for y in (table.y_min, table.y_max)
    ]
    u, v = camera.to_image(np.array(corners)).T
    assert min(u.min(), v.min()) > 0
    assert u.max() < size[0]
    assert v.max() < size[1] * (0.4 if panel and size[0] < size[1] else 1.0)
    assert max(np.ptp(u) / size[0], np.ptp(v) / size[1]) > 0.8


@pytest.mark.parametrize("radius", [0.01, 0.16])
def test_a_blind_place_is_hatched_inside_its_circle(radius):
    segments = hatched_circle((-1.08, 0.42), radius, 0.004)
    away = np.linalg.norm(segments[..., :2] - [-1.08, 0.42], axis=-1)
    np.testing.assert_allclose(away, radius)
    # The outline has 48 segments; each line across it is longer than they are.
    lines = segments[48:]
    assert len(lines) >= 1
    assert np.all(np.linalg.norm(lines[:, 1] - lines[:, 0], axis=-1) > 2 * np.pi * radius / 48)
    assert np.all(segments[..., 2] == 0.004)


def test_a_trail_always_has_as_many_vertices_and_as_wide_a_ribbon():
    turn = np.linspace(0, np.pi, 600)
    path = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    for count in (2, 63, 600):
        kept = thinned(path[:count], len(path))
        assert np.array_equal(kept[-1], path[count - 1])
        vertices, faces = ribbon(level(kept, 0.004), [0.0, 0.0, 1.0])
        assert vertices.shape == (2 * TRAIL_COUNT, 3)
        assert faces.max() == len(vertices) - 1
        left, right = vertices.reshape(TRAIL_COUNT, 2, 3).transpose(1, 0, 2)[:, : len(kept)]
        assert np.allclose(np.linalg.norm(left - right, axis=1), TRAIL_WIDTH)
        assert np.allclose(((left + right) / 2)[:, :2], kept)
    # A point that was left out stays out, so that the trail does not tremble.
    early, late = (thinned(path[:count], len(path))[:-1] for count in (280, 550))
    assert np.array_equal(early, late[: len(early)])


def test_words_on_the_table_are_as_wide_as_they_are_long():
    short, long = (text_image(text, (10, 20, 30)) for text in ("1", "1:  3.2 cm, 5.1 %"))
    assert long.shape[1] > 4 * short.shape[1]
    assert long.shape[0] == short.shape[0]
    seen = long[long[..., 3] > 200]
    assert len(seen) > 100
    assert (seen[:, :3] == (10, 20, 30)).all()
    # No letter is cut off at the edge.
    assert not long[[0, -1], :, 3].any()
    assert (text_image("1", (10, 20, 30), (9, 9, 9))[0, 0, :3] == 9).all()
