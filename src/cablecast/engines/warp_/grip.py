"""Held ends: the gripper's polynomial path, evaluated inside the step."""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def grip_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp functions that follow a path."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, sin_cos, mul = f.real, f.lane, f.sin_cos, f.mul
    Path = s.Path
    count = wp.constant(lane_count)
    never = wp.constant(1.0e30)

    @wp.func
    def start(path: Path, group: int):
        """Take the direction and the roll of a held end at time 0."""
        advance_pieces(path, group, real(0.0))
        piece_t = piece_time(path, group, real(0.0))
        path.direction[group] = direction(path, group, piece_t)
        path.next_direction[group] = path.direction[group]
        path.roll[group] = channel(path, group, 5, piece_t)

    @wp.func
    def follow(path: Path, group: int, t: real, dt: real):
        """Move a held end on by a step; `Path` tells which of its values are of when.

        Args:
            path: Path whose current values are updated.
            t: Time at the end of the step [s].
            dt: Step [s].
        """
        if t >= path.next_knot[group]:
            advance_pieces(path, group, t)
        piece_t = piece_time(path, group, t)
        inverse_dt = real(1.0) / dt
        path.position[group] = wp.matrix_from_rows(
            channel(path, group, 0, piece_t),
            channel(path, group, 1, piece_t),
            channel(path, group, 2, piece_t),
        )
        new_direction = path.next_direction[group]
        path.direction_rate[group] = (new_direction - path.direction[group]) * inverse_dt
        path.direction[group] = new_direction
        path.next_direction[group] = direction(path, group, piece_t)
        roll = channel(path, group, 5, piece_t)
        path.previous_spin[group] = path.spin[group]
        path.spin[group] = (roll - path.roll[group]) * inverse_dt
        path.roll[group] = roll

    @wp.func
    def advance_pieces(path: Path, group: int, t: real):
        """Make the pieces that hold at time t [s] current, lane by lane.

        It runs only when the first lane passes a knot, a few times in a hundred steps, so that the
        step itself reads contiguous lanes.
        """
        row_count = path.knots.shape[0]
        piece_count = path.coefficients.shape[1]
        piece_start = lane()
        duration = lane()
        next_knot = real(never)
        for k in range(count):
            row = wp.min(group * count + k, row_count - 1)
            piece = path.piece[group, k]
            while piece < piece_count - 1 and t >= path.knots[row, piece + 1]:
                piece += 1
            path.piece[group, k] = piece
            piece_start[k] = path.knots[row, piece]
            duration[k] = path.knots[row, piece + 1] - path.knots[row, piece]
            if piece < piece_count - 1:
                next_knot = wp.min(next_knot, path.knots[row, piece + 1])
        path.piece_start[group] = piece_start
        path.piece_duration[group] = duration
        path.next_knot[group] = next_knot
        for c in range(36):
            value = lane()
            for k in range(count):
                row = wp.min(group * count + k, row_count - 1)
                value[k] = path.coefficients[row, path.piece[group, k], c]
            path.current[group, c] = value

    @wp.func
    def piece_time(path: Path, group: int, t: real):
        """Return the time since the current pieces began, within their bounds, at time t [s]."""
        since = lane(t) - path.piece_start[group]
        return f.smaller(f.larger(since, lane()), path.piece_duration[group])

    @wp.func
    def channel(path: Path, group: int, index: int, piece_t: lane):
        """Return one channel of the current pieces: x, y, z [m], yaw, pitch or roll [rad].

        Args:
            path: Path.
            index: Index of the channel, 0 to 5.
            piece_t: Time since the pieces began [s].
        """
        c = index * 6
        value = path.current[group, c + 5]
        value = mul(value, piece_t) + path.current[group, c + 4]
        value = mul(value, piece_t) + path.current[group, c + 3]
        value = mul(value, piece_t) + path.current[group, c + 2]
        value = mul(value, piece_t) + path.current[group, c + 1]
        return mul(value, piece_t) + path.current[group, c]

    @wp.func
    def direction(path: Path, group: int, piece_t: lane):
        """Return the unit direction in which the cable leaves the gripper (conventions.tangent).

        Args:
            path: Path.
            piece_t: Time since the pieces began [s].
        """
        yaw = sin_cos(channel(path, group, 3, piece_t))
        pitch = sin_cos(channel(path, group, 4, piece_t))
        return wp.matrix_from_rows(mul(yaw[0], pitch[1]), mul(yaw[1], pitch[1]), pitch[0])

    return SimpleNamespace(start=start, follow=follow)
