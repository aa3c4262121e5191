"""A cable that rolls: from sliding to rolling, rolling friction, spinning friction."""

import dataclasses

import numpy as np

from benchmarks.validation import scenes
from benchmarks.validation.case import Case, Curve, MakeEngine, Measured, Outcome
from benchmarks.validation.scenes import LENGTH, MASS, RADIUS
from benchmarks.validation.sliding import ROD_MASS, turned_rod
from cablecast.engines.base import GRAVITY

SPEED = 0.6


def watched(segment_count: int) -> int:
    """Return a node away from both ends: engines differ in the rolling of the ends."""
    return round(0.75 * segment_count)


def slip_to_roll(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    outcomes, curves = [], []
    duration = 0.3
    for friction in (0.1, 0.4):
        slip = SPEED / (3.0 * friction * GRAVITY)
        slipped = SPEED * slip - 0.5 * friction * GRAVITY * slip**2

        def law(t, slip=slip, slipped=slipped, friction=friction):
            sliding = SPEED * t - 0.5 * friction * GRAVITY * t**2
            return np.where(t < slip, sliding, slipped + SPEED * (t - slip) * 2 / 3)

        path = scenes.pieces_along_x(
            (0.0, slip, 2 * duration),
            ((0.0, SPEED, -0.5 * friction * GRAVITY), (slipped, SPEED * 2 / 3, 0.0)),
        )
        cable = scenes.make_cable(lateral_friction=friction)
        state = scenes.straight(segment_count, (0, 0, RADIUS), (0, 1, 0), (SPEED, 0, 0))
        rollout = make(segment_count, dt).rollout(
            cable,
            path,
            state,
            duration=duration,
            sample_dt=0.01,
            record_nodes=True,
        )
        assert rollout.nodes is not None
        node = watched(segment_count)
        x = rollout.nodes[0, :, node, 0]
        label = f"μ = {friction:g}"
        end = rollout.times[-1]
        outcomes += [
            Outcome(
                quantity=f"distance after {duration:g} s, {label}",
                unit="m",
                exact=float(law(end)),
                computed=float(x[-1]),
            ),
            Outcome(
                quantity=f"rate of roll then, {label}",
                unit="rad/s",
                exact=2 / 3 * SPEED / RADIUS,
                computed=float(rollout.final_state.roll_rate[0, node]),
            ),
        ]
        t = np.linspace(0.0, end, 200)
        curves.append(Curve(label=label, x=t, exact=law(t), x_computed=rollout.times, computed=x))
    return Measured(outcomes=tuple(outcomes), curves=tuple(curves))


OBLIQUE_FRICTION = 0.4


def oblique_slip(duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times [s] and distances along and across the cable [m] of an oblique slide.

    With slip s along and q across the cable, friction makes s' = -mu g s / |(s, q)| and
    q' = -3 mu g q / |(s, q)|, since a cylinder yields and turns. So q = SPEED (s / SPEED)^3, and
    the slip along the cable tells the time by a quadrature.
    """
    from scipy.integrate import cumulative_trapezoid

    along = np.linspace(SPEED, 0.0, 4001)
    across = SPEED * (along / SPEED) ** 3
    # |(s, q)| / s without the quotient of zeros at the end.
    slowness = np.sqrt(1.0 + (along / SPEED) ** 4) / (OBLIQUE_FRICTION * GRAVITY)
    sideways = SPEED - (SPEED - across) / 3.0

    def integral(values):
        return -cumulative_trapezoid(values, along, initial=0.0)

    times = integral(slowness)
    rest = np.linspace(times[-1], duration, 100)[1:]
    slid = integral(slowness * along)
    rolled = integral(slowness * sideways)
    return (
        np.concatenate([times, rest]),
        np.concatenate([slid, np.full(len(rest), slid[-1])]),
        np.concatenate([rolled, rolled[-1] + sideways[-1] * (rest - times[-1])]),
    )


def oblique_slip_to_roll(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    duration = 0.2
    law_times, law_along, law_across = oblique_slip(2.0 * duration)

    def position(times):
        return np.stack(
            [
                np.interp(times, law_times, law_across),
                np.interp(times, law_times, law_along),
                np.full_like(times, RADIUS),
            ],
            axis=-1,
        )

    cable = scenes.make_cable(lateral_friction=OBLIQUE_FRICTION)
    state = scenes.straight(segment_count, (0, 0, RADIUS), (0, 1, 0), (SPEED, SPEED, 0))
    rollout = make(segment_count, dt).rollout(
        cable,
        scenes.fitted(position, 1.5 * duration),
        state,
        duration=duration,
        sample_dt=0.01,
        record_nodes=True,
    )
    assert rollout.nodes is not None
    node = watched(segment_count)
    moved = rollout.nodes[0, :, node] - rollout.nodes[0, 0, node]
    exact = position(rollout.times)
    t = np.linspace(0.0, duration, 200)
    outcomes, curves = [], []
    for axis, label in ((0, "across the cable"), (1, "along the cable")):
        outcomes.append(
            Outcome(
                quantity=f"distance after {duration:g} s, {label}",
                unit="m",
                exact=float(exact[-1, axis]),
                computed=float(moved[-1, axis]),
            )
        )
        curves.append(
            Curve(
                label=label,
                x=t,
                exact=position(t)[:, axis],
                x_computed=rollout.times,
                computed=moved[:, axis],
            )
        )
    outcomes.append(
        Outcome(
            quantity="rate of roll then",
            unit="rad/s",
            exact=2 / 3 * SPEED / RADIUS,
            computed=float(rollout.final_state.roll_rate[0, node]),
        )
    )
    return Measured(outcomes=tuple(outcomes), curves=tuple(curves))


def roll_to_stop(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    outcomes, curves = [], []
    for lever in (5e-4, 1e-3):
        slowing = 2.0 * lever * GRAVITY / (3.0 * RADIUS)
        stop = SPEED / slowing
        distance = 0.5 * SPEED * stop
        path = scenes.pieces_along_x((0.0, stop), ((0.0, SPEED, -0.5 * slowing),))
        cable = scenes.make_cable(lateral_friction=2.0, rolling_friction=lever)
        state = scenes.straight(segment_count, (0, 0, RADIUS), (0, 1, 0), (SPEED, 0, 0))
        spin = np.full_like(state.roll_rate, SPEED / RADIUS)
        state = dataclasses.replace(state, roll_rate=spin)
        rollout = make(segment_count, dt).rollout(
            cable, path, state, duration=1.1, sample_dt=0.025, record_nodes=True
        )
        assert rollout.nodes is not None
        node = watched(segment_count)
        x = rollout.nodes[0, :, node, 0]
        label = f"ρ = {lever * 1e3:g} mm"
        outcomes += [
            Outcome(
                quantity=f"distance to rest, {label}", unit="m", exact=distance, computed=x[-1]
            ),
            Outcome(
                quantity=f"angle rolled, {label}",
                unit="rad",
                exact=distance / RADIUS,
                computed=float(rollout.final_state.roll[0, node]),
            ),
        ]
        t = np.linspace(0.0, 1.1, 200)
        rolling = np.minimum(t, stop)
        exact = SPEED * rolling - 0.5 * slowing * rolling**2
        curves.append(Curve(label=label, x=t, exact=exact, x_computed=rollout.times, computed=x))
    return Measured(outcomes=tuple(outcomes), curves=tuple(curves))


def spun_rod(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    lever = 2e-3
    couple = lever * ROD_MASS / LENGTH * GRAVITY
    return turned_rod(
        make,
        segment_count,
        dt,
        deceleration=3.0 * lever * GRAVITY / LENGTH**2,
        load=0.0,
        tip_force=-couple,
        torque=couple * LENGTH,
        spinning_friction=lever,
        rate=0.25,
    )


UNWIND_STIFFNESS = 2e-6
UNWIND_TWIST = 5.0
UNWIND_SHARE = 2.0 / 3.0


def unwind(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    # Where the torque GJ tau is used up by friction on the length a.
    length = UNWIND_SHARE * LENGTH
    per_length = UNWIND_STIFFNESS * UNWIND_TWIST / length
    lever = per_length / (MASS / LENGTH * GRAVITY)
    cable = scenes.make_cable(
        twist_stiffness=UNWIND_STIFFNESS, rolling_friction=lever, angular_damping=50.0
    )
    state = scenes.straight(segment_count, (0, 0, RADIUS), (0, 1, 0))
    middles = scenes.lengthwise(segment_count)
    state = dataclasses.replace(state, roll=(UNWIND_TWIST * middles)[None])
    rollout = make(segment_count, dt).rollout(
        cable, scenes.hold((0, 0, RADIUS)), state, duration=30.0, sample_dt=30.0
    )
    s = np.linspace(0.0, LENGTH, 200)

    def law(s):
        slid = np.maximum(s - (LENGTH - length), 0.0)
        return UNWIND_TWIST * (s - 0.5 * slid**2 / length)

    roll = rollout.final_state.roll[0]
    return Measured(
        outcomes=(
            Outcome(
                quantity="roll left at the free end",
                unit="rad",
                exact=float(law(middles[-1])),
                computed=float(roll[-1]),
            ),
            Outcome(
                quantity="roll where nothing moved",
                unit="rad",
                exact=float(law(middles[segment_count // 4])),
                computed=float(roll[segment_count // 4]),
            ),
        ),
        curves=(Curve(x=s, exact=law(s), x_computed=middles, computed=roll),),
    )


CASES = (
    Case(
        name="slip_to_roll",
        title="A cable pushed sideways ends up rolling",
        theory=(
            "A solid cylinder that is thrown sideways without spin slides, slowed by μ g and spun "
            "up, until it rolls without slipping at two thirds of its speed, after v / (3 μ g). "
            "Without twist stiffness the grip does not keep segments from rolling."
        ),
        parameters=("lateral_friction",),
        tolerance=1e-2,
        reason="the end of slipping falls between two steps",
        measure=slip_to_roll,
        segment_count=16,
        dt=2.5e-4,
        x_label="time [s]",
        y_label="distance [m]",
    ),
    Case(
        name="oblique_slip_to_roll",
        title="A cable pushed obliquely slides along itself while it begins to roll",
        theory=(
            "A solid cylinder is thrown at 45 deg to its axis. Friction opposes the velocity of "
            "its contact, s along and q across, and slows q three times as much, as it yields "
            "and turns. So q falls as s³, and the time is ∫ √(1 + (s / v)⁴) ds / (μ g). It ends "
            "rolling at two thirds of its speed across."
        ),
        parameters=("lateral_friction",),
        tolerance=1e-2,
        reason="as for the cable that is pushed sideways",
        measure=oblique_slip_to_roll,
        segment_count=16,
        dt=2.5e-4,
        x_label="time [s]",
        y_label="distance [m]",
    ),
    Case(
        name="roll_to_stop",
        title="A rolling cable is stopped by rolling friction",
        theory=(
            "Rolling friction with lever arm ρ is a torque ρ N. A solid cylinder that rolls "
            "without slipping is slowed by 2 ρ g / (3 R) and stops after 3 R v² / (4 ρ g)."
        ),
        parameters=("rolling_friction",),
        tolerance=1e-2,
        reason="friction acts once a step: its share of a stop is one step in a thousand",
        measure=roll_to_stop,
        segment_count=16,
        x_label="time [s]",
        y_label="distance [m]",
    ),
    Case(
        name="spun_rod",
        title="A straight stiff cable is spun down by spinning friction",
        theory=(
            "Spinning friction with lever arm σ is a torque σ N about the vertical, on every "
            "segment. Without Coulomb friction a rod that turns about its end is slowed by "
            "3 σ g / L². The grip turns it with just that deceleration, so that no moment may be "
            "left at the grip, and the tip lags by 7 σ m g L² / (120 EI) (beam theory: a uniform "
            "couple is a force at the tip)."
        ),
        parameters=("spinning_friction",),
        tolerance=1e-2,
        reason="as for the rod that Coulomb friction stops",
        measure=spun_rod,
        segment_count=40,
        dt=1e-4,
        x_label="distance from the grip [m]",
        y_label="lead [mm]",
    ),
    Case(
        name="unwind",
        title="A twisted cable unwinds as far as rolling friction lets it",
        theory=(
            "A cable with a uniform twist τ lies on the table without Coulomb friction, clamped at "
            "the grip. Its free end unwinds until friction's torque per length, q = ρ m g / L, "
            "has taken up the torque: over the last a = GJ τ / q, by τ a / 2 at the end. The rest "
            "keeps its twist. Angular damping is high, so that nothing overshoots."
        ),
        parameters=("twist_stiffness", "rolling_friction"),
        tolerance=1e-2,
        reason="the last segment has half a cell; damping leaves an overshoot below 1 %",
        measure=unwind,
        segment_count=40,
        dt=1e-3,
        x_label="distance from the grip [m]",
        y_label="roll [rad]",
    ),
)
