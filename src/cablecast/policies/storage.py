"""policy.npz: file with the candidates of a forward search."""

import dataclasses
import io
import json
import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.checks import check_keys
from cablecast.errors import CablecastError, CheckpointError, InputError, UnreadableFileError
from cablecast.files import write_bytes
from cablecast.reading import read_bytes
from cablecast.setup import Setup

FORMAT = "cablecast.forward_search"
FORMAT_VERSION = 3
POLICY_NAME = "policy.npz"

ARRAY_SHAPES: dict[str, tuple[int, ...]] = {
    "actions": (4,),
    "predicted_xy": (2,),
    "sensitivity": (),
    "spread": (),
    "margin": (),
}
"""Arrays of the file, and the shape of each after the candidate axis."""

# The spread is NaN if the model has seen no real casts.
_MAY_BE_NAN = {"spread"}


@dataclasses.dataclass(frozen=True, kw_only=True)
class StoredPolicy:
    """Content of a policy.npz.

    Attributes:
        arrays: Arrays by name; see `ARRAY_SHAPES`.
        setup: Set-up that the candidates were planned for.
        info: Description of the policy.
    """

    arrays: dict[str, NDArray[np.float64]]
    setup: Setup
    info: dict[str, Any]


def write_policy(folder: str | pathlib.Path, stored: StoredPolicy) -> None:
    """Write `policy.npz` atomically and without pickled objects."""
    meta = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "setup": stored.setup.to_dict(),
        "info": stored.info,
    }
    text = json.dumps(meta, ensure_ascii=False, allow_nan=False)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, meta=np.array(text), **stored.arrays)
    write_bytes(pathlib.Path(folder) / POLICY_NAME, buffer.getvalue())


def read_policy(folder: str | pathlib.Path) -> StoredPolicy:
    """Read `policy.npz`.

    Raises:
        CheckpointError: The file is missing, damaged, of another kind, or of another version.
        UnreadableFileError: The system refuses to read it.
    """
    file = pathlib.Path(folder) / POLICY_NAME
    try:
        content = read_bytes(file)
    except UnreadableFileError:
        raise
    except FileNotFoundError:
        raise CheckpointError(
            f"there is no policy at {file}: make it with `cablecast train`"
        ) from None
    except InputError as error:
        raise CheckpointError(str(error)) from None
    # Damaged bytes make zipfile, zlib and NumPy raise a dozen types of errors.
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            meta = json.loads(str(archive["meta"]))
            kind, version = meta["format"], meta["format_version"]
            known = (kind, version) == (FORMAT, FORMAT_VERSION)
            arrays = {name: archive[name] for name in ARRAY_SHAPES} if known else {}
    except Exception as error:
        raise CheckpointError(
            f"{file} is damaged or not a policy ({_line(error)}): train again"
        ) from None
    if not known:
        raise CheckpointError(
            f"{file} holds {_line(kind)} of version {_line(version)}: it must be {FORMAT} of "
            f"version {FORMAT_VERSION}, train again"
        )
    try:
        check_keys(meta, {"format", "format_version", "setup", "info"}, "it", required={"setup"})
        info = meta.get("info")
        if not isinstance(info, Mapping):
            raise InputError("info must be a mapping")
        setup = Setup.from_dict(meta["setup"])
        return StoredPolicy(arrays=_checked(arrays), setup=setup, info=dict(info))
    except (CablecastError, TypeError) as error:
        raise CheckpointError(
            f"{file} does not match this version of cablecast ({_line(error)}): train again"
        ) from None


def _checked(arrays: dict[str, NDArray]) -> dict[str, NDArray[np.float64]]:
    """Check that the arrays have consistent shapes and types, and return them."""
    count = len(arrays["actions"]) if arrays["actions"].ndim else 0
    if count == 0:
        raise InputError("it holds no candidates")
    for name, shape in ARRAY_SHAPES.items():
        values = arrays[name]
        if values.dtype != np.float64 or values.shape != (count, *shape):
            raise InputError(f"{name} has shape {values.shape} and type {values.dtype}")
        if name not in _MAY_BE_NAN and not np.all(np.isfinite(values)):
            raise InputError(f"{name} is not finite")
    return arrays


def _line(value: Any) -> str:
    return " ".join(str(value).split())[:120] or type(value).__name__
