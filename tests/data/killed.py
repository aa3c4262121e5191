"""Processes that are killed while they write a dataset, and what they leave behind."""

import os
import pathlib
import signal
import subprocess
import sys

ROOT = pathlib.Path(__file__).parents[2]


def kill_at_rename(number):
    """Die with SIGKILL when the file with this number, from 0, lies complete but unrenamed."""
    rename, calls = os.replace, []

    def replace(source, target):
        if len(calls) == number:
            os.kill(os.getpid(), signal.SIGKILL)
        calls.append(target)
        rename(source, target)

    os.replace = replace


def run_and_kill(script, moment, path, *options):
    """Run a script of this folder, which kills itself at a moment."""
    command = [sys.executable, "-m", f"tests.data.{script}", str(moment), path, *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True)
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()


def contents(path):
    """Return the bytes of every file in a folder, by its path there."""
    return {
        str(file.relative_to(path)): file.read_bytes()
        for file in sorted(path.rglob("*"))
        if file.is_file()
    }
