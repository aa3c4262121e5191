import dataclasses
import math

import numpy as np
import pytest

from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.data.dataset import Dataset
from cablecast.errors import DatasetError, InputError
from cablecast.evaluation.repeatability import (
    ActionScatter,
    Repeatability,
    confidence_ellipse,
    measure_repeatability,
    repeat_actions,
    save_actions,
)
from cablecast.motion.feasibility import check_actions
from cablecast.pipeline.repeat import check_repeat
from cablecast.rigs.base import RigLifecycle
from cablecast.setup import Setup

SETUP = Setup()
CABLE = SETUP.cable
REPEATS = 40
# Estimates of a deviation from 4 x 40 landings have one of 5.6 % themselves.
SCATTER_TOLERANCE = 0.10


class NormalRig(RigLifecycle):
    """Lands around a point that the action decides, with a known normal scatter along arcs."""

    def __init__(self, radial, tangential, off_beyond=math.inf):
        super().__init__()
        self.description = {"rig": "normal", "radial": radial, "tangential": tangential}
        self.scales = np.array([radial, tangential])
        self.off_beyond = off_beyond
        self._next = 0

    def seek(self, index, purpose=""):
        self._next = index

    def execute(self, trajectory):
        self._use_reset()
        random = np.random.default_rng([7, self._next])
        theta = trajectory.action.theta2
        out = np.array([np.sin(theta), np.cos(theta)])
        radial, tangential = random.normal(size=2) * self.scales
        xy = (1.0 + radial) * out + tangential * np.array([out[1], -out[0]])
        off = random.random() < 0.5 and theta > self.off_beyond
        self._next += 1
        return EndpointTrack(
            times=np.array([0.0, trajectory.duration + 1.0]),
            endpoint_xy=np.stack([np.array([0.0, 1.2]), xy]),
            status=TrialStatus.OFF_TABLE if off else TrialStatus.OK,
        )


