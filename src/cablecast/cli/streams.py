"""Standard streams that are closed, full, or cannot write every character."""

import contextlib
import io
import os
import shutil
import sys
import textwrap
from typing import TextIO


class WrappedStream(io.TextIOBase):
    """Stream that breaks long lines of plain text between words, at the width of the terminal."""

    def __init__(self, stream: TextIO):
        self._stream = stream

    @property
    def encoding(self) -> str:
        """Encoding of the stream below."""
        return self._stream.encoding

    def isatty(self) -> bool:
        """Return whether the stream below is a terminal."""
        return self._stream.isatty()

    def write(self, text: str) -> int:
        """Write a text; a box is as wide as the terminal already."""
        width = shutil.get_terminal_size().columns
        lines = (
            textwrap.fill(line, width) if len(line) > width and "\x1b" not in line else line
            for line in text.split("\n")
        )
        return self._stream.write("\n".join(lines))


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
