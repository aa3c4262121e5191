"""Motion without the table: free flight, and the balance of energy in a swing."""

import numpy as np

from benchmarks.validation import scenes
from benchmarks.validation.case import Case, Curve, MakeEngine, Measured, Outcome
from benchmarks.validation.scenes import LENGTH, MASS
from cablecast.engines.base import GRAVITY

SPIN = 12.0
FLIGHT_TIME = 1.0
TOSS = np.array([0.3, 0.0, 2.0])
START = np.array([0.0, 0.0, 6.0])


def tumbling(times, from_centre: float):
    """Return a point of the flying cable [m], shape [step, 3].

    Args:
        times: Times [s], shape [step].
        from_centre: Distance of the point beyond the centre of mass [m].
    """
    t = np.asarray(times, dtype=float)[..., None]
    flight = START + TOSS * t - 0.5 * np.array([0, 0, GRAVITY]) * t**2
    angle = SPIN * t[..., 0]
    along = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=-1)
    return flight + from_centre * along


def free_flight(make: MakeEngine, segment_count: int, dt: float) -> Measured:
    cable = scenes.make_cable()

    # The near node has half a segment's mass, but the grip carries it: the centre of what is free
    # to fly lies a little beyond the middle.
    masses = scenes.node_masses(cable, segment_count)
    s = np.linspace(0.0, LENGTH, segment_count + 1)
    centre = float((masses * s).sum() / masses.sum())

    def at(times, distance):
        return tumbling(times, distance - centre)

    state = scenes.straight(segment_count, at(0.0, 0.0), (1, 0, 0), TOSS)
    middle = at(0.0, centre)
    state = scenes.turning(state, -SPIN, (0, 1, 0), middle)
    sample_dt = 0.01
    rollout = make(segment_count, dt).rollout(
        cable,
        scenes.fitted(lambda t: at(t, 0.0), FLIGHT_TIME, count=400),
        state,
        duration=FLIGHT_TIME,
        sample_dt=sample_dt,
        record_nodes=True,
    )
    assert rollout.nodes is not None
    nodes, times = rollout.nodes[0], rollout.times
    mean = np.einsum("n,snc->sc", masses, nodes) / masses.sum()
    # Momentum and spin from the first and the last sample interval, the flight between them.
    velocity = np.diff(mean, axis=0) / sample_dt
    relative = nodes - mean[:, None]
    angle = np.unwrap(np.arctan2(relative[:, -1, 2], relative[:, -1, 0]))
    exact = at(times, LENGTH)
    last = len(times) - 1
    span = (last - 1) * sample_dt
    distance = np.linalg.norm(nodes[-1, -1] - exact[-1])
    # Straight and in the plane, the rotation about the centre of mass is one angle; its rate over
    # a step is the angular momentum over the moment of inertia.
    inertia = (masses * ((nodes - mean[:, None]) ** 2).sum(2)).sum(1)
    momentum = inertia[1:] * np.diff(angle) / sample_dt
    fine = np.linspace(0.0, FLIGHT_TIME, 400)
    path = at(fine, LENGTH)
    return Measured(
        outcomes=(
            Outcome(
                quantity=f"distance of the far end from its path after {FLIGHT_TIME:g} s",
                unit="m",
                exact=0.0,
                computed=float(distance),
                scale=LENGTH,
            ),
            Outcome(
                quantity="vertical momentum lost, over weight and time",
                unit="-",
                exact=1.0,
                computed=float((velocity[0, 2] - velocity[-1, 2]) / (GRAVITY * span)),
            ),
            Outcome(
                quantity="horizontal momentum at the end",
                unit="mN·s",
                exact=1e3 * MASS * TOSS[0],
                computed=float(1e3 * MASS * velocity[-1, 0]),
            ),
            Outcome(
                quantity="angular momentum at the end, over that at the start",
                unit="-",
                exact=1.0,
                computed=float(momentum[-1] / momentum[0]),
            ),
        ),
        curves=(
            Curve(
                x=path[:, 0],
                exact=path[:, 2],
                x_computed=nodes[::2, -1, 0],
                computed=nodes[::2, -1, 2],
            ),
        ),
    )


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
    assert rollout.nodes is not None
    clamp = (1.0, 0.0, 0.0)
    kinetic, potential = scenes.energies(rollout.nodes[0], dt, cable, clamp)
    total = kinetic + potential
    turned = float(np.max(kinetic))
    times = rollout.times[1:] - 0.5 * dt
    few = slice(None, None, max(1, len(times) // 60))
    drift = total - total[0]
    worst = drift[np.argmax(np.abs(drift))]
    return Measured(
        outcomes=(
            Outcome(
                quantity="largest change of the total, over the largest kinetic energy",
                unit="-",
                exact=0.0,
                computed=float(worst) / turned,
                scale=1.0,
            ),
        ),
        curves=(
            Curve(
                label="total",
                x=times,
                exact=np.zeros_like(times),
                x_computed=times[few],
                computed=1e3 * (total - total[0])[few],
            ),
            Curve(
                label="kinetic (line: what weight and bending gave)",
                x=times,
                exact=1e3 * (potential[0] - potential + kinetic[0]),
                x_computed=times[few],
                computed=1e3 * kinetic[few],
            ),
        ),
    )


CASES = (
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
