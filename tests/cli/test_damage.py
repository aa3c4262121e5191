"""Seeded damage to every kind of file and kills in every verb: results are equal, or none."""

import dataclasses
import json
import random
import re
import shutil
import signal
import subprocess
import sys

import pytest
from tests.data.killed import contents
from tools.attack import damaged_bytes, damaged_json
from tools.small_results import SMALL, digests

from cablecast.cable import load_cable
from cablecast.cli import main
from cablecast.setup import Setup


@dataclasses.dataclass(frozen=True)
class Reading:
    """A verb that reads files.

    Attributes:
        verb: Verb, with the words of its small form.
        files: Patterns of the files below runs/, beside those of the verbs before it.
        missing: Files that are left out, so that the verb goes on from what an earlier run left.
        count: Number of damages. Each takes a tenth of a second, or seconds where work goes on.
    """

    verb: str
    files: tuple[str, ...]
    missing: tuple[str, ...] = ()
    count: int = 12


READINGS = {
    "casts": Reading(
        "collect", ("tune-data/meta/info.json", "tune-data/metrics.json", "tune-data/data/**/*")
    ),
    "repeats": Reading("repeat", ("repeat/*.json", "repeat/**/info.json", "repeat/**/*.parquet")),
    "casts to tune to": Reading("tune", ("tune-data/data/**/*", "tune/*.json", "tune/**/*.json")),
    "generations": Reading("tune", ("tune/generations/*",), ("tune/metrics.json",), count=4),
    "a choice": Reading("select", ("select/*.json", "repeat/*.json")),
    "coverage": Reading("select", ("select/coverage/*",), ("select/metrics.json",), count=4),
    "parameters": Reading(
        "simulate", ("tune/params.json", "dataset/meta/info.json", "dataset/data/**/*"), count=8
    ),
    "simulated casts": Reading(
        "train", ("dataset/meta/info.json", "dataset/data/**/*", "model/*.json", "model/policy.npz")
    ),
    "a policy": Reading("plan", ("model/policy.npz", "model/model.safetensors")),
    "an evaluation": Reading(
        "evaluate",
        ("evaluate/*.json", "evaluate/casts/**/*.parquet", "evaluate/casts/**/info.json"),
        count=3,
    ),
}
# Files for people, which no verb reads.
UNREAD = ("README.md", "stats.json", "model.json")


def ask(words, capsys):
    """Return the exit status of a command, its standard output, and its lines of errors."""
    capsys.readouterr()
    status = main(list(words))
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    lines = [line for line in captured.err.splitlines() if line.startswith("cablecast: ")]
    return status, captured.out, lines


def ask_again(words, folder, capsys):
    """Return what a command prints that has nothing to do, checked to say so and to do nothing."""
    before = contents(folder)
    capsys.readouterr()
    assert main(list(words)) == 0
    captured = capsys.readouterr()
    assert contents(folder) == before
    lines = [line for line in captured.err.splitlines() if not line.startswith("Choosing")]
    if words[0] != "plan":
        assert lines == [lines[-1]]
        assert lines[-1].endswith(": already done, nothing changed")
    return captured.out


def read_files(reading, folder):
    """Return the files that a verb reads."""
    found = (file for pattern in reading.files for file in sorted((folder / "runs").glob(pattern)))
    return [file for file in found if file.is_file() and file.name not in UNREAD]


def test_casts_that_are_made_again_are_evaluated_again(in_copy, capsys, monkeypatch):
    words = ("evaluate", *SMALL["evaluate"])
    trials = (in_copy / "runs/evaluate/trials.csv").read_text()
    # The world has changed, and nothing that the rig says of itself tells it.
    world = sys.modules["stick_of_the_attack"]
    point = world.tangent
    monkeypatch.setattr(world, "tangent", lambda yaw, pitch: point(yaw + 0.2, pitch))
    for file in sorted(in_copy.glob("runs/evaluate/casts/data/**/*.parquet"))[3:]:
        file.unlink()
    status, new, _ = ask(words, capsys)
    assert status == 0
    assert (in_copy / "runs/evaluate/trials.csv").read_text() != trials
    # What is done now is shown as it is.
    assert ask(words, capsys) == (0, new, [])


def test_a_report_that_was_deleted_is_drawn_again(in_copy, capsys):
    report = in_copy / "runs/evaluate/report.html"
    report.unlink()
    assert ask(("evaluate", *SMALL["evaluate"]), capsys)[0] == 0
    assert report.is_file()


@pytest.mark.parametrize(
    ("verb", "lost"), [("tune", "tune/params.json"), ("train", "model/policy.npz")]
)
def test_a_result_that_lacks_a_file_says_how_it_is_made_again(verb, lost, in_copy, capsys):
    words, file = (verb, *SMALL[verb]), in_copy / "runs" / lost
    file.unlink()
    status, _, lines = ask(words, capsys)
    assert (status, len(lines)) == (2, 1)
    named = re.search(r"Delete (\S+), and the same command", lines[0])
    (in_copy / named[1]).unlink()
    assert ask(words, capsys)[0] == 0
    assert file.is_file()


