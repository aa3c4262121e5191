"""What casts can reach is said before any is made, with what limits it and what helps."""

import dataclasses

import numpy as np
import pytest
from benchmarks.pages import outlook_values
from benchmarks.result import quoted

import cablecast as cc
from cablecast.cli.main import main
from cablecast.conventions import polar_to_xy
from cablecast.engines.dynamics import Dynamics
from cablecast.engines.warp_ import EngineWarp
from cablecast.files import read_json
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.polar import polar_config
from cablecast.pipeline import check
from cablecast.pipeline.check import OUTLOOK_FILE, _try_changes, outlooks


@pytest.fixture(scope="module")
def checked():
    return cc.check(cc.Setup(), changes=False)


@pytest.fixture
def try_only(monkeypatch):
    """Return a function that leaves only changes of some kinds to be tried."""
    possible = check._possible

    def leave(*kinds):
        monkeypatch.setattr(
            check, "_possible", lambda setup: [row for row in possible(setup) if row[0] in kinds]
        )

    return leave


def test_places_that_are_called_reached_are_those_where_other_casts_land(checked):
    setup = cc.Setup()
    # Another engine's resolution, other casts.
    paths = cast_grip_paths(feasible_uniform(600, setup, seed=7), setup)
    engine = EngineWarp(segment_count=28, dt=1e-3)
    xy = Dynamics.of(None, setup).rollout(engine, setup, paths).endpoint_xy
    landed = xy[(setup.workspace.edge_distance(xy) > 0.0).all(axis=1), -1]
    reached = checked.chance(landed) > 0
    assert reached.mean() > 0.97
    assert not any(checked.is_out_of_reach(place) for place in landed)


def test_what_nothing_reaches_is_named_with_the_nearest_landing(checked):
    behind = np.array([0.0, 0.1])
    assert checked.is_out_of_reach(behind)
    assert "the nearest is r = " in checked.words_at(behind)
    assert checked.doubt_words_at(behind) == checked.words_at(behind)
    assert not checked.is_out_of_reach([0.0, 1.1])
    assert "6 of 6 cables that this may be" in checked.words_at([0.0, 1.1])
    assert any("beyond arm and cable, 1.56 m" in limit for limit in checked.limits)


@pytest.mark.usefixtures("few_casts")
def test_a_change_that_is_named_reaches_more_of_the_table(try_only):
    try_only("r0", "table")
    changed = cc.check(cc.Setup(cable="cable_2").with_motion(r0=0.9))
    assert changed.changes
    # Compared with the share that is said.
    assert {change.before for change in changed.changes} == {changed.shares[0]}
    for change in changed.changes:
        other = cc.check(change.setup, changes=False)
        assert other.shares[0] > changed.shares[0], str(change)


def test_progress_ends_with_all_changes_tried(monkeypatch):
    monkeypatch.setattr("cablecast.pipeline.check._share", lambda *_: 0.0)
    reports = []
    _try_changes(cc.Setup(), 0.5, 0, reports.append, lays_out=True)
    assert [report.done for report in reports] == list(range(reports[0].total + 1))


@pytest.mark.usefixtures("few_casts")
def test_a_cable_of_which_little_is_known_is_less_sure():
    cable = {"name": "line", "length": 0.62, "diameter": 0.011, "mass": 0.05}
    guessed = cc.check(cc.Setup.from_dict({"cable": cable}), changes=False)
    sure = {name: 1.01 for name in ("bend_stiffness", "twist_stiffness", "mass")}
    known = cc.check(cc.Setup.from_dict({"cable": {**cable, "deviations": sure}}), changes=False)
    assert np.ptp(guessed.shares) > np.ptp(known.shares)


def test_a_cable_heavier_than_lead_is_asked_about(checked):
    cable = {"name": "typo", "length": 0.62, "diameter": 0.0011, "mass": 0.05}
    found = dataclasses.replace(checked, setup=cc.Setup.from_dict({"cable": cable}))
    assert any("85 kg/l is unusual" in line for line in found.limits)
    assert not any("unusual" in line for line in checked.limits)


@pytest.mark.usefixtures("few_casts")
def test_an_arm_that_can_follow_nothing_hears_what_would_help(try_only):
    try_only("jerk")
    jerky = cc.Setup().with_motion(jerk=400.0)
    words = r"break its .* with jerk = (40|160) m/s³: .* instead"
    with pytest.raises(cc.CablecastError, match=words):
        cc.check(jerky)


@pytest.mark.usefixtures("few_casts")
def test_the_verb_prints_what_is_reached_and_draws_it(tmp_path, monkeypatch, capsys, try_only):
    try_only("v_max")
    monkeypatch.chdir(tmp_path)
    lab = tmp_path / "lab.yaml"
    lab.write_text("cable: {length: 0.7, diameter: 0.005, mass: 0.022, kind: hose}\n")
    assert main(["check", "--setup", str(lab), "--target", "0.15", "5"]) == 0
    page = capsys.readouterr().out
    assert "casts of cable reach" in page
    assert "no simulated cast of what this cable may be lands there" in page
    assert (tmp_path / "runs/cable/check/check.png").stat().st_size > 10_000


def test_the_outlook_of_a_target_is_what_the_benchmark_measured():
    assert read_json(OUTLOOK_FILE) == outlook_values(quoted("promises"), quoted("five-casts"))


def test_what_to_expect_of_a_target_is_said_by_the_casts_that_reach_it(checked):
    length = checked.setup.cable.length
    places = {
        "calm": polar_to_xy([1.2, 0.0]),
        "edge": polar_to_xy([1.45, 0.0]),
        "wild": polar_to_xy([0.5, 1.1]),
    }
    for kind, xy in places.items():
        assert checked.outlook_at(xy) == kind
        assert outlooks()[kind].words(length) in checked.words_at(xy)
    assert checked.doubt_words_at(places["calm"]) == ""
    assert checked.doubt_words_at(places["edge"]).startswith("it is at the edge of")
    assert "The nearest landing of a calm cast is r = " in checked.doubt_words_at(places["wild"])
    first, second, *_ = outlooks()["calm"].hit
    assert first < second


@pytest.mark.usefixtures("few_casts")
def test_what_a_reset_does_to_the_cable_is_said_before_any_cast(checked, capsys):
    assert checked.swing_words == ""
    cable = dataclasses.replace(checked.setup.cable, name="own")
    own = dataclasses.replace(checked, setup=dataclasses.replace(checked.setup, cable=cable))
    assert own.swing_words.startswith("the standard one was chosen for other cables: ")
    tuned = dataclasses.replace(own.setup, polar=polar_config(own.setup))
    assert dataclasses.replace(own, setup=tuned).swing_words == ""
    rope = {"name": "rope", "kind": "rope", "length": 1.1, "diameter": 0.008, "mass": 0.02}
    lab = {"cable": rope, "workspace": {"table_depth": 2.75}}
    long = cc.check(cc.Setup.from_dict(lab), changes=False)
    assert not long.lays_out
    remedy = "look for a swing that does with `cablecast check --tune-swing`"
    assert f"as only 0.70 m of it hang free: {remedy}" in long.swing_words
    hasty = dataclasses.replace(tuned, polar=polar_config(own.setup).paced(0.3, 0.3))
    found = cc.check(hasty, changes=False)
    cannot = "the ur5 cannot make the reset of the cable: "
    assert found.swing_words == f"{cannot}change the section `polar`, or {remedy}"
    assert dataclasses.replace(own, reset_offset=np.inf).swing_words == f"{cannot}{remedy}"
