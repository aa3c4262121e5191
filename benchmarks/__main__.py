"""`python -m benchmarks NAME`: one command for every measurement."""

import importlib
import sys
import typing
from collections.abc import Callable
from typing import Any

COMMANDS = {
    "convergence": ("accuracy:convergence", "error of the landing by segments and step"),
    "order": ("accuracy:order", "order of EngineWarp in time"),
    "sensitivity": ("accuracy:sensitivity", "error of the landing by the cast's own sensitivity"),
    "stability": (
        "energy:stability",
        "worlds over the search space: none may gain energy",
    ),
    "swing": ("energy:swing", "energy that an undamped swing loses, by the step"),
    "validation": ("validation:main", "closed forms; writes docs/validation.md"),
    "engines": ("engines:main", "rollouts per second and accuracy of every engine"),
    "peers": ("peers:main", "EngineWarp and other simulators: stable step, error, rate"),
    "mocap": ("mocap:main", "motion capture of cables held at both ends, with published figures"),
    "material": ("fits:material", "fits with and without damping and curl, on casts"),
    "sampler": ("fits:sampler", "posterior of a fit and draws of a sampler"),
    "casts": ("casts:casts", "error at targets by the number of real casts and corrections"),
    "sessions": ("casts:sessions", "first tries of a session with and without new fits"),
    "scatter": ("scatter:scatter", "scatter of equal casts, and what predicts it and the error"),
    "uneven": ("scatter:uneven", "share of a miss that one correction leaves on uneven friction"),
    "preparation": ("times:preparation", "time from five casts to the first aimed one"),
    "cluster": ("times:cluster", "throughput of a Ray cluster on this machine and of one thread"),
    "page": ("page:main", "latencies, memory and frames of the page of `cablecast view`"),
    "light": ("light:main", "tracker in flicker, casts of colour, and with markers of any hue"),
    "effects": ("effects:effects", "shift of landings by each effect of the virtual rig"),
    "laboratory": ("laboratory:main", "scatter and difficulty of the virtual rig and of the paper"),
}
"""Module and function of each command, and what it measures."""


def parse(name: str, words: list[str]) -> tuple[Callable[[Any], int | None], Any]:
    """Return the function of a command, and its arguments from the words of a command line."""
    import tyro

    module, function = COMMANDS[name][0].split(":")
    run = getattr(importlib.import_module(f"benchmarks.{module}"), function)
    kind = typing.get_type_hints(run)["args"]
    return run, tyro.cli(kind, prog=f"python -m benchmarks {name}", args=words)


def main() -> int:
    name = sys.argv[1] if len(sys.argv) > 1 else "--help"
    if name not in COMMANDS:
        print("usage: python -m benchmarks NAME [options]\n")
        for command, (_, what) in COMMANDS.items():
            print(f"  {command:13}{what}")
        return 0 if name in ("-h", "--help") else 2
    run, args = parse(name, sys.argv[2:])
    return run(args) or 0


if __name__ == "__main__":
    sys.exit(main())
