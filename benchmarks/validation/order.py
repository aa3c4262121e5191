"""Order of the method on casts: no closed form, but a slope that theory prescribes."""

import dataclasses
import functools

import numpy as np

from benchmarks.common import random_casts, track_errors
from benchmarks.validation.case import Case, Curve, MakeEngine, Measured, Outcome
from benchmarks.validation.scenes import LOCKED
from cablecast.cable import load_cable

CAST_COUNT = 16
DURATION = 1.2
"""Up to the whip [s]: after it the cast magnifies errors by an amount that is chance."""
SEED = 3

SMOOTH = {"worksurface_friction": 0.0, "rolling_friction": 0.0, "spinning_friction": 0.0}
SLIDING = {"twist_stiffness": 0.0, "rolling_friction": LOCKED, "spinning_friction": 0.0}


def slope(
    make: MakeEngine,
    segment_count: int,
    dt: float,
    *,
    in_time: bool,
    changes: dict[str, float],
) -> Measured:
    """Measure the slope of the median error against a resolution much finer than the finest.

    Args:
        make: Makes the engine.
        segment_count: Number of segments of the finest rung.
        dt: Step of the finest rung [s].
        in_time: True to vary the step, False to vary the segments.
        changes: Parameters of cable_1 to change.
    """
    cable = load_cable("cable_1")
    params = dataclasses.replace(cable.params, **changes)
    paths = random_casts(CAST_COUNT, SEED)

    def play(count, step):
        rollout = make(count, step).rollout(
            cable.with_params(params), paths, duration=DURATION, sample_dt=0.1
        )
        return rollout.endpoint_xy[:, 1:]

    rungs = [(segment_count, dt * 2**k) for k in (2, 1, 0)]
    fine = (segment_count, dt / 8)
    if not in_time:
        rungs = [(segment_count // 2**k, dt) for k in (2, 1, 0)]
        fine = (3 * segment_count, dt)
    errors = track_errors(play, rungs, fine)
    counts, steps = np.array(rungs).T
    sizes = 1e3 * steps if in_time else 1e3 * cable.length / counts
    line = np.polyfit(np.log(sizes), np.log(errors), 1)
    x = np.linspace(sizes[-1], sizes[0], 50)
    return Measured(
        outcomes=(
            Outcome(
                quantity="slope of the error of the endpoint",
                unit="-",
                exact=2.0,
                computed=float(line[0]),
                scale=1.0,
            ),
        ),
        curves=(
            Curve(
                x=x,
                exact=1e3 * errors[-1] * (x / sizes[-1]) ** 2,
                x_computed=sizes,
                computed=1e3 * errors,
            ),
        ),
    )


IN_TIME = Case(
    name="order_in_time",
    title="Casts without friction converge with the square of the step",
    theory=(
        f"{CAST_COUNT} random feasible casts of cable_1 on a table without friction, the "
        f"endpoint every 0.1 s up to {DURATION:g} s, at 2, 1 and 0.5 ms against 1/16 ms. The "
        "line has slope 2."
    ),
    tolerance=0.2,
    reason="the coarsest step is at the edge of what resolves the bending waves",
    measure=functools.partial(slope, in_time=True, changes=SMOOTH),
    segment_count=20,
    dt=5e-4,
    x_label="step [ms]",
    y_label="median error [mm]",
)

CASES = (
    IN_TIME,
    dataclasses.replace(
        IN_TIME,
        name="order_in_time_with_friction",
        title="Casts with friction converge nearly as fast",
        theory=(
            "The same casts with all frictions of cable_1. The line has slope 2, which holds as "
            "long as nothing starts or stops; each start and stop falls between two steps."
        ),
        tolerance=0.6,
        reason="the kinks of friction leave errors of the first order, of micrometres",
        measure=functools.partial(slope, in_time=True, changes={}),
    ),
    Case(
        name="order_in_space",
        title="Casts converge with the square of the segment",
        theory=(
            "The same casts of a cable that slides and does not roll, with 20, 40 and 80 segments "
            "against 240, at 0.25 ms. The line has slope 2."
        ),
        tolerance=0.4,
        reason="20 segments hardly resolve a fold, which leaves some scatter",
        measure=functools.partial(slope, in_time=False, changes=SLIDING),
        segment_count=80,
        dt=2.5e-4,
        x_label="segment [mm]",
        y_label="median error [mm]",
    ),
)
