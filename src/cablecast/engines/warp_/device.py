"""Warp's devices: start Warp quietly, find a device, and launch the kernel on all cores."""

import concurrent.futures
import contextlib
import functools
import os
import pathlib
import threading
from collections.abc import Iterator
from typing import Any

import warp as wp

from cablecast.errors import InputError

CUDA_BLOCK = 32
"""Threads of a block on CUDA, each with one world: few, so that a small batch is spread over all
multiprocessors. A large batch is as fast with 16 or 64."""


@functools.cache
def start_warp() -> None:
    """Start Warp without its list of devices, and without its warning where there is no GPU.

    The warning goes straight to the process's error stream, at any log level. Whoever asks for a
    CUDA device that is not there gets an error of our own.
    """
    wp.config.log_level = wp.LOG_ERROR
    saved, silent = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(silent, 2)
        wp.init()
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(silent)


def find_device(name: str):
    """Return the Warp device of a name, such as "cpu" or "cuda"."""
    start_warp()
    known = ", ".join(str(device) for device in wp.get_devices())
    # Asking Warp for a CUDA device where there is none prints errors of the driver.
    if name.startswith("cuda") and not wp.get_cuda_devices():
        raise InputError(f"device {name!r} is not available here: one of {known}")
    try:
        return wp.get_device(name)
    except Exception as error:
        raise InputError(f"device {name!r} is not available here: one of {known}") from error


one_builder = threading.RLock()
"""Lock of the thread that makes or loads a kernel: Python 3.11 may fail where two threads parse
sources at a time ("AST constructor recursion depth mismatch")."""

_loaded: set[Any] = set()
"""Kernels that this process has loaded for the CPU."""


def load(kernel: Any) -> None:
    """Load a kernel for the CPU; of several processes one compiles it, and the others wait for it.

    To compile the rollout takes a core ten seconds, which processes that start side by side, and
    threads that launch it first, would each spend on the same file. It has a module of its own.
    """
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


def launch(kernel, device, group_count: int, thread_count: int, inputs: list) -> None:
    """Run the rollout kernel on every group, and wait until it is done.

    Its first argument is the first group of a launch; inputs are those after it.
    """
    if device.is_cuda:
        inputs = [0, *inputs]
        wp.launch(kernel, dim=group_count, inputs=inputs, device=device, block_dim=CUDA_BLOCK)
        wp.synchronize_device(device)
        return
    # Before threads ask for it.
    load(kernel)
    # Warp runs a CPU launch serially but releases the interpreter lock, so that threads with a
    # share of the groups each use all cores. Shares are small, for an even finish.
    share = max(1, -(-group_count // (8 * thread_count)))
    starts = range(0, group_count, share)

    def run(start: int) -> None:
        dim = min(share, group_count - start)
        wp.launch(kernel, dim=dim, inputs=[start, *inputs], device=device)

    if thread_count == 1 or len(starts) == 1:
        for start in starts:
            run(start)
        return
    with concurrent.futures.ThreadPoolExecutor(thread_count) as pool:
        for done in [pool.submit(run, start) for start in starts]:
            done.result()
