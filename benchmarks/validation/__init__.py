"""EngineWarp against closed forms: `python -m benchmarks validation` writes docs/validation.md.

tests/engines/test_warp_validation.py runs the same scenes.
"""

import dataclasses
import pathlib
from typing import Literal

from benchmarks.validation.case import Case, Result, Theme, make_mujoco, make_warp, write
from benchmarks.validation.contact import ROLLING, SLIDING
from benchmarks.validation.motion import DAMPING, FLIGHT, ORDER
from benchmarks.validation.shape import BENDING, HANGING, TWIST

THEMES = (
    Theme(title="Friction", cases=SLIDING),
    Theme(title="Rolling and spinning", cases=ROLLING),
    Theme(title="Weight and tension", cases=HANGING),
    Theme(title="Bending", cases=BENDING),
    Theme(title="Twist", cases=TWIST),
    Theme(title="Flight and energy", cases=FLIGHT),
    Theme(title="Damping", cases=DAMPING),
    Theme(title="Order of the method", cases=ORDER),
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
    """

    engine: Literal["warp", "mujoco"] = "warp"
    only: tuple[str, ...] = ()
    docs: pathlib.Path = pathlib.Path("docs")


def main(args: Args) -> int:
    """Run the cases, print their errors, and write the page; status 1 where one is missed."""
    names = [case.name for case in CASES]
    for name in args.only:
        if name not in names:
            print(f"no case {name!r}: one of {', '.join(names)}")
            return 2
    results = {}
    for case in CASES:
        if not args.only or case.name in args.only:
            result = Result.of(case, MAKERS[args.engine])
            results[case.name] = result
            print(result, flush=True)
    missed = sum(not result.met for result in results.values())
    print(f"\n{len(results) - missed} of {len(results)} cases are within their tolerance")
    if args.engine == "warp" and not args.only:
        write(args.docs, THEMES, results)
        print(f"written: {args.docs / 'validation.md'}")
    return 1 if missed else 0
