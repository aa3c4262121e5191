"""Loading of kernels: processes that start side by side compile each of them once."""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false

import pathlib
import threading

import pytest
import warp as wp

from cablecast.runs import kernels
from cablecast.runs.kernels import load, start_warp

# Long enough for a thread to get to the lock, and to go on if it is free [s].
PATIENCE = 2.0


@wp.kernel(enable_backward=False, module="unique")
def count(first: int, numbers: wp.array(dtype=int)):
    numbers[wp.tid()] = first


def test_a_kernel_that_another_process_compiles_is_waited_for():
    fcntl = pytest.importorskip("fcntl")
    start_warp()
    lock = pathlib.Path(wp.config.kernel_cache_dir) / f"cablecast-{count.module.name}.lock"
    with lock.open("w") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        thread = threading.Thread(target=load, args=(count,))
        thread.start()
        thread.join(PATIENCE)
        assert thread.is_alive()
    thread.join()
    (loaded,) = count.module.execs.values()
    # It is loaded: whoever compiles another one need not be waited for.
    with lock.open("w") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        load(count)
    # What is loaded is what a launch runs.
    wp.launch(count, dim=1, inputs=[3, wp.zeros(1, dtype=int, device="cpu")], device="cpu")
    assert list(count.module.execs.values()) == [loaded]


def test_a_kernel_is_loaded_where_no_lock_can_be_made(monkeypatch, tmp_path):
    start_warp()
    monkeypatch.setattr(kernels, "_loaded", set())
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path / "nowhere"))
    load(count)
    assert count.module.execs
