"""The notebook of the tutorial says what its page says, and runs to its end."""

import pytest
from tools.make_notebook import NOTEBOOK, content

# Numbers that teach nothing; the virtual rig takes a second and more for each cast.
BUDGET = {
    "TARGETS = 16, 32, 4000, 32": "TARGETS = 4, 32, 100, 1",
    "CANDIDATES = 30, 30, 50_000": "CANDIDATES = 2, 2, 200",
    "tries=3": "tries=1",
    "cc.TuneConfig(": "cc.TuneConfig(population_size=6, ",
    'make_rig("virtual"': 'make_rig("engine"',
}


def test_the_notebook_is_made_of_the_page_as_it_is():
    assert NOTEBOOK.read_text() == content(), "run `python tools/make_notebook.py`"


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_engine", "brief_adaptation", "blank_figures")
def test_every_cell_runs(small_fit, tmp_path, monkeypatch, capsys):
    nbformat = pytest.importorskip("nbformat")
    from cablecast.pipeline.aim import SimulatorConfig

    quick = SimulatorConfig(fit=small_fit, spread_count=3)
    monkeypatch.setattr("cablecast.pipeline.aim.SimulatorConfig", lambda: quick)
    monkeypatch.setattr("cablecast.pipeline.collect.FitConfig", lambda: small_fit)
    monkeypatch.chdir(tmp_path)
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    code = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    for full, small in BUDGET.items():
        assert code.count(full) == 1
        code = code.replace(full, small)
    exec(compile(code, NOTEBOOK.name, "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "cable_1 is 0.62 m long"
    assert sum(line.startswith("median miss") for line in lines) == 2
