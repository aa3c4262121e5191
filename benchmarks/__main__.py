"""`python -m benchmarks NAME`: one command for every measurement."""

import importlib
import sys

NAMES = {
    "convergence": "error of the landing by segments and step",
    "order": "order of EngineWarp in time",
    "engines": "rollouts per second of every engine, with the accuracy reached",
    "peers": "EngineWarp beside other simulators: stable step, error, rate",
    "swing": "energy that an undamped swing loses, by the step",
    "stability": "worlds over the search space: none may gain energy and go unmarked",
    "sensitivity": "error of the landing beside the cast's own sensitivity",
    "validation": "closed forms; writes docs/validation.md",
    "figures": "the figure of docs/engine.md",
    "material": "fits with and without damping and curl, on casts",
    "mocap": "motion capture of cables held at both ends, beside published figures",
    "casts": "error at targets against the number of real casts and corrections",
    "preparation": "time from five casts to the first aimed one",
    "scatter": "scatter of equal casts, and what tells it and the error beforehand",
    "uneven": "share of a miss that one correction leaves on uneven friction",
    "sessions": "first tries of a session with and without new fits to all its casts",
    "sampler": "posterior of a fit beside draws of a sampler",
    "page": "latencies, memory and frames of the page of `cablecast view`",
    "cluster": "throughput of a Ray cluster on this machine beside one thread",
    "laboratory": "the virtual laboratory's scatter and difficulty beside the paper's",
}


def main() -> int:
    name = sys.argv[1] if len(sys.argv) > 1 else "--help"
    if name not in NAMES:
        print("usage: python -m benchmarks NAME [options]\n")
        for known, what in NAMES.items():
            print(f"  {known:16}{what}")
        return 0 if name in ("-h", "--help") else 2
    import tyro

    module = importlib.import_module(f"benchmarks.{name}")
    args = tyro.cli(module.Args, prog=f"python -m benchmarks {name}", args=sys.argv[2:])
    return module.main(args) or 0


if __name__ == "__main__":
    sys.exit(main())
