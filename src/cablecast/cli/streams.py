"""Standard streams that are closed, full, or cannot write every character."""

import contextlib
import os
import sys
from typing import TextIO


def prepare_streams() -> None:
    """Open the streams that were closed, and let none fail for a character that it cannot write.

    A closed descriptor would go to the next file that is opened, and whatever a library prints
    would land in that file.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:
            _open_descriptor(number)
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115
        elif mode == "w" and hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def say(line: str) -> None:
    """Write a line to standard error; a stream that takes no more is no reason to stop."""
    with contextlib.suppress(OSError):
        print(line, file=sys.stderr)
    drain(sys.stderr)


def drain(stream: TextIO) -> None:
    """Write what a stream still holds.

    What it cannot write goes nowhere: Python would complain of it at the very end.
    """
    try:
        stream.flush()
    except OSError:
        with contextlib.suppress(OSError):
            handle = os.open(os.devnull, os.O_WRONLY)
            os.dup2(handle, stream.fileno())
            os.close(handle)


def _open_descriptor(number: int) -> None:
    """Point a descriptor at nothing, if it is closed."""
    try:
        os.fstat(number)
    except OSError:
        handle = os.open(os.devnull, os.O_RDWR)
        if handle != number:
            os.dup2(handle, number)
            os.close(handle)
