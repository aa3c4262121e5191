"""Grip paths: the gripper's pose over time as piecewise polynomials, and how paths are built.

`GripPath` is the only description of a motion that passes from planning to execution: engines
evaluate it inside their step, rigs at the robot's control ticks, and measured paths are fitted to
it. `Profiles` are jerk-limited moves from rest to rest (section V-B). `PlanePath` builds the paths
of the reset and of polar casting.
"""

import dataclasses
import functools
import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import InputError

PHASE_COUNT = 7
"""Number of constant-jerk phases of a rest-to-rest move. Those of constant acceleration last 0 s,
since acceleration is unlimited."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Profiles:
    """Rest-to-rest moves from 0, one per row, in phases of constant jerk.

    Attributes:
        durations: Duration of each phase [s], shape [move, 7].
        jerks: Jerk of each phase [rad/s³], same shape.
    """

    durations: NDArray[np.float64]
    jerks: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.durations)

    @functools.cached_property
    def knots(self) -> NDArray[np.float64]:
        """Times at which the jerk switches, from 0 to the end [s], shape [move, 8]."""
        start = np.zeros((len(self), 1))
        return np.concatenate([start, np.cumsum(self.durations, axis=1)], axis=1)

    @property
    def duration(self) -> NDArray[np.float64]:
        """Duration of each move [s], shape [move]."""
        return self.knots[:, -1]

    @property
    def peak_velocity(self) -> NDArray[np.float64]:
        """Peak speed of each move [rad/s], shape [move]; by symmetry, the speed halfway."""
        return np.abs(self.evaluate(self.duration[:, None] / 2)[1][:, 0])

    def dilated(self, factor: NDArray[np.float64]) -> "Profiles":
        """Return the moves slowed down by a factor of all times, at least 1 [-], shape [move]."""
        factor = factor[:, None]
        return Profiles(durations=self.durations * factor, jerks=self.jerks / factor**3)

    def evaluate(
        self, times: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return position [rad], velocity and acceleration, each of shape [move, step].

        The moves are at rest before the start and after the end. `times` since the start of each
        move [s] have the same shape.
        """
        knots = self.knots
        position, velocity, acceleration = self._states
        times = np.clip(times, 0.0, knots[:, -1:])
        phase = np.zeros(times.shape, dtype=np.intp)
        for column in range(1, PHASE_COUNT):
            phase += times >= knots[:, column : column + 1]
        p, v, a, j, start = (
            np.take_along_axis(values, phase, axis=1)
            for values in (position, velocity, acceleration, self.jerks, knots)
        )
        t = times - start
        return (p + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2), a + t * j)

    @functools.cached_property
    def _states(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return position, velocity and acceleration at each knot, each of shape [move, 8]."""
        p, v, a = np.zeros((3, len(self), PHASE_COUNT + 1))
        for phase in range(PHASE_COUNT):
            t, j = self.durations[:, phase], self.jerks[:, phase]
            p0, v0, a0 = p[:, phase], v[:, phase], a[:, phase]
            p[:, phase + 1] = p0 + t * (v0 + t * (a0 / 2 + t * j / 6))
            v[:, phase + 1] = v0 + t * (a0 + t * j / 2)
            a[:, phase + 1] = a0 + t * j
        return p, v, a


def plan_profiles(
    distances: NDArray[np.float64], velocities: NDArray[np.float64], jerks: NDArray[np.float64]
) -> Profiles:
    """Plan the fastest rest-to-rest moves within limits of velocity and jerk (section V-B).

    ruckig plans without a limit of acceleration, so that only the jerk switches. Only the phases
    are read from it: nothing is sampled in Python.

    Args:
        distances: Signed distances [rad], shape [move].
        velocities: Velocity limit of each move [rad/s], shape [move].
        jerks: Jerk limit of each move [rad/s³], shape [move].

    Raises:
        InputError: ruckig finds no plan because a distance or a limit is invalid.
    """
    import ruckig

    planner = ruckig.Ruckig(1)
    request = ruckig.InputParameter(1)
    request.max_acceleration = [float("inf")]
    trajectory = ruckig.Trajectory(1)
    # Plan all moves forwards and then mirror them, so that mirrored moves are bit-identical. A grid
    # of actions has few distinct moves; each is planned once.
    moves, inverse = np.unique(
        np.stack([np.abs(distances), velocities, jerks], axis=1), axis=0, return_inverse=True
    )
    planned = np.zeros((len(moves), 2, PHASE_COUNT))
    for row, (distance, velocity, jerk) in enumerate(moves.tolist()):
        if distance == 0.0:
            continue
        request.target_position = [distance]
        request.max_velocity = [velocity]
        request.max_jerk = [jerk]
        try:
            planner.calculate(request, trajectory)
        except ruckig.RuckigError as error:
            raise InputError(
                f"no profile over {distance} rad at {velocity} rad/s and {jerk} rad/s³: "
                + str(error).strip()
            ) from None
        profile = trajectory.profiles[0][0]
        planned[row, 0] = profile.t
        planned[row, 1] = profile.j
    planned = planned[inverse.reshape(-1)]
    return Profiles(durations=planned[:, 0], jerks=planned[:, 1] * np.sign(distances)[:, None])


CHANNELS = ("x", "y", "z", "yaw", "pitch")
DEGREE = 5

# Hermite basis of degree five: coefficients of (value, velocity, acceleration) at the start and at
# the end of a piece of unit duration, in ascending powers.
_HERMITE = np.array(
    [
        [1, 0, 0, 0, 0, 0],
        [0, 1, 0, 0, 0, 0],
        [0, 0, 0.5, 0, 0, 0],
        [-10, -6, -1.5, 10, -4, 0.5],
        [15, 8, 1.5, -15, 7, -1],
        [-6, -3, -0.5, 6, -3, 0.5],
    ]
)


LEVEL = 0.02
"""Turn about the cable up to which a gripper counts as level [rad]: a real one tilts a little."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class GripPath:
    """Gripper pose over time, constant before the first and after the last knot.

    Attributes:
        knots: Boundaries of the pieces, ascending; a row may repeat its last knot as padding [s],
            shape [world, piece + 1].
        coefficients: Coefficient of each power of the time since the start of the piece, for
            x, y, z [m], yaw and pitch [rad], shape [world, piece, 5, 6].
        roll: The same for the angle by which the gripper has turned about the cable's direction,
            against a frame that the direction carries along without turning [rad], shape [world,
            piece, 6]. None where it does not turn.
    """

    knots: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    roll: NDArray[np.float64] | None = None

    def __post_init__(self):
        world_count, knot_count = self.knots.shape
        shape = (world_count, knot_count - 1, len(CHANNELS), DEGREE + 1)
        if self.coefficients.shape != shape or knot_count < 2:
            raise InputError(
                f"coefficients have shape {self.coefficients.shape}: the knots require {shape}"
            )
        if self.roll is not None and self.roll.shape != (*shape[:2], shape[-1]):
            raise InputError(
                f"roll has shape {self.roll.shape}: the knots require {shape[:2]} + [6]"
            )
        roll = self.roll if self.roll is not None else np.zeros(1)
        if not all(np.all(np.isfinite(k)) for k in (self.knots, self.coefficients, roll)):
            raise InputError("a grip path must be finite")
        if np.any(np.diff(self.knots, axis=1) < 0):
            raise InputError("the knots of a grip path must not decrease")

    def __len__(self) -> int:
        return len(self.knots)

    def __getitem__(self, index) -> "GripPath":
        """Return the worlds selected by an index, a slice or a mask, always as a batch."""
        if isinstance(index, (int, np.integer)):
            index = [int(index)]
        roll = None if self.roll is None else self.roll[index]
        return GripPath(knots=self.knots[index], coefficients=self.coefficients[index], roll=roll)

    def without_padding(self) -> "GripPath":
        """Return the same motions without the trailing pieces that are padding in every row."""
        moves = np.flatnonzero(np.any(np.diff(self.knots, axis=1) > 0.0, axis=0))
        count = 1 + int(moves.max(initial=0))
        roll = None if self.roll is None else self.roll[:, :count]
        return GripPath(
            knots=self.knots[:, : count + 1], coefficients=self.coefficients[:, :count], roll=roll
        )

    @property
    def duration(self) -> NDArray[np.float64]:
        """End time of each motion [s], shape [world]."""
        return self.knots[:, -1]

    def evaluate(self, times: ArrayLike, derivative: int = 0) -> NDArray[np.float64]:
        """Return the poses, or their time derivatives, at given times.

        Args:
            times: Times [s], shape [step] for all worlds or [world, step] per world.
            derivative: 0 for poses, 1 for velocities, 2 for accelerations and so on.

        Returns:
            x, y, z [m], yaw and pitch [rad] (or per s^derivative), shape [world, step, 5].
        """
        times = np.asarray(times, dtype=float)
        times = np.broadcast_to(times, (len(self), times.shape[-1]))
        clamped = np.clip(times, self.knots[:, :1], self.knots[:, -1:])
        piece = np.empty(times.shape, dtype=int)
        for world, row in enumerate(self.knots):
            piece[world] = np.searchsorted(row[1:-1], clamped[world], side="right")
        world = np.arange(len(self))[:, None]
        # The end time may fall on a padding piece of zero duration; step back from it.
        last = np.argmax(self.knots >= self.knots[:, -1:], axis=1)[:, None] - 1
        piece = np.minimum(piece, np.maximum(last, 0))
        local = (clamped - self.knots[world, piece])[..., None]
        coefficients = self.coefficients[world, piece]
        value = _derivative(coefficients, local, derivative)
        if derivative:
            outside = (times < self.knots[:, :1]) | (times > self.knots[:, -1:])
            value[outside] = 0.0
        return value

    def mirrored(self) -> "GripPath":
        """Return the motion mirrored about the workspace axis (x and yaw change sign)."""
        coefficients = self.coefficients.copy()
        coefficients[:, :, [0, 3]] *= -1.0
        roll = None if self.roll is None else -self.roll
        return GripPath(knots=self.knots.copy(), coefficients=coefficients, roll=roll)

    @property
    def is_level(self) -> bool:
        """True if the gripper's side stays as level as at the start (`levelled`), to `LEVEL`."""
        turn, wanted = (path._rolls(0)[..., 0] for path in (self, self.levelled()))
        return bool(np.allclose(turn, wanted, rtol=0.0, atol=LEVEL))

    def levelled(self) -> "GripPath":
        """Return the motion of a gripper whose side stays level, as that of an arm with a yaw does.

        Where the direction points up or down, a turn of the yaw is a turn about the cable: the roll
        is the integral of -sin(pitch) d yaw, a quintic in each piece.
        """
        h = np.diff(self.knots, axis=1)

        def rates(local: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            """Return the first and second derivative of the roll at a time within each piece."""
            (yaw1, yaw2), (pitch, pitch1) = (
                [_derivative(self.coefficients[:, :, channel], local, k) for k in orders]
                for channel, orders in ((3, (1, 2)), (4, (0, 1)))
            )
            return (-np.sin(pitch) * yaw1, -np.cos(pitch) * pitch1 * yaw1 - np.sin(pitch) * yaw2)

        points, weights = np.polynomial.legendre.leggauss(8)
        turned = sum(
            0.5 * weight * h * rates(0.5 * (1.0 + point) * h)[0]
            for point, weight in zip(points, weights, strict=True)
        )
        if not np.any(turned):
            return dataclasses.replace(self, roll=None)
        roll = np.pad(np.cumsum(turned, axis=1), ((0, 0), (1, 0)))
        starts, ends = rates(np.zeros_like(h)), rates(h)
        return dataclasses.replace(
            self,
            roll=_hermite(h, (roll[:, :-1], starts[0], starts[1]), (roll[:, 1:], ends[0], ends[1])),
        )

    @classmethod
    def from_hermite(
        cls, knots: ArrayLike, poses: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike
    ) -> "GripPath":
        """Make quintic pieces that match pose, velocity and acceleration at both ends.

        Args:
            knots: Times [s], shape [world, piece + 1].
            poses: x, y, z, yaw, pitch at the knots, shape [world, piece + 1, 5].
            velocities: Their first derivatives, same shape.
            accelerations: Their second derivatives, same shape. If they jump at knots, the values
                at the start and at the end of each piece, shape [world, piece, 2, 5].
        """
        knots = np.atleast_2d(np.asarray(knots, dtype=float))
        p, v, a = (np.asarray(k, dtype=float) for k in (poses, velocities, accelerations))
        if a.ndim == 3:
            a = np.stack([a[:, :-1], a[:, 1:]], axis=2)
        h = np.diff(knots, axis=1)[..., None]
        coefficients = _hermite(
            np.broadcast_to(h, (*h.shape[:2], len(CHANNELS))),
            (p[:, :-1], v[:, :-1], a[:, :, 0]),
            (p[:, 1:], v[:, 1:], a[:, :, 1]),
        )
        return cls(knots=knots, coefficients=coefficients)

    @classmethod
    def fit(cls, times: ArrayLike, poses: ArrayLike, roll: ArrayLike | None = None) -> "GripPath":
        """Fit a smooth path through measured poses (not-a-knot cubic spline), for one world.

        Args:
            times: At least four ascending times [s], shape [step].
            poses: x, y, z [m], yaw, pitch [rad], shape [step, 5].
            roll: Turn about the cable [rad], shape [step]; none by default.
        """
        from scipy.interpolate import CubicSpline

        times = np.asarray(times, dtype=float)
        if times.ndim != 1 or len(times) < 4:
            raise InputError(f"fitting a grip path needs at least 4 times, not {times.shape}")
        turn = np.zeros(len(times)) if roll is None else np.asarray(roll, dtype=float)
        spline = CubicSpline(times, np.column_stack([np.asarray(poses, dtype=float), turn]))
        fitted = np.zeros((1, len(times) - 1, len(CHANNELS) + 1, DEGREE + 1))
        fitted[0, :, :, :4] = np.moveaxis(spline.c[::-1], 0, -1)
        return cls(
            knots=times[None],
            coefficients=fitted[:, :, : len(CHANNELS)],
            roll=None if roll is None else fitted[:, :, -1],
        )

    @classmethod
    def hold(cls, pose: ArrayLike, duration: float) -> "GripPath":
        """Return a path, for one world, that holds x, y, z [m], yaw, pitch [rad] for a time [s]."""
        coefficients = np.zeros((1, 1, len(CHANNELS), DEGREE + 1))
        coefficients[0, 0, :, 0] = np.asarray(pose, dtype=float)
        return cls(knots=np.array([[0.0, duration]]), coefficients=coefficients)

    @classmethod
    def stack(cls, paths: Sequence["GripPath"]) -> "GripPath":
        """Stack several batches into one, padded to the longest."""
        piece_count = max(path.coefficients.shape[1] for path in paths)
        counts = np.cumsum([0, *(len(path) for path in paths)])
        coefficients = np.zeros((counts[-1], piece_count, len(CHANNELS), DEGREE + 1))
        knots, rolls = [], []
        for path, first, last in zip(paths, counts, counts[1:], strict=False):
            pieces = path.coefficients.shape[1]
            pad = piece_count - pieces
            knots.append(np.pad(path.knots, ((0, 0), (0, pad)), mode="edge"))
            coefficients[first:last, :pieces] = path.coefficients
            coefficients[first:last, pieces:, :, 0] = path.evaluate(path.duration[:, None])
            rolls.append(path._rolls(pad))
        return cls(
            knots=np.concatenate(knots),
            coefficients=coefficients,
            roll=None if all(p.roll is None for p in paths) else np.concatenate(rolls),
        )

    def _rolls(self, pad: int) -> NDArray[np.float64]:
        """Return the coefficients of the roll, with some pieces that hold its end."""
        world_count, piece_count = self.coefficients.shape[:2]
        rolls = np.zeros((world_count, piece_count + pad, DEGREE + 1))
        if self.roll is not None:
            rolls[:, :piece_count] = self.roll
            last = self.knots[:, -1] - self.knots[:, -2]
            rolls[:, piece_count:, 0] = _derivative(self.roll[:, -1], last, 0)[:, None]
        return rolls


def _derivative(
    coefficients: NDArray[np.float64], local: NDArray[np.float64], order: int
) -> NDArray[np.float64]:
    """Return a derivative of polynomials, coefficients lowest first, shape [..., 6], at a time."""
    value = np.zeros(coefficients.shape[:-1])
    for power in range(DEGREE, order - 1, -1):
        factor = np.prod(np.arange(power, power - order, -1), dtype=float)
        value = value * local + factor * coefficients[..., power]
    return value


_Ends = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def _hermite(duration: NDArray[np.float64], start: _Ends, end: _Ends) -> NDArray[np.float64]:
    """Return quintics that match value, velocity and acceleration at both ends, [..., 6].

    Pieces of no duration hold their value.
    """
    ends = [value * duration**k for side in (start, end) for k, value in enumerate(side)]
    unit = np.einsum("ij,...j->...i", _HERMITE, np.stack(ends, axis=-1))
    powers = np.arange(DEGREE + 1)
    unit /= np.where(duration > 0, duration, 1.0)[..., None] ** powers
    return np.where((duration <= 0)[..., None] & (powers > 0), 0.0, unit)


COORDINATES = ("azimuth", "radius", "height", "turn", "pitch")

PIECE_DURATION = 0.1
"""Longest piece of a path [s]. A quintic that matches pose, velocity and acceleration at both ends
follows the turning plane to within 1 um at 2 rad/s (tests/motion/test_plane_path.py)."""

# Minimum-jerk move from 0 to 1 over unit time, from rest to rest.
SMOOTH = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])


class PlanePath:
    """Grip path under construction in a vertical plane that turns about the robot's base.

    Plane coordinates are the azimuth of the plane, radius and height in it, the heading of the
    cable relative to the azimuth, and pitch. Every move is appended and returns the path. It starts
    at a pose x, y, z [m], yaw, pitch [rad], shape [5].
    """

    def __init__(self, pose: ArrayLike):
        x, y, z, yaw, pitch = (float(value) for value in np.asarray(pose, dtype=float))
        azimuth = float(np.arctan2(x, y))
        self._times = [0.0]
        # Position, velocity and acceleration before and after each knot.
        still = np.zeros(len(COORDINATES))
        here = np.array([azimuth, np.hypot(x, y), z, yaw - azimuth, pitch])
        self._before = [np.stack([here, still, still])]
        self._after: list[NDArray[np.float64]] = []

    @property
    def place(self) -> dict[str, float]:
        """Coordinates at the current end of the path, by name [m], [rad]."""
        return dict(zip(COORDINATES, self._before[-1][0].tolist(), strict=True))

    def hold(self, duration: float) -> "PlanePath":
        """Hold the pose for a duration [s]."""
        return self.move(duration) if duration > 0.0 else self

    def move(self, duration: float, **goal: float) -> "PlanePath":
        """Move for a duration [s] with minimum jerk from rest to rest, to new coordinates."""
        start = self._before[-1][0]
        end = start.copy()
        for name, value in goal.items():
            end[COORDINATES.index(name)] = value
        count = max(1, int(np.ceil(duration / PIECE_DURATION)))
        share = np.linspace(0.0, 1.0, count + 1)
        orders = [SMOOTH.deriv(order)(share) / duration**order for order in range(3)]
        states = np.stack(orders, axis=1)[:, :, None] * (end - start)
        states[:, 0] += start
        self._append(share * duration, states)
        return self

    def through(self, times: Sequence[float], **points: Sequence[float]) -> "PlanePath":
        """Move through points from rest to rest, along a cubic spline.

        Args:
            times: Ascending times of the points, counted from the current end of the path [s]. The
                path comes to rest at the last one.
            points: Values of some coordinates at these times [m], [rad]; the others are kept.
        """
        from scipy.interpolate import CubicSpline

        knots = np.concatenate([[0.0], np.asarray(times, dtype=float)])
        if np.any(np.diff(knots) <= 0):
            raise InputError(f"times {list(times)} must ascend and be above 0")
        values = np.repeat(self._before[-1][:1], len(knots), axis=0)
        for name, row in points.items():
            values[1:, COORDINATES.index(name)] = row
        spline = CubicSpline(knots, values, bc_type="clamped")
        parts = [
            np.linspace(low, high, max(1, int(np.ceil((high - low) / PIECE_DURATION))) + 1)[1:]
            for low, high in itertools.pairwise(knots)
        ]
        at = np.concatenate([[0.0], *parts])
        states = np.stack([spline(at, order) for order in range(3)], axis=1)
        self._append(at, states)
        return self

    def _append(self, at: NDArray[np.float64], states: NDArray[np.float64]) -> None:
        self._times += (self._times[-1] + at[1:]).tolist()
        self._after += list(states[:-1])
        self._before += list(states[1:])

    def grip_path(self) -> GripPath:
        """Return the path so far as one row."""
        if not self._after:
            raise InputError("a path needs at least one move")
        after = [*self._after, self._before[-1]]
        poses, velocities, ends = _to_base(np.stack(self._before))
        _, _, starts = _to_base(np.stack(after))
        # Accelerations jump at some knots; poses and velocities do not.
        accelerations = np.stack([starts[:-1], ends[1:]], axis=1)
        knots = np.array(self._times)
        return GripPath.from_hermite(
            knots[None], poses[None], velocities[None], accelerations[None]
        ).levelled()


def _to_base(states: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return pose, velocity and acceleration in the base frame, each of shape [knot, 5]."""
    (a, da, dda), (r, dr, ddr), (z, dz, ddz), (t, dt, ddt), (p, dp, ddp) = states.transpose(2, 1, 0)
    sin, cos = np.sin(a), np.cos(a)
    radial, across = ddr - r * da**2, r * dda + 2.0 * dr * da
    return (
        np.stack([r * sin, r * cos, z, a + t, p], axis=1),
        np.stack([dr * sin + r * da * cos, dr * cos - r * da * sin, dz, da + dt, dp], axis=1),
        np.stack(
            [radial * sin + across * cos, radial * cos - across * sin, ddz, dda + ddt, ddp], axis=1
        ),
    )
