"""EngineWarp against closed forms, as docs/validation.md shows them.

tests/engines/test_warp_validation.py runs the same scenes.
"""

import dataclasses
from collections.abc import Generator
from typing import Literal

from benchmarks.result import ROOT, Table
from benchmarks.validation.case import (
    Case,
    Result,
    Theme,
    make_mujoco,
    make_warp,
    result_tables,
    write_plots,
)
from benchmarks.validation.contact import ROLLING, SLIDING
from benchmarks.validation.motion import DAMPING, FLIGHT, ORDER
from benchmarks.validation.shape import BENDING, HANGING, TWIST
from cablecast.errors import InputError

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
        engine: Name of the engine. Only EngineWarp's results get plots.
        only: Names of cases; all where none is given, and only then are plots written.
    """

    engine: Literal["warp", "mujoco"] = "warp"
    only: tuple[str, ...] = ()


def main(args: Args) -> Generator[Table, None, int]:
    """Yield the outcomes of each case and write the plots; status 1 where one is missed."""
    names = [case.name for case in CASES]
    for name in args.only:
        if name not in names:
            raise InputError(f"no case {name!r}: one of {', '.join(names)}")
    results: list[Result] = []
    for case in CASES:
        if not args.only or case.name in args.only:
            results.append(Result.of(case, MAKERS[args.engine]))
            yield from result_tables(results[-1])
    if args.engine == "warp" and not args.only:
        write_plots(ROOT / "docs", results)
    return 0 if all(result.met for result in results) else 1
