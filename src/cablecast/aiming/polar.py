"""PolarLandings: where polar casts are expected to land, from a simulator and from real ones.

A polar cast swings the cable out in the same way at every target and pulls it slowly along the
table, so that equal casts end within some thousandths of its length, and all err alike: short by as
much as the cable is not laid out straight, and to one side the more, the more the pull turns it.
What the simulator does not have of this is modelled as a Gaussian process over the cast's
parameters, for the error along the cable and across it. So some casts correct the others, and the
next is aimed as far the other way.
"""

import contextlib
import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from cablecast.cast import Cast
from cablecast.conventions import Array
from cablecast.engines.base import Engine
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import CablecastError, InputError
from cablecast.learning.kernel import matern
from cablecast.motion.polar import PolarCast, PullReach
from cablecast.motion.trajectory import plan_trajectory
from cablecast.setup import Setup
from cablecast.task import LANDING, Expectation, Landing, MissLaw, Task
from cablecast.tuning.tuned import Tuned

LEVELS = np.array([0.013, 0.02])
"""Standard deviation of the part of the simulator's error that all casts share, along the cable and
across it [cable lengths]. These were chosen by 134 polar casts of three cables in three virtual
laboratories; with three pilots the others landed 1.3 % from where they were expected in the median
(4.4 % with one straight ahead)."""

TURNING = 0.08
"""That of the error across the cable per angle by which the pull turns it [cable lengths/rad]."""

CHANGES = np.array([0.015, 0.045])
"""That of the part that changes from cast to cast as a Matern 3/2 process [cable lengths]."""

SCALES = np.array([1.0, 0.8, 0.8])
"""Changes of azimuth, x and y over which it changes [rad, m, m]."""

LOCAL, LOCAL_SCALE = np.array([0.015, 0.03]), 0.15
"""The same of a part that changes over a share of these scales only. Equal casts end within some
thousandths of the length, so what is left of an error at a target is removed by the next cast
there. Without this part it was taken for scatter, and a third of it followed."""

ASIDE = 0.75
"""Azimuth of the two pilots aside over the largest azimuth [-]."""

SWING_PACES = (0.9, 0.8, 1.0)
"""Paces of the swing in the order in which they are tried. In seven pairs of a laboratory and a
cable, swings at 0.9 erred by 0.5 to 14 %; at 1.0 a light cable was left in a heap, and at 0.83 a
stiff one after a short pull."""

LAID_OUT = 0.08
"""Distance of the free end from that of a straight cable, along it, up to which a swing has laid it
out [cable lengths]; else another pace is tried."""

HEAP = 0.2
"""The same distance beyond which it lies in a heap, and says nothing of other casts [cable
lengths]. No cast like it is made again. A straight cable that lies far aside is corrected."""

FLOOR = 0.003
"""Standard deviation of equal casts along each axis after a long pull [cable lengths]."""

SWAY = np.array([0.003, 0.015])
"""That of how a swing lays the cable down, along it and across it [cable lengths]. A pull lets the
free end trail, and takes it down by exp(-way / length)."""

ERROR_SIZES, SWAY_SIZES = np.geomspace(0.5, 5.0, 7), np.geomspace(0.5, 8.0, 5)
"""Sizes of the simulator's errors and of the sway over the typical ones, all of which are believed
in part, by the casts that were made: a light cable may not be laid out, or never twice alike."""

SIZES = np.reshape(np.meshgrid(ERROR_SIZES, SWAY_SIZES, indexing="ij"), (2, -1))
"""All pairs of these, shape [2, size]."""

SIZE_DEVIATIONS = np.array([0.6, 0.6])
"""Standard deviation of the logarithms of these sizes about 0 before any cast."""

