"""Validation cases: scenes with a known outcome, an engine's results, and the page about them."""

import dataclasses
import pathlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.result import Table
from cablecast import files
from cablecast.cable import PAPER_PARAMS
from cablecast.engines.base import GRAVITY, Engine


class MakeEngine(Protocol):
    """Builds the engine under test at a resolution."""

    def __call__(self, segment_count: int, dt: float, gravity: float = GRAVITY) -> Engine: ...


def make_warp(segment_count: int, dt: float, gravity: float = GRAVITY) -> Engine:
    """Make an EngineWarp in double precision that computes every world to the end."""
    from cablecast.engines.warp_ import EngineWarp

    return EngineWarp(
        segment_count=segment_count, dt=dt, precision="double", rest_speed=0.0, gravity=gravity
    )


def make_mujoco(segment_count: int, dt: float, gravity: float = GRAVITY) -> Engine:
    """Make MuJoCo's rod, with rolling."""
    from cablecast.engines.mujoco_ import EngineMujoco

    return EngineMujoco(segment_count, dt, gravity=gravity)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """One number and its closed form.

    Attributes:
        quantity: Name of the quantity.
        unit: Unit, "-" for none.
        exact: Value by the closed form.
        computed: Value by the engine.
        scale: Value that the error is relative to; the exact value where None.
    """

    quantity: str
    unit: str
    exact: float
    computed: float
    scale: float | None = None

    @property
    def error(self) -> float:
        """Relative error [-]; infinite where the engine gave no number."""
        scale = abs(self.exact) if self.scale is None else self.scale
        error = abs(self.computed - self.exact) / scale
        return float(error) if np.isfinite(error) else float("inf")


@dataclasses.dataclass(frozen=True)
class Curve:
    """Curve in the plot of a case: the closed form as a line, the engine as points.

    Attributes:
        x: Abscissa of the closed form.
        exact: Values of the closed form.
        x_computed: Abscissa of the engine.
        computed: Values of the engine.
        label: Name among the curves of the case; empty if there is only one.
    """

    x: NDArray[np.float64]
    exact: NDArray[np.float64]
    x_computed: NDArray[np.float64]
    computed: NDArray[np.float64]
    label: str = ""


Measured = Iterator[Outcome | Curve]
"""Results of a scene at one resolution, its curves drawn in this order."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Case:
    """A scene with a known outcome.

    Attributes:
        name: Name of its plot and its test.
        title: Heading.
        theory: Closed form and the scene that poses it, in Markdown.
        parameters: Names of the cable's parameters that decide the outcome.
        tolerance: Largest relative error of any outcome [-].
        reason: Reason that the tolerance is not smaller.
        measure: Runs the scene on the engine that is made, with a number of segments and a step.
        segment_count: Number of segments at which the tolerance holds.
        dt: Step at which it holds [s].
        ladder: Resolutions (segments, step [s]) over which the error's slope is measured; either
            the segments change or the step.
        x_label: Label of the plot's abscissa.
        y_label: Label of its ordinate.
        equal: True where both axes of the plot have the same scale.
    """

    name: str
    title: str
    theory: str
    parameters: tuple[str, ...] = ()
    tolerance: float
    reason: str
    measure: Callable[[MakeEngine, int, float], Measured]
    segment_count: int = 40
    dt: float = 5e-4
    ladder: tuple[tuple[int, float], ...] = ()
    x_label: str
    y_label: str
    equal: bool = False

    def run(self, make: MakeEngine = make_warp) -> list[Outcome | Curve]:
        """Run the case at its own resolution."""
        return list(self.measure(make, self.segment_count, self.dt))

    def ladder_errors(self, make: MakeEngine = make_warp) -> list[float]:
        """Return the error of the first outcome at each resolution of the ladder."""
        return [outcomes(self.measure(make, *rung))[0].error for rung in self.ladder]

    def slope(self, errors: list[float]) -> float:
        """Return the slope of these errors over step or segment's length, in logarithms."""
        counts, steps = np.array(self.ladder).T
        sizes = steps if steps.max() > steps.min() else 1.0 / counts
        return float(np.polyfit(np.log(sizes), np.log(np.maximum(errors, 1e-15)), 1)[0])


def outcomes(measured: Iterable[Outcome | Curve]) -> list[Outcome]:
    """Return the outcomes among the results of a scene."""
    return [one for one in measured if isinstance(one, Outcome)]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Theme:
    """Cases that belong together, under a heading."""

    title: str
    cases: tuple[Case, ...]


