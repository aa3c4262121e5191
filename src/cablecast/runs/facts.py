"""Facts about a run for the record: versions, commit, machine, time. They are never compared."""

import datetime
import os
import pathlib
import subprocess
from typing import Any

from cablecast.machine import library_versions


def run_facts() -> dict[str, Any]:
    """Return versions, commit, number of processors, and the time now."""
    return {
        "versions": library_versions(),
        "commit": source_commit(),
        "cpu_count": os.cpu_count(),
        "started": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


def source_commit() -> str | None:
    """Return the commit of the source tree that runs, with "+changes" if it differs.

    Returns:
        None without git, or where the package is installed.
    """
    package = pathlib.Path(__file__).resolve().parent.parent
    # Without the index lock: a status for the record must not disturb a commit under way.
    git = ["git", "--no-optional-locks", "-C", str(package)]

    def ask(*arguments: str) -> str:
        answer = subprocess.run(
            [*git, *arguments], capture_output=True, text=True, timeout=5, check=True
        )
        return answer.stdout.strip()

    try:
        # An installed package may lie inside another repository: ask whether git tracks it.
        ask("ls-files", "--error-unmatch", "errors.py")
        commit = ask("rev-parse", "HEAD")
        return commit + "+changes" * bool(ask("status", "--porcelain", "-uno", "."))
    except (OSError, subprocess.SubprocessError):
        return None
