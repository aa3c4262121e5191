"""Streams, terminals and homes that do not work, odd names, and processes that are stopped."""

import io
import os
import pathlib
import shlex
import signal
import subprocess
import sys
import time

import pytest
import yaml
from tests.cli.conftest import skip_check

from cablecast.cable import load_cable
from cablecast.cli import main

NAMES = ["- [bold]x[/bold] [/] 線 weiß :smile: 100% a'b\"c\\d: y # z", "../.."]


@pytest.mark.usefixtures("blank_figures")
@pytest.mark.parametrize("name", NAMES)
def test_a_cable_and_a_rig_may_have_any_printable_name(name, lab, capsys, monkeypatch):
    pytest.importorskip("matplotlib")
    skip_check(monkeypatch)
    values = load_cable("cable_1").to_dict() | {"name": name}
    (lab.path / "my.yaml").write_text(yaml.safe_dump(values, allow_unicode=True), encoding="utf-8")
    options = [*lab.rig, "--cable", "my.yaml"]
    assert main(["collect", *options, "--count", "2"]) == 0
    assert f"2 casts of {name} are in runs" in capsys.readouterr().out
    one = ["--combinations", "1.2", "--action-count", "1", "--repeats", "2"]
    assert main(["repeat", *options, *one]) == 0
    assert all(path.is_relative_to(lab.path / "runs") for path in lab.path.glob("**/metrics.json"))


def run_shell(command: str, folder: pathlib.Path) -> subprocess.CompletedProcess[str]:
    """Run the command line in a shell, as a person does; `cablecast` stands for it."""
    python = f"{shlex.quote(sys.executable)} -m cablecast"
    # The status of the command line, where a pipe would give that of its reader.
    shell = ["bash", "-o", "pipefail", "-c", command.replace("cablecast", python)]
    return subprocess.run(shell, cwd=folder, capture_output=True, text=True, timeout=300)


PLAN = "cablecast plan --model model --target 1 10 --miss-max 1000"


@pytest.mark.parametrize(
    ("command", "status"),
    [
        (f"{PLAN} >&- 2>&- <&-", 0),
        (f"{PLAN} >/dev/full", 2),
        (f"{PLAN} >/dev/full 2>&1", 2),
        (f"{PLAN} 2>/dev/full", 0),
        ("cablecast plan --help >/dev/full", 2),
        (f"{PLAN} --bad 2>/dev/full", 2),
        (f"{PLAN} | true", 141),
        (f"LC_ALL=C PYTHONIOENCODING=ascii COLUMNS=40 {PLAN}", 0),
        (f"LC_ALL=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0 {PLAN} --cable weiß", 2),
        (f"COLUMNS=x TERM=dumb HOME=/dev/null {PLAN}", 0),
    ],
)
def test_streams_and_languages_that_do_not_work_give_no_traceback(
    command, status, model_folder, tmp_path
):
    (tmp_path / "model").symlink_to(model_folder)
    if "/dev/full" in command and not pathlib.Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    done = run_shell(command, tmp_path)
    assert done.returncode == status, done.stderr
    for word in ("Traceback", "Exception ignored", "Error"):
        assert word not in done.stderr


def test_a_home_that_cannot_be_written_names_the_variable_of_the_cache(tmp_path):
    unset = "unset XDG_CACHE_HOME WARP_CACHE_PATH;"
    done = run_shell(f"{unset} HOME=/dev/null cablecast simulate --count 60", tmp_path)
    assert done.returncode == 2
    assert "set WARP_CACHE_PATH to a folder that can be written" in done.stderr.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("blank_figures")
def test_a_table_keeps_its_numbers_on_a_narrow_terminal_and_in_ascii(
    lab, capsys, monkeypatch, model_folder
):
    monkeypatch.setenv("COLUMNS", "40")
    arguments = ["evaluate", "--model", str(model_folder), *lab.rig, "--out", "out"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "median" in printed
    assert "…" not in printed
    # The rig lands at one point, whatever the target: the errors have three digits.
    assert "paper: Gaussian process, D_sim" in printed
    out = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr("sys.stdout", out)
    assert main(arguments) == 0
    assert b"[/] [bold]wei? rig" in out.buffer.getvalue()


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGINT"])
def test_a_rig_is_closed_when_the_process_is_told_to_stop_in_mid_cast(name, lab):
    (lab.path / "slow").touch()
    number = getattr(signal, name)
    process = subprocess.Popen(
        [sys.executable, "-m", "cablecast", "repeat", *lab.rig, "--combinations", "1.2"],
        cwd=lab.path,
        stderr=subprocess.PIPE,
        text=True,
        # A shell that runs the tests in the background has them ignore signals.
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    )
    wait_for(lambda: "cast" in lab.events, process)
    process.send_signal(number)
    _, error = process.communicate(timeout=60)
    assert lab.events == ["connected", "cast", "closed"]
    assert process.returncode == 128 + number
    assert error.splitlines()[-1].startswith("cablecast: ")
    assert "Traceback" not in error


@pytest.mark.parametrize("verb", ["collect", "repeat", "evaluate"])
def test_a_second_process_with_the_same_folder_is_refused_before_its_rig_is_connected(
    verb, lab, capsys, model_folder
):
    fcntl = pytest.importorskip("fcntl")
    (lab.path / "out").mkdir()
    arguments = [verb, *lab.rig, "--out", "out"]
    if verb == "evaluate":
        arguments += ["--model", str(model_folder)]
    # A handle of its own holds the folder as another process would.
    handle = os.open("out", os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        assert main(arguments) == 2
    finally:
        os.close(handle)
    assert "another process is writing to out" in capsys.readouterr().err
    assert lab.events == []


def wait_for(happened, process) -> None:
    """Wait until something has happened, or the process has ended."""
    while not happened() and process.poll() is None:
        time.sleep(0.02)
    assert happened(), process.stderr and process.stderr.read()
