"""Cables in the air that hang, bend and twist: their shapes and their swings."""

import dataclasses
import functools

import numpy as np

from benchmarks.validation import scenes
from benchmarks.validation.case import Case, Curve, MakeEngine, Measured, Outcome
from benchmarks.validation.scenes import LENGTH, RADIUS
from cablecast.cable import Cable
from cablecast.engines.base import GRAVITY, CableState
from cablecast.motion.grip_path import GripPath

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
        cable, scenes.hold(left), state, duration=8.0, far_path=scenes.hold(right)
    )
    a: float = brentq(lambda a: 2 * a * np.sinh(SPAN / (2 * a)) - LENGTH, 0.02, 10.0)  # type: ignore

    def curve(x):
        return HEIGHT + a * (np.cosh((x - SPAN / 2) / a) - np.cosh(SPAN / (2 * a)))

    nodes = rollout.final_state.positions[0]
    worst = np.argmax(np.abs(nodes[:, 2] - curve(nodes[:, 0])))
    x = np.linspace(0.0, SPAN, 200)
    yield Outcome(
        "height of the node that is farthest off",
        "m",
        float(curve(nodes[worst, 0])),
        nodes[worst, 2],
        scale=HEIGHT - float(curve(SPAN / 2)),
    )
    yield Curve(x, curve(x), nodes[:, 0], nodes[:, 2])


AMPLITUDE = 1e-3


