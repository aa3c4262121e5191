"""Throw bad inputs at the command line, kill it at any moment, and report what it does wrong.

    python tools/attack.py inputs --count 800
    python tools/attack.py kills --count 200
    python tools/attack.py kills --count 200 --interrupt

Small results of every verb are made first. Everything is drawn from a seed.

inputs: each case runs the command line in a process of its own: bad values of options, files that a
person wrote badly, damaged files of a run, and streams, terminals and homes that do not work. A
case is fine if the exit status is 0, 2 or 3, a refusal is one line, and nothing that was damaged is
believed. Takes about a second a case.

kills: each verb runs undisturbed. Then it runs again in a copy of the same folder, is killed (`kill
-9`) at a moment drawn evenly from the time that it took, is started anew, and so on up to four
times; then it may finish. Its results must be those of the undisturbed run, file by file, and
nothing else may lie in the folder. Each verb is killed at least once and gets about as much time as
any other. Takes about half an hour on two cores. With `--interrupt` it is stopped as by Ctrl-C, and
must also end with the sentence that says what the same command does.
"""

import argparse
import collections
import contextlib
import dataclasses
import importlib
import io
import itertools
import json
import os
import pathlib
import pkgutil
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

from cablecast.cli.main import EXIT_INTERRUPTED


def in_child(
    folder: pathlib.Path,
    streams: tuple[pathlib.Path, pathlib.Path],
    work: Callable[[], int],
    watch: Callable[[int], None],
) -> tuple[int, resource.struct_rusage]:
    """Do some work in a process of its own.

    Args:
        folder: Working folder.
        streams: Files for standard output and standard error.
        work: Work, which returns an exit status.
        watch: Called with the number of the process again and again while it runs.

    Returns:
        Exit status, negative the number of the signal that ended it, and what the process used.
    """
    child = os.fork()
    if child == 0:
        status = 70
        with contextlib.suppress(BaseException):
            os.setsid()
            os.chdir(folder)
            for number, file in enumerate(streams, start=1):
                handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
                os.dup2(handle, number)
                os.close(handle)
            signal.signal(signal.SIGINT, signal.default_int_handler)
            try:
                status = work()
            except SystemExit as error:
                status = error.code if isinstance(error.code, int) else 1
            except BaseException:
                traceback.print_exc()
                status = 1
            sys.stdout.flush()
        os._exit(status)
    while True:
        done, raw, usage = os.wait4(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(raw), usage
        watch(child)
        time.sleep(0.002)


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
        arrange: Prepares the working folder, a copy of the small results.
        damaged: Name of a damaged file, if there is one: the command refuses it, or the results are
            those of the undamaged one.
        shell: Command of a shell to run instead.
        quiet: Whether no line can be expected, as where there is no standard error.
    """

    name: str
    group: str
    arguments: tuple[str, ...]
    arrange: Callable[[pathlib.Path], None] = lambda folder: None
    damaged: str = ""
    shell: str = ""
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

        words = (verb.split()[0], *SMALL[verb])
        name = f"{number} {verb}: {place} {label}" + " unfinished" * bool(without)
        yield Case(name, "damage", words, arrange=arrange, damaged=place)


def differing(good: dict[str, str], found: dict[str, str]) -> set[str]:
    """Return the names of the files whose digests differ, or which only one of both has."""
    return {name for name in {*good, *found} if good.get(name) != found.get(name)}


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
        differing: Results that differ from those of an undamaged file.
    """

    case: Case
    status: int
    seconds: float
    hung: bool
    memory: int
    out: str
    err: str
    differing: list[str]

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
        if self.differing:
            return "other results"
        return None


def run_case(case: Case, base: pathlib.Path, good: dict[str, str]) -> Outcome:
    """Run a case in a process of its own, in a copy of the small results.

    Args:
        case: The case.
        base: Folder of the small results.
        good: Digests of these.
    """
    waited, last, hung = 0.0, time.monotonic(), False

    def watch(child: int) -> None:
        nonlocal waited, last, hung
        if waited > WAIT or _processor_time(child) > HANG:
            hung = True
            os.killpg(child, signal.SIGKILL)
        # A machine that slept, or stopped the attack, made no case slower.
        now = time.monotonic()
        waited, last = waited + min(now - last, 1.0), now

    with copied(base) as folder:
        case.arrange(folder)
        streams = folder.parent / "out", folder.parent / "err"
        status, usage = in_child(folder, streams, lambda: _command(case), watch)
        believed = status == 0 and case.damaged
        return Outcome(
            case=case,
            status=status,
            seconds=usage.ru_utime + usage.ru_stime,
            hung=hung,
            memory=usage.ru_maxrss * 1024,
            out=streams[0].read_text(errors="replace"),
            err=streams[1].read_text(errors="replace"),
            differing=sorted(differing(good, digests(folder)) - {case.damaged}) if believed else [],
        )


def _command(case: Case) -> int:
    """Run the command line of a case, and return its exit status."""
    from cablecast.cli import main

    if case.shell:
        os.execv("/bin/sh", ["sh", "-c", case.shell])
    sys.stdout = io.TextIOWrapper(io.FileIO(1, "wb", closefd=False), "utf-8")
    sys.stderr = io.TextIOWrapper(io.FileIO(2, "wb", closefd=False), "utf-8", write_through=True)
    return main(list(case.arguments))


def _processor_time(process: int) -> float:
    """Return the processor time of a running process [s]; 0 where the system does not tell."""
    try:
        fields = pathlib.Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    except (OSError, IndexError):
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run_all(cases: list[Case], base: pathlib.Path) -> list[Outcome]:
    """Run cases, and print what came of them as it comes.

    Args:
        cases: The cases.
        base: Folder of the small results.
    """
    outcomes, good = [], digests(base)
    for number, case in enumerate(cases, start=1):
        outcome = run_case(case, base, good)
        outcomes.append(outcome)
        if outcome.fault is not None:
            print(f"{outcome.fault}: {case.name}\n  cablecast {' '.join(case.arguments)[:300]!r}")
            print("  " + "\n  ".join([*outcome.err.splitlines()[-6:], *outcome.differing[:4]]))
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


KILLS_MAX = 4
"""Largest number of kills before a verb may finish."""
CALM = 600.0
"""Time in which a verb that is not killed must end [s]."""
BEGIN_TIME = 0.3
"""Time in which a verb has read its words [s]."""

LAB = """
arm: {model: ur5, measured: true}
"""


@dataclasses.dataclass(frozen=True)
class Job:
    """A verb that is killed.

    Attributes:
        name: Name for people.
        arguments: Words after `cablecast`; empty for the reproduction on a tiny budget.
        result: File or folder that it writes.
    """

    name: str
    arguments: tuple[str, ...]
    result: str


def jobs() -> list[Job]:
    """Return each verb on a budget of seconds."""
    found = [
        Job(name, (name.split()[0], *words), words[words.index("--out") + 1])
        for name, words in SMALL.items()
        if name not in ("plan", "track", "reproduce")
    ]
    virtual = ("--rig", "virtual", "--count", "6", "--out", "runs/virtual")
    motion = ("--setup", "lab.yaml", "--miss-max", "1000", "--save", "motion.csv", "--force")
    film = ("film.mp4", "--tags", "tags.yaml", "--out", "runs/track")
    return [
        *found,
        Job("collect virtual", ("collect", *virtual), "runs/virtual"),
        Job("plan", ("plan", *SMALL["plan"], *motion), "motion.csv"),
        Job("track", ("track", *film), "runs/track"),
        Job("reproduce", (), "runs/reproduce"),
    ]


def make_film(folder: pathlib.Path) -> None:
    """Write a video of a short made-up motion, film.mp4, and the places of its tags, tags.yaml.

    Args:
        folder: Folder of the two files.
    """
    import numpy as np
    from tools.fit_camera_error import clip_trial

    from cablecast.rigs.virtual.camera import VirtualCamera
    from cablecast.vision.video import write_video

    film = VirtualCamera().film(clip_trial(np.random.default_rng(6), 0), seed=6)
    write_video(folder / "film.mp4", (film.frame(i) for i in range(film.frame_count)), 60.0)
    film.camera.layout.save(folder / "tags.yaml")


def run_job(job: Job) -> int:
    """Run a verb in the working folder, and return its exit status."""
    from cablecast.cli import main

    if job.arguments:
        return main(list(job.arguments))
    from cablecast.pipeline.reproduce import Budget, reproduce

    budget = Budget(
        cables=("cable_1", "cable_2"),
        tune_casts=4,
        more_casts=1,
        validation_casts=1,
        real_trials=24,
        grid=3,
        grid_psi=2,
        generations=2,
        repeat_actions=2,
        repeat_casts=2,
        casts=120,
        epochs=2,
        candidates=200,
        repeats=1,
    )
    reproduce("runs/reproduce", budget=budget, rig="stick_of_the_attack:make")
    return 0


def run(
    job: Job,
    folder: pathlib.Path,
    killed_after: float | None = None,
    number: signal.Signals = signal.SIGKILL,
) -> int:
    """Run a verb in a process of its own.

    Args:
        job: The verb.
        folder: Working folder.
        killed_after: Time after which it is killed, if it still runs [s].
        number: Signal that kills it.

    Returns:
        Exit status; negative the number of the signal that ended it.
    """
    end = time.monotonic() + (CALM if killed_after is None else killed_after)
    output = folder.parent / "output.txt"
    output.write_text("")

    def watch(child: int) -> None:
        nonlocal end
        if time.monotonic() >= end:
            os.kill(child, number)
            end = float("inf")

    return in_child(folder, (output, output), lambda: run_job(job), watch)[0]


def contents(folder: pathlib.Path, job: Job) -> tuple[dict[str, str], set[str]]:
    """Return a digest of each result that decides something, and the names of all files."""
    found = digests(folder, job.result) | digests(folder, f"{job.result}/**/*")
    names = {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}
    return found, {name for name in names if "__pycache__" not in name}


def kill_again_and_again(
    job: Job,
    base: pathlib.Path,
    good: tuple[dict[str, str], set[str]],
    took: float,
    rng: random.Random,
    number: signal.Signals,
) -> tuple[int, str]:
    """Kill a verb up to some times, let it finish, and compare.

    Args:
        job: The verb.
        base: Folder in which it has not run yet.
        good: Contents of the folder after an undisturbed run.
        took: Time of the undisturbed run [s].
        rng: Source of the moments.
        number: Signal that kills it.

    Returns:
        Number of kills, and what differs from the undisturbed results; empty text for nothing.
    """
    with copied(base) as folder:
        kills = 0
        for _ in range(rng.randint(1, KILLS_MAX)):
            # Before it has begun, nothing says more than Python does.
            soonest = 0.0 if number == signal.SIGKILL else BEGIN_TIME
            status = run(job, folder, rng.uniform(soonest, max(took, 2 * soonest)), number)
            if status == -signal.SIGKILL:
                kills += 1
            elif status == EXIT_INTERRUPTED and number == signal.SIGINT:
                kills += 1
                if "cablecast: interrupted. " not in last_line(folder):
                    return kills, f"it ends with {last_line(folder)!r}"
            elif status:
                return kills, f"status {status}: {last_line(folder)}"
            if contents(folder, job) == good:
                # The work was done before the kill; not every verb may be asked twice.
                return kills, ""
        if status := run(job, folder):
            return kills, f"status {status}: {last_line(folder)}"
        digest, names = contents(folder, job)
        return kills, ", ".join(sorted(differing(good[0], digest) | (names ^ good[1])))


@contextlib.contextmanager
def copied(base: pathlib.Path) -> Iterator[pathlib.Path]:
    """Yield a copy of a folder, which is deleted afterwards."""
    with tempfile.TemporaryDirectory(prefix="attack-") as temporary:
        folder = pathlib.Path(temporary) / "copy"
        shutil.copytree(base, folder)
        yield folder


def last_line(folder: pathlib.Path) -> str:
    """Return the last line that a verb printed."""
    lines = (folder.parent / "output.txt").read_text(errors="replace").splitlines()
    return lines[-1] if lines else ""


def undisturbed(job: Job, base: pathlib.Path) -> tuple[tuple[dict[str, str], set[str]], float]:
    """Return what a verb leaves when nobody kills it, and the time that it takes [s]."""
    with copied(base) as folder:
        begun = time.monotonic()
        if status := run(job, folder):
            raise SystemExit(f"{job.name} failed with status {status}: {last_line(folder)}")
        return contents(folder, job), time.monotonic() - begun


@contextlib.contextmanager
def small_results(kept: pathlib.Path | None) -> Iterator[pathlib.Path]:
    """Yield a folder with small results of every verb, made anew unless it is kept from before."""
    with tempfile.TemporaryDirectory(prefix="attack-base-") as temporary:
        base = kept.resolve() if kept is not None else pathlib.Path(temporary) / "prepared"
        if not (base / "tags.yaml").exists():
            base.mkdir(parents=True, exist_ok=True)
            files = pathlib.Path(temporary) / "out", pathlib.Path(temporary) / "err"
            # In a process of its own: the threads that it starts would not survive a fork.
            if in_child(base, files, lambda: _prepare(base), lambda _: None)[0]:
                reason = files[1].read_text(errors="replace")[-1000:]
                raise SystemExit(f"the small results cannot be made: {reason}")
        yield base


def _prepare(base: pathlib.Path) -> int:
    prepare(base)
    (base / "lab.yaml").write_text(LAB)
    make_film(base)
    return 0


def import_all() -> None:
    """Import what any verb imports, so that a run that is forked off takes its own time only."""
    import cablecast

    for module in pkgutil.walk_packages(cablecast.__path__, "cablecast."):
        # The command line as a script, and what needs an extra that is missing.
        if not module.name.endswith("__main__"):
            with contextlib.suppress(ImportError):
                importlib.import_module(module.name)
    for name in (
        *("pyarrow.parquet", "scipy.optimize", "scipy.spatial", "torch", "safetensors.torch"),
        *("matplotlib.figure", "shapely", "jinja2", "warp", "mujoco", "cv2", "rich.progress"),
    ):
        importlib.import_module(name)


def without_results(base: pathlib.Path, place: pathlib.Path, job: Job) -> pathlib.Path:
    """Return a copy of the small results without those of a verb, in a folder at a place."""
    folder = place / job.name.replace(" ", "-")
    shutil.copytree(base, folder)
    shutil.rmtree(folder / job.result, ignore_errors=True)
    return folder


def throw_inputs(options: argparse.Namespace, base: pathlib.Path) -> bool:
    """Run bad inputs, print the figures, and return whether there was a fault."""
    rng = random.Random(options.seed)
    cases = [
        case
        for case in all_cases(base, rng, options.count, options.only)
        if options.only in case.name and options.group in (None, case.group)
    ]
    outcomes = run_all(cases, base)
    print(report(outcomes))
    return any(outcome.fault for outcome in outcomes)


def kill_verbs(options: argparse.Namespace, base: pathlib.Path) -> bool:
    """Kill verbs, print the figures, and return whether a result differed."""
    rng = random.Random(options.seed)
    number = signal.SIGINT if options.interrupt else signal.SIGKILL
    # The reproduction is not called by its verb here.
    chosen = [
        j for j in jobs() if options.only in j.name and (j.arguments or not options.interrupt)
    ]
    kills, runs = collections.Counter[str](), collections.Counter[str]()
    spent = {job.name: 0.0 for job in chosen}
    faults = 0
    with tempfile.TemporaryDirectory(prefix="kills-") as temporary:
        before = {job.name: without_results(base, pathlib.Path(temporary), job) for job in chosen}
        good = {job.name: undisturbed(job, before[job.name]) for job in chosen}
        chosen.sort(key=lambda job: good[job.name][1])
        while sum(kills.values()) < options.count or not all(spent.values()):
            # The quick ones come first, and each gets about as much time as any other.
            job = min(chosen, key=lambda job: spent[job.name])
            begun, (wanted, took) = time.monotonic(), good[job.name]
            count, fault = kill_again_and_again(job, before[job.name], wanted, took, rng, number)
            spent[job.name] += time.monotonic() - begun
            kills[job.name] += count
            runs[job.name] += 1
            if fault:
                faults += 1
                print(f"{job.name} differs after {count} kills: {fault[:500]}")
            print(f"{sum(kills.values())} kills, the last in {job.name}", flush=True)
    for name in kills:
        print(f"{name}: {kills[name]} kills in {runs[name]} runs of {good[name][1]:.1f} s")
    print(
        f"{sum(kills.values())} kills in {sum(runs.values())} runs of {len(kills)} verbs: "
        f"{faults or 'no'} run{'s' * (faults != 1)} finished with other results"
    )
    return faults > 0


def main(arguments: list[str] | None = None) -> int:
    """Attack, print the figures, and return 1 if there was a fault."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("what", choices=("inputs", "kills"))
    parser.add_argument("--count", type=int, help="number of bad inputs (800) or of kills (200)")
    parser.add_argument("--seed", type=int, default=0, help="seed of inputs and moments")
    parser.add_argument("--only", default="", help="cases or verbs whose name holds this text")
    parser.add_argument("--group", help="inputs of one group: options, files and so on")
    parser.add_argument("--interrupt", action="store_true", help="stop verbs as by Ctrl-C")
    parser.add_argument("--base", type=pathlib.Path, help="folder that keeps the small results")
    options = parser.parse_args(arguments)
    options.count = options.count or {"inputs": 800, "kills": 200}[options.what]
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with small_results(options.base) as base:
        import_all()
        return int({"inputs": throw_inputs, "kills": kill_verbs}[options.what](options, base))


if __name__ == "__main__":
    sys.exit(main())
