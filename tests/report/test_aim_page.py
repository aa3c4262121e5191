import dataclasses
import json
import re
import types

import numpy as np
import pytest

from cablecast.aiming.config import AimConfig
from cablecast.aiming.session import Stop, StopReason
from cablecast.cast import Cast, EndpointTrack, Proposal, TrialStatus
from cablecast.evaluation.evaluate import Evaluation
from cablecast.motion.casting import Action
from cablecast.motion.trajectory import JointPath, plan_trajectory
from cablecast.report.aim_page import Tried, aim_page
from cablecast.report.style import png_bytes
from cablecast.report.tries import joint_curves, target_panels, tracking_error, tries_map
from cablecast.setup import Setup
from cablecast.task import LANDING, Expectation

SETUP = Setup()
TARGETS = np.array([[0.2, 1.0], [-0.3, 1.1], [0.5, 0.9], [0.0, 1.3]])

# Misses of the tries at each target [m]; NaN left the table, and none is no try.
MISSES = [[0.05, 0.01], [0.04, 0.06, 0.04], [np.nan], []]
LAG = 0.02  # Of the measured joints behind the commanded ones [rad].
CONFIG = {
    "settings": {"seed": 0},
    "versions": {"python": "3.11.7"},
    "commit": None,
    "started": "2026-11-21T00:00:00+00:00",
}


@pytest.fixture(scope="module")
def tried():
    """Four targets: one hit, one left after three tries, one off the table, one not cast at."""
    trajectory = plan_trajectory(Action(theta1=-0.6, theta2=0.5, r2=0.55, psi=0.8), SETUP)
    times = np.arange(0.0, 3.05, 0.1)
    commanded = trajectory.joint_path
    measured = JointPath(times=commanded.times, q=commanded.q - LAG, qd=commanded.qd)
    goals, casts, index = LANDING.goals(SETUP, TARGETS), [], []
    for place, (goal, misses) in enumerate(zip(goals, MISSES, strict=True)):
        for number, miss in enumerate(misses, start=1):
            landed = np.isfinite(miss)
            path = np.tile(goal.value + [miss if landed else 0.0, 0.0], (len(times), 1))
            track = EndpointTrack(
                times=times,
                endpoint_xy=path,
                status=TrialStatus.OK if landed else TrialStatus.OFF_TABLE,
                joint_path=measured,
            )
            expected = Expectation(mean=goal.value, covariance=1e-4 * np.eye(2), scatter=0.01)
            proposal = Proposal(
                goal=goal,
                number=5 + len(casts),
                try_number=number,
                action=trajectory.action,
                expected=expected,
                inside_coverage=True,
            )
            casts.append(Cast.of_motion(trajectory, track, "aim", proposal))
            index.append(place)
    every = Evaluation(
        setup=SETUP,
        rig={"rig": "virtual", "seed": 0},
        target_xy=TARGETS,
        inside_coverage=np.ones(4, dtype=bool),
        casts=tuple(casts),
        motions=(trajectory,) * len(casts),
        target_index=np.array(index),
        predicted_xy=TARGETS[index],
    )
    info = {"metrics": {"training_count": 7200, "held_out_count": 800, "held_out_median_pct": 0.4}}
    model = types.SimpleNamespace(
        policy=types.SimpleNamespace(model=types.SimpleNamespace(info=info))
    )
    session = types.SimpleNamespace(
        setup=SETUP,
        config=AimConfig(),
        active_casts=lambda: list(enumerate(range(10))),
        fitted_count=5,
        model=model,
    )
    stuck = Stop(
        proposal=casts[4].proposal, reason=StopReason.STUCK, nearest=TARGETS[1], is_simulated=False
    )
    return Tried(
        session=session,
        every=every,
        stops=[None, stuck, stuck, stuck],
        beyond=[(np.array([1.3, 1.4]), "no simulated cast lands there")],
    )


@pytest.fixture(scope="module")
def page(tried):
    return aim_page(tried, CONFIG)


def test_the_page_says_first_how_many_of_the_targets_that_were_asked_for_are_hit(page):
    lead = re.search(r'<p class="lead">(.*?)</p>', page, re.S).group(1)
    words = "<b>1 of 5 targets were hit; 2 were missed, 1 was not cast at, 1 is out of reach.</b>"
    assert lead.startswith(words)
    assert "within\n1.9 cm of the target, 3 % of the cable's length of 0.62 m." in lead
    assert (
        "5<small> of 6</small></b><span>casts at these targets came to rest on the table; 1 off"
        in page
    )


def test_each_target_says_what_came_of_it_and_how_far_each_try_missed(page):
    tries = re.search(r"<td>hit at try 2</td><td>(.*?)</td>", page).group(1)
    assert re.fullmatch(r"5\.0 cm \(\d+ %\), 1\.0 cm \(\d+ %\)", tries.replace("\u00a0", " "))
    assert "<td>left after 3 tries: " in page
    assert "<td>left after one try: " in page
    assert "<td>not cast at: " in page
    assert "<td>out of reach: no simulated cast lands there</td><td></td>" in page


