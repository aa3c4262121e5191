"""PyBullet's library, and a client of it that nobody else uses."""

import functools
import os
import sys
from typing import Any

from cablecast.errors import MissingExtraError


def load_pybullet() -> Any:
    """Return the module, and swallow the build time that it prints on standard error.

    Raises:
        MissingExtraError: PyBullet is not installed.
    """
    if (library := sys.modules.get("pybullet")) is not None:
        return library
    sys.stderr.flush()
    saved, silent = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(silent, 2)
        import pybullet
    except ModuleNotFoundError:
        raise MissingExtraError("pybullet", "pybullet", "EnginePybullet") from None
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(silent)
    return pybullet


class BulletClient:
    """PyBullet's functions with a client of our own: its default one belongs to the user."""

    def __init__(self):
        self._library = load_pybullet()
        self._id = self._library.connect(self._library.DIRECT)

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._library, name)
        if callable(value):
            value = functools.partial(value, physicsClientId=self._id)
        setattr(self, name, value)
        return value
