"""Pages say what the results hold, and whether code that these depend on has changed since."""

import dataclasses
import json
import shlex
import subprocess
import sys

import numpy as np
import pytest
from benchmarks import __main__ as benchmarks
from benchmarks import pages
from benchmarks.result import (
    ROOT,
    SHOWING,
    Result,
    Table,
    depends,
    fingerprint,
    fingerprints_at,
    measured,
    quoted,
    show,
)

NAMES = sorted(path.stem for path in pages.FOLDER.glob("*.json"))


@pytest.mark.parametrize("page", pages.PAGES)
def test_a_page_says_what_its_results_hold(page):
    text = (ROOT / page).read_text()
    assert pages.rendered(text) == text, (
        f"{page} differs from its results: run `make results`; `python -m benchmarks all --budget "
        "HOURS` renews results whose code has changed"
    )


def test_a_digit_that_was_changed_by_hand_is_found():
    text = (ROOT / "docs/reproduce.md").read_text()
    changed = text.replace("| 43.3 |", "| 34.3 |")
    assert changed != text
    assert pages.rendered(changed) == text


@pytest.mark.parametrize("path", pages.FIGURES)
def test_a_figure_is_drawn_from_its_result(path):
    name = pages.FIGURES[path][0]
    drawn = pages.signature(ROOT / path)
    assert drawn == f"{name} {pages.digest(name)}", f"{path}: run `make results`"


def test_every_result_is_quoted_and_every_run_has_a_result():
    shown = set().union(*(pages.quoted_names((ROOT / page).read_text()) for page in pages.PAGES))
    assert set(NAMES) == shown == {*benchmarks.QUOTED, *benchmarks.ONCE}


@pytest.mark.parametrize("name", benchmarks.ONCE)
def test_a_result_of_code_that_is_not_kept_names_the_commit_that_has_it(name):
    result = quoted(name)
    assert result.commit is not None
    start = f"git checkout {result.commit[:8]} && python -m benchmarks "
    assert result.command.startswith(start)


@pytest.mark.parametrize("name", benchmarks.QUOTED)
def test_a_result_is_of_the_command_that_renews_it(name):
    line, hours = benchmarks.QUOTED[name]
    command, *words = shlex.split(line)
    settings = benchmarks.settings_of(benchmarks.parse(command, words)[1])
    result = quoted(name)
    assert result.command == f"python -m benchmarks {line}"
    assert result.settings == json.loads(json.dumps(settings, default=str))
    assert hours > 0.0


def test_a_benchmark_depends_on_what_it_imports():
    module = "benchmarks.arrival"
    names = f"import sys, {module}; print(*(n for n in sys.modules if n[:10] == 'cablecast.'))"
    done = subprocess.run([sys.executable, "-c", names], capture_output=True, check=True, text=True)
    imported = [name.split(".")[1:] for name in done.stdout.split()]
    found = depends(module)
    counted = ["/".join(parts) for parts in imported if parts[0] not in SHOWING]
    assert len(counted) > 10
    for part in counted:
        assert covers(found, part), part


def test_a_benchmark_depends_on_what_its_functions_import_and_public_names_stand_for():
    found = depends("benchmarks.casts")
    for part in (
        "engines/warp_/step",
        "motion/servo",
        "pipeline/aim",
        "rigs/virtual/scene",
        "task",
    ):
        assert covers(found, part), part
    for room in (*SHOWING, "rigs/ur", "exports"):
        assert not any(f"{part}/".startswith(f"{room}/") for part in found), room
    # Its code is the text of a script.
    assert covers(depends("benchmarks.replay"), "exports/pybullet_cable")


def covers(found, part):
    """Return whether a part is one of those found, or lies in one; a package by its first file."""
    return any(f"{part}/".startswith(f"{other}/") or other == f"{part}/__init__" for other in found)


@pytest.fixture
def rewritten(tmp_path):
    """Return a function that gives the root of a tree with a room in which a text is replaced."""

    def write(before, after):
        source = ROOT / "src/cablecast/conventions.py"
        file = tmp_path / str(len([*tmp_path.iterdir()])) / source.relative_to(ROOT)
        file.parent.mkdir(parents=True)
        assert before in source.read_text()
        file.write_text(source.read_text().replace(before, after))
        return file.parents[2]

    return write


