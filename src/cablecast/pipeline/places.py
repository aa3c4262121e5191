"""Helpers that all verbs share: a folder to work in, and the extras that a verb needs."""

import contextlib
import importlib.util
import os
import pathlib
import tempfile
from collections.abc import Iterator

from cablecast.errors import MissingExtraError

_EXTRAS = {
    "matplotlib": "report",
    "jinja2": "report",
    "shapely": "report",
    "torch": "learn",
    "safetensors": "learn",
    "viser": "view",
    "trimesh": "view",
}


@contextlib.contextmanager
def folder_or_temporary(out: str | os.PathLike[str] | None) -> Iterator[pathlib.Path]:
    """Yield a folder of results, or a temporary one if None."""
    if out is not None:
        yield pathlib.Path(out)
        return
    with tempfile.TemporaryDirectory(prefix="cablecast-") as folder:
        yield pathlib.Path(folder)


def require(purpose: str, *modules: str) -> None:
    """Refuse work whose libraries are missing, before it starts; the error names the extra."""
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise MissingExtraError(module, _EXTRAS[module], purpose)
