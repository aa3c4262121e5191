"""Twist stiffness: torsional swings, a twisted shaft, and Michell's instability."""

import dataclasses

import numpy as np

from benchmarks.validation import scenes
from benchmarks.validation.case import Case, Curve, MakeEngine, Measured, Outcome
from benchmarks.validation.scenes import LENGTH, MASS, RADIUS
from cablecast.engines.base import CableState
from cablecast.motion.grip_path import GripPath

HEIGHT = 2.0
DOWN = -0.5 * np.pi
START = (0.0, 0.0, HEIGHT)


def torsional_rate(stiffness: float, mass: float = MASS) -> float:
    """Return the speed of a torsion wave in a solid cable [m/s], √(GJ L / (m R² / 2))."""
    return float(np.sqrt(stiffness * LENGTH / (0.5 * mass * RADIUS**2)))


def swing(make: MakeEngine, segment_count: int, dt: float, cable, mode: int):
    """Return the roll of the last segment after release in a mode, at 24 times in 1.2 periods."""
    wave = (mode - 0.5) * np.pi / LENGTH
    speed = torsional_rate(float(cable.params.twist_stiffness), float(cable.params.mass))
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
    outcomes, curves = [], []
    for stiffness, mode in ((3e-5, 1), (3e-5, 2), (1.2e-4, 1)):
        cable = scenes.make_cable(twist_stiffness=stiffness)
        times, roll, omega = swing(make, segment_count, dt, cable, mode)
        measured = 2 * np.pi / scenes.fitted_swing(times, roll, omega)[0]
        label = f"GJ = {stiffness:g} N·m², mode {mode}"
        outcomes.append(
            Outcome(
                quantity=f"period, {label}", unit="s", exact=2 * np.pi / omega, computed=measured
            )
        )
        t = np.linspace(0.0, times[-1], 200)
        curves.append(
            Curve(
                label=label,
                x=t,
                exact=roll[0] * np.cos(omega * t),
                x_computed=times,
                computed=roll,
            )
        )
    return Measured(outcomes=tuple(outcomes), curves=tuple(curves))


def damped_roll(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    cable = scenes.make_cable(twist_stiffness=3e-5, angular_damping=10.0)
    times, roll, omega = swing(make, segment_count, dt, cable, 1)
    decay = 0.5 * float(cable.params.angular_damping)
    damped = float(np.sqrt(omega**2 - decay**2))
    t = np.linspace(0.0, times[-1], 200)
    exact = np.exp(-decay * t) * (np.cos(damped * t) + decay / damped * np.sin(damped * t))
    return Measured(
        outcomes=(
            Outcome(
                quantity="decay rate",
                unit="1/s",
                exact=decay,
                computed=scenes.fitted_swing(times, roll, damped, decay)[1],
            ),
        ),
        curves=(Curve(x=t, exact=roll[0] * exact, x_computed=times, computed=roll),),
    )


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
        far_path=scenes.hold((0, 0, HEIGHT - LENGTH), pitch=DOWN),
    )
    # Roll is counted from the grip, which has turned; the far end has not.
    middles = scenes.lengthwise(segment_count)
    roll = rollout.final_state.roll[0]
    exact = -TURN * middles / LENGTH
    worst = np.argmax(np.abs(roll - exact))
    s = np.array([0.0, LENGTH])
    return Measured(
        outcomes=(
            Outcome(
                quantity="roll against the grip, of the segment farthest off",
                unit="rad",
                exact=float(exact[worst]),
                computed=float(roll[worst]),
                scale=TURN,
            ),
        ),
        curves=(Curve(x=s, exact=-TURN * s / LENGTH, x_computed=middles, computed=roll),),
    )


RING_BEND = 1e-4
RING_TWIST = 2e-4
RING_DAMPING = 5.0
RING_TURNS = np.array([0.7, 0.75, 0.8, 0.85, 0.9, 0.925, 0.95, 0.97])
"""Turns to try, over the critical one [-]."""


def pushed_ring(make: MakeEngine, segment_count: int, dt: float, turns, push: float):
    """Return the shapes of a ring whose grips turn, pushed out of its plane at first [m/s]."""
    cable = scenes.make_cable(
        bend_stiffness=RING_BEND, twist_stiffness=RING_TWIST, linear_damping=RING_DAMPING
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
    assert rollout.nodes is not None
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
    return Measured(
        outcomes=(
            Outcome(quantity="critical turn", unit="rad", exact=critical, computed=measured),
        ),
        curves=(
            Curve(
                label="fit, and Michell's zero",
                x=np.append(x, [np.nan, critical, critical]),
                exact=np.append(fit(x), [np.nan, 0.0, fit(turns[0])]),
                x_computed=turns,
                computed=stiffness,
            ),
        ),
    )


CASES = (
    Case(
        name="torsional_swing",
        title="A twisted cable swings as a clamped shaft",
        theory=(
            "Clamped at the grip and free at its end: T = 4 L / (2 n − 1) · √(J / GJ), "
            "with J = m R² / (2 L) the moment of inertia per length of a solid cable."
        ),
        parameters=("twist_stiffness",),
        tolerance=5e-3,
        reason="torsion is taken at the end of the step, which is of first order",
        measure=torsional_swing,
        segment_count=30,
        dt=1e-4,
        ladder=((30, 8e-4), (30, 4e-4), (30, 2e-4)),
        x_label="time [s]",
        y_label="roll of the last segment [rad]",
    ),
    Case(
        name="damped_roll",
        title="Angular damping slows the roll",
        theory="The same swing with angular damping c decays at c / 2.",
        parameters=("angular_damping",),
        tolerance=1e-2,
        reason="torsion at the end of the step adds ω² dt / 2",
        measure=damped_roll,
        segment_count=30,
        dt=5e-5,
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
