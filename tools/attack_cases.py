"""The cases of `tools/attack.py`: which bad input goes to which verb, and what must come of it."""

import dataclasses
import itertools
import pathlib
import random
import shlex
import sys
from collections.abc import Callable, Iterator
from typing import Any

from tools.attack_inputs import bad_options, bad_yaml, damaged_bytes, damaged_json
from tools.small_results import COARSE, SMALL, STICK, digests


@dataclasses.dataclass(frozen=True)
class Case:
    """One bad input.

    Attributes:
        name: Name for people.
        group: Kind of input.
        arguments: Words after `cablecast`.
        environment: Variables that differ.
        arrange: Prepares the working folder, a copy of the small results.
        same_as: Where a damage may have no consequence: returns what differs from the undamaged
            results, given the folder and the standard output; empty text where nothing.
        shell: Command of a shell to run instead.
        must_fail: Whether the exit status 0 is a fault.
        quiet: Whether no line can be expected, as where there is no standard error.
    """

    name: str
    group: str
    arguments: tuple[str, ...]
    environment: dict[str, str] = dataclasses.field(default_factory=dict)
    arrange: Callable[[pathlib.Path], None] = lambda folder: None
    same_as: Callable[[pathlib.Path, str], str] | None = None
    shell: str = ""
    must_fail: bool = False
    quiet: bool = False


def all_cases(base: pathlib.Path, rng: random.Random, count: int, only: str = "") -> list[Case]:
    """Return bad inputs of every group.

    Args:
        base: Folder of the small results.
        rng: Source of chance.
        count: Number of cases.
        only: Text that the name of an option's case must hold.
    """
    options = [case for case in option_cases() if only in case.name]
    rng.shuffle(options)
    shares = {"options": count // 2, "files": count // 8}
    written = list(itertools.islice(file_cases(rng), shares["files"]))
    streams = list(stream_cases())
    rest = max(count - len(streams) - len(written) - shares["options"], 0)
    damaged = list(itertools.islice(damage_cases(base, rng), rest))
    return [*options[: shares["options"]], *written, *streams, *damaged]


# Getting ready to aim takes a minute: what is asked for again goes on in the same folder.
_KEEPS_OUT = ("aim",)


def option_cases() -> Iterator[Case]:
    """Yield each bad value of each option of each verb."""
    from cablecast.cli import main as _  # noqa: F401
    from cablecast.cli.main import VERBS

    for verb, kind in VERBS.items():
        if verb not in SMALL:
            # The page, which runs until somebody stops it.
            continue
        for option in bad_options(kind):
            for words in option.values:
                small = list(SMALL[verb])
                given = [option.flag, *words] if option.flag else list(words)
                if option.flag in small:
                    # The last of two equal options may count: leave the good one out.
                    place = small.index(option.flag)
                    end = place + 1
                    while end < len(small) and not small[end].startswith("--"):
                        end += 1
                    del small[place:end]
                if not option.flag:
                    small = small[1:]
                if option.flag != "--out" and verb not in _KEEPS_OUT:
                    place = small.index("--out") if "--out" in small else None
                    small = small if place is None else small[:place] + small[place + 2 :]
                    small += ["--out", "runs/new"] if "--out" in SMALL[verb] else []
                shown = " ".join(word[:20] for word in given)
                yield Case(f"{verb} {shown!r}", "options", (verb, *small, *given))


def file_cases(rng: random.Random) -> Iterator[Case]:
    """Yield badly written files of a person, without end."""
    from cablecast.cable import load_cable
    from cablecast.setup import Setup

    params = {"cable": "cable_1", "params": load_cable("cable_1").params.to_dict()}
    goods: list[tuple[str, dict[str, Any], tuple[str, ...]]] = [
        ("cable.yaml", load_cable("cable_1").to_dict(), ("simulate", "--cable")),
        ("lab.yaml", Setup().to_dict(), ("simulate", "--setup")),
        ("params.json", params, ("simulate", "--params")),
        ("lab.yaml", Setup().to_dict(), ("collect", *STICK, "--setup")),
        ("actions.csv", {}, ("repeat", *STICK, "--repeats", "2", "--actions")),
    ]
    small = {
        "simulate": ("--count", "60", *COARSE),
        "collect": ("--count", "2"),
        "repeat": (),
    }
    for number in itertools.count():
        name, values, words = goods[number % len(goods)]
        text = _bad_actions(rng) if name == "actions.csv" else bad_yaml(values, rng)

        def write(folder: pathlib.Path, name: str = name, text: str = text) -> None:
            (folder / name).write_bytes(text.encode("utf-8", "surrogatepass"))

        arguments = (*words, name, *small[words[0]], "--out", "runs/new")
        yield Case(f"{number} {words[0]} {name} {text[:60]!r}", "files", arguments, arrange=write)


def _bad_actions(rng: random.Random) -> str:
    cell = rng.choice(["nan", "inf", "1e308", "", "x", "-40,", '"', "400", "\x00", "١"])
    row = ["-40", "30", "0.6", "50"]
    row[rng.randrange(4)] = cell
    header = rng.choice(["theta1_deg,theta2_deg,r2_m,psi_deg", "\ufefftheta1_deg;r2_m", ""])
    return f"{header}\n{','.join(row)}\n"


def stream_cases() -> Iterator[Case]:
    """Yield streams, terminals, homes and languages that do not work."""
    python = shlex.quote(sys.executable)
    plan = f"{python} -m cablecast plan --model runs/model --target 1 10 --miss-max 1000"
    simulate = f"{python} -m cablecast simulate --count 60 {' '.join(COARSE)} --out runs/new"
    repeat = f"{python} -m cablecast repeat {' '.join(SMALL['repeat'])}"
    select = f"{python} -m cablecast select {' '.join(SMALL['select'])}"
    for command in (plan, simulate, repeat, select):
        for streams in (
            ">&-",
            "2>&-",
            "<&-",
            ">&- 2>&- <&-",
            ">/dev/full",
            "2>/dev/full",
            ">/dev/full 2>&1",
            "| true",
            "2>&1 | head -c 1 >/dev/null",
        ):
            name = f"{command.split()[3]} {streams}"
            yield Case(name, "streams", (), shell=f"{command} {streams}", quiet=True)
        for variables in (
            "LC_ALL=C PYTHONIOENCODING=ascii",
            "LC_ALL=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0",
            "COLUMNS=40",
            "COLUMNS=1",
            "COLUMNS=x",
            "TERM=dumb FORCE_COLOR=1",
            "HOME=/dev/null",
            "HOME=/proc",
            "TMPDIR=/nowhere",
        ):
            name = f"{variables} {command.split()[3]}"
            yield Case(name, "streams", (), shell=f"{variables} {command}")


# What a verb reads: which of its files may be damaged, and which are left out so that it has to
# work on what an earlier run left.
READS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("collect", "runs/tune-data/**/*", ()),
    ("collect", "runs/tune-data/**/*", ("runs/tune-data/data/chunk-000/file-003.parquet",)),
    ("tune", "runs/tune-data/**/*", ("runs/tune",)),
    ("tune", "runs/tune/*", ()),
    ("tune", "runs/tune/*", ("runs/tune/metrics.json",)),
    ("simulate", "runs/tune/params.json", ()),
    ("simulate", "runs/dataset/**/*", ()),
    ("train", "runs/dataset/**/*", ()),
    ("train", "runs/model/*", ()),
    ("train real", "runs/real-data/**/*", ()),
    ("train real", "runs/model/*", ()),
    ("train real", "runs/model-fine-tuning/*", ()),
    ("plan", "runs/model/*", ()),
    ("repeat", "runs/repeat/**/*", ()),
    ("repeat", "runs/repeat/**/*", ("runs/repeat/metrics.json",)),
    ("select", "runs/repeat/*", ()),
    ("select", "runs/select/**/*", ()),
    ("select", "runs/select/**/*", ("runs/select/metrics.json",)),
    ("evaluate", "runs/model/*", ()),
    ("evaluate", "runs/evaluate/**/*", ()),
    ("evaluate", "runs/evaluate/**/*", ("runs/evaluate/metrics.json",)),
)


