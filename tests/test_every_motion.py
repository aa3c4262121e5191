"""Casts of every family of motions, hit, missed and lost, pass every word and picture."""

import dataclasses
import re
import types

import numpy as np
import pytest

from cablecast.aiming.config import AimConfig
from cablecast.cast import Cast, EndpointTrack, Proposal, TrialStatus
from cablecast.evaluation.evaluate import Evaluation, trial_rows
from cablecast.motion.casting import Action
from cablecast.motion.families import MOTIONS
from cablecast.motion.joint_move import JointMove, JointMoves
from cablecast.motion.polar import PolarCast, PullReach
from cablecast.motion.trajectory import joints_at, plan_trajectory
from cablecast.report.aim_page import Tried, aim_page
from cablecast.report.strike_page import strike_map, strike_page
from cablecast.report.words import distance_text, hit_text, miss_text, motion_text, reason_text
from cablecast.setup import Setup, StrikeConfig
from cablecast.task import LANDING, STRIKE, Expectation
from cablecast.view.film import FilmConfig, write_film
from cablecast.view.look import Shot, ShownCast
from cablecast.view.shapes import INK
from cablecast.view.strike_film import _Painter, write_strike_film

TABLE, AIR = Setup(), Setup(strike=StrikeConfig())
PLACE = np.array([0.2, 1.0])
PLACE_IN_AIR = np.array([0.0, 1.2, 0.9])
CONFIG = {
    "settings": {"seed": 0},
    "versions": {"python": "3.11.7"},
    "commit": None,
    "started": "2026-11-21T00:00:00+00:00",
}
SMALL = FilmConfig(width=64, height=64, frames_per_second=2)
# How far each try misses [m]; NaN is hidden, infinite was stopped. Lost ones come before a landing.
MISSES = (0.2, np.nan, np.inf, 0.0)


def motions(kind):
    """Return motions of a family that differ a little, a lot, or only in their pace."""
    if kind is Action:
        first = Action(theta1=-0.6, theta2=0.5, r2=0.55, psi=0.8)
        steps = ({}, {"theta2": 0.51}, {"pace": 0.9}, {"theta1": -0.2})
        return [dataclasses.replace(first, **step) for step in steps]
    if kind is PolarCast:
        first = PullReach.of(TABLE).cast_to(PLACE, 0.9)
        steps = ({}, {"x": first.x + 0.01}, {"pace": 1.0}, {"azimuth": first.azimuth + 0.1})
        return [dataclasses.replace(first, **step) for step in steps]
    assert kind is JointMove
    moves = JointMoves.of(AIR)
    units = 0.5 + 0.1 * np.eye(3)
    return [moves.move(unit) for unit in (np.full(3, 0.5), *units)]


def casts_of(kind):
    """Return a session that knows four tries at one target, and the tries."""
    setup, task = (AIR, STRIKE) if kind is JointMove else (TABLE, LANDING)
    (goal,) = task.goals(setup, [1.2, 0.9] if kind is JointMove else PLACE)
    size = len(goal.value)
    casts = []
    for number, (motion, miss) in enumerate(zip(motions(kind), MISSES, strict=True)):
        proposal = Proposal(
            goal=goal,
            number=number,
            try_number=number + 1,
            action=motion,
            expected=Expectation(mean=goal.value, covariance=1e-4 * np.eye(size), scatter=0.01),
            inside_coverage=True,
        )
        trajectory = plan_trajectory(motion, setup)
        times = np.linspace(0.0, trajectory.duration, 9)
        path = np.tile(
            goal.value + np.append(np.nan_to_num(miss, posinf=0.0), np.zeros(size - 1)), (9, 1)
        )
        path[5 if np.isnan(miss) else 9 :] = np.nan
        track = EndpointTrack(
            times=times,
            endpoint_xy=path[:, :2],
            endpoint_z=path[:, 2] if size == 3 else None,
            status=TrialStatus.OCCLUDED if np.isnan(miss) else TrialStatus.OK,
        )
        if np.isinf(miss):
            track = EndpointTrack.unseen(TrialStatus.ABORTED, "the emergency stop was pressed")
            track = dataclasses.replace(track, endpoint_z=[np.nan] if size == 3 else None)
        casts.append(Cast.of_motion(trajectory, track, "aim", proposal))
    info = {"metrics": {"training_count": 9, "held_out_count": 1, "held_out_median_pct": 0.4}}
    model = types.SimpleNamespace(info=info)
    session = types.SimpleNamespace(
        setup=setup,
        config=AimConfig(),
        active_casts=lambda: list(enumerate(casts)),
        casts_at=lambda value: casts,
        fitted_count=5,
        sight=None,
        model=types.SimpleNamespace(policy=types.SimpleNamespace(model=model)),
    )
    return session, casts


