"""Atomic file writes: a reader finds the old file or the new one, never half of one."""

import glob
import json
import os
import pathlib
import shutil
import tempfile
from typing import Any


def temporary_prefix(path: pathlib.Path) -> str:
    """Return how the temporary name of a file or folder begins; it names the process."""
    return f".{path.name}.{os.getpid()}-"


def remove_leftovers(path: pathlib.Path) -> None:
    """Remove what processes that were killed left of a file or folder, under temporary names.

    Args:
        path: Path of the whole file or folder.
    """
    for left in path.parent.glob(f".{glob.escape(path.name)}.*-*.tmp"):
        process = left.name.removeprefix(f".{path.name}.").partition("-")[0]
        if process.isdecimal() and not _is_alive(int(process)):
            if left.is_dir():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink(missing_ok=True)


def _is_alive(process: int) -> bool:
    if os.name == "nt":
        # There, signal 0 is no question.
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        # It belongs to somebody else.
        return True
    return True


def write_bytes(path: pathlib.Path, content: bytes) -> None:
    """Write a file under a temporary name, flush it to the disk, and rename it.

    Args:
        path: Path of the file; its folder is created.
        content: Whole content of the file.
    """
    temporary = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(
            prefix=temporary_prefix(path), suffix=".tmp", dir=path.parent
        )
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp makes files that only their owner may read; results are for sharing.
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)
    except BaseException as error:
        if temporary:
            pathlib.Path(temporary).unlink(missing_ok=True)
        # A person knows the file, not its temporary name; writing itself names none at all.
        if isinstance(error, OSError) and error.errno is not None:
            error.filename, error.filename2 = str(path), None
        raise


def write_text(path: pathlib.Path, text: str) -> None:
    """Write text in UTF-8; see `write_bytes`."""
    write_bytes(path, text.encode())


def write_json(path: pathlib.Path, values: Any) -> None:
    """Write plain values as indented JSON, which has no NaN; see `write_bytes`."""
    text = json.dumps(values, indent=2, ensure_ascii=False, allow_nan=False)
    write_text(path, text + "\n")
