"""Tasks: what a cast is aimed at, what of its path counts, and by how much it misses.

A `Task` reads an outcome of k numbers off the path of the free end. A `Goal` is an outcome that a
cast is to have, within a tolerance; an `Expectation` is the distribution of the outcome before the
cast. `Landing` is the task of the paper: the point at which the free end comes to rest.
"""

import abc
import dataclasses
import functools
import warnings
from collections.abc import Iterable
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.conventions import Array, Ellipse, polar_to_xy, xy_to_polar
from cablecast.errors import InputError, TargetError, check_number
from cablecast.motion.joint_move import JointMoves, SwingPlane
from cablecast.setup import Setup

WITHIN_PCT = 3.0
"""Tolerance of a goal unless another is given [% of cable length]."""

SAME_GOAL = 1e-6
"""Two goals nearer to each other than this are the same, in the unit of their values."""


class Task(abc.ABC):
    """What counts of a cast.

    Attributes:
        name: Name in files and on the command line.
        coordinates: Name of each component of an outcome, shape [k].
        mirror: +1 or -1, the factor of each component in the mirror image of a cast (x -> -x),
            shape [k].
    """

    name: ClassVar[str]
    coordinates: ClassVar[tuple[str, ...]]
    mirror: ClassVar[tuple[float, ...]]

    @abc.abstractmethod
    def scale(self, setup: Setup) -> Array:
        """Return the change of each component that counts as one cable length, shape [k]."""

    @abc.abstractmethod
    def values(
        self, setup: Setup, value: ArrayLike | None = None, **forms: ArrayLike | None
    ) -> Array:
        """Check the values of goals and return them, shape [goal, k].

        Raises:
            InputError: They have the wrong kind or shape.
            TargetError: No cast of this set-up can have such an outcome.
        """

    @abc.abstractmethod
    def outcome(self, path_xy: Array) -> Array:
        """Return the outcome of paths of the free end [m], shape [..., step, 2]; NaN for none."""

    def outcome_at(self, path: Array, value: ArrayLike) -> Array:
        """Return the outcome of paths aimed at a value, shape [k].

        It is `outcome`, unless what counts of a path depends on what it was aimed at.
        """
        return self.outcome(path)

    @abc.abstractmethod
    def lost(self, path_xy: Array, setup: Setup) -> NDArray[np.bool_]:
        """Return which paths [m], shape [..., step, 2], have no outcome that counts, [...]."""

    def mirrored(self, outcome: ArrayLike, side: ArrayLike) -> Array:
        """Return outcomes, shape [..., k], mirrored where `side`, shape [...], is -1."""
        is_odd = np.array(self.mirror) < 0
        return np.asarray(outcome) * np.where(is_odd, np.asarray(side)[..., None], 1.0)

    def side_of(self, value: ArrayLike) -> Array:
        """Return the side that casts with outcomes go to: +1 right, -1 left, shape [...].

        The first component that the mirror image reverses tells; without any it is the right.
        """
        odd = np.asarray(value)[..., np.array(self.mirror) < 0][..., :1]
        return np.where(np.any(odd < 0, axis=-1), -1.0, 1.0)

    def units(self, setup: Setup) -> Array:
        """Return the change of each component that counts as one metre, shape [k]."""
        return self.scale(setup) / setup.cable.length

    def miss(self, outcome: ArrayLike, value: ArrayLike, setup: Setup) -> Array:
        """Return the distance of outcomes from values [cable lengths].

        Both have shape [..., k], the result [...]; NaN where an outcome is.
        """
        offset = np.asarray(outcome, dtype=float) - np.asarray(value, dtype=float)
        count = len(self.coordinates)
        if offset.shape[-1:] != (count,):
            raise InputError(
                f"outcomes of {self.name} have shape {offset.shape}: it must be [..., {count}]"
            )
        return np.asarray(np.linalg.norm(offset / self.scale(setup), axis=-1))

    def goals(
        self,
        setup: Setup,
        value: ArrayLike | None = None,
        *,
        within_pct: float = WITHIN_PCT,
        **forms: ArrayLike | None,
    ) -> tuple["Goal", ...]:
        """Return checked goals; see `values` for the forms that they are given in, and for errors.

        `within_pct` is the tolerance [% of cable length].
        """
        check_number("within_pct", within_pct, 0.01, 100.0, "%")
        found = self.values(setup, value, **forms)
        return tuple(
            Goal(task=self, setup=setup, value=one, within_pct=within_pct) for one in found
        )


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Goal:
    """Outcome that a cast is to have; `Task.goals` makes checked ones.

    Attributes:
        task: Task that reads the outcome off a path.
        setup: Set-up in which it is aimed at.
        value: Outcome, shape [k].
        within_pct: Distance at which a cast has hit [% of cable length].
    """

    task: Task
    setup: Setup
    value: Array
    within_pct: float = WITHIN_PCT

    def miss(self, outcome: ArrayLike) -> Array:
        """Return the distance of outcomes, shape [..., k], from the goal [cable lengths], [...]."""
        return self.task.miss(outcome, self.value, self.setup)

    def hit(self, outcome: ArrayLike) -> NDArray[np.bool_]:
        """Return which outcomes, shape [..., k], are within the tolerance, shape [...]."""
        return np.asarray(100.0 * self.miss(outcome) <= self.within_pct)

    def is_same(self, value: ArrayLike) -> bool:
        """Return whether the goal has a value, shape [k]."""
        return bool(np.linalg.norm(self.value - np.asarray(value, dtype=float)) < SAME_GOAL)


class Landing(Task):
    """The free end comes to rest at a point of the table (paper, section III)."""

    name = "landing"
    coordinates = ("x", "y")
    mirror = (-1.0, 1.0)

    def scale(self, setup: Setup) -> Array:
        """Return the length of the cable for x and y [m], shape [2]."""
        return np.full(2, setup.cable.length)

    def values(
        self,
        setup: Setup,
        value: ArrayLike | None = None,
        *,
        r: ArrayLike | None = None,
        theta_deg: ArrayLike | None = None,
    ) -> Array:
        """Check targets, Cartesian or polar, and return them as x and y.

        Args:
            setup: Table, arm and cable.
            value: Targets [m], shape [2] or [target, 2]; alternative to r and theta_deg.
            r: Distances from the robot's base [m], a number or shape [target].
            theta_deg: Angles from straight ahead, positive to the robot's right [deg], a number or
                shape [target].

        Returns:
            Targets [m], shape [target, 2].

        Raises:
            InputError: Both forms are given, or neither, or values of the wrong kind or shape.
            TargetError: A target is not finite, has a negative radius, is farther than the reach of
                arm and cable, or off the table.
        """
        if (value is None) == (r is None and theta_deg is None):
            raise InputError("targets are given as either target_xy or r and theta_deg")
        if value is None:
            value = _xy_from_polar(r, theta_deg)
        targets = np.atleast_2d(_numbers("target_xy", value))
        if targets.ndim != 2 or targets.shape[1] != 2:
            raise InputError(
                f"target_xy has shape {np.shape(value)}: it must be [2] or [target, 2]"
            )
        table = setup.workspace
        bound = table.reach(setup.cable.length)
        for xy in targets:
            if not np.all(np.isfinite(xy)):
                raise TargetError(f"target ({xy[0]}, {xy[1]}) is not finite")
            radius, theta = xy_to_polar(xy)
            where = f"target r = {radius:.3f} m, theta = {np.degrees(theta):.1f} deg"
            if radius > bound:
                raise TargetError(f"{where} is out of reach: r must be at most {bound:.3f} m")
            if not table.on_table(xy):
                raise TargetError(
                    f"{where} is off the table: |x| <= {table.half_width:g} m and {table.y_min:g} "
                    f"<= y <= {table.y_max:g} m, but x = {xy[0]:.3f}, y = {xy[1]:.3f}"
                )
        return targets

    def outcome(self, path_xy: Array) -> Array:
        """Return the last point of paths [m], shape [..., 2]."""
        return path_xy[..., -1, :]

    def lost(self, path_xy: Array, setup: Setup) -> NDArray[np.bool_]:
        """Return which paths end off the table, or unseen, shape [...]."""
        return ~setup.workspace.on_table(self.outcome(path_xy))


def closest(path: ArrayLike, point: ArrayLike) -> tuple[Array, Array]:
    """Return how near paths come to a point, and where on them.

    Args:
        path: Paths as polylines, NaN where they are not known, shape [..., step, d].
        point: Point, shape [d].

    Returns:
        Distance [m], shape [...], infinite for a path of no known piece, and the number of the step
        before the closest point plus the way to the next one, shape [...].
    """
    path = np.asarray(path)
    offset = path - np.asarray(point, dtype=path.dtype)
    start, way = offset[..., :-1, :], np.diff(offset, axis=-2)
    length = np.sum(way * way, axis=-1)
    along = -np.sum(start * way, axis=-1) / np.maximum(length, 1e-12)
    along = np.clip(along, 0.0, 1.0)
    square = np.sum((start + along[..., None] * way) ** 2, axis=-1)
    square = np.where(np.isnan(square), np.inf, square)
    step = np.argmin(square, axis=-1)[..., None]
    square, along = (np.take_along_axis(v, step, axis=-1)[..., 0] for v in (square, along))
    # The first step of a path of no known piece.
    return np.sqrt(square), step[..., 0] + np.nan_to_num(along)


class Strike(Task):
    """The free end passes a point in the air, at any time before the cable touches something.

    What counts of a path, NaN from the first contact on, is its point closest to the goal.
    """

    name = "strike"
    coordinates = ("x", "y", "z")
    mirror = (-1.0, 1.0, 1.0)

    def scale(self, setup: Setup) -> Array:
        """Return the length of the cable for x, y and z [m], shape [3]."""
        return np.full(3, setup.cable.length)

    def values(
        self, setup: Setup, value: ArrayLike | None = None, **forms: ArrayLike | None
    ) -> Array:
        """Check goals and return them as x, y, z [m], shape [goal, 3].

        They are given so, shape [3] or [goal, 3], or by their distance ahead of the base's axis and
        their height [m] in the plane of the swing, shape [2] or [goal, 2]; see `SwingPlane`. Which
        of them a move can strike, `StrikePrior` knows.
        """
        if any(form is not None for form in forms.values()) or value is None:
            raise InputError("a strike is given as target_xyz, or by distance ahead and height")
        goals = np.atleast_2d(_numbers("target_xyz", value))
        if goals.ndim != 2 or goals.shape[1] not in (2, 3):
            raise InputError(
                f"target_xyz has shape {np.shape(value)}: it must be [3] or [target, 3], or with 2 "
                "in place of 3 for distances ahead and heights"
            )
        if goals.shape[1] == 2:
            goals = SwingPlane.of(JointMoves.of(setup)).points(goals)
        for xyz in goals:
            if not np.all(np.isfinite(xyz)):
                raise TargetError(f"target ({xyz[0]}, {xyz[1]}, {xyz[2]}) is not finite")
        return goals

    def outcome(self, path_xy: Array) -> Array:
        """Raise an error: a path has an outcome at a goal only, see `outcome_at`."""
        raise InputError("what counts of a strike depends on its goal: a path alone has no outcome")

    def outcome_at(self, path: Array, value: ArrayLike) -> Array:
        """Return the points of paths [m], [..., step, 3], closest to a goal [m], shape [3]."""
        start, way, share = self._piece(path, value)
        return start + share[..., None] * way

    def arrival(self, path: Array, value: ArrayLike, dt: float) -> Array:
        """Return the velocity at the closest points [m/s], shape [..., 3].

        Arguments are those of `outcome_at`, and the time between steps [s].
        """
        return self._piece(path, value)[1] / dt

    def _piece(self, path: Array, value: ArrayLike) -> tuple[Array, Array, Array]:
        """Return start and way of the pieces closest to a goal, and the share of it before; NaN."""
        distance, place = closest(path, value)
        before = np.minimum(place.astype(int), path.shape[-2] - 2)
        start, end = (
            np.take_along_axis(path, step[..., None, None], axis=-2)[..., 0, :]
            for step in (before, before + 1)
        )
        start = np.where(np.isfinite(distance)[..., None], start, np.nan)
        return start, end - start, place - before

    def lost(self, path_xy: Array, setup: Setup) -> NDArray[np.bool_]:
        """Return which paths were never seen, shape [...]."""
        return np.asarray(~np.isfinite(path_xy).all(axis=-1).any(axis=-1))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Arrival:
    """How a tip is to arrive at the goal of a strike: in a direction, and fast enough.

    Called with a path of the tip [m], shape [step, 3], it returns what is missing as a distance
    [m], which is added to the miss.

    Attributes:
        goal: Goal [m], shape [3].
        direction: Direction of arrival, of any length, shape [3].
        dt: Time between the steps of a path [s].
        within_deg: Angle between both directions up to which nothing is missing [deg].
        least_speed: Speed from which on nothing is missing [m/s].
        scale: Distance that an angle of twice `within_deg`, or no speed at all, counts as [m].
    """

    goal: tuple[float, float, float]
    direction: tuple[float, float, float]
    dt: float
    within_deg: float = 10.0
    least_speed: float = 1.0
    scale: float = 0.05

    def __call__(self, path: Array) -> float:
        """Return what is missing [m]; the scale for a path that was never seen."""
        velocity = STRIKE.arrival(path, self.goal, self.dt)
        speed = float(np.linalg.norm(velocity))
        if not np.isfinite(speed) or speed == 0.0:
            return self.scale
        wanted = np.array(self.direction) / np.linalg.norm(self.direction)
        angle = float(np.degrees(np.arccos(np.clip(velocity @ wanted / speed, -1.0, 1.0))))
        turned = max(angle / self.within_deg - 1.0, 0.0)
        slow = max(1.0 - speed / self.least_speed, 0.0) if self.least_speed > 0.0 else 0.0
        return self.scale * (turned + slow)


STRIKE = Strike()
"""The task of rope whipping: to pass a point in the air."""

LANDING = Landing()
"""The task of the paper."""


def _xy_from_polar(r: ArrayLike | None, theta_deg: ArrayLike | None) -> Array:
    """Return targets [m] from radii [m] and angles [deg], shape [target, 2]."""
    if r is None or theta_deg is None:
        raise InputError("a target needs both r and theta_deg")
    radius, angle = _numbers("r", r), _numbers("theta_deg", theta_deg)
    try:
        radius, angle = np.broadcast_arrays(np.atleast_1d(radius), np.atleast_1d(angle))
    except ValueError:
        shapes = f"{radius.shape} and {angle.shape}"
        raise InputError(f"r and theta_deg have shapes {shapes}, which do not match") from None
    if radius.ndim != 1:
        raise InputError(f"r and theta_deg have shape {radius.shape}: it must be [target]")
    for one_r, one_theta in zip(radius, angle, strict=True):
        if not (np.isfinite(one_r) and np.isfinite(one_theta)):
            raise TargetError(
                f"target r = {one_r:g} m, theta = {one_theta:g} deg must be finite numbers"
            )
        if abs(one_theta) > 180.0:
            raise TargetError(f"theta_deg = {one_theta:g} must be from -180 to 180")
        if one_r < 0:
            raise TargetError(f"target r = {one_r:g} m must not be negative")
    # Degrees are typed with few digits, and radians computed.
    small = (angle != 0.0) & (np.abs(angle) <= np.pi / 2)
    computed = small & (np.abs(angle - np.round(angle, 3)) > 1e-9)
    if computed.any():
        found = float(angle[computed][0])
        warnings.warn(
            f"theta_deg = {found:.6g} looks like radians: it is read as {found:.3g} degrees, and "
            f"{found:.3g} rad would be {np.degrees(found):.1f} degrees",
            stacklevel=4,
        )
    return polar_to_xy(np.stack([radius, np.radians(angle)], axis=-1))


def _numbers(name: str, values: ArrayLike) -> Array:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {str(values)[:80]!r} must be numbers") from None


TAIL_FREEDOM = 3.0
"""Degrees of freedom of Student's t distribution of outcomes before any cast at a goal: most are
nearer to the expected one than under a Gaussian of the same covariance, and a few far off [-]."""

MISS_WEIGHT = 0.5
"""Weight of each miss in the belief about the scale: misses at one goal are correlated."""

MISS_MEMORY = 20
"""Number of the last misses that count: a cable changes."""

SQUARE_MAX = 9.0
"""Largest Mahalanobis square of a miss that counts [-]: a cast that tipped over the other way says
nothing of calm ones."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MissLaw:
    """Law of outcomes about the expected one: Student's t distribution in k dimensions.

    Stated covariances may all be too large, or too small, by one factor, which differs from cable
    to cable. An inverse gamma belief about it makes outcomes follow Student's t distribution, and
    every miss updates it.

    Attributes:
        scale: Covariance over that which was stated before any miss [-].
        freedom: Degrees of freedom, above 2 [-].
    """

    scale: float = 1.0
    freedom: float = TAIL_FREEDOM

    @classmethod
    def after(cls, squares: Iterable[float], dimension: int = 2) -> "MissLaw":
        """Return the law after misses with Mahalanobis squares d' C^-1 d [-].

        d is the offset from the expected outcome, of `dimension` components, and C the covariance
        that was stated before any miss.
        """
        last = [min(square, SQUARE_MAX) for square in squares][-MISS_MEMORY:]
        freedom = TAIL_FREEDOM + dimension * MISS_WEIGHT * len(last)
        scale = (TAIL_FREEDOM - 2.0 + MISS_WEIGHT * sum(last)) / (freedom - 2.0)
        return cls(scale=scale, freedom=freedom)

    def square(self, probability: float, dimension: int = 2) -> float:
        """Return the Mahalanobis square [-] that outcomes keep within with some probability [-].

        d' C^-1 d / k, with C the covariance of this law, is (n - 2) / n times a variable of
        Fisher's F distribution with k and n degrees of freedom.
        """
        from scipy.special import fdtri

        check_number("probability", probability, 0.01, 0.9999)
        quantile = float(fdtri(dimension, self.freedom, probability))
        return dimension * quantile * (self.freedom - 2.0) / self.freedom

    def probability(self, square: float, dimension: int = 2) -> float:
        """Return the probability of outcomes within a Mahalanobis square [-]: inverts `square`."""
        from scipy.special import fdtr

        ratio = square * self.freedom / (dimension * (self.freedom - 2.0))
        return float(fdtr(dimension, self.freedom, ratio))


# Regions start at a probability of 1 %.
_SHELLS, _DIRECTIONS = 48, 32


def shell_points(radius: Array, turn: NDArray[np.floating], count: int) -> Array:
    """Return points on circles about the origin, shape [circle * count, 2].

    `radius` is that of each circle, `turn` its turn in steps between points, shape [circle].
    """
    angle: Array = (np.arange(count) + turn[:, None]) * 2.0 * np.pi / count
    shell = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return shell.reshape(-1, 2)


@functools.cache
def _directions(dimension: int, count: int) -> Array:
    """Return evenly spread unit vectors, shape [count, dimension]."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    # Shifted by half a step, off the middle.
    shares = (qmc.Halton(dimension, scramble=False).random(count) + 0.5 / count) % 1.0
    points = ndtri(shares)
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Expectation:
    """Distribution of the outcome of a cast before it is made.

    Attributes:
        mean: Expected outcome, shape [k].
        covariance: Covariance about it before any miss, in the squared units of the outcome, shape
            [k, k].
        law: Law of the outcome, with the factor on the covariance from earlier misses.
        scatter: Standard deviation of equal casts along each axis, a part of it [m].
        failure: Probability that the cast has no outcome: off the table, or hidden [-].
    """

    mean: Array
    covariance: Array
    law: MissLaw = dataclasses.field(default_factory=MissLaw)
    scatter: float
    failure: float = 0.0

    @property
    def dimension(self) -> int:
        """Number of components of the outcome, k."""
        return len(self.mean)

    @property
    def spread(self) -> Array:
        """Covariance of the outcome under the law, shape [k, k]."""
        return self.law.scale * self.covariance

    def square(self, outcome: ArrayLike) -> float:
        """Return the Mahalanobis square of an outcome, shape [k], under the law [-]."""
        offset = np.asarray(outcome, dtype=float) - self.mean
        return float(offset @ np.linalg.solve(self.spread, offset))

    def holds(self, outcome: ArrayLike, probability: float) -> bool:
        """Return whether the region of some probability [-] holds an outcome, shape [k]."""
        return self.square(outcome) <= self.law.square(probability, self.dimension)

    def ellipse(self, probability: float = 0.9) -> Ellipse:
        """Return the region of some probability [-] in the plane of the first two components."""
        square = self.law.square(probability, self.dimension)
        return Ellipse.of_covariance(self.mean[:2], self.spread[:2, :2], square)

    def hit_chance(self, goal: Goal) -> float:
        """Return the probability that the cast hits a goal [-]."""
        return (1.0 - self.failure) * float(np.mean(goal.hit(self._points())))

    def miss_within(self, goal: Goal, share: float) -> float:
        """Return the distance from a goal that a share of the outcomes [-] is within.

        It is in cable lengths. Casts without an outcome are left out.
        """
        return float(np.quantile(goal.miss(self._points()), share))

    def _points(self) -> Array:
        """Return equally likely outcomes, shape [point, k]."""
        # Points of equal probability: shells that halve equal shares, turned against each other.
        share = (np.arange(_SHELLS) + 0.5) / _SHELLS
        radius = np.sqrt([self.law.square(float(value), self.dimension) for value in share])
        if self.dimension == 2:
            unit = shell_points(radius, share, _DIRECTIONS)
        else:
            directions = _directions(self.dimension, _DIRECTIONS * self.dimension)
            unit = (radius[:, None, None] * directions).reshape(-1, self.dimension)
        return self.mean + unit @ np.linalg.cholesky(self.spread).T