def test_casts_that_were_discarded_are_not_among_those_that_are_known(page):
    assert "and 4 casts on the rig besides those at these targets" in page


@pytest.mark.usefixtures("blank_figures")
def test_one_try_is_not_called_all_of_them(tried):
    first, stuck, _, last = tried.stops
    page = aim_page(dataclasses.replace(tried, stops=[first, stuck, None, last]), CONFIG)
    assert "<td>missed by its only try</td>" in page


def test_the_table_of_casts_and_the_film_have_every_try(page, tried):
    assert "<summary>6 rows, the same as in trials.csv</summary>" in page
    data = re.search(r'<script type="application/json" id="casts">(.*?)</script>', page, re.S)
    casts = json.loads(data.group(1))["casts"]
    assert [cast["label"].split(", ")[2] for cast in casts[:3]] == [
        "try 1: 8.1 % off",
        "try 2: hit",
        "try 1: 6.5 % off",
    ]
    for cast in casts:
        region = np.array(cast["region_mm"]).reshape(-1, 2)
        expected = tried.every.casts[0].proposal.expected.ellipse(0.9).semi_axes[0]
        away = np.linalg.norm(region - cast["target_mm"], axis=1)
        np.testing.assert_allclose(away, 1000.0 * expected, atol=2.0)
        assert cast["within_mm"] == pytest.approx(18.6, abs=0.5)


def test_the_page_refers_to_no_other_file_and_says_nothing_of_the_papers_errors(page):
    assert not re.search(r"https?://|@import|url\(", page)
    assert "published" not in page


def test_the_map_draws_every_landing_with_its_region_and_every_target(tried):
    figure = tried.map()
    table, curves, hits = figure.axes
    drawn = [tuple(line.get_xydata()[0]) for line in table.lines if len(line.get_xydata()) == 1]
    for xy in [*tried.every.landed_xy[:5], *TARGETS, tried.beyond[0][0]]:
        assert any(np.allclose(xy, one) for one in drawn)
    assert len(table.patches) - 2 == len(tried.every.casts)
    assert [bar.get_height() for bar in hits.patches] == [0.0, 20.0, 20.0]
    assert curves.get_xlim()[0] < 1.0
    assert any(np.allclose(line.get_ydata(), 3.0) for line in curves.lines)
    assert png_bytes(figure, dpi=30)


@pytest.mark.usefixtures("blank_figures")
def test_many_targets_none_of_which_was_cast_at_are_drawn(tried, make_evaluation):
    every = make_evaluation().rows(np.arange(0))
    assert tries_map(every).axes[2].patches[0].get_height() == 0.0
    stops = [tried.stops[1]] * len(every.target_xy)
    page = aim_page(dataclasses.replace(tried, every=every, stops=stops), CONFIG)
    assert page.count("<td>not cast at: ") == len(stops)


@pytest.mark.usefixtures("blank_figures")
def test_a_first_try_without_a_landing_has_no_miss_in_percent(tried):
    last = np.flatnonzero(tried.every.target_index == 2)
    one = dataclasses.replace(
        tried.every.rows(last), target_xy=TARGETS[2:3], target_index=np.zeros(1, dtype=int)
    )
    page = aim_page(dataclasses.replace(tried, every=one, stops=[None]), CONFIG)
    assert "<b>miss</b><span>median miss of the first try" in page


def test_the_panels_draw_the_tolerance_at_its_size(tried):
    figure = target_panels(tried.every)
    assert [axes.get_title(loc="left") for axes in figure.axes][3].endswith("not cast at")
    radii = [patch.width / 2 for patch in figure.axes[0].patches if hasattr(patch, "width")]
    assert 0.03 * SETUP.cable.length in radii
    assert png_bytes(figure, dpi=30)


def test_the_joints_are_drawn_beside_their_limits(tried):
    figure = joint_curves(tried.every.casts, SETUP)
    speeds = figure.axes[6]
    bound = np.degrees(SETUP.arm.limits.velocity[0])
    assert {bound, -bound} <= {float(line.get_ydata()[0]) for line in speeds.lines}
    assert len(speeds.lines) == 2 + len(tried.every.casts)
    assert png_bytes(figure, dpi=30)


def test_the_tracking_error_is_measured_minus_commanded(tried):
    times, error = tracking_error(tried.every.casts[0])
    assert error.shape == (len(times), 6)
    np.testing.assert_allclose(error, -LAG)


def test_a_rig_without_joints_has_no_curves_of_joints():
    track = EndpointTrack(times=np.zeros(1), endpoint_xy=np.zeros((1, 2)), status=TrialStatus.OK)
    cast = Cast(action=None, duration=1.0, joint_path=None, track=track, purpose="aim")
    assert joint_curves([cast], SETUP) is None
    assert tracking_error(cast)[1].size == 0


def test_the_map_of_many_targets_shows_what_share_was_within_a_distance(make_evaluation):
    figure = tries_map(make_evaluation())
    assert figure.axes[1].get_xlabel() == "miss [% of cable length]"
    assert png_bytes(figure, dpi=30)
