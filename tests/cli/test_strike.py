"""`cablecast aim` and `check` for strikes in the air, from the command line."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from cablecast.cli.main import main
from cablecast.cli.options import load_lab
from cablecast.data.store import CastStore
from cablecast.errors import InputError
from cablecast.setup import load_setup
from cablecast.task import STRIKE

LAB = "strike: {watch_time: 1.4}\n"
AIM = ["aim", "--rig", "engine", "--setup", "lab.yaml", "--out", "out", "--within-pct", "4"]
# A process that is killed as soon as its first swing is on the disk.
KILLED = """
import os, signal
from cablecast.cli.main import main
from cablecast.cli.options import load_lab
from cablecast.data.store import CastStore
from cablecast.pipeline import strike
strike.MOVE_COUNT, strike.CABLE_COUNT = 64, 2
add = CastStore.add
def add_and_die(self, cast):
    add(self, cast)
    os.kill(os.getpid(), signal.SIGKILL)
CastStore.add = add_and_die
main({words!r})
"""


@pytest.fixture
def lab(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, count in (("MOVE_COUNT", 64), ("CABLE_COUNT", 2), ("CHECK_MOVES", 64)):
        monkeypatch.setattr(f"cablecast.pipeline.strike.{name}", count)
    (tmp_path / "lab.yaml").write_text(LAB)
    return tmp_path


def swings(lab):
    return CastStore(load_setup(lab / "lab.yaml"), lab / "out" / "session", STRIKE).casts


def test_a_killed_command_goes_on_with_the_swings_that_it_made(lab, capsys):
    words = [*AIM, "--target", "1.2", "0.9", "--tries", "2"]
    done = subprocess.run([sys.executable, "-c", KILLED.format(words=words)], env=os.environ)
    assert done.returncode == -signal.SIGKILL
    assert len(swings(lab)) == 1
    first = swings(lab)[0].track.path
    status = main(words)
    said = capsys.readouterr().out
    assert "1 swing of cable_1 is known" in said
    assert len(swings(lab)) <= 2
    np.testing.assert_array_equal(swings(lab)[0].track.path, first)
    assert status == (0 if "1 of 1 targets were hit" in said else 3)
    for name in ("report.html", "tries.png", "metrics.json"):
        assert (lab / "out" / "report" / name).is_file()
    page = (lab / "out" / "report" / "report.html").read_text()
    assert "1.20 m ahead, 0.90 m high" in page
    assert "the cable can be anywhere in x" in said
    assert "next      cablecast view --rig engine --setup lab.yaml --out out\n" in said


@pytest.mark.parametrize("force", [False, True])
def test_force_is_named_where_it_was_not_given_and_swings(lab, capsys, force):
    # A bit, and far beyond what any swing of these cables passes.
    near = ["--target", "1.85", "0.9"]
    words = [*AIM, *near, "--target", "3", "0.9", "--tries", "1", *["--force"] * force]
    assert main(words) == 3
    said = capsys.readouterr().out
    assert said.count("cannot be struck") == 2
    assert "3.00 m ahead, 0.90 m high cannot be struck: the nearest point" in said
    assert said.count("(--force swings all the same)") == (not force)
    assert said.count("cm away; it swings all the same") == force
    assert len(swings(lab)) == force


def test_a_target_that_cannot_be_struck_counts_and_a_swing_is_filmed_from_the_side(lab, capsys):
    places = ["--target", "1.2", "0.9", "--target", "3", "0.9"]
    assert main([*AIM, *places, "--tries", "1"]) == 3
    words = "of 2 targets were hit"
    assert words in capsys.readouterr().out
    page = (lab / "out" / "report" / "report.html").read_text()
    assert words in page
    assert "1 is out of reach" in page
    assert "Target 3.00 m ahead, 0.90 m high cannot be struck" in page
    film = ["film", "--casts", "out", "--width", "128", "--height", "96", "--fps", "5"]
    assert main([*film, "--out", "swing.gif"]) == 0
    assert "1 cast" in capsys.readouterr().out
    with Image.open(lab / "swing.gif") as picture:
        assert picture.size == (128, 96)
        assert picture.n_frames > 5
    assert main([*film, "--out", "swing.html"]) == 2
    assert "ends in .mp4 or .gif" in capsys.readouterr().err
    assert main([*film, "--out", "other.gif", "--select", "7"]) == 2


def test_a_cable_that_hangs_onto_the_floor_is_refused_before_any_swing(lab, capsys):
    rope = "cable: {name: rope, length: 0.9, diameter: 0.006, mass: 0.04}\n"
    (lab / "lab.yaml").write_text(rope + LAB)
    words = ["--setup", "lab.yaml", "--target", "1.2", "0.9"]
    for verb in ("check", "aim"):
        assert main([verb, *words]) == 2
        said = capsys.readouterr().err
        assert "rope of 0.90 m hangs onto the floor: the stick ends 0.90 m above it" in said
    (lab / "lab.yaml").write_text(rope + "strike: {watch_time: 1.4, floor: -1.4}\n")
    assert main(["check", *words]) == 0


def test_a_check_says_what_can_be_struck_without_a_rig(lab, capsys):
    places = ["--target", "1.2", "0.9", "--target", "3", "0.9"]
    assert main(["check", "--task", "strike", *places]) == 3
    said, progress = capsys.readouterr()
    assert "Simulating 64 swings of each cable that this may be: 6 of 6 cables" in progress
    assert "swings of this cable pass" in said
    assert "1.20 m ahead, 0.90 m high\n         a swing passes there" in said
    assert "cannot be struck" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--target-xy", "1", "1"], "a strike needs --target AHEAD HEIGHT"),
        (["--target", "1", "1", "--target-xy", "1", "1"], "not --target-xy"),
        (["--paper-targets"], "--paper-targets is for casts onto a table"),
        (["--target", "nan", "1"], "is not finite"),
    ],
)
def test_a_wrong_strike_is_refused_in_one_line(lab, capsys, words, said):
    assert main([*AIM, *words]) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("cablecast: ")
    assert said in error


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("strike: {speed: [3, 1]}", "a least and a largest one"),
        ("strike: {joints: [knee, elbow]}", "strike joint 'knee' is none of the arm's"),
        ("strike: {turns_deg: [[1, 2]]}", "two angles for each of the 2 joints"),
        ("strike: {stick_length: 9}", "stick_length = 9 m is outside"),
        ("strike: {stik: 1}", "strike has unknown keys"),
        ("strike: {clear_low: [0, 0, 0]}", "both clear_low and clear_high"),
        ("strike: {start_deg: [0, 0]}", "start_deg has 2 angles"),
    ],
)
def test_a_wrong_strike_section_is_refused_in_one_line(lab, capsys, text, said):
    (lab / "lab.yaml").write_text(text)
    assert main([*AIM, "--target", "1", "1"]) == 2
    assert said in capsys.readouterr().err


def test_a_landing_can_be_asked_of_a_lab_that_strikes(lab, capsys):
    assert main(["aim", "--task", "landing", "--setup", "lab.yaml", "--target", "9", "0"]) == 2
    assert "out of reach: r must be at most" in capsys.readouterr().err


def test_verbs_that_know_no_strikes_take_the_lab_as_one_of_a_table(lab):
    assert load_lab(lab / "lab.yaml", None).strike is None
    assert load_lab(lab / "lab.yaml", None, None).strike is not None
    assert load_lab(None, None, "strike").strike is not None
    (lab / "lab.yaml").write_text("cable: {length: 1.6, diameter: 0.01, mass: 0.1}\n" + LAB)
    # It hangs well, and would lie beyond the table's edge.
    assert load_lab(lab / "lab.yaml", None, "strike").cable.length == 1.6
    with pytest.raises(InputError, match="beyond the table's edge"):
        load_lab(lab / "lab.yaml", None)
