import dataclasses
import html.parser
import importlib.util
import json
import re

import numpy as np
import pytest
from tools.browse_page import find_browser, open_browser

from cablecast.cable import load_cable
from cablecast.report.page import report_page
from cablecast.setup import Setup
from cablecast.workspace import Workspace

HAS_BROWSER = find_browser() is not None and importlib.util.find_spec("playwright") is not None
CONFIG = {
    "command": "evaluate",
    "settings": {"rig": "virtual", "seed": 0, "model_fingerprint": "0123abcd"},
    "versions": {"python": "3.11.7", "cablecast": "0.1.0"},
    "commit": None,
    "cpu_count": 2,
    "started": "2026-11-21T00:00:00+00:00",
}
MODEL_INFO = {
    "metrics": {
        "training_count": 32_400,
        "held_out_count": 3_600,
        "held_out_median_pct": 0.4321,
        "held_out_p90_pct": 2.1,
        "epoch_count": 2,
        "best_epoch": 2,
    },
    "curve": [
        {"epoch": 1, "loss": 0.1, "held_out_loss": 0.1},
        {"epoch": 2, "loss": 0.05, "held_out_loss": 0.06},
    ],
    "dataset": {"settings": {"count": 36_000, "engine": {"class": "EngineWarp"}}},
}


def page_of(evaluation, **changes):
    return report_page(evaluation, MODEL_INFO, CONFIG | changes)


@pytest.fixture(scope="module")
def page(make_evaluation):
    return page_of(make_evaluation())


class LinkCollector(html.parser.HTMLParser):
    """Everything that a browser would fetch, and whether all tags are closed."""

    VOID = frozenset({"meta", "img", "input", "br", "link"})

    def __init__(self):
        super().__init__()
        self.links, self.open_tags = [], []

    def handle_starttag(self, tag, attrs):
        self.links += [value for name, value in attrs if name in ("src", "href", "action")]
        if tag not in self.VOID:
            self.open_tags.append(tag)

    def handle_endtag(self, tag):
        assert self.open_tags.pop() == tag


def test_the_page_is_well_formed_and_refers_to_no_other_file(page):
    collector = LinkCollector()
    collector.feed(page)
    assert collector.open_tags == []
    assert len(collector.links) >= 5
    assert all(link.startswith("data:image/") for link in collector.links)
    assert not re.search(r"https?://|@import|url\(", page)


def test_the_page_says_what_was_measured_and_that_no_robot_moved(page, make_evaluation):
    evaluation = make_evaluation()
    assert f"{evaluation.summary.median_pct:.1f}" in page
    assert "30<small> of 32</small>" in page
    assert "2 off table" in page
    assert "virtual rig" in page
    assert "No real robot moved" in page
    assert "paper, table II: polar casting" in page
    assert "from 36,000 simulated casts, and from nothing else" in page


@pytest.mark.usefixtures("blank_figures")
def test_the_page_of_a_real_rig_does_not_call_it_virtual(make_evaluation):
    evaluation = make_evaluation(rig={"serial": "UR5 no. 7"})
    settings = CONFIG["settings"] | {"rig": "my_lab:make_rig"}
    page = page_of(evaluation, settings=settings)
    assert "virtual" not in page
    assert "No real robot moved" not in page
    assert "my_lab:make_rig" in page


@pytest.mark.usefixtures("blank_figures")
def test_names_from_a_users_file_cannot_break_out_of_the_page(make_evaluation):
    name = "</script><script>alert(1)</script>"
    setup = Setup(cable=dataclasses.replace(load_cable("cable_1"), name=name))
    page = page_of(make_evaluation(setup=setup))
    assert name not in page
    assert "&lt;/script&gt;" in page


def test_the_player_holds_every_cast_in_millimetres(page, make_evaluation):
    data = re.search(r'<script type="application/json" id="casts">(.*?)</script>', page, re.S)
    casts = json.loads(data.group(1))["casts"]
    trials = make_evaluation().casts
    assert len(casts) == len(trials)
    for cast, trial in zip(casts, trials, strict=True):
        assert len(cast["nodes_mm"]) == len(cast["times"]) == len(trial.track.times)
        last = cast["nodes_mm"][-1][-2:]
        assert last == pytest.approx(1000 * trial.track.nodes[-1, -1, :2], abs=0.5)


