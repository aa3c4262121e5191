"""`python -m benchmarks NAME`: one command for every measurement.

Each prints its tables and writes them to a file, with what they were measured on: to
`benchmarks/results` where a page quotes a run with these settings, to `runs/benchmarks` otherwise.
`python -m benchmarks pages` writes the pages anew from the files, as `make results` does;
`python -m benchmarks all --budget HOURS` repeats the runs that pages quote.
"""

import dataclasses
import importlib
import shlex
import subprocess
import sys
import time
import typing
from collections.abc import Callable, Iterable
from typing import Any

from benchmarks.result import FOLDER, OTHER, Result, Table, depends, measured

COMMANDS: dict[str, tuple[str, str]] = {
    "convergence": ("accuracy:convergence", "error of the landing by segments and step"),
    "order": ("accuracy:order", "order of EngineWarp in time"),
    "sensitivity": ("accuracy:sensitivity", "error of the landing by the cast's own sensitivity"),
    "stability": ("energy:stability", "worlds over the search space: none may gain energy"),
    "swing": ("energy:swing", "energy that an undamped swing loses, by the step"),
    "validation": ("validation:main", "closed forms, with plots"),
    "engines": ("engines:main", "rollouts per second and accuracy of every engine"),
    "cosserat": (
        "cosserat:cosserat",
        "another author's tests of rod solvers, with MuJoCo and PyElastica",
    ),
    "mocap": ("mocap:main", "motion capture of cables held at both ends, with published figures"),
    "casts": ("casts:casts", "error at targets by the number of real casts and corrections"),
    "uneven": ("uneven:uneven", "share of a miss that one correction leaves on uneven friction"),
    "waits": ("times:waits", "waits: check, fit, first plan, each try, opening"),
    "processors": (
        "processors:main",
        "landings on older processors, emulated on this one",
    ),
    "cluster": ("times:cluster", "throughput of a Ray cluster on this machine and of one thread"),
    "replay": ("replay:main", "exported cables in other simulators, against measured casts"),
    "laws": ("replay:laws", "exported chain of MuJoCo against EngineWarp, by the effect"),
    "hand": ("hand:main", "fits of made cables that a hand swings: whether their intervals hold"),
    "light": ("light:main", "tracker in flicker, casts of colour, with markers of any hue"),
    "faults": ("faults:main", "faults of robot, camera and cable in every phase"),
    "effects": ("effects:effects", "shift of landings by each effect of the laboratory"),
    "arms": ("arms:arms", "arms of other makers: time of candidates, and hits"),
    "labs": ("labs:labs", "random laboratories: run or refused"),
    "promises": ("promises:promises", "random laboratories: stated chances of a hit, and hits"),
    "resets": ("promises:resets", "random laboratories: whether a reset lays the cable straight"),
    "irp": ("irp:main", "strikes in the air on the benchmark of Iterative Residual Policy"),
    "strike": ("strike:main", "strikes in the air on the strike laboratory, with floors"),
    "arrival": (
        "arrival:main",
        "strikes from a direction: within 5 cm and 10 deg, at 1 m/s, with a known rope",
    ),
    "whip": (
        "whip:main",
        "strikes with a whip: another author's six targets, known whip and unknown",
    ),
    "reproduce": ("reproduction:main", "every experiment of the paper, by `cablecast reproduce`"),
}
"""Module and function of each command, and what it measures."""

QUOTED: dict[str, tuple[str, float]] = {
    "five-casts": ("casts --rigs virtual --counts 5 --methods aim --targets 18 --equal 3", 1.2),
    "other-physics": (
        "casts --rigs strange patchy example --counts 5 --methods aim --cables cable_1 "
        "--targets 18 --equal 3",
        0.5,
    ),
    "labs": ("labs --count 50", 0.3),
    "promises": ("promises", 1.5),
    "resets": ("resets --count 60", 0.6),
    "waits": ("waits --cables cable_1 --targets 3", 0.1),
    "arms": ("arms", 0.1),
    "reproduce": ("reproduce", 3.0),
    "reproduce-pybullet": ("reproduce --quick --cables cable_1 --engine pybullet", 1.0),
    "reproduce-labs": ("reproduce --quick --cables cable_1 --labs 0 1 2", 1.0),
    "uneven": ("uneven", 0.3),
    "replay": ("replay", 0.3),
    "laws": ("laws", 0.1),
    "hand": ("hand", 0.3),
    "effects": ("effects --count 10", 0.3),
    "validation": ("validation", 0.2),
    "faults": ("faults", 1.5),
    "swing": ("swing", 0.01),
    "order": ("order", 0.01),
    "cosserat": ("cosserat", 0.2),
    "stability-materials": ("stability --materials --share 0.02", 0.05),
    "sensitivity": ("sensitivity --count 40", 0.1),
    "convergence-attachments": ("convergence --attachments --count 40", 0.1),
    "convergence": ("convergence", 0.15),
    "stability": ("stability", 0.25),
    "mocap": ("mocap --data DIR --sets 1", 0.2),
    "light": ("light", 0.5),
    "irp": ("irp --goals 25", 1.4),
    "arrival": ("arrival", 0.05),
    "strike": ("strike --targets 34", 1.0),
    "irp-rows": ("irp --rows image noise fit prior impulse --goals 5 --tries 6", 0.5),
    "whip": ("whip", 0.5),
}
"""Command and expected hours on two cores of each run that a page quotes, in order of worth."""

