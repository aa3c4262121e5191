"""Throw bad inputs at the command line, and report tracebacks, hangs and memory.

    python tools/attack.py --count 800

Small results of every verb are made first. Then each case runs the command line in a process of its
own: bad values of options, files that a person wrote badly, damaged files of a run, and streams,
terminals and homes that do not work. A case is fine if the exit status is 0, 2 or 3, a refusal is
one line, and nothing that was damaged is believed. Takes about a second a case. Everything is drawn
from a seed.
"""

import argparse
import collections
import contextlib
import dataclasses
import io
import itertools
import json
import os
import pathlib
import random
import resource
import shlex
import shutil
import signal
import sys
import tempfile
import time
import traceback
import typing
from collections.abc import Callable, Iterator
from typing import Any

import tyro

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from tools.small_results import COARSE, SMALL, STICK, digests, prepare

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


def bad_options(verb: type) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield every option of a verb with each bad value for its type, a list of words.

    The option is its name on the command line; empty for a positional argument.
    """
    hints = typing.get_type_hints(verb)
    marked = typing.get_type_hints(verb, include_extras=True)
    for field in dataclasses.fields(verb):
        is_positional = _POSITIONAL in getattr(marked[field.name], "__metadata__", ())
        flag = "" if is_positional else "--" + field.name.replace("_", "-")
        yield from ((flag, words) for words in _values(field.name, hints))


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
        for flag, words in bad_options(kind):
            # The last of two equal options may count: leave the good one out.
            small = _without(flag, SMALL[verb]) if flag else SMALL[verb][1:]
            if flag != "--out" and "--out" in small and verb not in _KEEPS_OUT:
                small = (*_without("--out", small), "--out", "runs/new")
            given = (flag, *words) if flag else words
            shown = " ".join(word[:20] for word in given)
            yield Case(f"{verb} {shown!r}", "options", (verb, *small, *given))


def _without(flag: str, words: tuple[str, ...]) -> tuple[str, ...]:
    """Return a command line without an option and its values."""
    if flag not in words:
        return words
    start = words.index(flag)
    end = next((k for k in range(start + 1, len(words)) if words[k].startswith("--")), len(words))
    return words[:start] + words[end:]


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


HANG = 120.0
"""A case that computes for longer hangs: its processor time [s]."""
WAIT = 600.0
"""So does one that waits for longer [s]; a busy machine makes any case wait."""
MEMORY_MAX = 2 * 2**30
"""Memory that no case may need [byte]."""
STATUSES = (0, 2, 3)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What came of a case.

    Attributes:
        case: The case.
        status: Exit status; negative the number of the signal that ended it.
        seconds: Processor time that it took [s].
        hung: Whether it was ended because it took too long.
        memory: Largest memory of its process [byte].
        out: Standard output.
        err: Standard error.
    """

    case: Case
    status: int
    seconds: float
    hung: bool
    memory: int
    out: str
    err: str

    @property
    def fault(self) -> str | None:
        """Fault of the command line; None where it behaved."""
        if self.hung:
            return "hang"
        if "Traceback" in self.out + self.err or "Exception ignored" in self.err:
            return "traceback"
        if self.memory > MEMORY_MAX:
            return "memory"
        if self.status not in STATUSES:
            return f"status {self.status}"
        if self.status == 2 and not self.case.quiet:
            lines = [line for line in self.err.splitlines() if line.startswith("cablecast: ")]
            parsed = "full helptext" in self.err
            if len(lines) != 1 and not parsed:
                return f"{len(lines)} lines"
        if self.status == 0 and self.case.must_fail:
            return "believed"
        return None


def run(case: Case, base: pathlib.Path) -> Outcome:
    """Run a case in a process of its own, in a copy of the small results.

    Args:
        case: The case.
        base: Folder of the small results.
    """
    folder = pathlib.Path(tempfile.mkdtemp(prefix="attack-"))
    shutil.copytree(base, folder, dirs_exist_ok=True)
    case.arrange(folder)
    waited, last, hung = 0.0, time.monotonic(), False
    child = os.fork()
    if child == 0:
        status = 70
        with contextlib.suppress(BaseException):
            status = _child(case, folder)
        os._exit(status)
    while True:
        done, raw, usage = os.wait4(child, os.WNOHANG)
        if done:
            break
        if waited > WAIT or _processor_time(child) > HANG:
            hung = True
            os.killpg(child, signal.SIGKILL)
        time.sleep(0.01)
        # A machine that slept, or stopped the attack, made no case slower.
        now = time.monotonic()
        waited, last = waited + min(now - last, 1.0), now
    outcome = Outcome(
        case=case,
        status=os.waitstatus_to_exitcode(raw),
        seconds=usage.ru_utime + usage.ru_stime,
        hung=hung,
        memory=usage.ru_maxrss * 1024,
        out=(folder / ".out").read_text(errors="replace"),
        err=(folder / ".err").read_text(errors="replace"),
    )
    if outcome.status == 0 and case.same_as is not None and not case.must_fail:
        changed = case.same_as(folder, outcome.out)
        if changed:
            outcome = dataclasses.replace(outcome, err=f"{outcome.err}\nTraceback: {changed}")
    shutil.rmtree(folder)
    return outcome


