"""Checkpoint files of models, and torch, which is imported only to train.

`model.safetensors` holds arrays and a text header, so that one rename replaces the whole
checkpoint. `model.json` repeats the description for human readers.
"""

import contextlib
import dataclasses
import hashlib
import json
import os
import pathlib
import sys
from collections.abc import Iterator
from typing import Any

from numpy.typing import NDArray

from cablecast.errors import CheckpointError, InputError, MissingExtraError
from cablecast.files import write_bytes, write_json

FORMAT_VERSION = 1
WEIGHTS_NAME = "model.safetensors"
CONFIG_NAME = "model.json"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """Contents of a checkpoint file before they are verified; see `check`.

    Attributes:
        file: Path of the file, for error messages.
        tensors: Arrays by name.
        header: Text header: format, format version, checksum, and the description as JSON.
    """

    file: pathlib.Path
    tensors: dict[str, NDArray]
    header: dict[str, str]

    @property
    def kind(self) -> str:
        """Format name of the stored model; empty where the file has none."""
        return self.header.get("format", "")

    def check(self, kind: str) -> None:
        """Check the kind of the model, the version of the format, and the checksum.

        Args:
            kind: Format name that the file must have.

        Raises:
            CheckpointError: The file is of another kind or version, or damaged.
        """
        version = self.header.get("format_version")
        if self.kind != kind or version != str(FORMAT_VERSION):
            raise CheckpointError(
                f"{self.file} holds {self.kind or 'something'} of version {version or '?'}: "
                f"it must be {kind} of version {FORMAT_VERSION}"
            )
        if digest(self.tensors) != self.header.get("sha256"):
            raise CheckpointError(f"{self.file} is damaged: its arrays do not match their checksum")


def write_checkpoint(
    folder: str | pathlib.Path, kind: str, tensors: dict[str, NDArray], info: dict[str, Any]
) -> None:
    """Write a checkpoint.

    Args:
        folder: Folder for `model.safetensors` and `model.json`.
        kind: Format name of the model.
        tensors: Contiguous arrays by name.
        info: Description of the model, in plain values.
    """
    folder = pathlib.Path(folder)
    checksum = digest(tensors)
    header = {
        "format": kind,
        "format_version": str(FORMAT_VERSION),
        "sha256": checksum,
        "info": json.dumps(info, ensure_ascii=False, allow_nan=False),
    }
    content = _safetensors("writing a model").save(tensors, metadata=header)
    write_bytes(folder / WEIGHTS_NAME, content)
    write_json(folder / CONFIG_NAME, {"format": kind, "sha256": checksum} | info)


def read_checkpoint(folder: str | pathlib.Path) -> Checkpoint:
    """Read a checkpoint of any kind of model.

    Args:
        folder: Folder given to `write_checkpoint`.

    Raises:
        CheckpointError: The file is missing or truncated.
    """
    file = pathlib.Path(folder) / WEIGHTS_NAME
    try:
        content = file.read_bytes()
    except OSError as error:
        raise CheckpointError(f"no model at {file}: {error.strerror}") from None
    module = _safetensors("reading a model")
    from safetensors import SafetensorError

    try:
        tensors = module.load(content)
        # safetensors reads the text header only from a path. The file starts with its length.
        length = int.from_bytes(content[:8], "little")
        header = json.loads(content[8 : 8 + length]).get("__metadata__", {})
    except (SafetensorError, ValueError, KeyError) as error:
        raise CheckpointError(
            f"{file} is truncated or not a safetensors file ({str(error).splitlines()[0]})"
        ) from None
    return Checkpoint(file=file, tensors=tensors, header=header)


def digest(tensors: dict[str, NDArray]) -> str:
    """Return the start of the SHA-256 of all arrays, with their names, types and shapes."""
    state = hashlib.sha256()
    for name in sorted(tensors):
        state.update(f"{name} {tensors[name].dtype} {tensors[name].shape}".encode())
        state.update(tensors[name].tobytes())
    return state.hexdigest()[:32]


def _safetensors(purpose: str):
    try:
        import safetensors.numpy
    except ImportError:
        raise MissingExtraError("safetensors", "learn", purpose) from None
    return safetensors.numpy


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