def damage_cases(base: pathlib.Path, rng: random.Random) -> Iterator[Case]:
    """Yield damaged files of a run with the verb that reads them, without end.

    Args:
        base: Folder of the small results.
        rng: Source of chance.
    """
    good = digests(base)
    for number in itertools.count():
        verb, pattern, without = READS[number % len(READS)]
        files = sorted(file for file in base.glob(pattern) if file.is_file())
        # Files for people alone are many; those that decide something come more often.
        deciding = [file for file in files if file.suffix in (".json", ".parquet", ".npz")]
        file = rng.choice(deciding if deciding and rng.random() < 0.85 else files)
        content = file.read_bytes()
        is_mapping = file.suffix == ".json" and rng.random() < 0.6
        damage = damaged_json if is_mapping else damaged_bytes
        label, bad = damage(content, rng)
        place = str(file.relative_to(base))

        def arrange(
            folder: pathlib.Path,
            place: str = place,
            bad: bytes = bad,
            without: tuple[str, ...] = without,
        ) -> None:
            import shutil

            for name in without:
                if (folder / name).is_dir():
                    shutil.rmtree(folder / name)
                else:
                    (folder / name).unlink()
            if (folder / place).parent.is_dir():
                (folder / place).write_bytes(bad)

        def same(folder: pathlib.Path, out: str, place: str = place) -> str:
            return _difference(good, digests(folder), place)

        words = (verb.split()[0], *SMALL[verb])
        name = f"{number} {verb}: {place} {label}" + " unfinished" * bool(without)
        yield Case(name, "damage", words, arrange=arrange, same_as=same)


def _difference(good: dict[str, str], found: dict[str, str], damaged: str) -> str:
    """Return the files that differ from good ones, beside the damaged one itself."""
    names = sorted(
        name for name in {*good, *found} if name != damaged and good.get(name) != found.get(name)
    )
    return f"results differ: {', '.join(names[:4])}" if names else ""
