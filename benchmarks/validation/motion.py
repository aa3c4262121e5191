"""Momentum, energy and damping of a moving cable, and the order of the method on casts."""

import dataclasses
import functools

import numpy as np

from benchmarks.common import random_casts, track_errors
from benchmarks.validation import scenes
from benchmarks.validation.case import Case, Curve, MakeEngine, Measured, Outcome
from benchmarks.validation.scenes import LENGTH, LOCKED, MASS
from cablecast.cable import load_cable
from cablecast.engines.base import GRAVITY, REFERENCE_SEGMENT_COUNT, CableState

SPIN = 12.0
FLIGHT_TIME = 1.0
TOSS = np.array([0.3, 0.0, 2.0])
START = np.array([0.0, 0.0, 6.0])


def free_flight(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    cable = scenes.make_cable()
    # The near node has half a segment's mass, but the grip carries it: the centre of what is free
    # to fly lies a little beyond the middle.
    masses = scenes.node_masses(cable, segment_count)
    s = np.linspace(0.0, LENGTH, segment_count + 1)
    centre = float((masses * s).sum() / masses.sum())

    def at(times, distance):
        """Return the point at a distance from the near end [m], shape [step, 3]."""
        t = np.asarray(times, dtype=float)[..., None]
        flight = START + TOSS * t - 0.5 * np.array([0, 0, GRAVITY]) * t**2
        angle = SPIN * t[..., 0]
        along = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=-1)
        return flight + (distance - centre) * along

    state = scenes.straight(segment_count, at(0.0, 0.0), (1, 0, 0), TOSS)
    state = scenes.turning(state, -SPIN, (0, 1, 0), at(0.0, centre))
    sample_dt = 0.01
    rollout = make(segment_count, dt).rollout(
        cable,
        scenes.fitted(lambda t: at(t, 0.0), FLIGHT_TIME, count=400),
        state,
        duration=FLIGHT_TIME,
        sample_dt=sample_dt,
        record_nodes=True,
    )
    nodes, times = rollout.nodes[0], rollout.times
    mean = np.einsum("n,snc->sc", masses, nodes) / masses.sum()
    # Momentum and spin from the first and the last sample interval, the flight between them.
    velocity = np.diff(mean, axis=0) / sample_dt
    relative = nodes - mean[:, None]
    angle = np.unwrap(np.arctan2(relative[:, -1, 2], relative[:, -1, 0]))
    exact = at(times, LENGTH)
    span = (len(times) - 2) * sample_dt
    distance = np.linalg.norm(nodes[-1, -1] - exact[-1])
    # Straight and in the plane, the rotation about the centre of mass is one angle; its rate over
    # a step is the angular momentum over the moment of inertia.
    inertia = (masses * (relative**2).sum(2)).sum(1)
    momentum = inertia[1:] * np.diff(angle) / sample_dt
    fine = np.linspace(0.0, FLIGHT_TIME, 400)
    path = at(fine, LENGTH)
    yield Outcome(
        f"distance of the far end from its path after {FLIGHT_TIME:g} s",
        "m",
        0.0,
        float(distance),
        scale=LENGTH,
    )
    yield Outcome(
        "vertical momentum lost, over weight and time",
        "-",
        1.0,
        float((velocity[0, 2] - velocity[-1, 2]) / (GRAVITY * span)),
    )
    yield Outcome(
        "horizontal momentum at the end",
        "mN·s",
        1e3 * MASS * TOSS[0],
        float(1e3 * MASS * velocity[-1, 0]),
    )
    yield Outcome(
        "angular momentum at the end, over that at the start",
        "-",
        1.0,
        float(momentum[-1] / momentum[0]),
    )
    yield Curve(path[:, 0], path[:, 2], nodes[::2, -1, 0], nodes[::2, -1, 2])


