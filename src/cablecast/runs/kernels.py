"""Warp's compiler: started quietly, used by one thread and one process at a time."""

import contextlib
import functools
import os
import pathlib
import threading
from collections.abc import Iterator
from typing import Any

one_builder = threading.RLock()
"""Lock of the thread that makes or loads a kernel: Python 3.11 may fail where two threads parse
sources at a time ("AST constructor recursion depth mismatch")."""

_loaded: set[Any] = set()
"""Kernels that this process has loaded for the CPU."""


@functools.cache
def start_warp() -> None:
    """Start Warp without its list of devices, and without its warning where there is no GPU.

    The warning goes straight to the process's error stream, at any log level. Whoever asks for a
    CUDA device that is not there gets an error of our own.
    """
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    saved, silent = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(silent, 2)
        wp.init()
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(silent)


def load(kernel: Any) -> None:
    """Load a kernel for the CPU; of several processes one compiles it, and the others wait for it.

    To compile the rollout takes a core ten seconds, which processes that start side by side, and
    threads that launch it first, would each spend on the same file. It has a module of its own.
    """
    import warp as wp

    if kernel in _loaded:
        return
    with one_builder, _turn(kernel.module.name):
        # Another thread may have loaded it meanwhile.
        if kernel not in _loaded:
            wp.load_module(kernel.module, device="cpu")
            _loaded.add(kernel)


@contextlib.contextmanager
def _turn(name: str) -> Iterator[None]:
    """Hold a lock in the folder of compiled kernels, where there are locks."""
    import warp as wp

    handle = None
    try:
        # Whatever is wrong with the folder, Warp says it.
        with contextlib.suppress(ImportError, OSError):
            import fcntl

            path = pathlib.Path(wp.config.kernel_cache_dir or "") / f"cablecast-{name}.lock"
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        if handle is not None:
            os.close(handle)