def scatter_of(points, statuses=None):
    points = np.asarray(points, dtype=float)
    return ActionScatter(
        action=np.array([-1.0, 0.5, 0.6, 0.5]),
        landed_xy=points,
        statuses=tuple(statuses or ["ok"] * len(points)),
    )


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Four actions, 60 casts each: 5 mm along the radius, 15 mm across it; one leaves at times."""
    theta2 = np.radians([10.0, 20.0, 30.0, 45.0])
    actions = np.stack([-theta2, theta2, np.full(4, 0.6), theta2], axis=1)
    return measure_repeatability(
        tmp_path_factory.mktemp("repeat") / "casts",
        NormalRig(0.005, 0.015, off_beyond=theta2[2]),
        SETUP,
        actions=actions,
        repeats=REPEATS,
    )


def test_the_two_readings_of_repeatability_are_the_rms_and_the_deviation_of_the_distance():
    result = scatter_of([[0.0, 1.0], [0.0, 1.2], [0.03, 1.1], [-0.03, 1.1]])
    distances = [0.1, 0.1, 0.03, 0.03]
    assert result.scatter == pytest.approx(np.sqrt(np.mean(np.square(distances))))
    assert result.distance_sd == pytest.approx(np.std(distances))
    # About the mean, over both directions.
    square = scatter_of([[0.01, 1.0], [-0.01, 1.0], [0.0, 1.01], [0.0, 0.99]])
    assert square.scatter == pytest.approx(0.01)
    np.testing.assert_allclose(square.mean_xy, [0.0, 1.0])
    pair = scatter_of([[0.0, 1.0], [0.03, 1.04]])
    assert pair.scatter == pytest.approx(0.025)


def test_the_ellipse_of_many_landings_holds_95_percent_of_them():
    points = np.random.default_rng(0).normal(size=(100_000, 2)) @ [[0.03, 0.01], [0.0, 0.01]]
    ellipse = confidence_ellipse(points)
    c, s = math.cos(ellipse.angle), math.sin(ellipse.angle)
    own = (points - ellipse.center_xy) @ np.array([[c, -s], [s, c]]) / ellipse.semi_axes
    inside = np.linalg.norm(own, axis=1) < 1.0
    # This share has a standard deviation of 0.0007.
    assert inside.mean() == pytest.approx(0.95, abs=0.003)
    # Two landings have none, and NaN is no landing.
    assert confidence_ellipse([[0, 1], [0, 1.1], [np.nan, np.nan]]) is None
    assert confidence_ellipse([[0, 1], [0, 1.1], [0.1, 1.0]]) is not None


def test_known_scatter_is_measured(measured):
    truth = 100.0 * math.hypot(0.005, 0.015) / CABLE.length
    assert measured.scatter_pct == pytest.approx(truth, rel=SCATTER_TOLERANCE)
    assert measured.along_arc_share == pytest.approx(0.9, abs=0.04)
    assert measured.cast_count == 4 * REPEATS
    assert measured.label == "v_max 1.5"


def test_casts_off_the_table_are_counted_but_do_not_scatter(measured):
    counts = [a.off_table_count for a in measured.actions]
    assert sorted(counts)[:3] == [0, 0, 0]
    assert 0.3 * REPEATS < max(counts) < 0.7 * REPEATS
    assert measured.off_table_share == pytest.approx(max(counts) / (4 * REPEATS))
    spoilt = measured.actions[int(np.argmax(counts))]
    assert len(spoilt.landed_xy) == REPEATS - max(counts)
    assert spoilt.scatter == pytest.approx(math.hypot(0.005, 0.015), rel=0.3)


def test_the_paper_s_mean_runs_over_actions_not_over_casts():
    wide, narrow = [[0.0, 0.98], [0.0, 1.02]], [[0.3, 1.0]] * 8
    result = Repeatability(
        setup=SETUP,
        actions=(scatter_of(wide), scatter_of(narrow), scatter_of(np.empty((0, 2)), ["off_table"])),
    )
    assert result.scatter_pct == pytest.approx(100 * 0.02 / CABLE.length / 2)
    # By the paper's words, two landings as far from their mean have no scatter.
    assert result.distance_sd_pct == pytest.approx(0.0)
    # Of two values the standard error of the mean is half their difference.
    assert result.scatter_standard_error_pct == pytest.approx(result.scatter_pct)
    assert np.isnan(result.scatters_pct[2])


def test_repeated_actions_are_those_of_the_paper_s_grid_that_the_arm_can_make():
    setup = SETUP.with_motion(v_max=1.2)
    flat = repeat_actions(setup, with_psi=False)
    turned = repeat_actions(setup, with_psi=True)
    assert 60 < len(flat) <= 125
    assert 30 < len(turned) <= 81
    np.testing.assert_array_equal(flat[:, 1], flat[:, 3])
    assert np.any(turned[:, 3] > turned[:, 1] + 0.1)
    for actions in (flat, turned):
        assert check_actions(actions, setup).mask.all()
    few = repeat_actions(setup, with_psi=True, action_count=7)
    assert len(few) == 7
    assert {tuple(action) for action in few} <= {tuple(action) for action in turned}


def test_counts_that_make_no_sense_are_refused(tmp_path):
    options = {"repeats": 2, "actions": np.zeros((3, 4)), "seed": 0}
    with pytest.raises(InputError, match="action_count is the number of chosen ones"):
        check_repeat(combinations=["1.2"], action_count=2, **options)
    for options, words in (
        ({"action_count": 0}, "action_count = 0"),
        ({"action_count": 2.5}, "action_count = 2.5 is not a whole number"),
        ({"seed": -1}, "seed = -1"),
    ):
        with pytest.raises(InputError, match=words):
            repeat_actions(SETUP, with_psi=False, **options)
    actions = repeat_actions(SETUP, with_psi=False, action_count=1)
    with pytest.raises(InputError, match="repeats = 1"):
        measure_repeatability(tmp_path / "d", NormalRig(0, 0), SETUP, actions=actions, repeats=1)
    empty = np.empty((0, 4))
    dataset = Dataset(
        actions=empty,
        rest_xy=empty[:, :2],
        status=np.array([], dtype=str),
        duration=empty[:, 0],
        extent=empty,
    )
    with pytest.raises(DatasetError, match="no repeated casts"):
        Repeatability.from_dataset(dataset)


def test_the_table_has_one_line_per_action(measured, tmp_path):
    save_actions(measured, tmp_path / "actions.csv")
    header, *lines = (tmp_path / "actions.csv").read_text().splitlines()
    assert len(lines) == 4
    first = dict(zip(header.split(","), lines[0].split(","), strict=True))
    assert float(first["scatter_pct"]) == pytest.approx(measured.scatters_pct[0], abs=1e-3)
    assert first["casts"] == str(REPEATS)


def test_the_map_draws_each_landing_and_marks_actions_that_left_the_table(measured):
    pytest.importorskip("matplotlib")
    from cablecast.report.maps import repeatability_map
    from cablecast.report.style import png_bytes

    figure = repeatability_map([measured, measured, measured], SETUP.workspace)
    # The legend stands where no panel does.
    *panels, legend = figure.axes
    assert len(panels) == 3
    labels = [text.get_text() for text in legend.get_legend().get_texts()]
    assert labels[0] == "landings of one action"
    assert not figure.legends
    assert len(repeatability_map([measured, measured], SETUP.workspace).legends) == 1
    drawn = sum(len(line.get_xdata()) for line in panels[1].lines if line.get_marker() == "o")
    assert drawn == sum(len(a.landed_xy) for a in measured.actions)
    assert sum(line.get_marker() == "^" for line in panels[1].lines) == 1
    assert "v_max 1.5" in panels[0].get_title(loc="left")
    assert png_bytes(figure, dpi=50).startswith(b"\x89PNG")


def test_no_ellipse_crosses_the_note_of_actions_without_a_landing(measured):
    pytest.importorskip("matplotlib")
    from cablecast.report.maps import repeatability_map

    nowhere = scatter_of(np.empty((0, 2)), ["off_table"] * 3)
    lost = dataclasses.replace(measured, actions=(*measured.actions, nowhere))
    axes = repeatability_map([lost], SETUP.workspace).axes[0]
    (note,) = (text for text in axes.texts if "have no landing" in text.get_text())
    assert note.get_bbox_patch().get_alpha() is None
    assert note.get_bbox_patch().get_facecolor()[3] == 1.0
    assert all(note.get_zorder() > line.get_zorder() for line in axes.lines)
