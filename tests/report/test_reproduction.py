"""The report of a reproduction, made from run folders as the stages leave them."""

import numpy as np
import pytest

from cablecast.errors import DamagedFileError, DatasetError, InputError
from cablecast.evaluation.evaluate import evaluation_metrics, save_trials
from cablecast.evaluation.published import BEST_METHOD
from cablecast.report.maps import ellipse_map
from cablecast.report.reproduction import Reproduction, cable_part, reproduction_page
from cablecast.report.style import svg_uri
from cablecast.runs.folder import Parts
from cablecast.setup import Setup
from cablecast.workspace import Workspace

# As deep as the paper's is wide: every target of the paper still lies on it.
TURNED = Setup(workspace=Workspace(table_width=1.8, table_depth=2.4, table_yaw_deg=90.0))
CONFIG = {
    "settings": {
        "setup": TURNED.to_settings(),
        "rig": "virtual",
        "budget": {"cables": ["cable_1"], "repeats": 1, "casts": 36_000},
    },
    "versions": {"python": "3.11.7"},
    "commit": None,
}


@pytest.fixture
def evaluation(make_evaluation):
    return make_evaluation(setup=TURNED)


@pytest.fixture
def results(evaluation, tmp_path):
    folder = tmp_path / "cable_1" / f"evaluate-{BEST_METHOD}"
    parts = Parts(folder)
    settings = {**TURNED.to_settings(), "repeats": 1}
    parts.put("config", {"command": "evaluate", "settings": settings})
    parts.put("metrics", evaluation_metrics(evaluation))
    save_trials(evaluation, folder / "trials.csv")
    return Reproduction(folder=tmp_path, cables=("cable_1",))


def test_the_set_up_is_the_one_that_the_stages_recorded(results):
    assert results.setup("cable_1") == TURNED


def test_the_map_of_landings_shows_the_table_of_the_evaluation(results, evaluation):
    trials = results.trials("cable_1", BEST_METHOD)
    landed = np.stack([trials["landed_x_m"], trials["landed_y_m"]], axis=1)
    # The file holds four decimals.
    np.testing.assert_allclose(landed, evaluation.landed_xy, atol=5.1e-5)
    (figure,) = cable_part(results).figures
    length = evaluation.cable.length
    assert figure.uri == svg_uri(ellipse_map(trials, TURNED.workspace, length))
    assert figure.uri != svg_uri(ellipse_map(trials, Workspace(), length))


def test_the_page_holds_what_was_measured_and_its_tables_come_with_it(results, evaluation):
    page, tables = reproduction_page(results, CONFIG, [("casting", 90.0)])
    median = f"{evaluation.summary.median_pct:.1f}"
    assert f"{median}<small> %" in page
    assert "32 targets" in " ".join(page.split())
    assert any(median in row.cells for table in tables for row in table.rows)
    assert tables[-1].rows[-1].cells == ("all", "1.5")


def test_folders_without_any_stage_are_refused_where_a_set_up_is_needed(tmp_path):
    with pytest.raises(InputError, match="no finished stage of cable_1"):
        Reproduction(folder=tmp_path, cables=("cable_1",)).setup("cable_1")


def test_a_stage_that_does_not_record_its_arm_is_refused(results):
    parts = Parts(results.folder / "cable_1" / f"evaluate-{BEST_METHOD}")
    config = parts.get("config")
    del config["settings"]["arm"]
    parts.put("config", config)
    with pytest.raises(DatasetError, match="lack arm"):
        results.setup("cable_1")


def test_a_damaged_file_is_refused_with_what_to_do(results):
    file = results.folder / "cable_1" / f"evaluate-{BEST_METHOD}" / "metrics.json"
    file.write_text('{"errors_pct": ')
    with pytest.raises(DamagedFileError, match=r"metrics\.json is damaged.*Delete it"):
        results.evaluations("cable_1")
