"""Every example runs, on a budget that teaches nothing but breaks where the example does."""

import contextlib
import importlib.util
import io
import pathlib

import pytest

FOLDER = pathlib.Path(__file__).parents[1] / "examples"
EXAMPLES = sorted(path.name for path in FOLDER.glob("*.py"))
LINE_COUNT_MAX = 120

BUDGETS = {
    "02_simulate_casts.py": {"count": 16},
    "03_make_a_dataset.py": {"count": 100},
    "04_train_and_plan.py": {"epochs": 2, "candidate_count": 300},
    "06_tune_a_simulator.py": {"count": 3, "generations": 1, "population_size": 8},
    "07_learn_from_real_casts.py": {"count": 32, "candidate_count": 300},
}
# What only a finished run prints in its last line.
LAST_WORDS = {
    "01_plan_a_motion.py": "mirror",
    "02_simulate_casts.py": "Coulomb coefficient 0.96",
    "03_make_a_dataset.py": "Parquet",
    "04_train_and_plan.py": "target (+0.00, 1.00) m",
    "05_your_own_rig.py": "casts",
    "06_tune_a_simulator.py": "after tuning",
    "07_learn_from_real_casts.py": "with real casts",
}


@pytest.fixture(scope="module")
def run_example(tmp_path_factory):
    """Runs an example after those that it builds on, each once, and says what it printed last."""
    out = tmp_path_factory.mktemp("examples")
    last_lines = {}

    def run(name):
        if name in last_lines:
            return last_lines[name]
        if name >= "04":
            run(EXAMPLES[EXAMPLES.index(name) - 1])
        spec = importlib.util.spec_from_file_location(f"example_{name[:2]}", FOLDER / name)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        folder = {} if name.startswith("02") else {"out": out}
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            module.main(**folder, **BUDGETS.get(name, {}))
        last_lines[name] = printed.getvalue().splitlines()[-1]
        return last_lines[name]

    return run


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs_to_its_end(name, run_example):
    assert LAST_WORDS[name] in run_example(name)


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_short_enough_to_read_at_once(name):
    assert len((FOLDER / name).read_text().splitlines()) <= LINE_COUNT_MAX
