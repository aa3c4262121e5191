"""On-demand access to torch: import, device check and thread limit."""

import contextlib
import os
import sys
from collections.abc import Iterator

from cablecast.errors import InputError, MissingExtraError


def import_torch(purpose: str):
    """Import torch and return the module.

    Args:
        purpose: Task that needs torch, as the subject of the error message.

    Raises:
        MissingExtraError: torch is not installed.
    """
    # OpenMP threads spin while they wait for each other, some forty times per training step. On
    # busy cores they mostly spin for a thread that is not running, which made training 15 times
    # slower than on one thread. OpenMP reads this variable once, when the library is loaded.
    variable = "OMP_WAIT_POLICY"
    set_here = "torch" not in sys.modules and variable not in os.environ
    if set_here:
        os.environ[variable] = "PASSIVE"
    try:
        import torch
    except ImportError:
        raise MissingExtraError("torch", "learn", purpose) from None
    finally:
        if set_here:
            del os.environ[variable]
    return torch


def check_device(device: str) -> None:
    """Check that training can run on a device.

    Args:
        device: "cpu" or "cuda".

    Raises:
        InputError: The name is unknown, or no CUDA device was found.
        MissingExtraError: torch is not installed.
    """
    if device not in ("cpu", "cuda"):
        raise InputError(f"device {device!r} must be 'cpu' or 'cuda'")
    torch = import_torch("training the forward model")
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("device 'cuda' is not available: no CUDA device was found, use cpu")


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Limit torch to one thread inside the `with` block.

    A batch of a few hundred rows through 256 units takes microseconds, as does a covariance of as
    many casts. Synchronising threads at every operation costs more than they gain, and ten times as
    much on a busy machine.
    """
    torch = import_torch("training the forward model")
    thread_count = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(thread_count)
