import json
import re
import subprocess
import sys
import warnings

import pytest

import cablecast
from cablecast.cli import main
from cablecast.cli.main import VERBS
from cablecast.cli.plan import PlanVerb

HEAVY = ("torch", "warp", "mujoco", "matplotlib", "scipy", "pyarrow", "jinja2", "ruckig")


def imported_by(arguments):
    """Which of the heavy libraries a run of the command line imports, in a new interpreter."""
    code = (
        "import json, sys\n"
        "from cablecast.cli import main\n"
        "try:\n"
        f"    status = main({list(map(str, arguments))!r})\n"
        "except SystemExit as exit:\n"
        "    status = exit.code\n"
        f"heavy = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "print(json.dumps([status or 0, heavy]), file=sys.stderr)\n"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    return json.loads(process.stderr.strip().splitlines()[-1])


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(verb, capsys):
    with pytest.raises(SystemExit) as exit_info:
        main([verb, "--help"])
    assert exit_info.value.code == 0
    text = capsys.readouterr().out
    assert f"usage: cablecast {verb}" in text
    assert "None" not in text
    # Of --no-write: a flag that is given to turn something off says what is then off.
    assert "(default: True)" not in " ".join(re.sub("[│•]", " ", text).split())
    # A person who starts a verb knows when to come back.
    assert re.search(r"\b(second|minute|hour)s?\b", text)


@pytest.mark.parametrize("verb", ["plan", "evaluate", "check", "aim"])
def test_a_verb_explains_the_targets_that_it_takes_and_no_others(verb, capsys):
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    text = " ".join(re.sub("[│•]", " ", capsys.readouterr().out).split())
    target = text.partition("--target R THETA")[2].partition("--target-xy X Y")[0]
    assert ("That of a strike" in target) == (verb in ("check", "aim"))
    assert ("Give it again" in target) == ("repeatable" in target) == (verb != "plan")


def test_help_breaks_lines_at_the_width_of_the_terminal(capsys, monkeypatch):
    for width in (80, 1000):
        monkeypatch.setenv("COLUMNS", str(width))
        with pytest.raises(SystemExit):
            main(["aim", "--help"])
        lines = capsys.readouterr().out.splitlines()
        assert max(map(len, lines)) <= width
    # Nor elsewhere: a source file has lines of its own.
    assert any(
        "and angle from straight ahead [deg], positive to the robot's right" in x for x in lines
    )


def test_no_arguments_show_the_verbs(capsys):
    with pytest.raises(SystemExit) as exit_info:
        main([])
    assert exit_info.value.code == 0
    text = " ".join(re.sub("[│•]", " ", capsys.readouterr().out).split())
    for verb, kind in VERBS.items():
        first, *others = (" ".join(part.split()) for part in kind.__doc__.split("\n\n"))
        assert f"{verb} {first}" in text
        # Its own help tells the rest.
        assert not any(other in text for other in others)


def test_the_version_is_that_of_the_package(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"cablecast {cablecast.__version__}\n"


def test_a_warning_is_one_line_without_a_place_in_the_code(monkeypatch):
    shown = []

    def warn(verb):
        del verb
        for category in (UserWarning, DeprecationWarning):
            shown.append(warnings.formatwarning("the cable\nis stiff", category, "file.py", 1, ""))

    monkeypatch.setattr(PlanVerb, "run", warn)
    usual = warnings.formatwarning
    assert main(["plan"]) == 0
    assert shown[0] == "cablecast: note: the cable is stiff\n"
    assert shown[1].startswith("file.py:1: DeprecationWarning")
    assert warnings.formatwarning is usual


def test_help_imports_no_heavy_library():
    assert imported_by(["--help"]) == [0, []]


def test_planning_imports_neither_torch_nor_an_engine(model_folder):
    status, heavy = imported_by(["plan", "--model", model_folder, "--target", "1.0", "10"])
    assert status == 0
    assert not {"torch", "warp", "mujoco", "matplotlib"} & set(heavy)


def test_a_folder_that_cannot_be_written_is_one_line_and_status_2(tmp_path, capsys):
    blocker = tmp_path / "file"
    blocker.write_text("in the way")
    assert main(["simulate", "--count", "60", "--out", str(blocker / "dataset")]) == 2
    error = capsys.readouterr().err
    assert error.splitlines()[-1].startswith("cablecast: ")
    assert blocker.read_text() == "in the way"


@pytest.mark.parametrize("missing", ["/proc/none", "/proc/none/.cache/warp/kernel"])
def test_a_home_that_cannot_be_written_is_named_with_what_the_simulator_keeps_there(
    missing, monkeypatch, capsys
):
    monkeypatch.setenv("HOME", "/proc/none")
    for name in ("XDG_CACHE_HOME", "WARP_CACHE_PATH"):
        monkeypatch.delenv(name, raising=False)

    def run(_):
        raise FileNotFoundError(2, "No such file or directory", missing)

    monkeypatch.setattr(PlanVerb, "run", run)
    assert main(["plan", "--target", "1.1", "10"]) != 0
    line = capsys.readouterr().err.strip()
    assert f"{missing}: No such file or directory" in line
    assert "set WARP_CACHE_PATH to a folder that can be written" in line
    assert "\n" not in line