def energy_balance(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    cable = scenes.make_cable(bend_stiffness=5e-3, endpoint_mass=0.02)
    start = (0.0, 0.0, 2.0)
    rollout = make(segment_count, dt).rollout(
        cable,
        scenes.hold(start, yaw=0.5 * np.pi),
        scenes.straight(segment_count, start, (1, 0, 0)),
        duration=1.5,
        sample_dt=dt,
        record_nodes=True,
    )
    kinetic, potential = scenes.energies(rollout.nodes[0], dt, cable, (1.0, 0.0, 0.0))
    total = kinetic + potential
    times = rollout.times[1:] - 0.5 * dt
    few = slice(None, None, max(1, len(times) // 60))
    drift = total - total[0]
    worst = drift[np.argmax(np.abs(drift))]
    yield Outcome(
        "largest change of the total, over the largest kinetic energy",
        "-",
        0.0,
        float(worst / np.max(kinetic)),
        scale=1.0,
    )
    yield Curve(times, np.zeros_like(times), times[few], 1e3 * drift[few], label="total")
    yield Curve(
        times,
        1e3 * (potential[0] - potential + kinetic[0]),
        times[few],
        1e3 * kinetic[few],
        label="kinetic (line: what weight and bending gave)",
    )


FLIGHT = (
    Case(
        name="free_flight",
        title="A cable in free flight keeps its momentum and its spin",
        theory=(
            "A straight cable is tossed and tumbles about its centre at 12 rad/s. The grip moves "
            "on the cycloid that the near end would follow by itself, so that it neither pulls nor "
            "pushes: the centre must follow its parabola, and the far end its own cycloid, through "
            "two turns."
        ),
        tolerance=1e-3,
        reason="0.25 ms at 12 rad/s are 0.2 degrees a step; the grip follows a spline",
        measure=free_flight,
        segment_count=20,
        dt=2.5e-4,
        ladder=((20, 2e-3), (20, 1e-3), (20, 5e-4)),
        x_label="x [m]",
        y_label="z [m]",
    ),
    Case(
        name="energy",
        title="A swinging cable gains no energy",
        theory=(
            "A cable with a weight at its end, clamped level, falls and swings without damping. "
            "Kinetic energy is what weight and bending give."
        ),
        tolerance=1e-2,
        reason="second order in the segment: at 60, half a per cent where the cable bends most",
        measure=energy_balance,
        segment_count=60,
        dt=1.25e-4,
        ladder=((15, 1.25e-4), (30, 1.25e-4), (60, 1.25e-4)),
        x_label="time [s]",
        y_label="energy [mJ]",
    ),
)


HEIGHT = 2.0
DAMPED_SPIN = 6.0


def slowed_spin(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    for damping in (0.5, 2.0, 5.0):
        cable = scenes.make_cable(linear_damping=damping)
        start = (0.0, 0.0, HEIGHT)
        state = scenes.straight(segment_count, start, (1, 0, 0))
        state = scenes.turning(state, DAMPED_SPIN, (0, 0, 1), start)
        rollout = make(segment_count, dt, 0.0).rollout(
            cable, scenes.hold(start), state, duration=1.5, sample_dt=0.025
        )
        x, y = rollout.endpoint_xy[0].T
        angle = np.unwrap(np.arctan2(y, x))
        t = np.linspace(0.0, 1.5, 200)

        def law(t, damping=damping):
            return DAMPED_SPIN / damping * (1.0 - np.exp(-damping * t))

        label = f"c = {damping:g} 1/s"
        yield Outcome(
            f"angle after 1.5 s, {label}", "rad", float(law(rollout.times[-1])), float(angle[-1])
        )
        yield Curve(t, law(t), rollout.times, angle, label=label)


STRING_MASS = 0.01
WEIGHT = 0.5
STRING_MODE = 3
PLUCK = 2e-5
"""Amplitude [m], small since a string that cannot stretch pulls on the weight twice a swing."""


def string_decay(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    tension = WEIGHT * GRAVITY
    speed = np.sqrt(tension * LENGTH / STRING_MASS)
    wave = STRING_MODE * np.pi / LENGTH
    omega = wave * speed
    heading = np.arcsin(PLUCK * wave * np.cos(wave * scenes.lengthwise(segment_count)))
    edges = np.stack([np.sin(heading), 0 * heading, -np.cos(heading)], axis=1)
    start = (0.0, 0.0, HEIGHT)
    nodes = scenes.from_edges(LENGTH / segment_count * edges, start)
    node = round(segment_count / (2 * STRING_MODE))
    for damping in (15.0, 50.0):
        cable = scenes.make_cable(mass=STRING_MASS, endpoint_mass=WEIGHT, angular_damping=damping)
        rollout = make(segment_count, dt).rollout(
            cable,
            scenes.hold(start, pitch=-0.5 * np.pi),
            CableState.at_rest(nodes[None]),
            duration=0.6,
            sample_dt=dt,
            record_nodes=True,
        )
        x = 1e6 * rollout.nodes[0, :, node, 0]
        decay = damping * (LENGTH / REFERENCE_SEGMENT_COUNT) ** 2 / 24 * wave**2
        measured = scenes.fitted_swing(rollout.times, x, omega, decay)[1]
        label = f"c = {damping:g} 1/s"
        yield Outcome(f"decay rate, {label}", "1/s", float(decay), measured)
    # The swings of the highest damping are drawn.
    t = np.linspace(0.0, 0.6, 800)
    few = slice(None, None, max(1, len(x) // 150))
    yield Curve(
        t,
        x[0] * np.exp(-decay * t) * np.cos(omega * t),
        rollout.times[few],
        x[few],
        label=label,
    )


DAMPING = (
    Case(
        name="linear_damping",
        title="Air slows a spinning cable",
        theory=(
            "Without gravity, a straight cable spins about the still grip. Damping c leaves it "
            "straight and takes its spin: the angle is Ω / c (1 − exp(−c t))."
        ),
        parameters=("linear_damping",),
        tolerance=1e-3,
        reason="the trapezoidal rule at 0.5 ms",
        measure=slowed_spin,
        segment_count=10,
        ladder=((10, 5e-3), (10, 2.5e-3), (10, 1.25e-3)),
        x_label="time [s]",
        y_label="angle [rad]",
    ),
    Case(
        name="angular_damping",
        title="Angular damping takes the energy of a wave",
        theory=(
            "Angular damping c slows the turning of every segment of l = L / 18 (the paper's), "
            "which is a viscous exchange of velocity with diffusivity c l² / 12. A string under "
            "the tension of a heavy weight, plucked in its third mode, decays at "
            "c l² / 24 · (3 π / L)²."
        ),
        parameters=("angular_damping",),
        tolerance=1e-2,
        reason=(
            "60 links have a mode number 0.1 % too low; the string has a fiftieth of the weight's "
            "mass, which moves with it a little"
        ),
        measure=string_decay,
        segment_count=60,
        dt=2.5e-4,
        x_label="time [s]",
        y_label="deflection at the first antinode [μm]",
    ),
)


CAST_COUNT = 16
ORDER_DURATION = 1.2
"""Up to the whip [s]: after it the cast magnifies errors by an amount that is chance."""
ORDER_SEED = 3

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
    paths = random_casts(CAST_COUNT, ORDER_SEED)

    def play(count, step):
        rollout = make(count, step).rollout(
            cable.with_params(params), paths, duration=ORDER_DURATION, sample_dt=0.1
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
    yield Outcome("slope of the error of the endpoint", "-", 2.0, float(line[0]), scale=1.0)
    yield Curve(x, 1e3 * errors[-1] * (x / sizes[-1]) ** 2, sizes, 1e3 * errors)


IN_TIME = Case(
    name="order_in_time",
    title="Casts without friction converge with the square of the step",
    theory=(
        f"{CAST_COUNT} random feasible casts of cable_1 on a table without friction, the "
        f"endpoint every 0.1 s up to {ORDER_DURATION:g} s, at 2, 1 and 0.5 ms against 1/16 ms. The "
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

ORDER = (
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
        reason="20 segments barely resolve a fold, which leaves some scatter",
        measure=functools.partial(slope, in_time=False, changes=SLIDING),
        segment_count=80,
        dt=2.5e-4,
        x_label="segment [mm]",
        y_label="median error [mm]",
    ),
)
