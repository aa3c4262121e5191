"""Processes that are killed while they write a dataset, and what they leave behind."""

import multiprocessing
import os
import signal

# Each is a copy of a process that has imported and computed already what takes long.
FORKING = multiprocessing.get_context("forkserver")
FORKING.set_forkserver_preload(["pytest", "pandas", "pyarrow.parquet", "tests.data.warm"])


def kill_at_rename(number):
    """Die with SIGKILL when the file with this number, from 0, lies complete but unrenamed."""
    rename, calls = os.replace, []

    def replace(source, target):
        if len(calls) == number:
            os.kill(os.getpid(), signal.SIGKILL)
        calls.append(target)
        rename(source, target)

    os.replace = replace


def run_and_kill(write, *arguments):
    """Run a function that kills itself in a process of its own."""
    process = FORKING.Process(target=write, args=arguments)
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL


def contents(path):
    """Return the bytes of every file in a folder, by its path there."""
    return {
        str(file.relative_to(path)): file.read_bytes()
        for file in sorted(path.rglob("*"))
        if file.is_file()
    }
