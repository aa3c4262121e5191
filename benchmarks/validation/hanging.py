"""Gravity and tension: catenary, modes of a hanging chain, a weight as a pendulum."""

import functools

import numpy as np

from benchmarks.validation import scenes
from benchmarks.validation.case import Case, Curve, MakeEngine, Measured, Outcome
from benchmarks.validation.scenes import LENGTH
from cablecast.engines.base import GRAVITY, CableState

SPAN = 0.4
HEIGHT = 1.0
DOWN = -0.5 * np.pi


def catenary(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    from scipy.optimize import brentq

    cable = scenes.make_cable(linear_damping=5.0)
    left, right = np.array([0.0, 0.0, HEIGHT]), np.array([SPAN, 0.0, HEIGHT])
    # Start from a V of the right length.
    slope = np.arccos(SPAN / LENGTH)
    heading = np.where(scenes.lengthwise(segment_count) < 0.5 * LENGTH, -slope, slope)
    state = CableState.at_rest(scenes.planar(heading, left, "xz")[None])
    rollout = make(segment_count, dt).rollout(
        cable,
        scenes.hold(left),
        state,
        duration=8.0,
        far_path=scenes.hold(right),
    )
    a: float = brentq(lambda a: 2 * a * np.sinh(SPAN / (2 * a)) - LENGTH, 0.02, 10.0)  # type: ignore

    def curve(x):
        return HEIGHT + a * (np.cosh((x - SPAN / 2) / a) - np.cosh(SPAN / (2 * a)))

    nodes = rollout.final_state.positions[0]
    worst = np.argmax(np.abs(nodes[:, 2] - curve(nodes[:, 0])))
    x = np.linspace(0.0, SPAN, 200)
    return Measured(
        outcomes=(
            Outcome(
                quantity="height of the node that is farthest off",
                unit="m",
                exact=float(curve(nodes[worst, 0])),
                computed=nodes[worst, 2],
                scale=HEIGHT - float(curve(SPAN / 2)),
            ),
        ),
        curves=(Curve(x=x, exact=curve(x), x_computed=nodes[:, 0], computed=nodes[:, 2]),),
    )


AMPLITUDE = 1e-3


def hanging_mode(make: MakeEngine, segment_count: int, dt: float, shape, omega, cable, label):
    """Measure the period of a hanging chain that is released in a mode."""
    s = np.linspace(0.0, LENGTH, segment_count + 1)
    heading = np.arcsin(np.diff(AMPLITUDE * shape(s)) * segment_count / LENGTH)
    edges = np.stack([np.sin(heading), 0 * heading, -np.cos(heading)], axis=1)
    nodes = scenes.from_edges(LENGTH / segment_count * edges, (0, 0, HEIGHT))
    period = 2 * np.pi / omega
    rollout = make(segment_count, dt).rollout(
        cable,
        scenes.hold((0, 0, HEIGHT), pitch=DOWN),
        CableState.at_rest(nodes[None]),
        duration=1.2 * period,
        sample_dt=2e-3,
    )
    x = rollout.endpoint_xyz[0, :, 0]
    measured = 2 * np.pi / scenes.fitted_swing(rollout.times, x, omega)[0]
    outcome = Outcome(quantity=f"period, {label}", unit="s", exact=float(period), computed=measured)
    t = np.linspace(0.0, 1.2 * period, 200)
    few = slice(None, None, max(1, len(x) // 40))
    curve = Curve(
        label=label,
        x=t,
        exact=1e3 * x[0] * np.cos(omega * t),
        x_computed=rollout.times[few],
        computed=1e3 * x[few],
    )
    return outcome, curve


def chain_modes(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    from scipy.special import j0, jn_zeros

    cable = scenes.make_cable()
    results = []
    for mode in range(3):
        omega = 0.5 * jn_zeros(0, 3)[mode] * np.sqrt(GRAVITY / LENGTH)

        def shape(s, omega=omega):
            return j0(2 * omega * np.sqrt((LENGTH - s) / GRAVITY))

        label = f"mode {mode + 1}"
        results.append(hanging_mode(make, segment_count, dt, shape, omega, cable, label))
    outcomes, curves = zip(*results, strict=True)
    return Measured(outcomes=outcomes, curves=curves)


def loaded_chain(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    from scipy.optimize import brentq
    from scipy.special import j0, j1, y0, y1

    results = []
    for endpoint_mass in (0.01, 0.05, 0.25):
        cable = scenes.make_cable(endpoint_mass=endpoint_mass)
        # Where the tension would vanish, below the weight.
        below = endpoint_mass / scenes.MASS * LENGTH

        def weight_condition(omega, z, below=below):
            # With u = 2 omega sqrt(z / g), the shape a J0(u) + b Y0(u) must hang still at the
            # grip, and at the weight its slope must be -omega^2 / g of its deflection.
            u_top = 2 * omega * np.sqrt((below + LENGTH) / GRAVITY)
            u_low = 2 * omega * np.sqrt(below / GRAVITY)
            a, b = y0(u_top), -j0(u_top)
            u = 2 * omega * np.sqrt(z / GRAVITY)
            slope = -(a * j1(u_low) + b * y1(u_low)) * omega / np.sqrt(GRAVITY * below)
            value = a * j0(u_low) + b * y0(u_low)
            return slope + omega**2 / GRAVITY * value, a * j0(u) + b * y0(u)

        pendulum = np.sqrt(GRAVITY / LENGTH)
        omega: float = brentq(  # type: ignore
            lambda w: weight_condition(w, LENGTH)[0], 0.9 * pendulum, 1.25 * pendulum
        )
        low = weight_condition(omega, below)[1]

        def shape(s, omega=omega, below=below, low=low, condition=weight_condition):
            return condition(omega, below + LENGTH - s)[1] / low

        label = f"{endpoint_mass * 1e3:g} g"
        results.append(hanging_mode(make, segment_count, dt, shape, omega, cable, label))
    outcomes, curves = zip(*results, strict=True)
    return Measured(outcomes=outcomes, curves=curves)


def pendulum(make: MakeEngine, segment_count: int, dt: float, swing_deg: float) -> Measured:
    from scipy.special import ellipj, ellipk

    cable = scenes.make_cable(mass=5e-4, endpoint_mass=0.5)
    angle = np.radians(swing_deg)
    direction = (np.sin(angle), 0, -np.cos(angle))
    k = np.sin(angle / 2)
    omega = np.sqrt(GRAVITY / LENGTH)
    period = 4 / omega * ellipk(k**2)
    sample_dt = 1e-3
    rollout = make(segment_count, dt).rollout(
        cable,
        scenes.hold((0, 0, HEIGHT), pitch=DOWN),
        scenes.straight(segment_count, (0, 0, HEIGHT), direction),
        duration=1.1 * period,
        sample_dt=sample_dt,
    )
    x, z = rollout.endpoint_xyz[0, :, 0], rollout.endpoint_xyz[0, :, 2]
    crossings = np.nonzero(np.diff(np.sign(x)))[0]
    share = x[crossings] / (x[crossings] - x[crossings + 1])
    times = rollout.times[crossings] + sample_dt * share
    t = np.linspace(0.0, 1.1 * period, 300)
    _, cn, dn, _ = ellipj(omega * t, k**2)
    exact = np.degrees(2 * np.arcsin(k * cn / dn))  # sn(u + K) = cn(u) / dn(u)
    few = slice(None, None, 40)
    return Measured(
        outcomes=(
            Outcome(
                quantity=f"period at {swing_deg:g} degrees",
                unit="s",
                exact=float(period),
                computed=2 * (times[1] - times[0]),
            ),
        ),
        curves=(
            Curve(
                x=t,
                exact=exact,
                x_computed=rollout.times[few],
                computed=np.degrees(np.arctan2(x, HEIGHT - z))[few],
            ),
        ),
    )


CASES = (
    Case(
        name="catenary",
        title="A cable held at both ends hangs in a catenary",
        theory=(
            "Both ends at one height, 0.4 m apart, no bend stiffness: z = a cosh(x / a), with "
            "2 a sinh(span / 2a) = L. The cable falls from a V and is damped to rest."
        ),
        tolerance=1e-3,
        reason="60 chords instead of a curve",
        measure=catenary,
        segment_count=60,
        ladder=((15, 5e-4), (30, 5e-4), (60, 5e-4)),
        x_label="x [m]",
        y_label="z [m]",
        equal=True,
    ),
    Case(
        name="chain_modes",
        title="A hanging chain swings in Bessel's modes",
        theory=(
            "Small swings of a hanging chain: ω = (j / 2) √(g / L) with j the zeros of J₀. The "
            "chain is released in the shape J₀(2 ω √(z / g)), z the height above its free end."
        ),
        tolerance=5e-3,
        reason="60 links and an amplitude of 1 mm leave 0.1 % in the third mode",
        measure=chain_modes,
        segment_count=60,
        ladder=((15, 2.5e-4), (30, 2.5e-4), (60, 2.5e-4)),
        x_label="time [s]",
        y_label="endpoint [mm]",
    ),
    Case(
        name="loaded_chain",
        title="A weight at the end of a hanging chain",
        theory=(
            "With an endpoint mass M the tension at the end is M g, and the shape is "
            "a J₀(u) + b Y₀(u), u = 2 ω √(z / g), z counted from M L / m below the weight; the "
            "weight asks for a slope of −ω² / g times its deflection. The endpoint mass alone "
            "tells the three periods from each other."
        ),
        parameters=("endpoint_mass",),
        tolerance=2e-3,
        reason="40 links; the periods differ from each other by more than ten times as much",
        measure=loaded_chain,
        segment_count=40,
        ladder=((5, 2.5e-4), (10, 2.5e-4), (20, 2.5e-4)),
        x_label="time [s]",
        y_label="endpoint [mm]",
    ),
    *(
        Case(
            name=f"pendulum_{swing_deg}",
            title=f"A weight on a light cable is a pendulum, {swing_deg} degree swing",
            theory=(
                "T = 4 √(L / g) K(sin²(α / 2)), K the complete elliptic integral; the curve is "
                "Jacobi's elliptic sine."
            ),
            tolerance=2e-3,
            reason="the cable has a thousandth of the weight's mass",
            measure=functools.partial(pendulum, swing_deg=swing_deg),
            segment_count=10,
            x_label="time [s]",
            y_label="angle [deg]",
        )
        for swing_deg in (1, 60)
    ),
)