@pytest.mark.parametrize("name", READINGS)
def test_damage_is_refused_or_of_no_consequence(name, in_copy, capsys):
    reading = READINGS[name]
    words = (reading.verb, *SMALL[reading.verb])
    good = digests(in_copy)
    for missing in reading.missing:
        (in_copy / "runs" / missing).unlink()
    files, before = read_files(reading, in_copy), contents(in_copy)
    said = None if reading.missing else ask_again(words, in_copy, capsys)
    rng = random.Random(f"damage of {name}")
    refused = 0
    for number in range(reading.count):
        file = files[number] if number < min(len(files), reading.count) else rng.choice(files)
        damage = damaged_json if file.suffix == ".json" and number % 2 else damaged_bytes
        place = str(file.relative_to(in_copy))
        label, content = damage(before[place], rng)
        label = f"{file.name}: {label}"
        file.write_bytes(content)
        status, out, lines = ask(words, capsys)
        found = digests(in_copy)
        wanted = good | {place: found[place]}
        if status == 0:
            assert found == wanted, label
            assert said in (None, out), label
            # Figures that can be computed again are written again, as they were.
            assert file.read_bytes() == content or found[place] == good[place], label
        else:
            assert (status, len(lines)) == (2, 1), label
            assert file.name in lines[0], label
            assert {name: wanted[name] for name in found} == found, label
            refused += 1
        for changed, was in before.items():
            (in_copy / changed).write_bytes(was)
        for missing in reading.missing:
            (in_copy / "runs" / missing).unlink(missing_ok=True)
    assert refused > reading.count / 3


@pytest.mark.parametrize("name", [name for name in READINGS if not READINGS[name].missing])
def test_a_file_that_the_system_refuses_is_not_called_damaged(name, in_copy, capsys):
    reading = READINGS[name]
    for pattern in reading.files:
        file = read_files(dataclasses.replace(reading, files=(pattern,)), in_copy)[0]
        aside = file.with_name("aside")
        file.rename(aside)
        # Whoever runs the tests may read everything, but nobody reads a folder as a file.
        file.mkdir()
        status, _, lines = ask((reading.verb, *SMALL[reading.verb]), capsys)
        file.rmdir()
        aside.rename(file)
        assert (status, len(lines)) == (2, 1), file
        assert file.name in lines[0]
        for word in ("damaged", "delete", "truncated", "restore"):
            assert word not in lines[0].lower(), lines[0]


# A file that a person writes has no checksum: what it says now is other settings, or nonsense.
WRITTEN = {"--setup": Setup().to_dict(), "--cable": load_cable("cable_1").to_dict()}


@pytest.mark.parametrize("option", WRITTEN)
def test_a_mistyped_lab_or_cable_file_does_not_show_the_old_results(option, in_copy, capsys):
    good, rng = digests(in_copy), random.Random(option)
    words = ("simulate", *SMALL["simulate"], option, "written.yaml")
    text = json.dumps(WRITTEN[option]).encode()
    (in_copy / "written.yaml").write_bytes(text)
    assert ask(words, capsys)[0] == 0
    refused = 0
    for number in range(16):
        label, content = (damaged_json if number % 2 else damaged_bytes)(text, rng)
        (in_copy / "written.yaml").write_bytes(content)
        status, _, lines = ask(words, capsys)
        assert digests(in_copy) == good, label
        if status:
            assert (status, len(lines)) == (2, 1), label
            refused += 1
    assert refused > 10


# Dies with SIGKILL when the file with this number, from 0, lies complete but not yet renamed.
DYING = """
import os, signal, sys

rename, renamed = os.replace, []

def replace(source, target):
    if len(renamed) == int(sys.argv[1]):
        os.kill(os.getpid(), signal.SIGKILL)
    renamed.append(target)
    rename(source, target)

os.replace = replace
from cablecast.cli import main

sys.exit(main(sys.argv[2:]))
"""


# Moments within the work of each verb, as numbers of the file that is being written. Of the verbs
# with a rig, `repeat` does not simulate first; `collect` is killed in its own tests.
# `tools/attack.py kills` kills every verb at any moment.
@pytest.mark.parametrize(
    ("verb", "moment"),
    [("repeat", 6), ("simulate", 1), ("tune", 3)],
)
def test_a_killed_verb_goes_on_to_the_same_results(verb, moment, in_copy):
    arguments = [verb, *SMALL[verb]]
    out = arguments[arguments.index("--out") + 1]
    wanted = digests(in_copy, f"{out}/**/*")
    shutil.rmtree(in_copy / out)
    command = [sys.executable, "-c", DYING, str(moment), *arguments]
    killed = subprocess.run(command, capture_output=True, text=True)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert digests(in_copy, f"{out}/**/*") != wanted
    assert main(arguments) == 0
    assert digests(in_copy, f"{out}/**/*") == wanted
    # What a killed write left behind is gone.
    assert not list(in_copy.glob("**/*.tmp"))
