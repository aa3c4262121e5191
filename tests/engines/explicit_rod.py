"""The third opinion: a rod whose every equation is as plain as can be, at a step of microseconds.

Springs for edges, a spring for the table, friction regularised at 1 mm/s, symplectic Euler. It
shares nothing with the engines but the equations and the CableState, and is far too slow for use.

Where it rolls, each edge carries a director that turns with its material, so that the twist at a
node is measured as an angle, and not accumulated from rates as in EngineWarp.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import numpy as np
import warp as wp

from cablecast.conventions import tangent
from cablecast.engines.base import reset_state

GRAVITY = 9.81
REFERENCE_SEGMENT_COUNT = 18
GRIP_DT = 1e-4
"""The grip's path is linear in between such times [s]: at 10 m/s² it is right to 12 nm."""


@wp.struct
class Rod:
    segment_length: wp.float64
    node_mass: wp.float64
    last_mass: wp.float64
    bending: wp.float64  # EI / l [N·m]
    friction: wp.float64
    damping: wp.float64
    viscosity: wp.float64  # [kg/s]
    radius: wp.float64
    edge_stiffness: wp.float64  # [N] per strain
    edge_damping: wp.float64  # [kg/s]
    table_stiffness: wp.float64  # [1/s²]
    table_damping: wp.float64  # [1/s]
    slip_speed: wp.float64  # [m/s]
    cross_share: wp.float64  # 1 for Coulomb's law
    tangent_law: int
    rolls: int
    roll_inertia: wp.float64  # of an edge about its axis [kg·m²]
    end_roll_inertia: wp.float64
    torsion: wp.float64  # GJ / l [N·m]
    spin_damping: wp.float64  # [1/s]
    rolling_friction: wp.float64  # lever arm [m]


@wp.func
def carried(director: wp.vec3d, old: wp.vec3d, new: wp.vec3d):
    """Return a director of the tangent `old`, carried to `new` without turning about it."""
    axis = wp.cross(old, new)
    moved = wp.cross(axis, director)
    return director + moved + wp.cross(axis, moved) / (wp.float64(1.0) + wp.dot(old, new))


@wp.func
def turned(director: wp.vec3d, along: wp.vec3d, angle: wp.float64):
    """Return a director after a small turn about its tangent, normalised and at right angles."""
    out = director + wp.cross(along, director) * angle
    return wp.normalize(out - along * wp.dot(out, along))


@wp.func
def unwrapped(angle: wp.float64, before: wp.float64):
    """Return the angle that differs from the one before by less than half a turn."""
    turn = wp.float64(2.0) * wp.float64(wp.pi)
    return angle + turn * wp.round((before - angle) / turn)


@wp.func
def bending_moment(rod: Rod, cell: wp.float64, sine: wp.float64, cosine: wp.float64):
    """Return the derivative of the bending energy by the angle at a node [N·m].

    The energy is EI phi^2 / (2 l), or that of discrete elastic rods, EI (2 tan(phi / 2))^2 / (2 l).
    """
    moment = wp.atan2(sine, cosine)
    if rod.tangent_law == 1:
        half = sine / wp.max(wp.float64(1.0) + cosine, wp.float64(1e-9))
        moment = wp.float64(2.0) * half * (wp.float64(1.0) + half * half)
    return rod.bending * moment / cell


@wp.kernel(enable_backward=False)
def advance(
    rod: Rod,
    dt: wp.float64,
    step_count: int,
    substeps: int,
    grip: wp.array2d(dtype=wp.vec3d),
    direction: wp.array2d(dtype=wp.vec3d),
    x: wp.array2d(dtype=wp.vec3d),
    v: wp.array2d(dtype=wp.vec3d),
    f: wp.array2d(dtype=wp.vec3d),
    director: wp.array2d(dtype=wp.vec3d),
    old_along: wp.array2d(dtype=wp.vec3d),
    spin: wp.array2d(dtype=wp.float64),
    torque: wp.array2d(dtype=wp.float64),
    twist: wp.array2d(dtype=wp.float64),
):
    world = wp.tid()
    last = x.shape[1] - 1
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    for step in range(step_count):
        k = step // substeps
        part = wp.float64(step - k * substeps + 1) / wp.float64(substeps)
        x[world, 0] = grip[world, k] * (one - part) + grip[world, k + 1] * part
        v[world, 0] = (grip[world, k + 1] - grip[world, k]) / (wp.float64(substeps) * dt)
        held = wp.normalize(direction[world, k] * (one - part) + direction[world, k + 1] * part)
        for i in range(last + 1):
            f[world, i] = wp.vec3d()
        for e in range(last):
            torque[world, e] = zero
        for e in range(last):
            edge = x[world, e + 1] - x[world, e]
            length = wp.length(edge)
            along = edge / length
            rate = v[world, e + 1] - v[world, e]
            stretching = wp.dot(rate, along)
            pull = along * (
                rod.edge_stiffness * (length / rod.segment_length - one)
                + rod.edge_damping * stretching
            )
            pull = pull + (rate - along * stretching) * rod.viscosity
            # The angle at the near end of this edge; half a cell at the grip.
            before = held
            cell = wp.float64(0.5)
            length_before = one
            if e > 0:
                edge_before = x[world, e] - x[world, e - 1]
                length_before = wp.length(edge_before)
                before = edge_before / length_before
                cell = one
            cosine = wp.dot(before, along)
            sine = wp.length(wp.cross(before, along))
            if sine > wp.float64(1e-14):
                moment = bending_moment(rod, cell, sine, cosine)
                after_force = (before - along * cosine) * (moment / (sine * length))
                f[world, e + 1] = f[world, e + 1] + after_force
                f[world, e] = f[world, e] - after_force
                if e > 0:
                    before_force = (along - before * cosine) * (moment / (sine * length_before))
                    f[world, e] = f[world, e] + before_force
                    f[world, e - 1] = f[world, e - 1] - before_force
            f[world, e] = f[world, e] + pull
            f[world, e + 1] = f[world, e + 1] - pull
            if rod.rolls == 1:
                own = carried(director[world, e], old_along[world, e], along)
                own = turned(own, along, spin[world, e] * dt)
                director[world, e] = own
                old_along[world, e] = along
                # The gripper keeps its own director upright.
                neighbour = wp.vec3d(zero, zero, one)
                if e > 0:
                    neighbour = director[world, e - 1]
                brought = carried(neighbour, before, along)
                angle = wp.atan2(wp.dot(along, wp.cross(brought, own)), wp.dot(brought, own))
                angle = unwrapped(angle, twist[world, e])
                twist[world, e] = angle
                moment = rod.torsion * angle / cell
                torque[world, e] = torque[world, e] - moment
                binormal = wp.cross(before, along) * (wp.float64(2.0) / (one + cosine))
                half_moment = binormal * (wp.float64(0.5) * moment)
                f[world, e + 1] = f[world, e + 1] - half_moment / length
                f[world, e] = f[world, e] + half_moment / length
                if e > 0:
                    torque[world, e - 1] = torque[world, e - 1] + moment
                    f[world, e] = f[world, e] - half_moment / length_before
                    f[world, e - 1] = f[world, e - 1] + half_moment / length_before
        for i in range(1, last + 1):
            mass = rod.node_mass
            if i == last:
                mass = rod.last_mass
            vi = v[world, i]
            a = f[world, i] / mass - vi * rod.damping - wp.vec3d(zero, zero, wp.float64(GRAVITY))
            depth = rod.radius - x[world, i][2]
            if depth > zero:
                push = wp.max(rod.table_stiffness * depth - rod.table_damping * vi[2], zero)
                flat = wp.vec3d(vi[0], vi[1], zero)
                # Coulomb's friction opposes the velocity; MuJoCo's only a share of its cross part.
                chord = x[world, wp.min(i + 1, last)] - x[world, i - 1]
                along = wp.normalize(wp.vec3d(chord[0], chord[1], zero))
                flat = flat * rod.cross_share + along * (
                    wp.dot(flat, along) * (one - rod.cross_share)
                )
                after = wp.min(i, last - 1)
                # To the side to which a positive spin rolls the cable.
                side = wp.vec3d(along[1], -along[0], zero)
                if rod.rolls == 1:
                    roll_rate = (spin[world, i - 1] + spin[world, after]) * wp.float64(0.5)
                    flat = flat - side * (rod.radius * roll_rate)
                speed = wp.sqrt(wp.dot(flat, flat) + rod.slip_speed * rod.slip_speed)
                pull = flat * (rod.friction * push / speed)
                a = a + wp.vec3d(zero, zero, push) - pull
                if rod.rolls == 1:
                    slow = rod.slip_speed / rod.radius
                    size = wp.sqrt(roll_rate * roll_rate + slow * slow)
                    resisted = rod.rolling_friction * roll_rate / size
                    gained = (rod.radius * wp.dot(pull, side) - resisted * push) * mass
                    gained = gained * wp.float64(0.5)
                    torque[world, i - 1] = torque[world, i - 1] + gained
                    torque[world, after] = torque[world, after] + gained
            v[world, i] = vi + a * dt
            x[world, i] = x[world, i] + v[world, i] * dt
        if rod.rolls == 1:
            for e in range(last):
                inertia = rod.roll_inertia
                if e == last - 1:
                    inertia = rod.end_roll_inertia
                old = spin[world, e]
                spin[world, e] = old + (torque[world, e] / inertia - old * rod.spin_damping) * dt


def simulate(
    cable,
    params,
    grip_path,
    segment_count,
    dt,
    duration,
    sample_dt=0.1,
    *,
    like_mujoco=False,
    rolls=False,
):
    """Cable shapes from the reset state on [m], shape [world, step, node, 3].

    `like_mujoco` takes the bending energy of discrete elastic rods, and the direction that MuJoCo's
    friction has on a sliding chain: the part of the velocity across the cable counts as divided by
    1 + mu^2. MuJoCo's contact lifts a node that slides, so that it touches for a share of the time
    only and with so much larger forces; their part along the cable is shared by all nodes, the part
    across it stops the node within the contact. Measured on its contact forces: 0.86 for mu = 0.4
    and 0.6 for mu = 0.8, whatever the step and the softness of the contact.

    `rolls` lets segments turn about their axis and roll on the table; without it they only slide.
    """
    x = reset_state(cable.with_params(params), grip_path, segment_count).positions
    segment_length = cable.length / segment_count
    mass = params.mass / segment_count
    diffusivity = params.angular_damping * (cable.length / REFERENCE_SEGMENT_COUNT) ** 2 / 12
    # How easily a contact moves a node's surface across the cable: a cylinder yields and turns.
    lightness = 3.0 if rolls else 1.0
    rod = Rod()
    values = {
        "segment_length": segment_length,
        "node_mass": mass,
        "last_mass": mass / 2 + params.endpoint_mass,
        "bending": params.bend_stiffness / segment_length,
        "friction": params.friction,
        "damping": params.linear_damping,
        "viscosity": diffusivity * mass / segment_length**2,
        "radius": cable.radius,
        "edge_stiffness": 2000.0,
        "edge_damping": 0.1,
        "table_stiffness": 1e6,
        "table_damping": 2e3,
        "slip_speed": 1e-3,
        "tangent_law": int(like_mujoco),
        "cross_share": 1.0 / (1.0 + lightness * params.friction**2) if like_mujoco else 1.0,
        "rolls": int(rolls),
        "roll_inertia": mass * cable.radius**2 / 2,
        "end_roll_inertia": (mass + params.endpoint_mass) * cable.radius**2 / 2,
        "torsion": params.twist_stiffness / segment_length,
        "spin_damping": params.angular_damping,
        "rolling_friction": params.rolling_friction,
    }
    for name, value in values.items():
        setattr(rod, name, value)
    substeps = round(GRIP_DT / dt)
    ticks_per_sample = round(sample_dt / GRIP_DT)
    sample_count = round(duration / sample_dt)
    poses = grip_path.evaluate(np.arange(sample_count * ticks_per_sample + 1) * GRIP_DT)
    directions = tangent(poses[:, :, 3], poses[:, :, 4])

    def device_array(values):
        return wp.array(np.ascontiguousarray(values), dtype=wp.vec3d, device="cpu")

    def device_zeros():
        return wp.zeros((len(x), segment_count), dtype=wp.float64, device="cpu")

    state = [device_array(x), device_array(np.zeros_like(x)), device_array(np.zeros_like(x))]
    along = np.diff(x, axis=1) / segment_length
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    # The reset cable lies in a vertical plane: without twist, every director points up in it.
    upright = np.array([0.0, 0.0, 1.0]) - along * along[..., 2:]
    upright /= np.linalg.norm(upright, axis=-1, keepdims=True)
    state += [device_array(upright), device_array(along)]
    state += [device_zeros() for _ in range(3)]
    shapes = [x]
    for sample in range(sample_count):
        ticks = slice(sample * ticks_per_sample, (sample + 1) * ticks_per_sample + 1)
        wp.launch(
            advance,
            dim=len(x),
            inputs=[
                rod,
                dt,
                ticks_per_sample * substeps,
                substeps,
                device_array(poses[:, ticks, :3]),
                device_array(directions[:, ticks]),
                *state,
            ],
            device="cpu",
        )
        shapes.append(state[0].numpy().copy())
    return np.stack(shapes, axis=1)
