"""Validation cases: scenes with a known outcome, and the outcome that an engine computes."""

import dataclasses
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Outcome:
    """One number beside its closed form.

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Curve:
    """Curve in the plot of a case: the closed form as a line, the engine as points.

    Attributes:
        label: Name that tells it from the other curves of the case; empty where there is one.
        x: Abscissa of the closed form.
        exact: Values of the closed form.
        x_computed: Abscissa of the engine.
        computed: Values of the engine.
    """

    label: str = ""
    x: NDArray[np.float64]
    exact: NDArray[np.float64]
    x_computed: NDArray[np.float64]
    computed: NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Measured:
    """Results of a case at one resolution; the slope that is printed is the first outcome's."""

    outcomes: tuple[Outcome, ...]
    curves: tuple[Curve, ...]


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

    def run(self, make: MakeEngine = make_warp) -> Measured:
        """Run the case at its own resolution."""
        return self.measure(make, self.segment_count, self.dt)

    def convergence(self, make: MakeEngine = make_warp) -> "Convergence | None":
        """Return the errors of the first outcome over the ladder, and their slope."""
        if not self.ladder:
            return None
        errors = [self.measure(make, *rung).outcomes[0].error for rung in self.ladder]
        counts, steps = np.array(self.ladder).T
        in_time = bool(steps.max() > steps.min())
        sizes = steps if in_time else 1.0 / counts
        slope = float(np.polyfit(np.log(sizes), np.log(np.maximum(errors, 1e-15)), 1)[0])
        return Convergence(ladder=self.ladder, in_time=in_time, errors=tuple(errors), slope=slope)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Convergence:
    """Decrease of an error over a ladder of resolutions.

    Attributes:
        ladder: Segments and step [s] of each rung.
        in_time: True where the step changes, False where the segments do.
        errors: Relative error on each rung [-].
        slope: Slope of the error's logarithm over that of the step or of the segment's length.
    """

    ladder: tuple[tuple[int, float], ...]
    in_time: bool
    errors: tuple[float, ...]
    slope: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Theme:
    """Cases that belong together, under a heading."""

    title: str
    cases: tuple[Case, ...]
