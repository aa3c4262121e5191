"""The twin from the command line, and a dry run against it."""

import contextlib
import dataclasses
import os
import pathlib
import subprocess
import sys

import pytest

from cablecast.cli.main import main
from cablecast.cli.options import open_rig, with_instruments
from cablecast.setup import Setup, load_setup, save_setup

pytest.importorskip("mujoco")


@pytest.fixture
def lab(tmp_path):
    """Write the lab file of a twin at an address of its own."""
    setup = load_setup(pathlib.Path(__file__).parents[2] / "examples" / "twin.yaml")
    if not sys.platform.startswith("linux"):
        pytest.skip("another loopback address needs Linux")
    process = os.getpid()
    address = f"127.{process // 250 % 250 + 1}.{process % 250 + 1}.200"
    robot = dataclasses.replace(setup.robot, address=address)
    path = tmp_path / "lab.yaml"
    save_setup(dataclasses.replace(setup, robot=robot, camera=None), path)
    return path, address


def test_a_dry_run_checks_all_against_a_twin_and_moves_nothing(lab, tmp_path, capsys):
    path, address = lab
    command = [sys.executable, "-m", "cablecast", "twin", "--setup", str(path)]
    with subprocess.Popen(
        [*command, "--address", address, "--fault", "speed_slider:reset:1"],
        stdout=subprocess.PIPE,
        text=True,
    ) as twin:
        try:
            assert "A twin of a ur5 (cb3) listens" in twin.stdout.readline()
            words = ["--rig", "ur", "--setup", str(path), "--count", "2", "--dry-run"]
            words += ["--out", str(tmp_path / "out")]
            assert main(["collect", *words]) == 2
        finally:
            twin.terminate()
    lines = capsys.readouterr().out.splitlines()
    # All but the camera, which this lab file does not have.
    assert [line[:4] for line in lines[:-1]] == ["ok  "] * 5 + ["NOT "]
    assert "the lab file has no section `camera`" in lines[-2]
    assert lines[-1] == "Nothing was moved."
    assert not (tmp_path / "out").exists()


def test_a_dry_run_without_a_controller_says_so_and_fails(lab, tmp_path, capsys):
    words = ["collect", "--rig", "ur", "--setup", str(lab[0]), "--count", "1", "--dry-run"]
    assert main(words) == 2
    assert "NOT controller: no RTDE server answers at" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--fault", "earthquake"], "unknown fault 'earthquake'"),
        (["--fault", "protective_stop:lunch"], "unknown phase 'lunch'"),
        (["--fault", "protective_stop:cast:soon"], "must be NAME[:PHASE[:SECONDS]]"),
        (["--address", "0.0.0.0"], "the twin listens on a loopback address"),
        (["--rate", "0"], "twin rate = 0 is outside"),
    ],
)
def test_a_twin_that_makes_no_sense_is_refused_in_one_line(lab, words, message, capsys):
    assert main(["twin", "--setup", str(lab[0]), *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_dry_run_is_only_for_the_arm(capsys):
    assert main(["collect", "--dry-run"]) == 2
    assert "--dry-run is for --rig ur, not for virtual" in capsys.readouterr().err


def test_a_model_is_evaluated_with_the_robot_of_the_lab_file(lab):
    setup = load_setup(lab[0])
    stored = Setup.from_dict(Setup().to_settings())
    merged = with_instruments(stored, lab[0])
    assert merged.robot == setup.robot
    assert merged.arm.measured
    assert merged.to_settings() == stored.to_settings()
    assert with_instruments(stored, None) is stored


@pytest.mark.parametrize(("seen_safe", "said"), [(False, 1), (True, 0)])
def test_a_person_is_told_that_the_first_casts_are_rehearsed(
    lab, tmp_path, monkeypatch, capsys, seen_safe, said
):
    setup = load_setup(lab[0])
    robot = dataclasses.replace(setup.robot, seen_safe=seen_safe)
    connected = contextlib.nullcontext("rig")
    monkeypatch.setattr("cablecast.rigs.make.make_rig", lambda *given, **options: connected)
    with open_rig("ur", dataclasses.replace(setup, robot=robot), 0, tmp_path) as rig:
        assert rig == "rig"
    assert (
        capsys.readouterr().out.count(
            "The first reset and 3 casts are rehearsed, 4 times as slowly"
        )
        == said
    )
