"""Warp's devices: find one, and launch the kernel on all cores."""

import concurrent.futures

import warp as wp

from cablecast.errors import InputError
from cablecast.runs.kernels import load, start_warp

CUDA_BLOCK = 32
"""Threads of a block on CUDA, each with one world: few, so that a small batch is spread over all
multiprocessors. A large batch is as fast with 16 or 64."""


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
