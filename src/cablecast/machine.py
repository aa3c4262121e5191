"""What the machine offers."""

import os

_DISTRIBUTIONS = (
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


def core_count() -> int:
    """Number of processor cores that this process may use, at least 1."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def library_versions() -> dict[str, str]:
    """Return the versions of Python, the platform and the libraries that decide the results.

    The libraries are not imported. One that is missing has the version "not installed".
    """
    import importlib.metadata
    import platform

    versions = {"python": platform.python_version(), "platform": platform.platform()}
    for name in _DISTRIBUTIONS:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions
