import dataclasses
import types

import numpy as np
import pytest

from cablecast.cable import load_cable
from cablecast.evaluation.evaluate import summarise_errors
from cablecast.evaluation.published import published_rows
from cablecast.learning.policy import COVERAGE_PCT
from cablecast.report.curves import error_boxes, learning_curves, target_errors
from cablecast.report.maps import (
    cast_frames,
    chosen_casts,
    coverage_figure,
    ellipse_map,
    landing_map,
    reach_map,
    track_panels,
)
from cablecast.report.style import BASE_RADIUS, log_scale, new_figure, png_bytes, svg_uri
from cablecast.setup import Setup
from cablecast.workspace import Workspace

ON_SCREEN = 1e-9  # What is drawn is what is stored, to rounding.

TABLES = {
    "paper": Workspace(),
    "turned": Workspace(table_width=2.0, table_depth=1.2, table_yaw_deg=90.0),
    "around the base": Workspace(table_near_y=-0.4, table_depth=2.0),
    "away from the base": Workspace(table_near_y=0.3),
}


def draw_ellipses(evaluation, workspace):
    xy = {
        "target": evaluation.target_xy,
        "landed": evaluation.landed_xy,
    }
    columns = {f"{name}_{axis}_m": xy[name][:, i] for name in xy for i, axis in enumerate("xy")}
    columns["target"] = np.arange(len(evaluation.target_xy))
    return ellipse_map(columns, workspace, evaluation.cable.length)


def draw_coverage(evaluation, workspace):
    hull = [[0.0, 0.6], [0.4, 0.9], [-0.4, 0.9], [0.0, 0.6]]
    result = {"with_psi": False, "r0": 0.6, "v_max": 1.5, "share": 0.2, "hulls_xy": [hull]}
    selection = {"coverage": [result], "polar_casting": {"outline_xy": hull}}
    return coverage_figure(selection, workspace, evaluation.cable.length)


def draw_tracks(evaluation, workspace):
    xy = np.stack([trial.track.endpoint_xy for trial in evaluation.casts[:2]])
    # The second one did not come to rest where it was seen.
    tracks = types.SimpleNamespace(
        endpoint_xy=xy,
        compared=np.isfinite(xy).all(axis=2),
        final_xy=np.array([xy[0, -1], [np.nan, np.nan]]),
    )
    return track_panels(tracks, xy + 0.02, xy + 0.01, workspace, [0, 1], 0.62)


MAPS = {
    "landings": lambda evaluation, workspace: landing_map(evaluation),
    "casts": lambda evaluation, workspace: cast_frames(evaluation, [0, 3]),
    "ellipses": draw_ellipses,
    "coverage": draw_coverage,
    "tracks": draw_tracks,
}


@pytest.mark.parametrize(
    ("name", "table"),
    [*(("landings", table) for table in TABLES), *((name, "turned") for name in [*MAPS][1:])],
)
def test_every_map_shows_the_whole_table_and_the_base(make_evaluation, name, table):
    workspace = TABLES[table]
    figure = MAPS[name](make_evaluation(setup=Setup(workspace=workspace)), workspace)
    maps = [axes for axes in figure.axes if axes.get_aspect() == 1.0]
    assert maps
    for axes in maps:
        drawn, base = axes.patches[:2]
        low, high = drawn.get_xy(), np.add(drawn.get_xy(), [drawn.get_width(), drawn.get_height()])
        np.testing.assert_allclose(low, [-workspace.half_width, workspace.y_min], atol=ON_SCREEN)
        np.testing.assert_allclose(high, [workspace.half_width, workspace.y_max], atol=ON_SCREEN)
        x_limits, y_limits = axes.get_xlim(), axes.get_ylim()
        for x, y in (low, high, [0.0, -base.get_radius()], [0.0, base.get_radius()]):
            assert x_limits[0] < x < x_limits[1]
            assert y_limits[0] < y < y_limits[1]


def test_panels_of_tracks_run_from_best_to_worst_and_tell_rest_from_a_last_sight(make_evaluation):
    evaluation = make_evaluation()
    figure = draw_tracks(evaluation, evaluation.setup.workspace)
    assert figure.get_suptitle() == "2 of 2 trials, from best to worst fitted"
    first, second = (axes.get_title(loc="left") + axes.get_title() for axes in figure.axes[:2])
    assert ("at rest" in first, "last seen" in first) == (True, False)
    assert ("at rest" in second, "last seen" in second) == (False, True)


def points_drawn(axes):
    """Every single point that is a marker on its own, as rows of x and y."""
    lines = [line for line in axes.lines if len(line.get_xdata()) == 1]
    return np.array([line.get_xydata()[0] for line in lines])


def has_point(points, xy):
    return np.any(np.all(np.abs(points - xy) < ON_SCREEN, axis=1))


def test_the_map_shows_and_numbers_every_target_and_joins_it_with_its_landing(make_evaluation):
    evaluation = make_evaluation()
    axes = landing_map(evaluation).axes[0]
    points = points_drawn(axes)
    joins = {
        tuple(np.round(line.get_xydata().ravel(), 9))
        for line in axes.lines
        if line.is_dashed() and len(line.get_xdata()) == 2
    }
    for cast, target in zip(evaluation.casts, evaluation.aimed_xy, strict=True):
        landed = cast.track.endpoint_xy[-1]
        assert has_point(points, target)
        assert has_point(points, landed) == cast.landed
        assert (tuple(np.round([*target, *landed], 9)) in joins) == cast.landed
    # As the table of trials does.
    labels = {text.get_text(): text.xy for text in axes.texts if hasattr(text, "xy")}
    for index, xy in enumerate(evaluation.target_xy):
        np.testing.assert_allclose(labels[str(index)], xy)


def test_a_cable_that_a_rig_never_saw_is_drawn_without_it(make_evaluation):
    evaluation = make_evaluation()
    track = evaluation.casts[0].track
    unseen = dataclasses.replace(track, nodes=np.full_like(track.nodes, np.nan))
    cast = dataclasses.replace(evaluation.casts[0], track=unseen)
    evaluation = dataclasses.replace(evaluation, casts=(cast, *evaluation.casts[1:]))
    assert png_bytes(cast_frames(evaluation, [0]), dpi=40).startswith(b"\x89PNG")


def test_the_coverage_is_shaded_on_both_halves_of_the_table(make_evaluation):
    from matplotlib.contour import ContourSet

    evaluation = make_evaluation()
    figure = landing_map(evaluation, np.array([[0.5, 0.8]]))
    (shade,) = (c for c in figure.axes[0].collections if isinstance(c, ContourSet))
    outline = np.concatenate([path.vertices for path in shade.get_paths()])
    # The outline of a disc, drawn in cells of 1 cm.
    farthest = 0.5 + COVERAGE_PCT / 100.0 * evaluation.cable.length
    assert outline[:, 0].max() == pytest.approx(farthest, abs=0.01)
    assert outline[:, 0].min() == pytest.approx(-farthest, abs=0.01)


def test_the_map_of_what_is_reached_marks_the_targets_and_names_the_base_below_its_disc():
    setup = Setup()
    x, y = np.meshgrid(np.linspace(-1.3, 1.3, 27), np.linspace(0.05, 1.45, 15))
    places, targets = np.stack([x, y], axis=-1).reshape(-1, 2), np.array([[0.18, 1.03]])
    figure = reach_map(setup, places, np.ones(len(places)), 0.1, targets)
    axes = figure.axes[0]
    assert any(np.allclose(line.get_xydata(), targets) for line in axes.lines)
    texts = {text.get_text(): text for text in axes.texts}
    assert "1.05 m, 10°" in texts
    base = texts["robot base"]
    assert base.xy[1] <= -BASE_RADIUS
    assert base.get_va() == "top"
    assert png_bytes(figure, dpi=30)