IMAGES = pathlib.PurePosixPath("images/validation")
OUTCOMES = ("quantity", "unit", "closed form", "engine", "error")
LADDER = ("segments", "step [ms]", "error of the first row", "slope")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Result:
    """Results of a case with one engine, and the errors on its ladder."""

    case: Case
    outcomes: list[Outcome]
    curves: list[Curve]
    ladder_errors: list[float]

    @classmethod
    def of(cls, case: Case, make: MakeEngine) -> "Result":
        """Run a case and its ladder."""
        measured = case.run(make)
        return cls(
            case=case,
            outcomes=outcomes(measured),
            curves=[one for one in measured if isinstance(one, Curve)],
            ladder_errors=case.ladder_errors(make),
        )

    @property
    def met(self) -> bool:
        """True where every outcome is within the tolerance."""
        return all(outcome.error <= self.case.tolerance for outcome in self.outcomes)


def result_tables(result: Result) -> Iterator[Table]:
    """Yield the outcomes of a case, and the errors on its ladder, if it has one."""
    case, errors = result.case, result.ladder_errors
    rows = [(o.quantity, o.unit, o.exact, o.computed, o.error) for o in result.outcomes]
    yield Table(case.title, OUTCOMES, rows)
    if errors:
        slope, rungs = case.slope(errors), zip(case.ladder, errors, strict=True)
        rows = [(count, 1e3 * dt, error, slope) for (count, dt), error in rungs]
        yield Table(f"{case.title}: convergence", LADDER, rows)


def _number(value: float) -> str:
    return "0" if abs(value) < 5e-13 else f"{value:.5g}"


def slope_sentence(case: Case, ladder: Table) -> str:
    """Return the convergence of the first outcome in words."""
    in_time = len({row[0] for row in ladder.rows}) == 1
    rungs = ", ".join(
        f"{error:.1e} at " + (f"{dt:g} ms" if in_time else f"{count} segments")
        for count, dt, error, _ in ladder.rows
    )
    what = "step" if in_time else "segment"
    slope = ladder.rows[0][-1]
    return f"Convergence of the first row: {rungs}; slope {slope:.2f} in the {what}."


def plot(result: Result) -> bytes:
    """Return the plot of a case as a PNG file: closed forms as lines, the engine as points."""
    from cablecast.report import style

    figure = style.new_figure(5.2, 2.9)
    with style.styled():
        axes = figure.subplots()
        colors = (style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE)
        for color, curve in zip(colors, result.curves, strict=False):
            axes.plot(curve.x, curve.exact, color=color, linewidth=1.2, alpha=0.6)
            points = {"marker": "o", "markersize": 1.8 if len(curve.computed) > 70 else 3.2}
            label = curve.label or None
            axes.plot(curve.x_computed, curve.computed, ls="", color=color, label=label, **points)
        axes.set_xlabel(result.case.x_label)
        axes.set_ylabel(result.case.y_label)
        if result.case.name.startswith("order_"):
            style.log_scale(axes, "x")
            style.log_scale(axes, "y")
        if result.case.equal:
            axes.set_aspect("equal")
        if any(curve.label for curve in result.curves):
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


def section(case: Case, tables: Mapping[str, Table]) -> str:
    """Return heading, theory, plot, table, tolerance and slope of a case."""
    rows = [
        (quantity, unit, _number(exact), _number(computed), f"{error:.1e}", f"{case.tolerance:g}")
        for quantity, unit, exact, computed, error in tables[case.title].rows
    ]
    ladder = tables.get(f"{case.title}: convergence")
    parts = [
        f"### {case.title}",
        case.theory,
        f"![{case.title}]({IMAGES / case.name}.png)",
        Table("", (*OUTCOMES, "tolerance"), rows).markdown(),
        f"At {case.segment_count} segments and {case.dt * 1e3:g} ms. Tolerance "
        f"{case.tolerance:g}: {case.reason}. {slope_sentence(case, ladder) if ladder else ''}",
    ]
    return "\n\n".join(part.strip() for part in parts)


def page(themes: tuple[Theme, ...], tables: Mapping[str, Table]) -> str:
    """Return what the page says, from the tables of the cases by their titles."""
    cases = [case for theme in themes for case in theme.cases]
    errors = {case.title: [row[-1] for row in tables[case.title].rows] for case in cases}
    met = sum(max(errors[case.title]) <= case.tolerance for case in cases)
    every = [error for of in errors.values() for error in of]
    parts = [
        f"{met} of {len(cases)} cases are within their tolerance; the median error of all "
        f"{len(every)} quantities is {np.median(every):.1e}.",
        "Each parameter decides the outcome of at least one case:",
        parameter_table(themes).markdown(),
    ]
    for theme in themes:
        parts.append(f"## {theme.title}")
        parts += [section(case, tables) for case in theme.cases]
    return "\n\n".join(parts)


def write_plots(docs: pathlib.Path, results: Iterable[Result]) -> None:
    """Write the plot of each case into a folder of pages."""
    images = docs / IMAGES
    images.mkdir(parents=True, exist_ok=True)
    for result in results:
        files.write_bytes(images / f"{result.case.name}.png", plot(result))
