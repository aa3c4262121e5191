"""Errors, and checks of input values: numbers, counts, seeds, choices, names and keys.

Every error that cablecast raises on purpose derives from CablecastError and from the matching
built-in, so that `except ValueError` works too. A message is one line that names the offending
value and the bound. The command line prints it without a traceback and exits with status 2.
"""

import dataclasses
import functools
import inspect
import math
import numbers
import os
import pathlib
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

T = TypeVar("T", bound=Callable[..., Any])


class CablecastError(Exception):
    """Base of every error that cablecast raises on purpose."""


class InputError(CablecastError, ValueError):
    """A value that is out of bounds, or of the wrong shape or type."""


class UnknownNameError(CablecastError, LookupError):
    """A name (cable, rig, engine, column) that does not exist."""


class UnreadableFileError(CablecastError, OSError):
    """A file that the system refuses to read: no permission, or a failing disk.

    Its content may be intact.
    """


class DamagedFileError(InputError):
    """A file whose content differs from what was written."""


class TargetError(InputError):
    """A target that no planned motion can reach, or that is not finite."""


class ActionError(InputError):
    """An action outside the ranges of its action set."""


class JointLimitError(InputError):
    """A motion that violates a joint position, velocity or acceleration limit."""


class IKError(InputError):
    """A tool pose that the arm cannot reach."""


class DatasetError(CablecastError, ValueError):
    """A dataset that is missing, incomplete, or was written with other settings."""


class CheckpointError(CablecastError, ValueError):
    """A model checkpoint that is missing, truncated, or of another kind."""


class RigError(CablecastError, RuntimeError):
    """A rig that cannot be created, or that failed during a trial."""


class StoppedError(RigError):
    """A person is to look before the rig moves again: no trial is made again by itself."""


class CameraError(RigError):
    """A camera that cannot be opened, or that failed while it filmed."""


class MissingExtraError(CablecastError, ImportError):
    """An optional library that is needed but not installed."""

    def __init__(self, library: str, extra: str, purpose: str):
        # As they came: an error of a worker process is made anew from its arguments.
        super().__init__(library, extra, purpose)

    def __str__(self) -> str:
        library, extra, purpose = self.args
        return (
            f"{purpose} needs {library}, which is not installed: pip install 'cablecast[{extra}]'"
        )


COUNT_MAX = 10_000_000
"""Largest number of casts, motions or steps; more would fill any disk."""

SEED_MAX = 2**32 - 1

NAME_LENGTH_MAX = 80

Ranges = Mapping[str, tuple[float, float, str]]
"""Lower bound, upper bound and unit by name; an empty unit for plain numbers."""


def check_number(name: str, value: Any, low: float, high: float, unit: str = "") -> float:
    """Return a number if it is within its bounds; the error states its name and unit.

    Raises:
        InputError: The value is no number, not finite, or outside its bounds.

    >>> check_number("v_max", 1.5, 0.05, 5.0, "m/s")
    1.5
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise InputError(f"{name} = {value!r} is not a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not (math.isfinite(number) and low <= number <= high):
        raise InputError(
            f"{name} = {number:g}{' ' * bool(unit)}{unit} is outside [{low:g}, {high:g}]"
        )
    return number


def check_ranges(owner: Any, ranges: Ranges, what: str = "") -> None:
    """Check attributes of an object against their bounds; the error names the object.

    A whole number in place of a float, or one of NumPy's, becomes a plain float: equal settings
    have one fingerprint.

    Raises:
        InputError: An attribute is no number, not finite, or outside its bounds.
    """
    kinds = {field.name: field.type for field in dataclasses.fields(owner)}
    for name, (low, high, unit) in ranges.items():
        value = getattr(owner, name)
        number = check_number(f"{what} {name}".strip(), value, low, high, unit)
        if kinds.get(name) is float and type(value) is not float:
            object.__setattr__(owner, name, number)


def check_count(name: str, value: Any, low: int = 1, high: int = COUNT_MAX) -> int:
    """Return a whole number if it is within its bounds.

    Raises:
        InputError: The value is no whole number, or outside its bounds.

    >>> check_count("count", 80)
    80
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise InputError(f"{name} = {value!r} is not a whole number")
    value = int(value)
    if not low <= value <= high:
        shown = str(value) if abs(value) < 10**15 else "a number of over 15 digits"
        raise InputError(f"{name} = {shown} is outside [{low}, {high}]")
    return value


def check_seed(seed: Any) -> int:
    """Return a seed if it is a whole number from 0 to 2**32 - 1.

    Raises:
        InputError: It is not.
    """
    return check_count("seed", seed, 0, SEED_MAX)


def check_choice(name: str, value: Any, choices: Sequence[str]) -> None:
    """Raise an InputError that lists the choices if a value is none of them."""
    if value not in choices:
        raise InputError(f"{name} {str(value)[:40]!r} must be one of {', '.join(choices)}")


def check_name(name: Any, what: str) -> str:
    """Return a name if it fits on one line; the error says what kind of thing it names.

    Raises:
        InputError: The name is no text, empty, too long, or holds control characters.
    """
    if not isinstance(name, str):
        raise InputError(f"{what} name = {str(name)[:40]!r} is not text: put it in quotes")
    if not 1 <= len(name) <= NAME_LENGTH_MAX:
        raise InputError(
            f"{what} name has {len(name)} characters: it must have 1 to {NAME_LENGTH_MAX}"
        )
    if not name.isprintable() or not name.strip():
        raise InputError(f"{what} name {name!r} must be printable, without line breaks")
    return name


def check_argument_types(verb: T) -> T:
    """Let a verb refuse an argument of another type than it is annotated with.

    Arguments are checked that are annotated with classes of this package, paths, text, or None.

    Raises:
        InputError: An argument is of another type; names it and both types.
    """
    plain = (str, os.PathLike, pathlib.Path, type(None))
    parameters = inspect.signature(verb).parameters
    known: dict[str, tuple[type, ...]] = {}
    for name, parameter in parameters.items():
        hint = parameter.annotation
        kinds = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
        kinds = tuple(typing.get_origin(kind) or kind for kind in kinds)
        if all(kind in plain or kind.__module__.startswith("cablecast.") for kind in kinds):
            known[name] = kinds

    @functools.wraps(verb)
    def checked(*args: Any, **kwargs: Any) -> Any:
        given = kwargs | dict(zip(parameters, args, strict=False))
        for name, kinds in known.items():
            if name in given and not isinstance(value := given[name], kinds):
                names = " or ".join(kind.__name__ for kind in kinds if kind is not type(None))
                shown = f" {value!r:.40}" if isinstance(value, str | int | float | tuple) else ""
                raise InputError(
                    f"{verb.__name__}: {name} must be {names}, not {type(value).__name__}{shown}"
                )
        return verb(*args, **kwargs)

    return typing.cast(T, checked)


def check_keys(
    values: Any, known: set[str], what: str, *, required: set[str] | None = None
) -> dict[str, Any]:
    """Return a mapping as a dictionary if it has known keys alone, and all that are required.

    Raises:
        InputError: The value is no mapping, or a key is unknown or missing.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{what} must be a mapping of {sorted(known)}, not {str(values)[:40]!r}")
    if unknown := sorted(str(key) for key in values if key not in known):
        raise InputError(f"{what} has unknown keys {unknown}: known are {sorted(known)}")
    if missing := sorted((required or set()) - set(values)):
        raise InputError(f"{what} lacks the keys {missing}")
    return dict(values)
