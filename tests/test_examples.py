"""Every example runs, on a budget that teaches nothing but breaks where the example does."""

import contextlib
import dataclasses
import importlib.util
import inspect
import io
import pathlib

import numpy as np
import pytest
from tools.film import main as make_films

from cablecast.rigs.ur.config import RobotUR
from cablecast.setup import Setup, load_setup

FOLDER = pathlib.Path(__file__).parents[1] / "examples"
EXAMPLES = sorted(path.name for path in FOLDER.glob("*.py"))
LINE_COUNT_MAX = 120

BUDGETS = {
    "03_simulate_casts.py": {"count": 16},
    "04_learn_from_real_casts.py": {
        "simulated_count": 200,
        "real_count": 32,
        "candidate_count": 300,
    },
    "09_strike.py": {"move_count": 32, "cable_count": 2, "tries": 1},
    # A tenth of these casts come after the learner began to learn.
    "06_reinforcement_learning.py": {"casts": 220, "targets": 4, "candidate_count": 300},
}
# Words that only a finished run prints in its last line.
LAST_WORDS = {
    "01_cast_at_targets.py": "ErrorSummary(count=",
    "02_plan_a_motion.py": "mirror",
    "03_simulate_casts.py": "Coulomb coefficient 0.96",
    "04_learn_from_real_casts.py": "with real casts",
    "05_your_own_rig.py": "casts",
    "06_reinforcement_learning.py": "forward model:",
    "07_fit_my_cable.py": "replay.mp4",
    "08_two_grippers.py": "catenary 0.245 N and",
    "09_strike.py": "of 2 targets were struck",
}
# Examples that need an input, which a tool makes.
FILMS = "07_fit_my_cable.py"
# An example that needs a library which no extra installs.
LEARNER = "06_reinforcement_learning.py"
SCRIPT_LINES_MAX = 12


# The script of the README has no arguments: its numbers are replaced in its text.
SCRIPT = "01_cast_at_targets.py"
SCRIPT_BUDGET = {
    '"virtual"': '"engine"',
    "cc.tune(casts)": (
        "cc.tune(casts, config=cc.FitConfig(start_count=2, rough_iterations=1, "
        "coarse_iterations=1, fine_iterations=1, coarse_segment_count=10, coarse_dt=2e-3, "
        "ensemble_iterations=1))"
    ),
    "count=4000": "count=100",
    "epochs=30": "epochs=5, candidate_count=300",
}


def run_script(text):
    """Run a script with less of everything, and return the last line that it printed."""
    for full, small in SCRIPT_BUDGET.items():
        assert full in text
        text = text.replace(full, small)
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(text, SCRIPT, "exec"), {})
    return printed.getvalue().splitlines()[-1]


def run_example(name, out, fit):
    """Run an example and return the last line that it printed."""
    if name == SCRIPT:
        return run_script((FOLDER / name).read_text())
    spec = importlib.util.spec_from_file_location(f"example_{name[:2]}", FOLDER / name)
    module = importlib.util.module_from_spec(spec)
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        spec.loader.exec_module(module)
        if hasattr(module, "main"):
            budget = dict(BUDGETS.get(name, {}))
            if name == FILMS:
                make_films(["hand", str(out / "films"), "--count", "2", "--rate", "10"])
                budget = {
                    "films": out / "films",
                    "config": dataclasses.replace(fit, ensemble_iterations=0),
                }
            takes_out = "out" in inspect.signature(module.main).parameters
            module.main(**({"out": out} if takes_out else {}), **budget)
    return printed.getvalue().splitlines()[-1]


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_engine", "brief_adaptation", "blank_figures")
@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs_to_its_end(name, small_fit, tmp_path):
    if name == LEARNER:
        pytest.importorskip("stable_baselines3")
    assert LAST_WORDS[name] in run_example(name, tmp_path, small_fit)


def test_the_script_of_the_readme_is_the_first_example_and_short():
    script = (FOLDER / "01_cast_at_targets.py").read_text().split('"""\n\n', 1)[1]
    assert f"```python\n{script}```" in (FOLDER.parent / "README.md").read_text()
    assert len([line for line in script.splitlines() if line.strip()]) <= SCRIPT_LINES_MAX


def test_the_lab_file_of_the_examples_is_the_default_set_up():
    assert load_setup(FOLDER / "lab.yaml") == Setup()


def test_the_lab_file_for_a_real_arm_moves_nothing_before_it_was_checked():
    setup = load_setup(FOLDER / "robot.yaml")
    assert setup.camera is not None
    assert setup.robot is not None
    assert not setup.robot.seen_safe
    assert not setup.arm.measured
    assert setup.robot.silence_max == RobotUR.silence_max


@pytest.mark.parametrize("name", ["robot.yaml", "twin.yaml"])
def test_the_post_of_the_camera_stands_off_the_table_and_out_of_the_cables_way(name):
    setup = load_setup(FOLDER / name)
    (post,) = setup.robot.obstacles
    foot = np.array(post.start[:2])
    assert setup.workspace.edge_distance(foot) < -post.radius
    assert np.linalg.norm(foot) > setup.workspace.reach(setup.cable.length) + post.radius


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_short_enough_to_read_at_once(name):
    assert len((FOLDER / name).read_text().splitlines()) <= LINE_COUNT_MAX
