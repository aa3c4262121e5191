"""Bad inputs for the command line: values of options, files that people write, files of a run.

Everything is drawn from a seed. `tools/attack.py` and the tests of damaged files use it.
"""

import dataclasses
import json
import pathlib
import random
import typing
from collections.abc import Iterator
from typing import Any

import tyro

HUGE_COUNTS = ("0", "-1", "1000000000", "1000000000000000", "10000000000000000000000")
BAD_COUNTS = (*HUGE_COUNTS, "nan", "1e3", "0x10", "1.5", "", " 7", "٣", "1_0", "9" * 5000)
BAD_SEEDS = ("-1", "-5000000000", "4294967296", "10000000000000000000000", "nan", "1.0", "", "seed")
BAD_NUMBERS = ("nan", "-nan", "inf", "-inf", "-1", "1e308", "1e400", "-1e-308", "", "1,5", "0x1p3")
BAD_TEXTS = (
    "",
    "[/]",
    "[bold]x",
    "a\nb",
    "x" * 100_000,
    "\x1b[31m",
    "..",
    "/",
    "\udcff",
    "weiß 線",
)
BAD_PATHS = (
    "",
    "nowhere",
    "nowhere/deep/er",
    "/dev/null",
    "/dev/full",
    "/proc/self/mem",
    "/",
    "a_file",
    "a_file/below",
    "foreign",
    "x" * 300,
    "weiß [/]",
    "\udcff",
)
LEAVES: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    1e308,
    10**22,
    "no",
    "",
    "x" * 10_000,
    [],
    [None],
    {},
    {"a": {}},
)


@dataclasses.dataclass(frozen=True)
class Option:
    """One option of a verb, and values that it should not be given.

    Attributes:
        flag: Name on the command line; empty for a positional argument.
        values: Bad values, each a list of words.
    """

    flag: str
    values: tuple[tuple[str, ...], ...]


def bad_options(verb: type) -> Iterator[Option]:
    """Yield every option of a verb with bad values for its type.

    Args:
        verb: Dataclass of the verb, as `cablecast.cli` declares it.
    """
    hints = typing.get_type_hints(verb)
    marked = typing.get_type_hints(verb, include_extras=True)
    for field in dataclasses.fields(verb):
        is_positional = _POSITIONAL in getattr(marked[field.name], "__metadata__", ())
        flag = "" if is_positional else "--" + field.name.replace("_", "-")
        yield Option(flag, tuple(_values(field.name, hints)))


_POSITIONAL = tyro.conf.Positional[str].__metadata__[0]


def _values(name: str, hints: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    hint = hints[name]
    kinds = [kind for kind in (hint, *typing.get_args(hint)) if kind is not type(None)]
    if bool in kinds:
        yield ("maybe",)
    elif int in kinds:
        yield from ((value,) for value in (BAD_SEEDS if name == "seed" else BAD_COUNTS))
    elif float in kinds and tuple not in [typing.get_origin(kind) for kind in kinds]:
        yield from ((value,) for value in BAD_NUMBERS)
    elif any(typing.get_origin(kind) is tuple for kind in kinds) and name != "combinations":
        yield from ((value, "1") for value in BAD_NUMBERS)
        yield from (("1", value) for value in BAD_NUMBERS)
        yield from ((), ("1",))
    elif pathlib.Path in kinds:
        yield from ((value,) for value in BAD_PATHS)
    else:
        yield from ((value,) for value in BAD_TEXTS)
        yield ()


def damaged_bytes(content: bytes, rng: random.Random) -> tuple[str, bytes]:
    """Return some content after an accident, and the name of the accident.

    Args:
        content: Content of any file.
        rng: Source of chance.
    """
    kind = rng.choice(["flip", "flip", "flip", "cut", "cut", "zeros", "twice", "gap", "text"])
    place = rng.randrange(len(content)) if content else 0
    if kind == "flip":
        changed = bytearray(content or b"x")
        changed[place] ^= 1 << rng.randrange(8)
        return f"bit flipped in byte {place}", bytes(changed)
    if kind == "cut":
        return f"cut after {place} bytes", content[:place]
    if kind == "zeros":
        size = rng.choice([1, 16, 512])
        return f"zeros from byte {place}", content[:place] + bytes(size) + content[place + size :]
    if kind == "twice":
        return "twice", content + content
    if kind == "gap":
        return f"byte {place} lost", content[:place] + content[place + 1 :]
    text = rng.choice(["", "[]", "7", "{}", "null", '"x"', "[" * 10**5, '{"a":' * 10**4, "\xff"])
    return f"replaced by {text[:8]!r}", text.encode("latin-1")


def damaged_json(content: bytes, rng: random.Random) -> tuple[str, bytes]:
    """Return JSON of which one value was changed or left out, and the name of the change.

    Args:
        content: JSON text of a mapping.
        rng: Source of chance.
    """
    values = json.loads(content)
    places = list(_places(values))
    owner, key = rng.choice(places)
    if rng.random() < 0.2:
        del owner[key]
        return f"without {key!r}", json.dumps(values).encode()
    old = owner[key]
    near = [old + 1, old * 2 + 1] if type(old) in (int, float) else [not old] * (type(old) is bool)
    owner[key] = rng.choice([*near, *LEAVES])
    text = json.dumps(values)
    return f"{key!r} is {str(owner[key])[:20]!r}, was {str(old)[:20]!r}", text.encode()


def _places(values: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every mapping and list within some values with each of its keys."""
    keys = values if isinstance(values, dict) else range(len(values))
    for key in keys:
        yield values, key
        if isinstance(values[key], (dict, list)):
            yield from _places(values[key])


def bad_yaml(values: dict[str, Any], rng: random.Random) -> str:
    """Return a file that a person might write instead of a good one.

    Args:
        values: Content of a good file.
        rng: Source of chance.
    """
    text = json.dumps(values)
    kind = rng.randrange(6)
    if kind == 0:
        return damaged_bytes(text.encode(), rng)[1].decode("latin-1")
    if kind == 1:
        return rng.choice(BAD_YAML)
    if kind == 2:
        # Tabs, comments and bare words in places where a person puts them.
        return text.replace(",", rng.choice([",\t", ", # x\n", ";", " "]), 1)
    return damaged_json(text.encode(), rng)[1].decode()


BAD_YAML = (
    "",
    "---\n---\n",
    "- 1",
    "name: 2026-01-01\nlength: 0.6",
    "name: null",
    "length: 0.6\nlength: 0.7",
    "a: &a [x, x]\nb: [*a, *a]",
    "!!python/object/apply:os.system ['true']",
    "{" * 3000,
    "cable: cable_1\nworkspace: 7",
    "cable: {name: [bold]}",
    "\ufeffcable: cable_1\n",
    "cable: ../../etc/passwd",
    "arm: {model: ur9}",
    "motion: {v_max: .nan}",
    "motion: {v_max: 1e400}",
    "workspace: {table: [1, 2]}",
)
