"""Linear and angular damping."""

import numpy as np

from benchmarks.validation import scenes
from benchmarks.validation.case import Case, Curve, MakeEngine, Measured, Outcome
from benchmarks.validation.scenes import LENGTH
from cablecast.engines.base import GRAVITY, REFERENCE_SEGMENT_COUNT, CableState

HEIGHT = 2.0
SPIN = 6.0


def slowed_spin(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    outcomes, curves = [], []
    for damping in (0.5, 2.0, 5.0):
        cable = scenes.make_cable(linear_damping=damping)
        start = (0.0, 0.0, HEIGHT)
        state = scenes.straight(segment_count, start, (1, 0, 0))
        state = scenes.turning(state, SPIN, (0, 0, 1), start)
        rollout = make(segment_count, dt, 0.0).rollout(
            cable, scenes.hold(start), state, duration=1.5, sample_dt=0.025
        )
        x, y = rollout.endpoint_xy[0].T
        angle = np.unwrap(np.arctan2(y, x))
        t = np.linspace(0.0, 1.5, 200)

        def law(t, damping=damping):
            return SPIN / damping * (1.0 - np.exp(-damping * t))

        label = f"c = {damping:g} 1/s"
        outcomes.append(
            Outcome(
                quantity=f"angle after 1.5 s, {label}",
                unit="rad",
                exact=float(law(rollout.times[-1])),
                computed=float(angle[-1]),
            )
        )
        curves.append(
            Curve(label=label, x=t, exact=law(t), x_computed=rollout.times, computed=angle)
        )
    return Measured(outcomes=tuple(outcomes), curves=tuple(curves))


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
    heading = PLUCK * wave * np.cos(wave * scenes.lengthwise(segment_count))
    heading = np.arcsin(heading)
    edges = np.stack([np.sin(heading), 0 * heading, -np.cos(heading)], axis=1)
    start = (0.0, 0.0, HEIGHT)
    nodes = scenes.from_edges(LENGTH / segment_count * edges, start)
    node = round(segment_count / (2 * STRING_MODE))
    outcomes, curves = [], []
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
        assert rollout.nodes is not None
        x = 1e6 * rollout.nodes[0, :, node, 0]
        decay = damping * (LENGTH / REFERENCE_SEGMENT_COUNT) ** 2 / 24 * wave**2
        measured = scenes.fitted_swing(rollout.times, x, omega, decay)[1]
        label = f"c = {damping:g} 1/s"
        outcomes.append(
            Outcome(
                quantity=f"decay rate, {label}", unit="1/s", exact=float(decay), computed=measured
            )
        )
        t = np.linspace(0.0, 0.6, 800)
        few = slice(None, None, max(1, len(x) // 150))
        curves.append(
            Curve(
                label=label,
                x=t,
                exact=x[0] * np.exp(-decay * t) * np.cos(omega * t),
                x_computed=rollout.times[few],
                computed=x[few],
            )
        )
    return Measured(outcomes=tuple(outcomes), curves=tuple(curves[-1:]))


CASES = (
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