def test_a_comment_or_a_docstring_changes_no_fingerprint_and_other_code_is_named(rewritten):
    here = fingerprint("conventions")
    result = result_of("conventions")
    for before, after in (('"""Return ', '"""Give back '), ("\ndef ", "\n# A comment.\ndef ")):
        root = rewritten(before, after)
        assert fingerprint("conventions", root) == here
        assert "has changed" not in pages.origin(result, root)
    words = "**The code of conventions has changed since.**"
    assert words in pages.origin(result, rewritten(" + ", " - "))


def test_a_page_names_the_rooms_of_which_the_result_has_no_fingerprint():
    parts = depends(benchmarks.module_of("swing"))
    whole = dataclasses.replace(result_of(*parts), command="python -m benchmarks swing")
    assert whole.changed() == []
    code = {part: stored for part, stored in whole.code.items() if part != "cable"}
    assert dataclasses.replace(whole, code=code).changed() == ["cable"]


def test_the_fingerprint_of_a_commit_is_that_of_its_files():
    if not (ROOT / ".git").exists():
        pytest.skip("needs the repository")
    stored = fingerprints_at("HEAD", ("motion", "cable", "no_room"))
    assert len(set(stored.values())) == 3
    assert stored["no_room"] == fingerprint("no_room")


def result_of(*code):
    rows = [("one", np.float64(1.23456789), 2), ("two", float("nan"), True)]

    def tables():
        yield Table("First of two", ("what", "number", "count"), rows)
        yield Table("Second", ("what",), [("three",)])
        return 1

    result, status = measured(tables(), name="test", command="cmd", settings={"a": (1,)}, code=code)
    assert status == 1
    return result


def test_a_result_comes_back_from_its_file(tmp_path):
    result = result_of("cable")
    again = Result.read(result.write(tmp_path))
    assert dataclasses.asdict(again)["settings"] == {"a": [1]}
    assert again.table("First").rows == [("one", 1.23457, 2), ("two", None, True)]
    assert (again.cores, again.processor) == (result.cores, result.processor)
    assert again.seconds is not None
    assert again.changed() == []


def test_a_number_of_a_table_has_three_digits_and_no_exponent():
    numbers = [0.12345, -0.0, 999.7, 12345.6, 4_567_890.0, float("nan")]
    assert [show(number) for number in numbers] == [
        "0.123",
        "0",
        "1,000",
        "12,300",
        "4,570,000",
        "nan",
    ]


def test_faults_with_the_same_words_are_told_once():
    columns = ("fault", "reset", "cast")
    old = [
        ("late", "stopped at 1.5 m; at rest after 0.20 s; resumed", "no harm; **not resumed**"),
        ("dark", "dark; resumed", "dark; resumed"),
    ]
    new = [("late", "no harm; resumed", "stopped at 0.5 m; at rest after 0.30 s; resumed")]
    tables = (Table("cb3", columns, old), Table("x", columns, new))
    text = pages.reactions(dataclasses.replace(result_of("cable"), tables=tables))
    assert text.splitlines()[2:] == [
        "| late | stopped at 0.5 to 1.5 m; no harm (reset on x, cast on cb3) | 0.3 | 3 of 4 |",
        "| dark (cb3) | dark |  | 2 of 2 |",
    ]


def test_a_run_with_the_settings_of_a_page_is_known_by_its_name():
    for name, (line, _) in benchmarks.QUOTED.items():
        command, *words = shlex.split(line)
        assert benchmarks.quoted_as(command, benchmarks.parse(command, words)[1]) == name
    assert benchmarks.quoted_as("light", benchmarks.parse("light", ["--clips", "2"])[1]) is None


def test_runs_that_do_not_fit_the_budget_are_left_out(monkeypatch, capsys):
    started = []
    monkeypatch.setattr(benchmarks, "QUOTED", {"one": ("swing", 2.0), "two": ("order", 0.1)})
    monkeypatch.setattr(benchmarks, "stored_result", lambda name: None)
    monkeypatch.setattr(benchmarks.subprocess, "run", lambda words: started.append(words) or Done())
    assert benchmarks.run_all(benchmarks.AllArgs(budget=1.0)) == 0
    assert [words[3] for words in started] == ["order"]
    assert "one: takes about 2 h" in capsys.readouterr().out


class Done:
    returncode = 0