# Steps of the aim point towards the one that is expected on the target, and the distance from it
# at which they end [m].
_STEPS, _CLOSE = 4, 0.002
# Distance of two casts in units of `SCALES` below which they are alike.
_SAME = 0.05


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class PolarLandings:
    """Landings of polar casts.

    Attributes:
        setup: Cable, workspace, arm and motion settings.
        dynamics: Simulator whose landings are expected.
        engine: Engine that simulates it.
        reach: Places to which they bring a straight cable's end.
        casts: Polar casts that landed.
        lost: Polar casts that did not; none is made again.
    """

    setup: Setup
    dynamics: Dynamics
    engine: Engine
    reach: PullReach
    casts: tuple[Cast, ...] = ()
    lost: tuple[PolarCast, ...] = ()
    _known: dict[PolarCast, Array] = dataclasses.field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, ensemble: Tuned | None, task: Task = LANDING) -> "PolarLandings | None":
        """Return the landings before any cast; None for another task, or where none is reached."""
        if ensemble is None or not isinstance(task, Landing):
            return None
        try:
            reach = PullReach.of(ensemble.setup)
        except InputError:
            return None
        return cls(
            setup=ensemble.setup,
            dynamics=ensemble.dynamics,
            engine=ensemble.member_engine,
            reach=reach,
        )

    def with_casts(self, casts: Sequence[Cast]) -> "PolarLandings":
        """Return the landings after more casts, of which only polar ones count."""
        new = [cast for cast in casts if isinstance(cast.action, PolarCast)]
        if not new:
            return self
        landed = [cast for cast in new if cast.landed]
        lost = [cast.action for cast in new if not cast.landed]
        return dataclasses.replace(self, casts=(*self.casts, *landed), lost=(*self.lost, *lost))

    @functools.cached_property
    def pace(self) -> float:
        """Pace of the casts: the first that lays the cable out, or the best of all.

        The simulator tells of those that were not tried, and a pace that the arm cannot follow
        straight ahead is none.
        """
        typical = []
        for pace in SWING_PACES:
            if self.reach.ahead(pace) not in self._pilots(pace):
                typical.append(np.inf)
                continue
            ahead = self.reach.ahead(pace)
            simulated = self._folded(ahead, self._simulated_xy(ahead))
            typical.append(self._folds.get(pace, simulated))
            if typical[-1] < LAID_OUT:
                return pace
        return SWING_PACES[int(np.argmin(typical))]

    @property
    def pilot(self) -> PolarCast | None:
        """The next of the casts from which most is learned of the others.

        One goes straight ahead with a short pull, which shows whether a swing lays the cable out.
        Two are pulled far across from either side, since the error is that of the turning. None
        when they are made, after other casts at their pace, and where the arm cannot follow.
        """
        pace = self.pace
        made = [*self.lost, *(action for _, action in self._made)]
        made = [action for action in made if action.pace == pace]
        pilots = self._pilots(pace)
        if not set(made) <= set(pilots):
            return None
        return next((pilot for pilot in pilots if pilot not in made), None)

    def _pilots(self, pace: float) -> list[PolarCast]:
        """Return the pilots at a pace that the arm can follow."""
        back = self.reach.back
        azimuth, x = ASIDE * back.theta_max, 0.5 * ASIDE * self.reach.end_x_max
        aside = PolarCast(-azimuth, x, back.grip_y_min, pace)
        every = (self.reach.ahead(pace), aside, aside.mirrored())
        return [pilot for pilot in every if _is_followed(pilot, self.setup)]

    def aimed_at(self, target_xy: Array) -> PolarCast | None:
        """Return the cast that is expected nearest to a target [m], shape [2].

        None for a target beyond the reach, where the arm cannot follow, and where a cast like it
        was lost.
        """
        found: list[tuple[float, PolarCast]] = []
        aim_xy = target_xy
        with contextlib.suppress(CablecastError):
            for _ in range(_STEPS):
                if (cast := self.reach.cast_to(aim_xy, self.pace)) is None:
                    break
                if self._folded(cast, self._modelled(cast)[0]) > LAID_OUT:
                    break
                offset = target_xy - self.expectation(cast).mean
                plan_trajectory(cast, self.setup)
                found.append((float(np.linalg.norm(offset)), cast))
                if found[-1][0] < _CLOSE:
                    break
                aim_xy = aim_xy + offset
        if not found:
            return None
        best = min(found, key=lambda one: one[0])[1]
        heaps = [action for cast, action in self._made if self._is_heap(cast, action)]
        wasted = [other for other in (*self.lost, *heaps) if other.pace == best.pace]
        steps = [_point(best) - _point(other) for other in wasted]
        return None if any(np.linalg.norm(step) < _SAME for step in steps) else best

    def expectation(self, cast: PolarCast, law: MissLaw | None = None) -> Expectation:
        """Return where a cast is expected to land.

        Raises:
            CablecastError: There is no such cast.
        """
        length, axes = self.setup.cable.length, self._axes(cast)
        errors, sways = SIZES
        alone = self._covariances([cast], [cast])[:, 0, 0]
        squares = errors[:, None, None] ** 2
        kernels = squares * self._covariances([cast], self._actions)[:, 0]
        gains = np.einsum("sanm,sam->san", self._inverses, kernels)
        means = np.einsum("san,na->sa", gains, self._errors)
        left = np.maximum(squares[:, 0] * alone - np.sum(gains * kernels, axis=2), 0.0)
        mean, left = self._weights @ means, self._weights @ (left + means**2)
        noise = self._weights @ self._noise([cast], sways)[:, :, 0]
        middle, doubt = self._modelled(cast)
        along = np.array([doubt**2, 0.0])
        covariance = length**2 * axes.T @ np.diag(left - mean**2 + noise + along) @ axes
        return Expectation(
            mean=middle + length * mean @ axes,
            covariance=covariance,
            law=law or MissLaw(),
            scatter=length * float(np.sqrt(np.mean(noise))),
        )

    def _simulated_xy(self, cast: PolarCast) -> Array:
        """Return where a cast lands in the simulator [m], shape [2]."""
        if cast not in self._known:
            path = self.dynamics.follow(cast.grip_path(self.setup), self.setup)
            rollout = self.dynamics.rollout(self.engine, self.setup, path)
            self._known[cast] = rollout.endpoint_xy[0, -1]
        return self._known[cast]

    def _modelled(self, cast: PolarCast) -> tuple[Array, float]:
        """Return where a cast lands before its error is known [m], [2], and a doubt [lengths].

        That is where the simulator says; or where a straight cable ends, if the simulator folds the
        cable, and real casts at the pace of this one laid it out. Which of them is right is not
        known: the doubt is half of the fold.
        """
        simulated_xy = self._simulated_xy(cast)
        folded = self._folded(cast, simulated_xy)
        if folded > LAID_OUT and self._folds.get(cast.pace, np.inf) < LAID_OUT:
            return self.reach.end_xy(cast.to_array()), 0.5 * folded
        return simulated_xy, 0.0

    def _axes(self, cast: PolarCast) -> Array:
        """Return the unit vectors along the resting cable and across it, to its right, [2, 2]."""
        offset = self.reach.end_xy(cast.to_array()) - np.array([cast.x, cast.y])
        along = offset / self.setup.cable.length
        return np.stack([along, np.array([along[1], -along[0]])])

    def _covariances(self, first: Sequence[PolarCast], second: Sequence[PolarCast]) -> Array:
        """Return the covariance of the errors on these axes, shape [2, first, second]."""
        points = [np.reshape([_point(c) for c in casts], (-1, 3)) for casts in (first, second)]
        turns = np.outer(
            [self._turn(cast) for cast in first], [self._turn(cast) for cast in second]
        )
        level, change, local = (size[:, None, None] ** 2 for size in (LEVELS, CHANGES, LOCAL))
        fine = matern(*(rows / LOCAL_SCALE for rows in points))
        along, across = level + change * matern(*points) + local * fine
        return np.stack([along, across + TURNING**2 * turns])

    def _turn(self, cast: PolarCast) -> float:
        """Return the angle by which the pull turns the cable, positive to the right [rad]."""
        along = self._axes(cast)[0]
        return float(np.arctan2(*along)) - cast.azimuth

    def _noise(self, casts: Sequence[PolarCast], sways: Array) -> Array:
        """Return the variance of equal casts on these axes, by the sway, shape [size, 2, cast]."""
        left = np.exp([-self.reach.way(cast) / self.setup.cable.length for cast in casts])
        return FLOOR**2 + (np.multiply.outer(sways, SWAY)[:, :, None] * left) ** 2

    @functools.cached_property
    def _made(self) -> list[tuple[Cast, PolarCast]]:
        """The casts that landed, with their motions."""
        return [(cast, cast.action) for cast in self.casts if isinstance(cast.action, PolarCast)]

    @functools.cached_property
    def _folds(self) -> dict[float, float]:
        """Median fold of the cable in the casts that were made at each pace [cable lengths]."""
        folds: dict[float, list[float]] = {}
        for cast, action in self._made:
            folds.setdefault(action.pace, []).append(self._folded(action, cast.final_xy))
        return {pace: float(np.median(own)) for pace, own in folds.items()}

    @functools.cached_property
    def _own(self) -> list[tuple[Cast, PolarCast]]:
        """Those at the pace of the next one, as swings at another err otherwise, and no heaps."""
        own = [(cast, action) for cast, action in self._made if action.pace == self.pace]
        return [one for one in own if not self._is_heap(*one)]

    @functools.cached_property
    def _actions(self) -> list[PolarCast]:
        return [action for _, action in self._own]

    @functools.cached_property
    def _errors(self) -> Array:
        """Errors of the simulator on the axes [cable lengths], shape [cast, 2]."""
        return np.reshape([self._error(*one) for one in self._own], (-1, 2))

    def _folded(self, action: PolarCast, end_xy: Array) -> float:
        """Return how far an end is from that of a straight cable, along it [cable lengths]."""
        offset = end_xy - self.reach.end_xy(action.to_array())
        return float(abs(self._axes(action)[0] @ offset)) / self.setup.cable.length

    def _is_heap(self, cast: Cast, action: PolarCast) -> bool:
        """Return whether a cast left the cable in a heap."""
        return self._folded(action, cast.final_xy) >= HEAP

    def _error(self, cast: Cast, action: PolarCast) -> Array:
        """Return the error of the simulator on the axes of a cast [cable lengths], shape [2]."""
        offset = cast.final_xy - self._modelled(action)[0]
        return self._axes(action) @ offset / self.setup.cable.length

    @functools.cached_property
    def _spreads(self) -> Array:
        """Covariance of the errors that were seen, by the sizes, shape [size, 2, cast, cast]."""
        errors, sways = SIZES
        own = self._covariances(self._actions, self._actions)
        noise = self._noise(self._actions, sways)[..., None] * np.eye(len(self._own))
        return errors[:, None, None, None] ** 2 * own + noise

    @functools.cached_property
    def _inverses(self) -> Array:
        """Their inverses."""
        return np.asarray(np.linalg.inv(self._spreads), dtype=float)

    @functools.cached_property
    def _weights(self) -> Array:
        """How much each pair of sizes is believed after these errors, shape [size]."""
        squares = np.einsum("na,sanm,ma->s", self._errors, self._inverses, self._errors)
        squares += np.linalg.slogdet(self._spreads)[1].sum(axis=1)
        squares += np.sum((np.log(SIZES) / SIZE_DEVIATIONS[:, None]) ** 2, axis=0)
        weights = np.exp(-0.5 * (squares - squares.min()))
        return weights / weights.sum()


@functools.lru_cache(maxsize=64)
def _is_followed(cast: PolarCast, setup: Setup) -> bool:
    """Return whether the arm can follow a cast."""
    with contextlib.suppress(CablecastError):
        plan_trajectory(cast, setup)
        return True
    return False


def _point(cast: PolarCast) -> Array:
    """Return the parameters of a cast that the errors change with over their scales, [3]."""
    return cast.to_array()[:3] / SCALES