def mode_results(times, x, omega, label, duration, scale=1.0) -> Measured:
    """Yield the period of what was released in a mode, and its swing over a duration [s]."""
    measured = 2 * np.pi / scenes.fitted_swing(times, x, omega)[0]
    yield Outcome(f"period, {label}", "s", float(2 * np.pi / omega), measured)
    t = np.linspace(0.0, duration, 200)
    few = slice(None, None, max(1, len(x) // 40))
    yield Curve(t, scale * x[0] * np.cos(omega * t), times[few], scale * x[few], label=label)


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
    yield from mode_results(rollout.times, x, omega, label, 1.2 * period, scale=1e3)


def chain_modes(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    from scipy.special import j0, jn_zeros

    cable = scenes.make_cable()
    for mode in range(3):
        omega = 0.5 * jn_zeros(0, 3)[mode] * np.sqrt(GRAVITY / LENGTH)

        def shape(s, omega=omega):
            return j0(2 * omega * np.sqrt((LENGTH - s) / GRAVITY))

        label = f"mode {mode + 1}"
        yield from hanging_mode(make, segment_count, dt, shape, omega, cable, label)


def loaded_chain(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    from scipy.optimize import brentq
    from scipy.special import j0, j1, y0, y1

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
        yield from hanging_mode(make, segment_count, dt, shape, omega, cable, label)


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
    yield Outcome(f"period at {swing_deg:g} degrees", "s", float(period), 2 * (times[1] - times[0]))
    yield Curve(t, exact, rollout.times[few], np.degrees(np.arctan2(x, HEIGHT - z))[few])


HANGING = (
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


LEVEL = 0.5 * np.pi  # the yaw of a cable along x


def sagging(make: MakeEngine, segment_count: int, dt: float, cable: Cable):
    """Return the nodes of level clamped cables at rest under their own weight [m], by world."""
    state = scenes.straight(segment_count, (0, 0, HEIGHT), (1, 0, 0))
    rollout = make(segment_count, dt).rollout(
        cable, scenes.hold((0, 0, HEIGHT), yaw=LEVEL), state, duration=4.0
    )
    return rollout.final_state.positions - [0, 0, HEIGHT]


def cantilever(make: MakeEngine, segment_count: int, dt: float) -> Measured:
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
        yield Outcome(f"sag of the tip, {label}", "mm", 1e3 * sag(LENGTH), -1e3 * nodes[-1, 2])
        # Both sag alike: stiffness and weight count by their ratio only. One curve is all.
        if stiffness == kinds[0][0]:
            yield Curve(s, -1e3 * sag(s), nodes[:, 0], 1e3 * nodes[:, 2], label=label)


def heavy_elastica(stiffness: float, weight: float):
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
    s = np.linspace(0.0, LENGTH, 2001)
    angle = solution.sol(s)[0]
    shape = [cumulative_trapezoid(f(angle), s, initial=0.0) for f in (np.cos, np.sin)]
    return np.stack(shape, axis=-1)


def elastica(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    for stiffness in (0.05, 0.01, 2e-3):
        cable = scenes.make_cable(
            bend_stiffness=stiffness, linear_damping=5.0, angular_damping=50.0
        )
        (nodes,) = sagging(make, segment_count, dt, cable)
        exact = heavy_elastica(stiffness, scenes.MASS * GRAVITY / LENGTH)
        label = f"EI = {stiffness:g} N·m²"
        for axis, name in ((1, "sag"), (0, "reach")):
            sign = -1.0 if axis else 1.0
            yield Outcome(
                f"{name} of the tip, {label}",
                "m",
                sign * exact[-1, axis],
                sign * nodes[-1, 2 * axis],
                scale=LENGTH,
            )
        yield Curve(exact[:, 0], exact[:, 1], nodes[:, 0], nodes[:, 2], label=label)


WAVE_NUMBER = 1.875104068711961
"""First solution of cos(k) cosh(k) = -1, over the length."""


def vibration(make: MakeEngine, segment_count: int, dt: float) -> Measured:
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
        yield from mode_results(rollout.times, z, omega, label, 2.0 * period)


BENDING = (
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


TWIST_HEIGHT = 2.0
START = (0.0, 0.0, TWIST_HEIGHT)


def swing(make: MakeEngine, segment_count: int, dt: float, cable, mode: int):
    """Return the roll of the last segment after release in a mode, at 24 times in 1.2 periods."""
    wave = (mode - 0.5) * np.pi / LENGTH
    # The speed of a torsion wave in a solid cable, √(GJ L / (m R² / 2)).
    stiffness, mass = float(cable.params.twist_stiffness), float(cable.params.mass)
    speed = float(np.sqrt(stiffness * LENGTH / (0.5 * mass * RADIUS**2)))
    omega = wave * speed
    middles = scenes.lengthwise(segment_count)
    state = scenes.straight(segment_count, START, (0, 1, 0))
    state = dataclasses.replace(state, roll=0.3 * np.sin(wave * middles)[None])
    times = np.round(np.linspace(0.0, 1.2 * 2 * np.pi / omega, 25)[1:] / dt) * dt
    rolls = scenes.rolls_after(
        make(segment_count, dt, 0.0), cable, scenes.hold(START), state, times
    )[:, -1]
    return np.append(0.0, times), np.append(state.roll[0, -1], rolls), omega


def torsional_swing(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    for stiffness, mode in ((3e-5, 1), (3e-5, 2), (1.2e-4, 1)):
        cable = scenes.make_cable(twist_stiffness=stiffness)
        times, roll, omega = swing(make, segment_count, dt, cable, mode)
        label = f"GJ = {stiffness:g} N·m², mode {mode}"
        yield from mode_results(times, roll, omega, label, times[-1])


def damped_roll(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    cable = scenes.make_cable(twist_stiffness=3e-5, angular_damping=10.0)
    times, roll, omega = swing(make, segment_count, dt, cable, 1)
    decay = 0.5 * float(cable.params.angular_damping)
    damped = float(np.sqrt(omega**2 - decay**2))
    t = np.linspace(0.0, times[-1], 200)
    exact = np.exp(-decay * t) * (np.cos(damped * t) + decay / damped * np.sin(damped * t))
    yield Outcome("decay rate", "1/s", decay, scenes.fitted_swing(times, roll, damped, decay)[1])
    yield Curve(t, roll[0] * exact, times, roll)


TURN = 4.0
TURN_TIME = 1.0


def turned_grip(turn: float) -> GripPath:
    """Return a grip that points down and turns about the cable by an angle [rad] in a second."""
    times = np.linspace(0.0, TURN_TIME, 60)
    share = times / TURN_TIME
    poses = np.zeros((60, 5))
    poses[:, :3], poses[:, 4] = START, DOWN
    return GripPath.fit(times, poses, turn * share**3 * (10 - 15 * share + 6 * share**2))


def shaft(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    cable = scenes.make_cable(twist_stiffness=1e-4, bend_stiffness=1e-2, angular_damping=50.0)
    state = scenes.straight(segment_count, START, (0, 0, -1))
    rollout = make(segment_count, dt, 0.0).rollout(
        cable,
        turned_grip(TURN),
        state,
        duration=TURN_TIME + 2.0,
        far_path=scenes.hold((0, 0, TWIST_HEIGHT - LENGTH), pitch=DOWN),
    )
    # Roll is counted from the grip, which has turned; the far end has not.
    middles = scenes.lengthwise(segment_count)
    roll = rollout.final_state.roll[0]
    exact = -TURN * middles / LENGTH
    worst = np.argmax(np.abs(roll - exact))
    s = np.array([0.0, LENGTH])
    yield Outcome(
        "roll against the grip, of the segment farthest off",
        "rad",
        float(exact[worst]),
        float(roll[worst]),
        scale=TURN,
    )
    yield Curve(s, -TURN * s / LENGTH, middles, roll)


RING_BEND = 1e-4
RING_TWIST = 2e-4
RING_DAMPING = 5.0
RING_TURNS = np.array([0.7, 0.75, 0.8, 0.85, 0.9, 0.925, 0.95, 0.97])
"""Turns to try, over the critical one [-]."""


def pushed_ring(make: MakeEngine, segment_count: int, dt: float, turns, push: float):
    """Return the shapes of a ring whose grips turn, pushed out of its plane at first [m/s]."""
    cable = scenes.make_cable(
        bend_stiffness=RING_BEND,
        twist_stiffness=RING_TWIST,
        linear_damping=RING_DAMPING,
        # Twist that swings on would hide how slowly the ring goes back.
        angular_damping=5.0,
    )
    around = (np.arange(segment_count) + 0.5) / segment_count * 2.0 * np.pi
    state = CableState.at_rest(scenes.planar(DOWN + around, START, "xz")[None])
    # The second mode is the first to become unstable.
    at = np.linspace(0.0, 2.0 * np.pi, segment_count + 1)
    state.velocities[0, :, 1] = push * (1.0 - np.cos(at)) * np.cos(at)
    rollout = make(segment_count, dt, 0.0).rollout(
        cable,
        GripPath.stack([turned_grip(turn) for turn in turns]),
        state,
        duration=8.0,
        sample_dt=0.25,
        far_path=scenes.hold(START, pitch=DOWN),
        record_nodes=True,
    )
    return rollout.times, rollout.nodes


def michell(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    critical = 2.0 * np.pi * np.sqrt(3.0) * RING_BEND / RING_TWIST
    turns = RING_TURNS * critical
    times, one = pushed_ring(make, segment_count, dt, turns, 1e-3)
    _, other = pushed_ring(make, segment_count, dt, turns, -1e-3)
    # Half the difference of two opposite pushes is free of what the grips do to the ring. A cable
    # without a shape of its own may turn as a whole about its tangent at the grips; that is no
    # buckling and is taken out.
    y = 0.5 * (one - other)[..., 1]
    x = 0.5 * (one + other)[..., 0]
    turned = (x * y).sum(axis=2) / (x * x).sum(axis=2)
    out = np.sqrt(((y - turned[..., None] * x) ** 2).mean(axis=2))
    late = times >= 4.0
    # The softest mode obeys y'' + c y' + k y = 0; k from the rate at which it decays.
    rate = np.array([np.polyfit(times[late], np.log(row[late]), 1)[0] for row in out])
    stiffness = -rate * (rate + RING_DAMPING)
    fit = np.polynomial.Polynomial.fit(turns, stiffness, 2)
    measured = float(max(fit.roots().real))
    x = np.linspace(turns[0], measured, 100)
    yield Outcome("critical turn", "rad", critical, measured)
    yield Curve(
        np.append(x, [np.nan, critical, critical]),
        np.append(fit(x), [np.nan, 0.0, fit(turns[0])]),
        turns,
        stiffness,
        label="fit, and Michell's zero",
    )


TWIST = (
    Case(
        name="torsional_swing",
        title="A twisted cable swings as a clamped shaft",
        theory=(
            "Clamped at the grip and free at its end: T = 4 L / (2 n − 1) · √(J / GJ), "
            "with J = m R² / (2 L) the moment of inertia per length of a solid cable."
        ),
        parameters=("twist_stiffness",),
        tolerance=2e-3,
        reason="30 segments; the second mode has a quarter of a wave in ten of them",
        measure=torsional_swing,
        segment_count=30,
        ladder=((8, 5e-4), (16, 5e-4), (32, 5e-4)),
        x_label="time [s]",
        y_label="roll of the last segment [rad]",
    ),
    Case(
        name="damped_roll",
        title="Angular damping slows the roll",
        theory="The same swing with angular damping c decays at c / 2.",
        parameters=("angular_damping",),
        tolerance=1e-4,
        reason="torsion and damping are of second order in the step",
        measure=damped_roll,
        segment_count=30,
        x_label="time [s]",
        y_label="roll of the last segment [rad]",
    ),
    Case(
        name="shaft",
        title="A cable clamped at both ends twists evenly",
        theory=(
            "A vertical cable is held at both ends, and the upper grip turns about it by 4 rad. "
            "Counted from the grip, the roll falls along the cable in a straight line to −4 rad."
        ),
        parameters=("twist_stiffness",),
        tolerance=1e-3,
        reason="half cells at both clamps make it exact but for what still swings",
        measure=shaft,
        segment_count=30,
        x_label="distance from the grip [m]",
        y_label="roll [rad]",
    ),
    Case(
        name="michell",
        title="Michell's instability of a twisted ring",
        theory=(
            "A ring whose ends are turned against each other stays plane up to "
            "2 π √3 EI / GJ (Michell 1889), then buckles out of its plane. Both ends are held at "
            "one place, one grip turns. Without gravity, a small push out of the plane decays at "
            "a rate that tells the stiffness that is left; it vanishes at the critical turn, at "
            "which the vertical line stands."
        ),
        parameters=("bend_stiffness", "twist_stiffness"),
        tolerance=1e-2,
        reason="a polygon of 60 sides; a parabola through eight rates below the threshold",
        measure=michell,
        segment_count=60,
        ladder=((15, 5e-4), (30, 5e-4), (60, 5e-4)),
        x_label="turn [rad]",
        y_label="stiffness of the mode [1/s²]",
    ),
)
