"""Bend stiffness: cantilever, heavy elastica, a bending wave."""

import numpy as np

from benchmarks.validation import scenes
from benchmarks.validation.case import Case, Curve, MakeEngine, Measured, Outcome
from benchmarks.validation.scenes import LENGTH
from cablecast.cable import Cable
from cablecast.engines.base import GRAVITY, CableState

HEIGHT = 1.0
LEVEL = 0.5 * np.pi  # the yaw of a cable along x


def sagging(make: MakeEngine, segment_count: int, dt: float, cable: Cable):
    """Return the nodes of level clamped cables at rest under their own weight [m], by world."""
    state = scenes.straight(segment_count, (0, 0, HEIGHT), (1, 0, 0))
    rollout = make(segment_count, dt).rollout(
        cable, scenes.hold((0, 0, HEIGHT), yaw=LEVEL), state, duration=4.0
    )
    return rollout.final_state.positions - [0, 0, HEIGHT]


def cantilever(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    outcomes, curves = [], []
    kinds = ((0.1, 2e-3), (0.05, 1e-3))
    stiffnesses, masses = np.array(kinds).T
    cable = scenes.make_cable(
        bend_stiffness=stiffnesses, mass=masses, linear_damping=5.0, angular_damping=50.0
    )
    shapes = sagging(make, segment_count, dt, cable)
    for (stiffness, mass), nodes in zip(kinds, shapes, strict=True):
        weight = mass * GRAVITY / LENGTH

        def sag(s, weight=weight, stiffness=stiffness):
            return weight * s**2 * (6 * LENGTH**2 - 4 * LENGTH * s + s**2) / (24 * stiffness)

        s = np.linspace(0.0, LENGTH, 100)
        label = f"EI = {stiffness:g} N·m², {mass * 1e3:g} g"
        outcomes.append(
            Outcome(
                quantity=f"sag of the tip, {label}",
                unit="mm",
                exact=1e3 * sag(LENGTH),
                computed=-1e3 * nodes[-1, 2],
            )
        )
        curves.append(
            Curve(
                label=label,
                x=s,
                exact=-1e3 * sag(s),
                x_computed=nodes[:, 0],
                computed=1e3 * nodes[:, 2],
            )
        )
    # Both sag alike: stiffness and weight count by their ratio only. One curve tells all.
    return Measured(outcomes=tuple(outcomes), curves=tuple(curves[:1]))


def heavy_elastica(stiffness: float, weight: float, count: int = 2001):
    """Return the shape (x, z) of a level clamped cable: EI φ'' = weight (L - s) cos φ."""
    from scipy.integrate import cumulative_trapezoid, solve_bvp

    s = np.linspace(0.0, LENGTH, 101)
    # From a beam that hangs a little, or the solver may find a coiled one.
    guess = np.stack([-0.5 * s / LENGTH, np.full_like(s, -0.5 / LENGTH)])
    solution = solve_bvp(
        lambda s, y: np.stack([y[1], weight * (LENGTH - s) * np.cos(y[0]) / stiffness]),
        lambda near, far: np.array([near[0], far[1]]),
        s,
        guess,
        tol=1e-8,
        max_nodes=20_000,
    )
    s = np.linspace(0.0, LENGTH, count)
    angle = solution.sol(s)[0]
    shape = [cumulative_trapezoid(f(angle), s, initial=0.0) for f in (np.cos, np.sin)]
    return np.stack(shape, axis=-1)


def elastica(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    outcomes, curves = [], []
    for stiffness in (0.05, 0.01, 2e-3):
        cable = scenes.make_cable(
            bend_stiffness=stiffness, linear_damping=5.0, angular_damping=50.0
        )
        (nodes,) = sagging(make, segment_count, dt, cable)
        exact = heavy_elastica(stiffness, scenes.MASS * GRAVITY / LENGTH)
        label = f"EI = {stiffness:g} N·m²"
        for axis, name in ((1, "sag"), (0, "reach")):
            sign = -1.0 if axis else 1.0
            outcomes.append(
                Outcome(
                    quantity=f"{name} of the tip, {label}",
                    unit="m",
                    exact=sign * exact[-1, axis],
                    computed=sign * nodes[-1, 2 * axis],
                    scale=LENGTH,
                )
            )
        curves.append(
            Curve(
                label=label,
                x=exact[:, 0],
                exact=exact[:, 1],
                x_computed=nodes[:, 0],
                computed=nodes[:, 2],
            )
        )
    return Measured(outcomes=tuple(outcomes), curves=tuple(curves))


WAVE_NUMBER = 1.875104068711961
"""First solution of cos(k) cosh(k) = -1, over the length."""


def vibration(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    outcomes, curves = [], []
    for stiffness, mass in ((5e-3, 0.05), (5e-3, 0.1), (0.02, 0.05)):
        cable = scenes.make_cable(bend_stiffness=stiffness, mass=mass)
        omega = (WAVE_NUMBER / LENGTH) ** 2 * np.sqrt(stiffness * LENGTH / mass)
        k, s = WAVE_NUMBER, np.linspace(0.0, 1.0, segment_count + 1)
        ratio = (np.sinh(k) - np.sin(k)) / (np.cosh(k) + np.cos(k))
        mode = np.cosh(k * s) - np.cos(k * s) - ratio * (np.sinh(k * s) - np.sin(k * s))
        heading = np.arcsin(np.diff(2e-3 * mode / mode[-1]) * segment_count / LENGTH)
        nodes = scenes.planar(heading, (0, 0, HEIGHT), "xz")
        period = 2 * np.pi / omega
        rollout = make(segment_count, dt, 0.0).rollout(
            cable,
            scenes.hold((0, 0, HEIGHT), yaw=LEVEL),
            CableState.at_rest(nodes[None]),
            duration=2.0 * period,
            sample_dt=2e-3,
        )
        z = 1e3 * (rollout.endpoint_xyz[0, :, 2] - HEIGHT)
        label = f"EI = {stiffness:g} N·m², {mass * 1e3:g} g"
        measured = 2 * np.pi / scenes.fitted_swing(rollout.times, z, omega)[0]
        outcomes.append(
            Outcome(quantity=f"period, {label}", unit="s", exact=float(period), computed=measured)
        )
        t = np.linspace(0.0, 2.0 * period, 200)
        few = slice(None, None, max(1, len(z) // 40))
        curves.append(
            Curve(
                label=label,
                x=t,
                exact=z[0] * np.cos(omega * t),
                x_computed=rollout.times[few],
                computed=z[few],
            )
        )
    return Measured(outcomes=tuple(outcomes), curves=tuple(curves))


CASES = (
    Case(
        name="cantilever",
        title="A stiff light cable sags as a beam",
        theory=(
            "Clamped level: w = (m g / L) L⁴ / (8 EI) at the tip, for sags that are small against "
            "the length."
        ),
        parameters=("bend_stiffness", "mass"),
        tolerance=2e-3,
        reason="half cells at the clamp leave 0.1 % at 40 segments",
        measure=cantilever,
        ladder=((10, 5e-4), (20, 5e-4), (40, 5e-4)),
        x_label="x [m]",
        y_label="sag [mm]",
    ),
    Case(
        name="elastica",
        title="A clamped cable sags as the heavy elastica",
        theory=(
            "Large deflections: EI φ″ = (m g / L) (L − s) cos φ, φ(0) = 0, φ′(L) = 0, solved as a "
            "boundary value problem. Errors are relative to the length."
        ),
        parameters=("bend_stiffness",),
        tolerance=2e-3,
        reason="half cells at the clamp make it second order: 0.1 % at 40 segments",
        measure=elastica,
        ladder=((10, 5e-4), (20, 5e-4), (40, 5e-4)),
        x_label="x [m]",
        y_label="z [m]",
        equal=True,
    ),
    Case(
        name="vibration",
        title="A clamped cable without weight vibrates as a beam",
        theory=(
            "Without gravity: ω = 1.8751² √(EI L / m) / L². Twice the mass and four times the "
            "stiffness each change the period by their square root."
        ),
        parameters=("bend_stiffness", "mass"),
        tolerance=2e-3,
        reason="40 segments and an amplitude of 2 mm",
        measure=vibration,
        dt=2.5e-4,
        ladder=((10, 2.5e-4), (20, 2.5e-4), (40, 2.5e-4)),
        x_label="time [s]",
        y_label="endpoint [mm]",
    ),
)
