"""make_rig: the rig of a name, a factory or an object, behind the checks of CheckedRig."""

import contextlib
import importlib
import inspect
import os
import re
import sys
from collections.abc import Callable, Iterator
from typing import Any

from cablecast.arm.robot import DRIVERS
from cablecast.engines import make_engine
from cablecast.errors import RigError, check_seed
from cablecast.rigs.base import Rig, foreign_code
from cablecast.rigs.checked import TIME_LIMIT, CheckedRig, missing_parts, takes
from cablecast.setup import Setup

RIG_NAMES = ("virtual", "virtual:LAB", "engine", "engine:NAME", *DRIVERS)
"""Rigs that come with cablecast; any other is given as package.module:factory."""

_LABORATORY = re.compile(r"virtual(?::(\d{1,9}))?")

RigFactory = Callable[[Setup, int], Rig]
"""Makes a rig for a set-up and a seed."""


def make_rig(
    spec: str | Rig | RigFactory,
    setup: Setup,
    seed: int = 0,
    *,
    time_limit: float | None = TIME_LIMIT,
) -> CheckedRig:
    """Return a rig whose answers are checked.

    Args:
        spec: "virtual" or "virtual:2", which is laboratory 2 ("virtual" is laboratory 0), "engine"
            or "engine:pybullet" for a simulator of `make_engine`, an arm such as "ur",
            "package.module:factory", a function factory(setup, seed) that returns a rig, or a rig.
            The module may lie in the working directory.
        setup: Cable, workspace, arm and motion settings.
        seed: Seed of what the rig draws by chance.
        time_limit: Longest time of one reset or one trial [s]; None for no limit.

    Raises:
        RigError: There is no such rig, module or factory, the factory fails or returns no rig, or
            the rig's description is no plain dictionary.
        MissingExtraError: The rig needs a library that is not installed.
        InputError: The seed or the time limit is out of bounds.
    """
    seed = check_seed(seed)
    if isinstance(spec, CheckedRig):
        if spec.setup.to_settings() != setup.to_settings():
            raise RigError("the rig was made for another set-up: make it anew for this one")
        return spec
    rig = _make(spec, setup, seed)
    return CheckedRig(rig, setup, time_limit=time_limit)


def check_rig(spec: str, setup: Setup) -> None:
    """Raise the errors of a rig's name that are known before the rig is made; see `make_rig`."""
    if spec in DRIVERS:
        from cablecast.rigs.driver import make_driver

        make_driver(setup, spec)
    elif _is_engine(spec):
        make_engine(spec.partition(":")[2] or "warp")
    elif not _LABORATORY.fullmatch(spec):
        with _working_directory_importable():
            _check_factory(_named_factory(spec), spec, setup)


def _is_engine(spec: str) -> bool:
    return spec == "engine" or spec.startswith("engine:")


def _make(spec: Any, setup: Setup, seed: int) -> Rig:
    """Return the rig itself, or what `CheckedRig` refuses as none."""
    if isinstance(spec, str):
        if spec in DRIVERS:
            from cablecast.rigs.arm_swing import make_arm

            return make_arm(setup, driver=spec)
        named = _swung if setup.strike is not None else _cast
        if (rig := named(spec, setup, seed)) is not None:
            return rig
        with _working_directory_importable():
            return _from_factory(_named_factory(spec), spec, setup, seed)
    if missing_parts(spec) and callable(spec):
        name = getattr(spec, "__qualname__", type(spec).__name__)
        return _from_factory(spec, name, setup, seed)
    return spec


def _cast(spec: str, setup: Setup, seed: int) -> Rig | None:
    """Return the simulated rig of a name that casts onto a table; None for another name."""
    if laboratory := _LABORATORY.fullmatch(spec):
        from cablecast.rigs.virtual import RigVirtual, VirtualConfig

        return RigVirtual(setup, seed, VirtualConfig(lab_seed=int(laboratory[1] or 0)))
    if _is_engine(spec):
        from cablecast.rigs.engine import RigEngine

        return RigEngine(make_engine(spec.partition(":")[2] or "warp"), setup)
    return None


def _swung(spec: str, setup: Setup, seed: int) -> Rig | None:
    """Return the simulated rig of a name that swings in the air; None for another name."""
    if laboratory := _LABORATORY.fullmatch(spec):
        from cablecast.rigs.virtual.strike import RigStrike, StrikeLabConfig

        return RigStrike(setup, seed, StrikeLabConfig(lab_seed=int(laboratory[1] or 0)))
    if _is_engine(spec):
        from cablecast.rigs.engine import RigSwing

        if spec not in ("engine", "engine:warp"):
            raise RigError(f"--rig {spec[:60]} swings no cable in the air: take --rig engine")
        return RigSwing(setup)
    return None


def _from_factory(factory: Callable[..., Any], name: str, setup: Setup, seed: int) -> Rig:
    """Return what a factory makes, if it is a rig."""
    _check_factory(factory, name, setup)
    with foreign_code(f"rig factory {name} failed"):
        rig = factory(setup, seed)
    if missing := missing_parts(rig):
        raise RigError(
            f"rig factory {name} returned a {type(rig).__name__}, which is no rig: "
            f"it lacks {', '.join(missing)}"
        )
    return rig


def _check_factory(factory: Callable[..., Any], name: str, setup: Setup) -> None:
    """Refuse a factory that does not take a set-up and a seed."""
    if not takes(factory, setup, 0):
        signature = str(inspect.signature(factory))[:100]
        raise RigError(f"rig factory {name} takes {signature}: it must take (setup, seed)")


def _named_factory(spec: str) -> Callable[..., Any]:
    """Return the factory of a name such as package.module:factory."""
    module_name, _, factory_name = spec.partition(":")
    if not (module_name and factory_name) or module_name == "virtual":
        names = ", ".join(RIG_NAMES)
        raise RigError(f"unknown rig {spec[:80]!r}: one of {names}, or package.module:factory")
    with foreign_code(f"rig module {module_name} cannot be imported"):
        try:
            module = importlib.import_module(module_name)
        except ModuleNotFoundError as error:
            # The module itself may be there and miss something that it imports.
            if error.name is None or not (module_name + ".").startswith(error.name + "."):
                raise
            raise RigError(
                f"there is no module {error.name!r} for the rig {module_name}, neither in the "
                "working directory nor installed"
            ) from None
    factory = getattr(module, factory_name, None)
    if factory is None:
        raise RigError(f"rig module {module_name} has no factory {factory_name!r}")
    if not callable(factory):
        raise RigError(f"{module_name}:{factory_name} is a {type(factory).__name__}, no factory")
    return factory


@contextlib.contextmanager
def _working_directory_importable() -> Iterator[None]:
    """Let modules in the working directory be found, as an installed command does not."""
    directory = os.getcwd()
    if directory in sys.path or "" in sys.path:
        yield
        return
    # At the end, so that a file there never hides an installed package.
    sys.path.append(directory)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):
            sys.path.remove(directory)
