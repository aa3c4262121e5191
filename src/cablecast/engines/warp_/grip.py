"""Held ends: evaluate the polynomial path of the gripper inside the step."""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def grip_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Warp functions that follow a path."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, sin_cos, mul = f.real, f.lane, f.sin_cos, f.mul
    Path = s.Path
    count = wp.constant(lane_count)
    never = wp.constant(1.0e30)

    @wp.func
    def advance_pieces(path: Path, group: int, t: real):
        """Make the pieces that hold at time t current, lane by lane.

        It runs only when the first lane passes a knot, a few times in a hundred steps, so that the
        step itself reads contiguous lanes.
        """
        row_count = path.knots.shape[0]
        piece_count = path.coefficients.shape[1]
        start = lane()
        duration = lane()
        next_knot = real(never)
        for k in range(count):
            row = wp.min(group * count + k, row_count - 1)
            piece = path.piece[group, k]
            while piece < piece_count - 1 and t >= path.knots[row, piece + 1]:
                piece += 1
            path.piece[group, k] = piece
            start[k] = path.knots[row, piece]
            duration[k] = path.knots[row, piece + 1] - path.knots[row, piece]
            if piece < piece_count - 1:
                next_knot = wp.min(next_knot, path.knots[row, piece + 1])
        path.piece_start[group] = start
        path.piece_duration[group] = duration
        path.next_knot[group] = next_knot
        for c in range(30):
            value = lane()
            for k in range(count):
                row = wp.min(group * count + k, row_count - 1)
                value[k] = path.coefficients[row, path.piece[group, k], c]
            path.current[group, c] = value

    @wp.func
    def horner(path: Path, group: int, channel: int, tau: lane):
        """One channel of the current pieces at local time tau."""
        c = channel * 6
        value = path.current[group, c + 5]
        value = mul(value, tau) + path.current[group, c + 4]
        value = mul(value, tau) + path.current[group, c + 3]
        value = mul(value, tau) + path.current[group, c + 2]
        value = mul(value, tau) + path.current[group, c + 1]
        return mul(value, tau) + path.current[group, c]

    @wp.func
    def local_time(path: Path, group: int, t: real):
        """Time since the current pieces began, held at their bounds."""
        tau = lane(t) - path.piece_start[group]
        return wp.min(wp.max(tau, lane()), path.piece_duration[group])

    @wp.func
    def direction(path: Path, group: int, tau: lane):
        """Unit direction in which the cable leaves the gripper (conventions.tangent)."""
        yaw = sin_cos(horner(path, group, 3, tau))
        pitch = sin_cos(horner(path, group, 4, tau))
        return wp.matrix_from_rows(mul(yaw[0], pitch[1]), mul(yaw[1], pitch[1]), pitch[0])

    @wp.func
    def start(path: Path, group: int):
        """Take the direction of a held end at time 0."""
        advance_pieces(path, group, real(0.0))
        tau = local_time(path, group, real(0.0))
        path.direction[group] = direction(path, group, tau)
        path.next_direction[group] = path.direction[group]
        path.yaw[group] = horner(path, group, 3, tau)

    @wp.func
    def follow(path: Path, group: int, t: real, dt: real):
        """Move a held end on to time t, the end of this step.

        It leaves the position at the end of the step, the direction at its start and how fast that
        turned in the step before, and the rates at which the gripper turns about it in both.
        """
        if t >= path.next_knot[group]:
            advance_pieces(path, group, t)
        tau = local_time(path, group, t)
        rate = real(1.0) / dt
        path.position[group] = wp.matrix_from_rows(
            horner(path, group, 0, tau), horner(path, group, 1, tau), horner(path, group, 2, tau)
        )
        here = path.next_direction[group]
        path.turn[group] = (here - path.direction[group]) * rate
        path.direction[group] = here
        path.next_direction[group] = direction(path, group, tau)
        # Yaw turns clockwise about the vertical, of which sin(pitch) lies along the direction.
        yaw = horner(path, group, 3, tau)
        path.spin_before[group] = path.spin[group]
        path.spin[group] = mul(path.yaw[group] - yaw, here[2]) * rate
        path.yaw[group] = yaw

    return SimpleNamespace(start=start, follow=follow)