def _processor_time(process: int) -> float:
    """Return the processor time of a running process [s]; 0 where the system does not tell."""
    try:
        fields = pathlib.Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    except (OSError, IndexError):
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _child(case: Case, folder: pathlib.Path) -> int:
    """Run the command line with its streams in files, and return its exit status."""
    from cablecast.cli import main

    os.setsid()
    os.chdir(folder)
    os.environ.update(case.environment)
    for number, name in ((1, ".out"), (2, ".err")):
        handle = os.open(name, os.O_WRONLY | os.O_CREAT)
        os.dup2(handle, number)
        os.close(handle)
    if case.shell:
        os.execv("/bin/sh", ["sh", "-c", case.shell])
    encoding = case.environment.get("PYTHONIOENCODING", "utf-8")
    sys.stdout = io.TextIOWrapper(io.FileIO(1, "wb", closefd=False), encoding)
    sys.stderr = io.TextIOWrapper(io.FileIO(2, "wb", closefd=False), encoding, write_through=True)
    try:
        status = main(list(case.arguments))
        sys.stdout.flush()
        return status
    except SystemExit as error:
        sys.stdout.flush()
        return error.code if isinstance(error.code, int) else 1
    except BaseException:
        traceback.print_exc()
        return 1


def run_all(cases: list[Case], base: pathlib.Path) -> list[Outcome]:
    """Run cases, and print what came of them as it comes.

    Args:
        cases: The cases.
        base: Folder of the small results.
    """
    outcomes = []
    for number, case in enumerate(cases, start=1):
        outcome = run(case, base)
        outcomes.append(outcome)
        if outcome.fault is not None:
            print(f"{outcome.fault}: {case.name}\n  cablecast {' '.join(case.arguments)[:300]!r}")
            print("  " + "\n  ".join(outcome.err.splitlines()[-6:]))
        if number % 50 == 0:
            print(f"{number} of {len(cases)} cases", flush=True)
    return outcomes


def report(outcomes: list[Outcome]) -> str:
    """Return the figures of an attack as text."""
    faults = collections.Counter(outcome.fault for outcome in outcomes if outcome.fault)
    groups = collections.Counter(outcome.case.group for outcome in outcomes)
    statuses = collections.Counter(outcome.status for outcome in outcomes)
    slowest = max(outcomes, key=lambda outcome: outcome.seconds)
    largest = max(outcomes, key=lambda outcome: outcome.memory)
    return "\n".join(
        [
            f"{len(outcomes)} bad inputs: " + ", ".join(f"{n} {g}" for g, n in groups.items()),
            "exit statuses: " + ", ".join(f"{n} of {s}" for s, n in sorted(statuses.items())),
            f"faults: {', '.join(f'{n} {f}' for f, n in faults.items()) or 'none'}",
            f"slowest: {slowest.seconds:.1f} s ({slowest.case.name})",
            f"largest: {largest.memory / 2**20:.0f} MiB ({largest.case.name})",
        ]
    )


@contextlib.contextmanager
def small_results(folder: pathlib.Path | None) -> Iterator[pathlib.Path]:
    """Yield a folder with small results of every verb, made anew unless one is given."""
    if folder is not None and (folder / "runs").is_dir():
        yield folder.resolve()
        return
    made = pathlib.Path(tempfile.mkdtemp(prefix="attack-base-")) if folder is None else folder
    made.mkdir(parents=True, exist_ok=True)
    prepare(made.resolve())
    yield made.resolve()
    if folder is None:
        shutil.rmtree(made)


def main(arguments: list[str] | None = None) -> int:
    """Attack, print the figures, and return 1 if there was a fault."""
    parser = argparse.ArgumentParser(description=__doc__, add_help=True)
    parser.add_argument("--count", type=int, default=800, help="number of bad inputs")
    parser.add_argument("--seed", type=int, default=0, help="seed of the inputs")
    parser.add_argument("--only", default="", help="run the cases whose name holds this text")
    parser.add_argument("--group", help="run the cases of one group: options, files and so on")
    parser.add_argument("--base", type=pathlib.Path, help="folder that keeps the small results")
    options = parser.parse_args(arguments)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with small_results(options.base) as base:
        rng = random.Random(options.seed)
        cases = [
            case
            for case in all_cases(base, rng, options.count, options.only)
            if options.only in case.name and options.group in (None, case.group)
        ]
        # Imported once, before the fork: a case then takes its own time only.
        for module in ("cablecast.pipeline.track_video", "cablecast.cli", "pyarrow.parquet"):
            __import__(module)
        outcomes = run_all(cases, base)
    print(report(outcomes))
    return int(any(outcome.fault for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