@pytest.mark.usefixtures("blank_figures")
def test_the_player_gets_the_corners_of_a_turned_table(make_evaluation):
    turned = Workspace(table_width=2.0, table_depth=1.2, table_yaw_deg=90.0, table_near_y=-0.1)
    page = report_page(make_evaluation(setup=Setup(workspace=turned)), MODEL_INFO, CONFIG)
    data = re.search(r'<script type="application/json" id="casts">(.*?)</script>', page, re.S)
    player = json.loads(data.group(1))
    assert player["table_mm"] == [[-600, -100], [600, 1900]]


@pytest.mark.usefixtures("blank_figures")
@pytest.mark.parametrize(
    ("counts", "phrase"),
    [
        ({"real_used_count": 118}, "from 36,000 simulated casts and 118 casts on a rig, and from"),
        (
            {"training_count": 0, "held_out_count": 0, "real_used_count": 118},
            "from 118 casts on a rig, and from nothing else",
        ),
    ],
)
def test_the_page_names_all_casts_that_the_model_learned_from(make_evaluation, counts, phrase):
    info = MODEL_INFO | {"metrics": MODEL_INFO["metrics"] | counts}
    page = report_page(make_evaluation(), info, CONFIG)
    assert phrase in page


@pytest.mark.usefixtures("blank_figures")
def test_without_cable_shapes_the_player_has_the_grip_and_the_free_end(make_evaluation):
    evaluation = make_evaluation(with_nodes=False)
    page = page_of(evaluation)
    data = re.search(r'<script type="application/json" id="casts">(.*?)</script>', page, re.S)
    first = json.loads(data.group(1))["casts"][0]
    assert not first["is_seen"]
    ends = np.reshape(first["nodes_mm"][-1], (2, 2))
    grip = evaluation.motions[0].grip_path.evaluate([evaluation.motions[0].duration])[0, 0, :2]
    path = evaluation.casts[0].track.endpoint_xy
    np.testing.assert_allclose(ends, 1000 * np.stack([grip, path[-1]]), atol=0.5)


@pytest.mark.usefixtures("blank_figures")
def test_the_page_says_why_the_papers_figures_are_not_beside_ours(make_evaluation):
    evaluation = make_evaluation(lost=())
    moved = dataclasses.replace(evaluation, target_xy=evaluation.target_xy + 0.01)
    page = page_of(moved)
    assert "The paper's figures are of other targets." in page
    assert "paper, table II" not in page
    assert "counted as misses" not in page


@pytest.mark.usefixtures("blank_figures")
def test_a_page_without_any_landing_shows_dashes_instead_of_numbers(make_evaluation):
    page = page_of(make_evaluation(lost=range(32)))
    assert "0<small> of 32</small>" in page
    assert "nan" not in re.sub(r'data:image/[^"]*|<script.*?</script>', "", page, flags=re.S)


@pytest.mark.usefixtures("blank_figures")
def test_a_training_of_one_epoch_has_no_curve_to_draw(make_evaluation):
    alt = "Training and held-out loss over the epochs"
    assert alt in page_of(make_evaluation())
    info = MODEL_INFO | {"curve": MODEL_INFO["curve"][:1]}
    assert alt not in report_page(make_evaluation(), info, CONFIG)


@pytest.mark.slow
@pytest.mark.skipif(not HAS_BROWSER, reason="no Chromium, or no Playwright to drive it")
@pytest.mark.usefixtures("blank_figures")
def test_the_slider_of_a_cast_of_one_sample_stands_at_its_start(make_evaluation):
    evaluation = make_evaluation()
    first = evaluation.casts[0]
    nodes = first.track.nodes[:1]
    track = dataclasses.replace(
        first.track, times=np.zeros(1), endpoint_xy=nodes[:, -1, :2], nodes=nodes
    )
    casts = (dataclasses.replace(first, track=track), *evaluation.casts[1:])
    with open_browser() as browser:
        tab = browser.new_page()
        tab.set_content(page_of(dataclasses.replace(evaluation, casts=casts)))
        value = "document.querySelector('#player input[type=range]').value"
        assert tab.evaluate(value) == "0"
        tab.select_option("#player select", "1")
        tab.click("#player button")
        assert tab.evaluate("document.querySelector('#player output').textContent") != "NaN s"
