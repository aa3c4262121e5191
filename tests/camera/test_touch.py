"""The robot's place at the table, from touched tags."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cablecast.arm.ur import ArmUR
from cablecast.camera.tags import (
    OUTLIER,
    TagLayout,
    default_layout,
    fit_table,
    read_touches,
)
from cablecast.errors import InputError

LAYOUT = default_layout()
# A tip is put on a tag's centre to half a millimetre along each axis.
TOUCH_SD = 0.0005
# Eleven such touches over two metres tell height and place to that over the root of eleven, and
# angles to that over a metre; four times it is never exceeded here.
PLACE_MAX, ANGLE_MAX_DEG = 4 * TOUCH_SD, 0.1
EXACT = 1e-9


def touches(arm, axis_xy=(0.0, 0.0), tilt=(0.0, 0.0), sd=0.0, seed=0, layout=LAYOUT):
    """Return what the controller of a mounted arm reports of the tags that are touched."""
    rng = np.random.default_rng(seed)
    base = arm.frames(np.zeros(6))[0]
    # The layout's origin is where the person had the axis; the arm stands beside it.
    (cx, cy), (sx, sy) = np.cos(tilt), np.sin(tilt)
    lean = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    lean = lean @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    R, t = lean @ base[:3, :3], base[:3, 3] + np.array([*axis_xy, 0.0])
    return {
        tag.id: tuple(R.T @ (np.array([tag.x, tag.y, 0.0]) - t) + rng.normal(0, sd, 3))
        for tag in layout.tags
    }


@settings(max_examples=40, deadline=None)
@given(
    yaw_deg=st.floats(-180, 180),
    height=st.floats(-0.5, 1.0),
    x=st.floats(-0.1, 0.1),
    y=st.floats(-0.1, 0.1),
)
def test_height_yaw_and_axis_come_back_from_exact_touches(yaw_deg, height, x, y):
    arm = ArmUR(base_height=height, base_yaw_deg=yaw_deg)
    fit = fit_table(LAYOUT, touches(arm, (x, y)))
    assert fit.base_height == pytest.approx(height, abs=EXACT)
    turn = np.radians(fit.base_yaw_deg - yaw_deg)
    assert np.hypot(np.sin(turn), np.cos(turn) - 1) < EXACT
    np.testing.assert_allclose(fit.axis_xy, (x, y), atol=EXACT)
    assert fit.outliers == ()
    # Measured anew from the axis, the tags are where the arm reaches them.
    moved = [[tag.x + x, tag.y + y] for tag in fit.layout.tags]
    np.testing.assert_allclose(moved, [[tag.x, tag.y] for tag in LAYOUT.tags], atol=EXACT)


@pytest.mark.parametrize("seed", range(8))
def test_moved_tags_are_named_and_do_not_pull_at_the_fit(seed):
    rng = np.random.default_rng([seed, 1])
    arm = ArmUR(base_yaw_deg=30.0)
    points = touches(arm, (0.02, -0.01), sd=TOUCH_SD, seed=seed)
    moved = sorted(rng.choice(len(points), 3, replace=False).tolist())
    for tag_id in moved:
        points[tag_id] = tuple(np.array(points[tag_id]) + [*rng.choice([-0.02, 0.03], 2), 0.0])
    fit = fit_table(LAYOUT, points)
    assert list(fit.outliers) == moved
    assert fit.base_height == pytest.approx(arm.base_height, abs=PLACE_MAX)
    assert fit.base_yaw_deg == pytest.approx(arm.base_yaw_deg, abs=ANGLE_MAX_DEG)
    np.testing.assert_allclose(fit.axis_xy, (0.02, -0.01), atol=PLACE_MAX)
    assert fit.rms < 2.5 * TOUCH_SD
    assert min(fit.residuals[i] for i in moved) > OUTLIER


def test_a_base_that_leans_is_measured_and_one_that_leans_much_is_refused():
    fit = fit_table(LAYOUT, touches(ArmUR(), tilt=(np.radians(0.5), np.radians(-0.3))))
    assert fit.tilt_deg == pytest.approx(np.hypot(0.5, 0.3), abs=0.01)
    with pytest.raises(InputError, match=r"tilted by 5\.0 deg .* above 2 deg"):
        fit_table(LAYOUT, touches(ArmUR(), tilt=(np.radians(5.0), 0.0)))


def test_too_few_tags_are_refused():
    points = touches(ArmUR())
    with pytest.raises(InputError, match="5 tags were touched: at least 6"):
        fit_table(LAYOUT, {i: points[i] for i in range(5)})


def test_tags_in_a_line_are_refused():
    row = [dataclasses.replace(tag, x=0.3 * k, y=1.0) for k, tag in enumerate(LAYOUT.tags[:7])]
    layout = TagLayout(tags=tuple(row))
    with pytest.raises(InputError, match="lie in a line"):
        fit_table(layout, touches(ArmUR(), layout=layout))


def test_touches_that_agree_on_nothing_are_refused():
    rng = np.random.default_rng(0)
    points = {tag.id: tuple(rng.uniform(-1, 1, 3)) for tag in LAYOUT.tags}
    with pytest.raises(InputError, match="do not agree"):
        fit_table(LAYOUT, points)


def test_a_tag_that_the_layout_does_not_have_is_named():
    with pytest.raises(InputError, match="tag 40 was touched"):
        fit_table(LAYOUT, {**touches(ArmUR()), 40: (0.0, 0.0, 0.0)})


def test_touches_come_from_a_table(tmp_path):
    file = tmp_path / "touched.csv"
    file.write_text("tag,x_m,y_m,z_m\n0,0.1,0.2,-0.18\n4,0.3,-0.4,-0.18\n")
    assert read_touches(file) == {0: (0.1, 0.2, -0.18), 4: (0.3, -0.4, -0.18)}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tag,x_m,y_m\n0,1,2\n", "lacks the columns z_m"),
        ("tag,x_m,y_m,z_m\n0,a,2,3\n", "line 2 of .* holds something else than numbers"),
        ("tag,x_m,y_m,z_m\n0,1,2,3\n0,1,2,3\n", "line 3 of .* touches tag 0 again"),
    ],
)
def test_a_table_of_touches_that_makes_no_sense_is_refused(text, words, tmp_path):
    file = tmp_path / "touched.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=words):
        read_touches(file)
