"""Write docs/validation.md and its plots from the results of the cases."""

import dataclasses
import pathlib
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.common import Table
from benchmarks.validation.case import Case, Convergence, MakeEngine, Measured, Theme
from cablecast import files
from cablecast.cable import PAPER_PARAMS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COMMAND = "python -m benchmarks validation"
IMAGES = pathlib.PurePosixPath("images/validation")
COLUMNS = ("quantity", "unit", "closed form", "engine", "error", "tolerance")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Result:
    """Results of a case with one engine."""

    case: Case
    measured: Measured
    convergence: Convergence | None

    @classmethod
    def of(cls, case: Case, make: MakeEngine) -> "Result":
        """Run a case and its ladder."""
        return cls(case=case, measured=case.run(make), convergence=case.convergence(make))

    @property
    def met(self) -> bool:
        """True where every outcome is within the tolerance."""
        return all(outcome.error <= self.case.tolerance for outcome in self.measured.outcomes)

    def table(self) -> Table:
        """Return the outcomes as a table."""
        rows = [
            (
                outcome.quantity,
                outcome.unit,
                _number(outcome.exact),
                _number(outcome.computed),
                f"{outcome.error:.1e}",
                f"{self.case.tolerance:g}",
            )
            for outcome in self.measured.outcomes
        ]
        return Table(self.case.title, COLUMNS, rows)

    def __str__(self) -> str:
        mark = "" if self.met else "\n**missed**"
        return f"{self.table()}\n{slope_sentence(self.convergence)}{mark}"


def _number(value: float) -> str:
    return "0" if abs(value) < 5e-13 else f"{value:.5g}"


def slope_sentence(convergence: Convergence | None) -> str:
    """Return the convergence of the first outcome in words."""
    if convergence is None:
        return ""
    rungs = []
    for (count, dt), error in zip(convergence.ladder, convergence.errors, strict=True):
        size = f"{dt * 1e3:g} ms" if convergence.in_time else f"{count} segments"
        rungs.append(f"{error:.1e} at {size}")
    what = "step" if convergence.in_time else "segment"
    return (
        f"Convergence of the first row: {', '.join(rungs)}; slope {convergence.slope:.2f} in the "
        f"{what}."
    )


def plot(result: Result) -> bytes:
    """Return the plot of a case as a PNG file: closed forms as lines, the engine as points."""
    from cablecast.report import style

    figure = style.new_figure(5.2, 2.9)
    with style.styled():
        axes: Axes = figure.subplots()
        colors = (style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE)
        for color, curve in zip(colors, result.measured.curves, strict=False):
            axes.plot(curve.x, curve.exact, color=color, linewidth=1.2, alpha=0.6)
            many = len(curve.x_computed) > 70
            axes.plot(
                curve.x_computed,
                curve.computed,
                linestyle="none",
                marker="o",
                markersize=1.8 if many else 3.2,
                color=color,
                label=curve.label or None,
            )
        axes.set_xlabel(result.case.x_label)
        axes.set_ylabel(result.case.y_label)
        if result.case.name.startswith("order_"):
            axes.set_xscale("log")
            axes.set_yscale("log")
        if result.case.equal:
            axes.set_aspect("equal")
        if any(curve.label for curve in result.measured.curves):
            axes.legend(loc="best")
    return style.compact_png(figure, 110)


def parameter_table(themes: tuple[Theme, ...]) -> Table:
    """Return a table of the cases that each parameter decides."""
    rows = []
    for name in PAPER_PARAMS:
        cases = [c for theme in themes for c in theme.cases if name in c.parameters]
        links = ", ".join(f"[{case.title}](#{anchor(case.title)})" for case in cases)
        rows.append((f"`{name}`", links))
    return Table("", ("parameter", "decides"), rows)


def anchor(title: str) -> str:
    """Return the anchor that a heading gets on the usual forges."""
    kept = "".join(c for c in title.lower() if c.isalnum() or c in " -_")
    return kept.replace(" ", "-")


def section(result: Result) -> str:
    """Return heading, theory, plot, table, tolerance and slope of a case."""
    case = result.case
    parts = [
        f"### {case.title}",
        case.theory,
        f"![{case.title}]({IMAGES / case.name}.png)",
        str(result.table()).split("\n\n", 1)[1].strip(),
        f"At {case.segment_count} segments and {case.dt * 1e3:g} ms. Tolerance "
        f"{case.tolerance:g}: {case.reason}. {slope_sentence(result.convergence)}".strip(),
    ]
    if not result.met:
        parts.append("**This case is outside its tolerance.**")
    return "\n\n".join(parts)


def write(docs: pathlib.Path, themes: tuple[Theme, ...], results: dict[str, Result]) -> None:
    """Write the page and its plots."""
    met = sum(result.met for result in results.values())
    errors = [outcome.error for r in results.values() for outcome in r.measured.outcomes]
    parts = [
        "# Validation",
        f"<!-- Written by `{COMMAND}`; changes made by hand are lost. -->",
        "Scenes whose outcome is known without a simulator, and what `EngineWarp` makes of them in "
        "double precision. Lines in the plots are closed forms, points are the engine. Errors are "
        "relative to the closed form, or to the size that stands in the name of the quantity; "
        f"positions are relative to the length of the cable. `{COMMAND}` repeats everything and "
        "writes this page; `tests/engines/test_warp_validation.py` holds the engine to the same "
        "tolerances.",
        f"{met} of {len(results)} cases are within their tolerance; the median error of all "
        f"{len(errors)} quantities is {np.median(errors):.1e}.",
        "Each parameter decides the outcome of at least one case:",
        str(parameter_table(themes)).strip(),
    ]
    for theme in themes:
        parts.append(f"## {theme.title}")
        parts += [section(results[case.name]) for case in theme.cases]
    images = docs / IMAGES
    images.mkdir(parents=True, exist_ok=True)
    for result in results.values():
        files.write_bytes(images / f"{result.case.name}.png", plot(result))
    files.write_text(docs / "validation.md", "\n\n".join(parts) + "\n")
