"""Throw bad inputs at the command line, and report tracebacks, hangs and memory.

    python tools/attack.py --count 800

Small results of every verb are made first. Then each case runs the command line in a process of its
own: bad values of options, files that a person wrote badly, damaged files of a run, and streams,
terminals and homes that do not work. A case is fine if the exit status is 0, 2 or 3, a refusal is
one line, and nothing that was damaged is believed. Takes about a second a case.
"""

import argparse
import collections
import contextlib
import dataclasses
import io
import os
import pathlib
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from tools.attack_cases import Case, all_cases
from tools.small_results import prepare

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
