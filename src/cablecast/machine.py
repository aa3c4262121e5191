"""Facts about the machine and the installed libraries."""

import functools
import importlib.metadata
import os
import platform

DISTRIBUTIONS = (
    "cablecast",
    "numpy",
    "scipy",
    "warp-lang",
    "mujoco",
    "ruckig",
    "torch",
    "pyarrow",
    "matplotlib",
)
"""Distributions whose versions affect the results."""


def core_count() -> int:
    """Return the number of processor cores that this process may use, at least 1."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def library_versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries that affect the results.

    The libraries are not imported.
    """
    return dict(_library_versions())


@functools.cache
def _library_versions() -> dict[str, str]:
    """Look the versions up once per process: what it has imported no longer changes."""
    versions = {"python": platform.python_version(), "platform": platform.platform()}
    for name in DISTRIBUTIONS:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions
