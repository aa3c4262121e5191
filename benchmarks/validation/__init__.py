"""EngineWarp against closed forms: `python -m benchmarks validation` writes docs/validation.md.

One file per theme holds the scenes; tests/engines/test_warp_validation.py runs the same ones.
"""

import dataclasses
import pathlib
from typing import Literal

from benchmarks.validation import (
    bending,
    damping,
    flight,
    hanging,
    order,
    rolling,
    sliding,
    twisting,
)
from benchmarks.validation.case import Case, Theme, make_mujoco, make_warp

THEMES = (
    Theme(title="Friction", cases=sliding.CASES),
    Theme(title="Rolling and spinning", cases=rolling.CASES),
    Theme(title="Weight and tension", cases=hanging.CASES),
    Theme(title="Bending", cases=bending.CASES),
    Theme(title="Twist", cases=twisting.CASES),
    Theme(title="Flight and energy", cases=flight.CASES),
    Theme(title="Damping", cases=damping.CASES),
    Theme(title="Order of the method", cases=order.CASES),
)
CASES: tuple[Case, ...] = tuple(case for theme in THEMES for case in theme.cases)

MAKERS = {"warp": make_warp, "mujoco": make_mujoco}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Closed forms against an engine.

    Attributes:
        engine: Name of the engine. Only EngineWarp's results are written to the page.
        only: Names of cases; all where none is given, and only then is the page written.
        docs: Folder that gets validation.md and images/validation.
        json: File that gets the figures, too.
    """

    engine: Literal["warp", "mujoco"] = "warp"
    only: tuple[str, ...] = ()
    docs: pathlib.Path = pathlib.Path("docs")
    json: pathlib.Path | None = None


def main(args: Args) -> int:
    """Run the cases, print their errors, and write the page; status 1 where one is missed."""
    from benchmarks.common import write_json
    from benchmarks.validation import page

    known = [case.name for case in CASES]
    for name in args.only:
        if name not in known:
            print(f"no case {name!r}: one of {', '.join(known)}")
            return 2
    results = {}
    for case in CASES:
        if not args.only or case.name in args.only:
            result = page.Result.of(case, MAKERS[args.engine])
            results[case.name] = result
            print(result, flush=True)
    missed = sum(not result.met for result in results.values())
    print(f"\n{len(results) - missed} of {len(results)} cases are within their tolerance")
    if args.engine == "warp" and not args.only:
        page.write(args.docs, THEMES, results)
        print(f"written: {args.docs / 'validation.md'}")
    write_json(args.json, [result.table() for result in results.values()])
    return 1 if missed else 0