def test_the_chosen_casts_run_from_the_best_to_the_worst_and_end_with_a_lost_one(make_evaluation):
    evaluation = make_evaluation()
    chosen = chosen_casts(evaluation)
    errors = evaluation.errors_pct[chosen]
    assert len(chosen) == 6
    assert errors[0] == np.nanmin(evaluation.errors_pct)
    assert errors[-2] == np.nanmax(evaluation.errors_pct)
    assert np.all(np.diff(errors[:-1]) > 0)
    assert np.isnan(errors[-1])


@pytest.mark.parametrize("lost", [(), range(32), range(31)])
def test_casts_can_be_chosen_and_drawn_however_many_landed(make_evaluation, lost):
    evaluation = make_evaluation(lost=lost)
    chosen = chosen_casts(evaluation)
    assert 1 <= len(chosen) <= 6
    assert png_bytes(cast_frames(evaluation, chosen), dpi=30)


def test_a_frame_shows_the_cable_at_every_sample_and_the_whole_path_of_the_gripper(make_evaluation):
    evaluation = make_evaluation()
    axes = cast_frames(evaluation, [3]).axes[0]
    drawn = [line.get_xydata() for line in axes.lines]
    drawn += [path.vertices for shapes in axes.collections for path in shapes.get_paths()]
    for nodes in evaluation.casts[3].track.nodes:
        assert any(len(xy) == len(nodes) and np.allclose(xy, nodes[:, :2]) for xy in drawn)
    path = evaluation.motions[3].grip_path
    ends = path.evaluate([0.0, path.duration[0]])[0, :, :2]
    assert any(np.allclose(xy[[0, -1]], ends) for xy in drawn)


def test_a_rig_that_does_not_see_the_cable_still_gives_pictures(make_evaluation):
    evaluation = make_evaluation(with_nodes=False)
    assert png_bytes(cast_frames(evaluation, [0, 1]), dpi=30)


def test_the_boxes_show_our_errors_above_those_of_the_paper():
    ours = [("ours", summarise_errors([1.0, 2.0, 4.0])), ("none", summarise_errors([]))]
    figure = error_boxes(ours, published_rows("cable_1"))
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert labels[0] == "ours"
    assert len(labels) == 1 + 5
    assert "median 22" in [text.get_text() for text in figure.axes[0].texts]


def test_errors_by_target_can_be_drawn_with_and_without_landings(make_evaluation):
    assert png_bytes(target_errors(make_evaluation(lost=())), dpi=30)
    nowhere = make_evaluation(lost=range(32))
    for figure in (target_errors(nowhere), landing_map(nowhere)):
        assert png_bytes(figure, dpi=30)


def test_the_learning_curve_is_drawn_in_percent_of_cable_length():
    curve = [{"epoch": k, "loss": 0.062 / k, "held_out_loss": 0.124 / k} for k in (1, 2, 3)]
    lines = learning_curves([("", curve)], load_cable("cable_1").length).axes[0].lines
    np.testing.assert_allclose(lines[0].get_ydata(), [10.0, 5.0, 10.0 / 3.0])
    np.testing.assert_allclose(lines[1].get_ydata(), [20.0, 10.0, 20.0 / 3.0])


def test_the_same_evaluation_gives_the_same_picture_twice(make_evaluation):
    pictures = {svg_uri(target_errors(make_evaluation())) for _ in range(2)}
    assert len(pictures) == 1


def test_a_dollar_sign_in_a_name_is_no_formula():
    figure = error_boxes([("my $_{$ rig", summarise_errors([1.0, 2.0]))], ())
    assert png_bytes(figure, dpi=30)


def test_a_logarithmic_axis_has_plain_numbers():
    # Formulas are off, so that a name may hold dollar signs; the default labels of one are some.
    axes = new_figure(4.0, 3.0).subplots()
    axes.plot([0.02, 50.0], [0.02, 50.0])
    log_scale(axes, "x")
    log_scale(axes, "y")
    for labels in (axes.get_xticklabels(), axes.get_yticklabels()):
        texts = [label.get_text() for label in labels]
        assert {"0.1", "1", "20"} <= set(texts)
        assert not any("$" in text for text in texts)