@pytest.fixture(params=MOTIONS, ids=lambda kind: kind.family)
def kind(request):
    return request.param


def test_every_try_is_told_in_words(kind):
    session, casts = casts_of(kind)
    for cast in casts:
        said = [motion_text(cast.proposal), distance_text(cast.proposal), miss_text(cast)]
        if kind is not JointMove:
            said += [hit_text(cast.proposal, 6), reason_text(cast.proposal, session)]
        assert all(said)
        assert not re.search(r"\bnan\b|\binf\b|<|array|object", "; ".join(said)), said
    assert [miss_text(cast) for cast in casts] == ["20.0 cm", "occluded", "aborted", "0.0 cm"]


def test_every_try_is_in_the_report(kind):
    session, casts = casts_of(kind)
    if kind is JointMove:
        page = strike_page([casts], AIR, CONFIG, ["a fact"])
    else:
        every = Evaluation(
            setup=TABLE,
            rig={"rig": "virtual", "seed": 0},
            target_xy=PLACE[None],
            inside_coverage=np.ones(1, dtype=bool),
            casts=tuple(casts),
            motions=tuple(cast.proposal.trajectory for cast in casts),
            target_index=np.zeros(len(casts), dtype=int),
            predicted_xy=np.tile(PLACE, (len(casts), 1)),
        )
        page = aim_page(Tried(session=session, every=every, stops=[None]), CONFIG)
        assert [row["status"] for row in trial_rows(every)].count("occluded") == 1
    text = re.sub(r"<[^>]*>|data:[^\"]*", " ", re.sub(r"<script.*?</script>", "", page, flags=re.S))
    text = text.replace("\u00a0", " ")
    assert "1 of 1 targets were hit" in text
    assert "20.0 cm" in text
    assert "occluded" in text
    assert not re.search(r"\bnan\b|\bNone\b", text)


def test_every_try_is_filmed(kind, tmp_path):
    _, casts = casts_of(kind)
    path = tmp_path / "film.gif"
    if kind is JointMove:
        write_strike_film(path, casts, SMALL)
    else:
        shots = [Shot(cast=ShownCast.of_cast(cast), target_xy=PLACE) for cast in casts]
        write_film(path, TABLE, shots, SMALL)
    assert path.stat().st_size


def test_a_film_of_swings_shows_the_arm_wherever_it_goes():
    _, casts = casts_of(JointMove)
    painter = _Painter(casts, SMALL)
    for cast in casts:
        for time in cast.track.times:
            pixels = painter._pixels(painter._arm(joints_at(cast.joint_path, [time])[0]))
            assert np.all(pixels > 0)
            assert np.all(pixels < np.array(painter.size) * [2, 2])


def test_a_film_of_swings_shows_the_cable_as_old_as_its_tip(monkeypatch):
    _, (cast, *_) = casts_of(JointMove)
    times = cast.track.times
    # The free end is one metre further with each sample.
    path = PLACE_IN_AIR + np.arange(len(times))[:, None] * [0.0, 1.0, 0.0]
    nodes = path[:, None] - np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])
    track = dataclasses.replace(
        cast.track, endpoint_xy=path[:, :2], endpoint_z=path[:, 2], nodes=nodes
    )
    cast = dataclasses.replace(cast, track=track)
    painter = _Painter([cast], SMALL)
    cables, tips = [], []
    monkeypatch.setattr(
        painter, "_line", lambda pen, at, color, _: cables.append(at) if color == INK else None
    )
    monkeypatch.setattr(painter, "_dot", lambda pen, place, color: tips.append(place))
    for time in (times[3], (times[3] + times[4]) / 2):
        painter.frame(cast, float(time))
    for cable, tip in zip(cables, tips, strict=True):
        np.testing.assert_array_equal(cable[-1], tip)


@pytest.mark.usefixtures("blank_figures")
def test_a_target_without_a_panel_is_said():
    _, casts = casts_of(JointMove)
    tries = [[], *[casts[:1]] * 13]
    said = "The first 12 of 13 targets"
    figure = strike_map(tries, AIR)
    assert len(figure.axes) == 12
    assert figure.get_suptitle() == said
    assert strike_map(tries[:-1], AIR).get_suptitle() == ""
    words = f"{said} are drawn; the table below has every try."
    assert words in strike_page(tries, AIR, CONFIG, ["a fact"])
    assert words not in strike_page(tries[:-1], AIR, CONFIG, ["a fact"])
