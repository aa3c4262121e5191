"""The notebook of the tutorial says what its page says, and runs to its end."""

import json
import os
import pathlib

import pytest
from tools.make_notebook import NOTEBOOK, content

# The first cell with code, on a budget that teaches nothing.
TINY = (
    "TUNE_CASTS, REAL_CASTS, SIMULATED_CASTS, TARGETS = 4, 32, 100, 1\n"
    "GENERATIONS, EPOCHS, CANDIDATES = 2, 2, 200\n"
    # A coarse cable, if not told otherwise.
    "import cablecast as cc\n"
    "build = cc.EngineWarp.__init__\n"
    "build.__defaults__ = (10, 2e-3, *build.__defaults__[2:])\n"
    # Ten passes over real casts.
    "import dataclasses, functools\n"
    "from cablecast.learning.network import FINE_TUNING\n"
    "from cablecast.pipeline import train as training\n"
    "brief = dataclasses.replace(FINE_TUNING, epochs=10, patience=10)\n"
    "training.fine_tune = functools.partial(training.fine_tune, config=brief)\n"
    # Simulators of `prepare_aim` that are fitted in a few steps, and coarse, too.
    "from cablecast.pipeline import aim as aiming, collect as collecting\n"
    "short = dict(start_count=2, coarse_iterations=1, fine_start_count=1, fine_iterations=1,\n"
    "    coarse_segment_count=10, coarse_dt=2e-3, ensemble_iterations=1)\n"
    "quick = aiming.SimulatorConfig(fit=cc.FitConfig(**short), spread_count=3)\n"
    "aiming.SimulatorConfig = lambda: quick\n"
    "collecting.FitConfig = lambda: quick.fit\n"
)
FEW = "cc.TuneConfig(population_size=6, "


def test_the_notebook_is_made_of_the_page_as_it_is():
    assert NOTEBOOK.read_text() == content(), "run `python tools/make_notebook.py`"


@pytest.mark.slow
def test_every_cell_runs(tmp_path, monkeypatch):
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    source = pathlib.Path(__file__).parents[1] / "src"
    paths = [str(source), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    notebook = nbformat.reads(json.dumps(json.loads(NOTEBOOK.read_text())), as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert "TUNE_CASTS" in cells[0].source
    cells[0].source = TINY
    # The virtual rig takes a second and more for each cast.
    cells[1].source = cells[1].source.replace('make_rig("virtual"', 'make_rig("engine"')
    assert '"engine"' in cells[1].source
    (search,) = [cell for cell in cells if "cc.TuneConfig(" in cell.source]
    search.source = search.source.replace("cc.TuneConfig(", FEW)
    resources = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=300, resources=resources).execute()
    said = [output.text for cell in cells for output in cell.outputs if "text" in output]
    assert said[0] == "cable_1 is 0.62 m long\n"
    assert sum(text.startswith("median miss") for text in said) == 2