ONCE = ("peers",)
"""Quoted results of code that is not kept: their command starts at the commit that has it."""

UNSAID = ("out", "data", "session", "workers")
"""Settings that change no figure."""


def parse(name: str, words: list[str]) -> tuple[Callable[[Any], Iterable[Table]], Any]:
    """Return the function of a command, and its arguments from the words of a command line."""
    import tyro

    run = getattr(importlib.import_module(module_of(name)), COMMANDS[name][0].split(":")[1])
    kind = typing.get_type_hints(run)["args"]
    return run, tyro.cli(kind, prog=f"python -m benchmarks {name}", args=words)


def module_of(command: str) -> str:
    """Return the name of the module of a command."""
    return f"benchmarks.{COMMANDS[command][0].split(':')[0]}"


def settings_of(args: Any) -> dict[str, Any]:
    """Return the settings that decide a result."""
    return {key: value for key, value in dataclasses.asdict(args).items() if key not in UNSAID}


def quoted_as(command: str, args: Any) -> str | None:
    """Return the name of the quoted run with these settings; None if no page quotes it."""
    for name, (line, _) in QUOTED.items():
        first, *words = shlex.split(line)
        if first == command and settings_of(parse(first, words)[1]) == settings_of(args):
            return name
    return None


def run_command(command: str, words: list[str]) -> int:
    """Run a benchmark and write its result."""
    run, args = parse(command, words)
    quoted = quoted_as(command, args)
    line = QUOTED[quoted][0] if quoted else shlex.join([command, *words])
    kept = getattr(args, "out", None)
    resumes = kept is not None and kept.is_dir() and any(kept.iterdir())
    result, status = measured(
        run(args),
        name=quoted or command,
        command=f"python -m benchmarks {line}",
        settings=settings_of(args),
        code=depends(module_of(command)),
    )
    if resumes:
        # An earlier call did a part of the work.
        result = dataclasses.replace(result, seconds=None)
    path = result.write(FOLDER if quoted else OTHER)
    print(f"\n{path}", *(["make results writes it into the pages"] if quoted else []), sep="\n")
    return status


@dataclasses.dataclass(frozen=True, kw_only=True)
class AllArgs:
    """Repeat the runs that pages quote, those of most worth first, the latest ones last.

    Attributes:
        budget: Time for all of them [h].
        stale: Leave out those whose code has not changed since.
    """

    budget: float
    stale: bool = True


def run_all(args: AllArgs) -> int:
    """Repeat the runs that fit into the budget, each in a process of its own."""
    end, status = time.monotonic() + 3600.0 * args.budget, 0
    for name, (line, hours) in QUOTED.items():
        stored = stored_result(name)
        if args.stale and stored is not None and not stored.changed():
            print(f"{name}: up to date")
            continue
        if stored is not None and stored.seconds is not None:
            hours = stored.seconds / 3600.0
        left = (end - time.monotonic()) / 3600.0
        if hours > left:
            print(f"{name}: takes about {hours:.2g} h, and {left:.2g} h are left")
            continue
        print(f"{name}: python -m benchmarks {line}", flush=True)
        done = subprocess.run([sys.executable, "-m", "benchmarks", *shlex.split(line)])
        status = status or done.returncode
    return status


def stored_result(name: str) -> Result | None:
    """Return a result that pages quote; None where it is still to be measured."""
    path = FOLDER / f"{name}.json"
    return Result.read(path) if path.is_file() else None


def main() -> int:
    name, words = (sys.argv[1], sys.argv[2:]) if len(sys.argv) > 1 else ("--help", [])
    if name == "pages":
        from benchmarks.pages import write_pages

        return write_pages()
    if name == "all":
        import tyro

        return run_all(tyro.cli(AllArgs, prog="python -m benchmarks all", args=words))
    if name not in COMMANDS:
        print("usage: python -m benchmarks NAME [options]\n")
        for command, (_, what) in COMMANDS.items():
            print(f"  {command:13}{what}")
        print("\n  all          repeat the runs that pages quote, within --budget hours")
        print("  pages        write the pages from the results, as `make results` does")
        return 0 if name in ("-h", "--help") else 2
    return run_command(name, words)


if __name__ == "__main__":
    sys.exit(main())
